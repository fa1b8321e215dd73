// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/opw.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

double wrapped(double a) {  // to (-pi, pi]
  if (a > kPi) a -= 2 * kPi * std::ceil((a - kPi) / (2 * kPi));
  if (a <= -kPi) a += 2 * kPi * std::ceil((-kPi - a) / (2 * kPi));
  if (a <= -kPi) a += 2 * kPi;
  return a;
}

bool arc_cosine(double x, double& a) {
  if (!(x >= -1 - 1e-11 && x <= 1 + 1e-11)) return false;
  a = std::acos(std::clamp(x, -1.0, 1.0));
  return true;
}

struct Line {
  Vec3 p, d;
};
/// Distance of two lines and the point halfway between them at their nearest; parallel lines: distance only.
double nearest(const Line& a, const Line& b, Vec3* halfway) {
  const Vec3 n = a.d.cross(b.d), r = b.p - a.p;
  const double n2 = n.squaredNorm();
  if (n2 < 1e-12) return r.cross(a.d).norm();
  const double s = r.cross(b.d).dot(n) / n2, t = r.cross(a.d).dot(n) / n2;
  if (halfway) *halfway = 0.5 * (a.p + s * a.d + b.p + t * b.d);
  return std::abs(r.dot(n)) / std::sqrt(n2);
}

}  // namespace

KinematicChain chain_of(const OpwParameters& c) {
  // Axes at theta = 0 (upright), then moved to where they are when the controller's joints are 0 (theta = -offset).
  const Vec3 y = Vec3::UnitY(), z = Vec3::UnitZ();
  const std::array<Vec3, 6> axis{z, y, y, z, y, z};
  const Vec3 elbow(c.a1_mm, 0, c.c1_mm + c.c2_mm), wrist(c.a1_mm + c.a2_mm, c.b_mm, c.c1_mm + c.c2_mm + c.c3_mm);
  const std::array<Vec3, 6> point{Vec3::Zero(), Vec3(c.a1_mm, 0, c.c1_mm), elbow, wrist, wrist, wrist};
  std::array<Vec3, 6> axis_zero, point_zero;
  Rigid T;
  for (int i = 0; i < 6; ++i) {
    axis_zero[i] = T.R * axis[i] * static_cast<double>(c.signs[i]);
    point_zero[i] = T.R * point[i] + T.p;
    const Mat3 R = Eigen::AngleAxisd(-c.offsets_rad[i], axis[i]).toRotationMatrix();
    T = T * Rigid{R, point[i] - R * point[i]};
  }
  return KinematicChain::from_axes(axis_zero, point_zero, T * Rigid{Mat3::Identity(), wrist + Vec3(0, 0, c.c4_mm)});
}

