// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/hand_eye.hpp"

#include <Eigen/Dense>
#include <Eigen/SVD>

namespace asbuilt {
namespace {

struct Motion {  // A X = X B
  Eigen::Quaterniond q_a, q_b;
  Vec3 t_a, t_b;
};

std::vector<Motion> motions_of(const std::vector<TargetView>& views, double min_rad) {
  std::vector<Motion> out;
  std::vector<Pose<frame::Sensor, frame::Target>> C;
  for (const TargetView& v : views) C.push_back(target_pose(v));
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const auto A = views[i].T_base_flange.inverse() * views[j].T_base_flange;
      const auto B = C[i] * C[j].inverse();
      if (quat_log(A.q).norm() < min_rad) continue;
      out.push_back({A.q, B.q, A.p_mm, B.p_mm});
    }
  return out;
}

Mat3 nearest_rotation(const Mat3& m) {
  Eigen::JacobiSVD<Mat3> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 d = Mat3::Identity();
  d(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  return svd.matrixU() * d * svd.matrixV().transpose();
}

/// (R_A - I) t = R t_B - t_A over all motions.
Vec3 translation_for(const std::vector<Motion>& m, const Mat3& R) {
  Mat3 N = Mat3::Zero();
  Vec3 b = Vec3::Zero();
  for (const Motion& k : m) {
    const Mat3 L = k.q_a.toRotationMatrix() - Mat3::Identity();
    N += L.transpose() * L;
    b += L.transpose() * (R * k.t_b - k.t_a);
  }
  return N.ldlt().solve(b);
}

HandEyeStart finish(const std::string& method, const std::vector<Motion>& m, const Mat3& R, const Vec3& t) {
  HandEyeStart s;
  s.method = method;
  s.T_flange_sensor = {Eigen::Quaterniond(R).normalized(), t};
  for (const Motion& k : m) {
    const Eigen::Quaterniond X(R);
    s.rotation_rms_rad += quat_log((k.q_a * X).conjugate() * (X * k.q_b)).squaredNorm() / static_cast<double>(m.size());
    s.translation_rms_mm += (k.q_a * t + k.t_a - R * k.t_b - t).squaredNorm() / static_cast<double>(m.size());
  }
  s.rotation_rms_rad = std::sqrt(s.rotation_rms_rad);
  s.translation_rms_mm = std::sqrt(s.translation_rms_mm);
  return s;
}

HandEyeStart park_martin(const std::vector<Motion>& m) {
  Mat3 M = Mat3::Zero();
  for (const Motion& k : m) M += quat_log(k.q_b) * quat_log(k.q_a).transpose();
  // R = (M^T M)^(-1/2) M^T
  Eigen::SelfAdjointEigenSolver<Mat3> es(M.transpose() * M);
  const Mat3 root = es.eigenvectors() * es.eigenvalues().cwiseMax(1e-300).cwiseSqrt().cwiseInverse().asDiagonal() * es.eigenvectors().transpose();
  const Mat3 R = nearest_rotation(root * M.transpose());
  return finish("park-martin", m, R, translation_for(m, R));
}

HandEyeStart andreff(const std::vector<Motion>& m) {
  // [I9 - R_A (x) R_B, 0; I3 (x) t_B^T, I3 - R_A] [vec R; t] = [0; t_A], row-major vec; lengths scaled to the mean of t_B
  double length = 1e-9;
  for (const Motion& k : m) length += k.t_b.norm() / static_cast<double>(m.size());
  Eigen::Matrix<double, 12, 12> N = Eigen::Matrix<double, 12, 12>::Zero();
  Eigen::Matrix<double, 12, 1> rhs = Eigen::Matrix<double, 12, 1>::Zero();
  for (const Motion& k : m) {
    const Mat3 A = k.q_a.toRotationMatrix(), B = k.q_b.toRotationMatrix();
    Eigen::Matrix<double, 12, 12> J = Eigen::Matrix<double, 12, 12>::Zero();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        J.block<3, 3>(3 * i, 3 * j) -= A(i, j) * B;
        if (i == j) J.block<3, 3>(3 * i, 3 * j) += Mat3::Identity();
      }
    for (int i = 0; i < 3; ++i) J.block<1, 3>(9 + i, 3 * i) = (k.t_b / length).transpose();
    J.block<3, 3>(9, 9) = Mat3::Identity() - A;
    Eigen::Matrix<double, 12, 1> r = Eigen::Matrix<double, 12, 1>::Zero();
    r.tail<3>() = k.t_a / length;
    N += J.transpose() * J;
    rhs += J.transpose() * r;
  }
  const Eigen::Matrix<double, 12, 1> x = N.ldlt().solve(rhs);
  Mat3 R;
  for (int i = 0; i < 3; ++i) R.row(i) = x.segment<3>(3 * i).transpose();
  if (R.determinant() < 0) R = -R;
  R = nearest_rotation(R);
  return finish("andreff", m, R, translation_for(m, R));
}

HandEyeStart daniilidis(const std::vector<Motion>& m) {
  // dual quaternions q + e q', q' = t q / 2; both with q0 >= 0 before they are stacked
  Eigen::Matrix<double, 8, 8> N = Eigen::Matrix<double, 8, 8>::Zero();
  for (const Motion& k : m) {
    Eigen::Quaterniond a = k.q_a, b = k.q_b;
    if (a.w() < 0) a.coeffs() *= -1;
    if (b.w() < 0) b.coeffs() *= -1;
    const Eigen::Quaterniond ta(0, k.t_a.x(), k.t_a.y(), k.t_a.z()), tb(0, k.t_b.x(), k.t_b.y(), k.t_b.z());
    const Vec3 da = 0.5 * (ta * a).vec(), db = 0.5 * (tb * b).vec(), va = a.vec(), vb = b.vec();
    Eigen::Matrix<double, 6, 8> S = Eigen::Matrix<double, 6, 8>::Zero();
    S.block<3, 1>(0, 0) = va - vb, S.block<3, 3>(0, 1) = skew(va + vb);
    S.block<3, 1>(3, 0) = da - db, S.block<3, 3>(3, 1) = skew(da + db);
    S.block<3, 1>(3, 4) = va - vb, S.block<3, 3>(3, 5) = skew(va + vb);
    N += S.transpose() * S;
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 8, 8>> es(N);
  const Eigen::Matrix<double, 8, 1> v7 = es.eigenvectors().col(0), v8 = es.eigenvectors().col(1);
  const Eigen::Vector4d u1 = v7.head<4>(), w1 = v7.tail<4>(), u2 = v8.head<4>(), w2 = v8.tail<4>();
  // l1^2 u1.w1 + l1 l2 (u1.w2 + u2.w1) + l2^2 u2.w2 = 0, l1^2 u1.u1 + 2 l1 l2 u1.u2 + l2^2 u2.u2 = 1
  const double a = u1.dot(w1), b = u1.dot(w2) + u2.dot(w1), c = u2.dot(w2);
  double best = -1, l1 = 1, l2 = 0;
  const auto offer = [&](double x1, double x2) {
    const double n = x1 * x1 * u1.dot(u1) + 2 * x1 * x2 * u1.dot(u2) + x2 * x2 * u2.dot(u2);
    const double size = x1 * x1 + x2 * x2;
    if (size > 0 && n / size > best) best = n / size, l1 = x1 / std::sqrt(n), l2 = x2 / std::sqrt(n);
  };
  const double root = std::sqrt(std::max(0.0, b * b - 4 * a * c));
  if (std::abs(a) > 1e-14) {
    offer((-b + root) / (2 * a), 1), offer((-b - root) / (2 * a), 1);
  } else {
    offer(1, 0), offer(-c, b);
  }
  const Eigen::Vector4d q = l1 * u1 + l2 * u2, d = l1 * w1 + l2 * w2;
  const Eigen::Quaterniond Q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized();
  const Vec3 t = 2 * (Eigen::Quaterniond(d[0], d[1], d[2], d[3]) * Q.conjugate()).vec();
  return finish("daniilidis", m, Q.toRotationMatrix(), t);
}

}  // namespace

Pose<frame::Sensor, frame::Target> target_pose(const TargetView& view) {
  must(view.p_target.size() == view.p_sensor.size() && view.p_target.size() >= 3, "a target's pose needs three points");
  Eigen::Matrix3Xd a(3, view.p_target.size()), b(3, view.p_target.size());
  for (std::size_t i = 0; i < view.p_target.size(); ++i) a.col(i) = view.p_target[i], b.col(i) = view.p_sensor[i];
  return Pose<frame::Sensor, frame::Target>(Eigen::Isometry3d(Eigen::umeyama(a, b, false)));
}

std::vector<HandEyeStart> hand_eye_starts(const std::vector<TargetView>& views, double min_motion_rad) {
  const std::vector<Motion> m = motions_of(views, min_motion_rad);
  if (m.empty()) return {};
  return {park_martin(m), andreff(m), daniilidis(m)};
}

}  // namespace asbuilt
