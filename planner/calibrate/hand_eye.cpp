// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/hand_eye.hpp"

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <algorithm>

namespace asbuilt {
namespace {

struct Motion {  // A X = X B
  Eigen::Quaterniond q_a, q_b;
  Vec3 t_a, t_b;
};

std::vector<Motion> motions_of(const std::vector<MotionView>& views, double min_rad) {
  std::vector<Motion> out;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const auto A = views[i].T_place_mount.inverse() * views[j].T_place_mount;
      const auto B = views[i].T_sensor_target * views[j].T_sensor_target.inverse();
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

MotionStart finish(const std::string& method, const Mat3& R, const Vec3& t) {
  MotionStart s;
  s.method = method;
  s.T_mount_sensor = {Eigen::Quaterniond(R).normalized(), t};
  return s;
}

MotionStart park_martin(const std::vector<Motion>& m) {
  Mat3 M = Mat3::Zero();
  for (const Motion& k : m) M += quat_log(k.q_b) * quat_log(k.q_a).transpose();
  // R = (M^T M)^(-1/2) M^T
  Eigen::SelfAdjointEigenSolver<Mat3> es(M.transpose() * M);
  const Mat3 root = es.eigenvectors() * es.eigenvalues().cwiseMax(1e-300).cwiseSqrt().cwiseInverse().asDiagonal() * es.eigenvectors().transpose();
  const Mat3 R = nearest_rotation(root * M.transpose());
  return finish("park-martin", R, translation_for(m, R));
}

MotionStart andreff(const std::vector<Motion>& m) {
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
  return finish("andreff", R, translation_for(m, R));
}

MotionStart daniilidis(const std::vector<Motion>& m) {
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
  return finish("daniilidis", Q.toRotationMatrix(), t);
}

/// A X = Y B over single views: (R_B (x) R_A) vec R_X = vec R_Y by the largest singular pair, then linear in both translations.
MotionStart shah(const std::vector<MotionView>& views) {
  Eigen::Matrix<double, 9, 9> K = Eigen::Matrix<double, 9, 9>::Zero();
  for (const MotionView& v : views) {
    const Mat3 A = v.T_place_mount.rotation(), B = v.T_sensor_target.inverse().rotation();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) K.block<3, 3>(3 * i, 3 * j) += B(i, j) * A;
  }
  Eigen::JacobiSVD<Eigen::Matrix<double, 9, 9>> svd(K, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix<double, 9, 1> x = svd.matrixV().col(0), y = svd.matrixU().col(0);
  Mat3 X, Y;
  for (int i = 0; i < 3; ++i) X.col(i) = x.segment<3>(3 * i), Y.col(i) = y.segment<3>(3 * i);
  if (X.determinant() < 0) X = -X, Y = -Y;
  X = nearest_rotation(X), Y = nearest_rotation(Y);
  Eigen::MatrixXd M(3 * views.size(), 6);
  Eigen::VectorXd b(3 * views.size());
  for (std::size_t k = 0; k < views.size(); ++k) {
    const auto B = views[k].T_sensor_target.inverse();
    const Eigen::Index at = static_cast<Eigen::Index>(3 * k);
    M.block<3, 3>(at, 0) = views[k].T_place_mount.rotation(), M.block<3, 3>(at, 3) = -Mat3::Identity();
    b.segment<3>(at) = Y * B.p_mm - views[k].T_place_mount.p_mm;
  }
  const Eigen::VectorXd t = M.colPivHouseholderQr().solve(b);
  MotionStart s;
  s.method = "shah";
  s.T_mount_sensor = {Eigen::Quaterniond(X).normalized(), t.head<3>()};
  return s;
}

/// The target's mean place given where the sensor sits, and how far the views are from it.
void add_target(MotionStart& s, const std::vector<MotionView>& views) {
  Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
  Vec3 t = Vec3::Zero();
  std::vector<Pose<frame::Place, frame::Target>> each;
  for (const MotionView& v : views) {
    each.push_back(v.T_place_mount * s.T_mount_sensor * v.T_sensor_target);
    Q += each.back().q.coeffs() * each.back().q.coeffs().transpose();
    t += each.back().p_mm / static_cast<double>(views.size());
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> es(Q);
  s.T_place_target = {Eigen::Quaterniond(Eigen::Vector4d(es.eigenvectors().col(3))).normalized(), t};
  for (const auto& T : each) {
    s.rotation_rms_rad += quat_log(T.q.conjugate() * s.T_place_target.q).squaredNorm() / static_cast<double>(views.size());
    s.translation_rms_mm += (T.p_mm - t).squaredNorm() / static_cast<double>(views.size());
  }
  s.rotation_rms_rad = std::sqrt(s.rotation_rms_rad), s.translation_rms_mm = std::sqrt(s.translation_rms_mm);
}

/// How much more the robot turned between two views than the sensor saw, and the difference of the screws' pitches (mm).
double angle_gap(const Pose<frame::Place, frame::Mount>& a, const Pose<frame::Place, frame::Mount>& b, const Pose<frame::Sensor, frame::Target>& c,
                 const Pose<frame::Sensor, frame::Target>& d) {
  return std::abs(quat_log(a.q.conjugate() * b.q).norm() - quat_log(c.q * d.q.conjugate()).norm());
}

}  // namespace

Pose<frame::Place, frame::Mount> place_mount(const Pose<frame::Base, frame::Flange>& T, bool is_sensor_fixed) {
  if (!is_sensor_fixed) return {T.q, T.p_mm};
  const auto back = T.inverse();
  return {back.q, back.p_mm};
}

Pose<frame::Sensor, frame::Target> pose_of_points(const std::vector<Vec3>& p_target, const std::vector<Vec3>& p_sensor) {
  must(p_target.size() == p_sensor.size() && p_target.size() >= 3, "a target's pose needs three points");
  Eigen::Matrix3Xd a(3, p_target.size()), b(3, p_target.size());
  for (std::size_t i = 0; i < p_target.size(); ++i) a.col(i) = p_target[i], b.col(i) = p_sensor[i];
  return Pose<frame::Sensor, frame::Target>(Eigen::Isometry3d(Eigen::umeyama(a, b, false)));
}

std::vector<MotionStart> motion_starts(const std::vector<MotionView>& views, double min_motion_rad) {
  const std::vector<Motion> m = motions_of(views, min_motion_rad);
  if (m.empty()) return {};
  std::vector<MotionStart> all{park_martin(m), andreff(m), daniilidis(m), shah(views)};
  // of motions about one axis a closed form may be no number at all
  std::erase_if(all, [](const MotionStart& s) { return !s.T_mount_sensor.p_mm.allFinite() || !s.T_mount_sensor.q.coeffs().allFinite() || s.T_mount_sensor.p_mm.norm() > 1e5; });
  for (MotionStart& s : all) add_target(s, views);
  return all;
}

std::vector<double> motion_disagreement_rad(const std::vector<MotionView>& views) {
  std::vector<double> out;
  for (std::size_t i = 0; i < views.size(); ++i) {
    std::vector<double> gap;
    for (std::size_t j = 0; j < views.size(); ++j)
      if (i != j) gap.push_back(angle_gap(views[i].T_place_mount, views[j].T_place_mount, views[i].T_sensor_target, views[j].T_sensor_target));
    if (gap.empty()) gap.push_back(0);
    std::nth_element(gap.begin(), gap.begin() + static_cast<std::ptrdiff_t>(gap.size() / 2), gap.end());
    out.push_back(gap[gap.size() / 2]);
  }
  return out;
}

MotionSpread motion_spread(const std::vector<Pose<frame::Place, frame::Mount>>& views) {
  Mat3 M = Mat3::Zero();
  std::size_t n = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j, ++n) {
      const Vec3 w = quat_log(views[i].q.conjugate() * views[j].q);
      M += w * w.transpose();
    }
  Eigen::SelfAdjointEigenSolver<Mat3> es(M / static_cast<double>(std::max<std::size_t>(1, n)));
  MotionSpread out;
  for (int i = 0; i < 3; ++i) out.axes.col(i) = es.eigenvectors().col(2 - i), out.rms_rad[i] = std::sqrt(std::max(0.0, es.eigenvalues()[2 - i]));
  return out;
}

std::vector<int> choose_turns(const std::vector<Pose<frame::Place, frame::Mount>>& robot, const std::vector<std::vector<Pose<frame::Sensor, frame::Target>>>& turned) {
  const std::size_t n = turned.size();
  std::vector<int> best(n, 0);
  double best_cost = 1e300;
  const auto gap = [&](std::size_t i, int a, std::size_t j, int b) { return std::min(0.2, angle_gap(robot[i], robot[j], turned[i][a], turned[j][b])); };
  for (std::size_t first = 0; first < n; ++first) {  // grow from each view in turn: one bad view must not lead
    std::vector<int> pick(n, 0);
    for (int pass = 0; pass < 4; ++pass)
      for (std::size_t k = 0; k < n; ++k) {
        const std::size_t i = (first + k) % n;
        if (i == first) continue;
        double least = 1e300;
        for (int a = 0; a < static_cast<int>(turned[i].size()); ++a) {
          double sum = 0;
          for (std::size_t j = 0; j < n; ++j)
            if (j != i && (pass > 0 || (j + n - first) % n < k)) sum += gap(i, a, j, pick[j]);
          if (sum < least - 1e-12) least = sum, pick[i] = a;
        }
      }
    double cost = 0;
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = i + 1; j < n; ++j) cost += gap(i, pick[i], j, pick[j]);
    if (cost < best_cost - 1e-9) best_cost = cost, best = pick;
  }
  return best;
}

}  // namespace asbuilt
