// SPDX-License-Identifier: GPL-3.0-or-later
// Poses whose frames are part of their type, so that a wrong product does not compile.
//
// T_a_b maps coordinates of frame b to frame a: p_a = T_a_b * p_b. Lengths mm, angles rad.
// Twists and 6x6 covariances: translation first, then rotation, perturbation in the child frame:
//   true = given * [exp(rot), trans].
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace asbuilt {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat3 = Eigen::Matrix3d;
using Mat6 = Eigen::Matrix<double, 6, 6>;

namespace frame {
struct Base {};
struct Flange {};
struct Tool {};
struct Sensor {};
struct Fixture {};
struct Part {};
struct Work {};  // the frame a program's points are written in
struct Obstacle {};
struct Target {};  // a calibration target: balls, board, plate
}  // namespace frame

inline Mat3 skew(const Vec3& v) {
  Mat3 m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// Rotation vector (rad) -> unit quaternion.
inline Eigen::Quaterniond quat_exp(const Vec3& w_rad) {
  const double a = w_rad.norm();
  if (a < 1e-12) return Eigen::Quaterniond(1, w_rad.x() / 2, w_rad.y() / 2, w_rad.z() / 2).normalized();
  return Eigen::Quaterniond(Eigen::AngleAxisd(a, w_rad / a));
}

/// Unit quaternion -> rotation vector (rad), angle in [0, pi].
inline Vec3 quat_log(Eigen::Quaterniond q) {
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double n = q.vec().norm();
  if (n < 1e-12) return 2.0 * q.vec();
  return q.vec() * (2.0 * std::atan2(n, q.w()) / n);
}

template <class A, class B>
struct Pose {  // pose of frame B seen from frame A
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Vec3 p_mm = Vec3::Zero();

  Pose() = default;
  Pose(const Eigen::Quaterniond& q_in, const Vec3& p_in) : q(q_in), p_mm(p_in) {}
  explicit Pose(const Eigen::Isometry3d& m) : q(m.rotation()), p_mm(m.translation()) { q.normalize(); }

  Mat3 rotation() const { return q.toRotationMatrix(); }
  Eigen::Isometry3d matrix() const {
    Eigen::Isometry3d m = Eigen::Isometry3d::Identity();
    m.linear() = rotation();
    m.translation() = p_mm;
    return m;
  }
  Pose<B, A> inverse() const {
    const Eigen::Quaterniond qi = q.conjugate();
    return {qi, -(qi * p_mm)};
  }
  /// Maps a point of B to A.
  Vec3 point(const Vec3& p_b) const { return q * p_b + p_mm; }
  /// Maps a direction of B to A.
  Vec3 direction(const Vec3& d_b) const { return q * d_b; }
  /// This pose disturbed in its child frame by a twist (translation mm first, then rotation rad).
  Pose disturbed(const Vec6& xi) const {
    return {(q * quat_exp(xi.tail<3>())).normalized(), p_mm + q * xi.head<3>()};
  }
};

template <class A, class B, class C>  // the only product there is
Pose<A, C> operator*(const Pose<A, B>& T_a_b, const Pose<B, C>& T_b_c) {
  return {(T_a_b.q * T_b_c.q).normalized(), T_a_b.q * T_b_c.p_mm + T_a_b.p_mm};
}

/// The twist xi with T_a_b.disturbed(xi) == T_a_b2 (translation mm first, then rotation rad, child frame of the first).
template <class A, class B>
Vec6 twist_between(const Pose<A, B>& T_a_b, const Pose<A, B>& T_a_b2) {
  Vec6 xi;
  xi.head<3>() = T_a_b.q.conjugate() * (T_a_b2.p_mm - T_a_b.p_mm);
  xi.tail<3>() = quat_log(T_a_b.q.conjugate() * T_a_b2.q);
  return xi;
}

/// R = Rz(a) * Ry(b) * Rx(c); KUKA A,B,C = a,b,c; Yaskawa Rz,Ry,Rx = a,b,c. rad.
inline Eigen::Quaterniond quat_from_zyx(double a_rad, double b_rad, double c_rad) {
  return Eigen::Quaterniond(Eigen::AngleAxisd(a_rad, Vec3::UnitZ()) * Eigen::AngleAxisd(b_rad, Vec3::UnitY()) *
                            Eigen::AngleAxisd(c_rad, Vec3::UnitX()));
}

/// Any right-handed rotation whose z is the given unit direction and whose x is as near to x_hint as it can be.
inline Eigen::Quaterniond quat_from_z(const Vec3& z_in, const Vec3& x_hint) {
  const Vec3 z = z_in.normalized();
  Vec3 x = x_hint - z * z.dot(x_hint);
  if (x.norm() < 1e-6) {
    const Vec3 other = std::abs(z.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
    x = other - z * z.dot(other);
  }
  x.normalize();
  Mat3 m;
  m.col(0) = x;
  m.col(1) = z.cross(x);
  m.col(2) = z;
  return Eigen::Quaterniond(m).normalized();
}

constexpr double kPi = 3.14159265358979323846;
constexpr double rad_from_deg(double deg) { return deg * kPi / 180.0; }
constexpr double deg_from_rad(double rad) { return rad * 180.0 / kPi; }

}  // namespace asbuilt