OpwSolutions solve_opw(const OpwArm& arm, const Rigid& T_base_flange) {
  const OpwParameters& o = arm.constants;
  const Rigid T = arm.T_base_arm.inverse() * T_base_flange * arm.T_wrist_flange.inverse();
  const Mat3& R = T.R;
  const Vec3 w = T.p - o.c4_mm * R.col(2);
  OpwSolutions out;

  const double planar = w.x() * w.x() + w.y() * w.y() - o.b_mm * o.b_mm;
  if (!(planar >= 0)) return out;
  const double radius = std::sqrt(planar), dz = w.z() - o.c1_mm;
  const double bearing = std::atan2(w.y(), w.x()), lateral = std::atan2(o.b_mm, radius);
  const double k2 = o.a2_mm * o.a2_mm + o.c3_mm * o.c3_mm, k = std::sqrt(k2), c2 = o.c2_mm;
  const double elbow_offset = std::atan2(o.a2_mm, o.c3_mm);
  const double tolerance = 1e-8 + 1e-11 * (std::abs(o.a1_mm) + c2 + k);

  for (int side = 0; side < 2; ++side) {  // facing the point, or over the shoulder
    const double t1 = side == 0 ? bearing - lateral : bearing + lateral - kPi;
    const double nx = side == 0 ? radius - o.a1_mm : -radius - o.a1_mm;
    const double s2 = nx * nx + dz * dz, s = std::sqrt(s2);
    double shoulder = 0, elbow = 0;
    if (s < 1e-9 || !arc_cosine((s2 + c2 * c2 - k2) / (2 * s * c2), shoulder) || !arc_cosine((s2 - c2 * c2 - k2) / (2 * c2 * k), elbow)) continue;
    const double line = std::atan2(nx, dz), cos1 = std::cos(t1), sin1 = std::sin(t1);
    for (int bend = 0; bend < 2; ++bend) {
      const double t2 = bend == 0 ? line - shoulder : line + shoulder;
      const double t3 = (bend == 0 ? elbow : -elbow) - elbow_offset;
      const double c23 = std::cos(t2 + t3), s23 = std::sin(t2 + t3);
      const double gx = o.a1_mm + c2 * std::sin(t2) + o.c3_mm * s23 + o.a2_mm * c23;
      const double gz = o.c1_mm + c2 * std::cos(t2) + o.c3_mm * c23 - o.a2_mm * s23;
      const Vec3 reached(gx * cos1 - o.b_mm * sin1, gx * sin1 + o.b_mm * cos1, gz);
      if ((reached - w).cwiseAbs().maxCoeff() > tolerance) continue;
      Mat3 F;  // orientation of the forearm
      F << cos1 * c23, -sin1, cos1 * s23, sin1 * c23, cos1, sin1 * s23, -s23, 0, c23;
      const Mat3 r = F.transpose() * R;
      const double sin5 = std::sqrt(r(0, 2) * r(0, 2) + r(1, 2) * r(1, 2));
      const bool is_singular = sin5 < 1e-9;
      const double c4 = is_singular ? 1.0 : r(0, 2) / sin5, s4 = is_singular ? 0.0 : r(1, 2) / sin5;
      const double t4 = is_singular ? 0.0 : std::atan2(s4, c4);
      const double t5 = std::atan2(sin5, r(2, 2));
      // Rz(t4)^T r = Ry(t5) Rz(t6): its second row is (sin t6, cos t6, 0), well conditioned at any t5
      const double t6 = std::atan2(c4 * r(1, 0) - s4 * r(0, 0), c4 * r(1, 1) - s4 * r(0, 1));
      {  // the wrist's own forward check (the flipped branch is the same rotation)
        const double a4 = std::sin(t4), b4 = std::cos(t4), a5 = std::sin(t5), b5 = std::cos(t5), a6 = std::sin(t6), b6 = std::cos(t6);
        Mat3 m;
        m << b4 * b5 * b6 - a4 * a6, -b4 * b5 * a6 - a4 * b6, b4 * a5, a4 * b5 * b6 + b4 * a6, -a4 * b5 * a6 + b4 * b6, a4 * a5, -a5 * b6,
            a5 * a6, b5;
        if ((m - r).cwiseAbs().maxCoeff() > 1e-9) continue;
      }
      out.is_wrist_singular |= is_singular;
      const double theta[2][6] = {{t1, t2, t3, t4, t5, t6}, {t1, t2, t3, t4 + kPi, -t5, t6 + kPi}};
      for (int flip = 0; flip < 2; ++flip) {
        const int n = 4 * flip + 2 * side + bend;
        out.is_valid[n] = true;
        for (int i = 0; i < 6; ++i) out.q_rad[n][i] = wrapped((theta[flip][i] + o.offsets_rad[i]) * o.signs[i]);
      }
    }
  }
  return out;
}

std::optional<OpwArm> opw_of(const KinematicChain& chain, const Rigid& flange_at_zero, double tolerance_mm, double tolerance_rad) {
  const auto& w = chain.axis;
  const auto& p = chain.point;
  const auto perpendicular = [&](const Vec3& a, const Vec3& b) { return std::abs(a.dot(b)) < tolerance_rad; };
  if (!perpendicular(w[0], w[1]) || w[1].cross(w[2]).norm() > tolerance_rad || !perpendicular(w[2], w[3])) return std::nullopt;
  if (!perpendicular(w[3], w[4]) || !perpendicular(w[4], w[5])) return std::nullopt;
  Vec3 wrist = Vec3::Zero();
  if (nearest({p[3], w[3]}, {p[4], w[4]}, &wrist) > tolerance_mm) return std::nullopt;
  if ((wrist - p[5]).cross(w[5]).norm() > tolerance_mm) return std::nullopt;

  OpwArm arm;
  OpwParameters& o = arm.constants;
  // Arm frame: z = axis 1, up in base whichever way the joint counts; y = axis 2 or its opposite, so that axis 2 lies in front
  // (a1 >= 0) when theta 1 = 0.
  const bool is_down = w[0].z() < -0.5;
  const Vec3 z = is_down ? Vec3(-w[0]) : w[0];
  Vec3 y = (w[1] - z * z.dot(w[1])).normalized();
  Vec3 origin = p[0] - z * z.dot(p[0]);
  const auto in_plane_x = [&](const Vec3& point) { return y.cross(z).dot(point - origin); };
  o.signs = {is_down ? -1 : 1, 1, 1, 1, 1, 1};
  if (in_plane_x(p[1]) < -1e-9) y = -y;
  o.signs[1] = y.dot(w[1]) > 0 ? 1 : -1;
  o.signs[2] = y.dot(w[2]) > 0 ? 1 : -1;
  arm.T_base_arm.R.col(0) = y.cross(z), arm.T_base_arm.R.col(1) = y, arm.T_base_arm.R.col(2) = z;
  arm.T_base_arm.p = origin;
  const Rigid inverse = arm.T_base_arm.inverse();
  const auto local = [&](const Vec3& point) { return Vec3(inverse.R * point + inverse.p); };
  const Vec3 p1 = local(p[1]), p2 = local(p[2]), pw = local(wrist), d4 = inverse.R * w[3];
  o.a1_mm = p1.x(), o.c1_mm = p1.z(), o.b_mm = pw.y();
  const double dx = p2.x() - p1.x(), dz = p2.z() - p1.z();
  o.c2_mm = std::hypot(dx, dz);
  if (o.c2_mm < 1e-3) return std::nullopt;
  const double t2 = std::atan2(dx, dz);
  o.signs[3] = (pw - p2).dot(d4) >= 0 ? 1 : -1;
  const Vec3 forearm = d4 * o.signs[3];
  const double t23 = std::atan2(forearm.x(), forearm.z()), c23 = std::cos(t23), s23 = std::sin(t23);
  o.c3_mm = (pw.x() - p2.x()) * s23 + (pw.z() - p2.z()) * c23;
  o.a2_mm = (pw.x() - p2.x()) * c23 - (pw.z() - p2.z()) * s23;
  if (std::hypot(o.c3_mm, o.a2_mm) < 1e-3) return std::nullopt;
  Mat3 F;
  F << c23, 0, s23, 0, 1, 0, -s23, 0, c23;
  const Vec3 u = F.transpose() * inverse.R * w[4];
  const double t4 = std::atan2(-u.x(), u.y());
  const Vec3 tip = inverse.R * flange_at_zero.p + inverse.p - pw;
  const Vec3 d6 = inverse.R * w[5];
  o.signs[5] = tip.dot(d6) >= 0 ? 1 : -1;
  o.c4_mm = std::abs(tip.dot(d6));
  const Mat3 R4 = Eigen::AngleAxisd(t4, Vec3::UnitZ()).toRotationMatrix();
  const Vec3 v = R4.transpose() * F.transpose() * d6 * o.signs[5];
  const double t5 = std::atan2(v.x(), v.z());
  const Mat3 R5 = Eigen::AngleAxisd(t5, Vec3::UnitY()).toRotationMatrix();
  const std::array<double, 6> theta_zero{0, t2, t23 - t2, t4, t5, 0};
  for (int i = 0; i < 6; ++i) o.offsets_rad[i] = wrapped(-theta_zero[i]);
  const Mat3 wrist_R = arm.T_base_arm.R * F * R4 * R5;
  const Rigid wrist_at_zero{wrist_R, wrist + wrist_R.col(2) * o.c4_mm};
  arm.T_wrist_flange = wrist_at_zero.inverse() * flange_at_zero;
  return arm;
}

}  // namespace asbuilt
