// SPDX-License-Identifier: GPL-3.0-or-later
// What the views cannot tell, in words, and which further poses would tell it.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/calibrate/network_detail.hpp"
#include "planner/calibrate/solve.hpp"

namespace asbuilt {

namespace {

/// "x", "-z", or the components.
std::string axis_text(Vec3 v) {
  v.normalize();
  for (int i = 0; i < 3; ++i)
    if (std::abs(v[i]) > 0.97) return std::string(1, "xyz"[i]);
  Eigen::Index most;
  v.cwiseAbs().maxCoeff(&most);
  if (v[most] < 0) v = -v;
  return fmt::format("({}, {}, {})", fixed_number(v.x(), 2), fixed_number(v.y(), 2), fixed_number(v.z(), 2));
}

/// How the point p of the sensor moves with the mount's twist.
Eigen::Matrix<double, 3, 6> point_jacobian(const Vec3& p) {
  Eigen::Matrix<double, 3, 6> J;
  J << Mat3::Identity(), -skew(p);
  return J;
}

Eigen::MatrixXd covariance_of(const Network& n, const Eigen::MatrixXd& H) {
  std::vector<int> f;
  for (Eigen::Index i = 0; i < H.rows(); ++i) {
    const bool is_free = i < 6 ? n.is_mount_free[i] : i < 12 ? n.is_target_free[i - 6] : i < 12 + kSensorConstants ? n.sensor_sd[i - 12] > 0 : n.arm_sd[i - 12 - kSensorConstants] > 0;
    if (is_free) f.push_back(static_cast<int>(i));
  }
  const int m = static_cast<int>(f.size());
  Eigen::MatrixXd A(m, m);
  Eigen::VectorXd s(m);
  for (int i = 0; i < m; ++i) s[i] = 1 / std::sqrt(std::max(1e-300, H(f[i], f[i])));
  for (int i = 0; i < m; ++i)
    for (int k = 0; k < m; ++k) A(i, k) = H(f[i], f[k]) * s[i] * s[k];
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(A);
  const Eigen::MatrixXd C = s.asDiagonal() * es.eigenvectors() * es.eigenvalues().cwiseMax(1e-13).cwiseInverse().asDiagonal() * es.eigenvectors().transpose() * s.asDiagonal();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(H.rows(), H.cols());
  for (int i = 0; i < m; ++i)
    for (int k = 0; k < m; ++k) out(f[i], f[k]) = C(i, k);
  return out;
}

double largest_sd(const Eigen::MatrixXd& C) {
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(0.5 * (C + C.transpose()));
  return std::sqrt(std::max(0.0, es.eigenvalues().maxCoeff()));
}

/// log det of the mount's covariance in mm (turns times the distance looked at); less is better.
double size_of(const Mat6& C, double lever_mm) {
  Vec6 d;
  d << 1, 1, 1, lever_mm, lever_mm, lever_mm;
  const Mat6 A = d.asDiagonal() * C * d.asDiagonal();
  Eigen::SelfAdjointEigenSolver<Mat6> es(0.5 * (A + A.transpose()));
  double sum = 0;
  for (int i = 0; i < 6; ++i)
    if (es.eigenvalues()[i] > 1e-12) sum += std::log(es.eigenvalues()[i]);
  return sum;
}

}  // namespace

std::vector<WeakDirection> weak_directions(const Mat6& covariance, const Vec3& p_look, int count) {
  const double lever = std::max(50.0, p_look.norm());
  Vec6 d;
  d << 1, 1, 1, lever, lever, lever;
  const Mat6 A = d.asDiagonal() * covariance * d.asDiagonal();
  Eigen::SelfAdjointEigenSolver<Mat6> es(0.5 * (A + A.transpose()));
  std::vector<WeakDirection> out;
  for (int i = 5; i >= 6 - count && i >= 0; --i) {
    const Vec6 v = es.eigenvectors().col(i);
    const double sd = std::sqrt(std::max(0.0, es.eigenvalues()[i]));
    WeakDirection w;
    const Vec3 t = v.head<3>() * sd, turn = v.tail<3>() * sd / lever;
    if (v.tail<3>().norm() > v.head<3>().norm()) {
      w.sd = deg_from_rad(turn.norm()), w.unit = "deg";
      w.text = fmt::format("turn about the sensor's {}: sd {} deg, together with a shift of {} mm", axis_text(turn), fixed_number(w.sd, 3), fixed_number(t.norm(), 3));
    } else {
      w.sd = t.norm(), w.unit = "mm";
      w.text = fmt::format("shift along the sensor's {}: sd {} mm, together with a turn of {} deg", axis_text(t), fixed_number(w.sd, 3), fixed_number(deg_from_rad(turn.norm()), 3));
    }
    w.point_mm = (t - skew(p_look) * turn).norm();
    w.text += fmt::format(" (moves what the sensor looks at by {} mm)", fixed_number(w.point_mm, 3));
    out.push_back(std::move(w));
  }
  return out;
}

std::vector<PoseToAdd> poses_to_add(const NetworkRecipe& sds, const Network& network, const NetworkState& state, const Eigen::MatrixXd& information,
                                    const Vec3& p_look, int count) {
  std::vector<NetworkView> candidates;
  std::size_t taken = 0;
  for (std::size_t k = 0; k < network.views.size() && taken < 4; k += std::max<std::size_t>(1, network.views.size() / 4), ++taken) {
    const NetworkView& v = network.views[k];
    if (v.observations.empty() && !v.T_sensor_target) continue;
    const auto C = target_in_sensor(network, v, state);
    const auto X = state.T_mount_sensor;
    for (const double tilt : {0.0, 0.35, 0.6})
      for (int side = 0; side < (tilt > 0 ? 8 : 1); ++side)
        for (const double roll : {0.0, kPi / 2, -kPi / 2, kPi}) {
          if (tilt == 0 && roll == 0) continue;
          const Vec3 w = tilt * Vec3(std::cos(side * kPi / 4), std::sin(side * kPi / 4), 0);
          // the sensor swings about the point it looks at
          const Eigen::Quaterniond turn = quat_exp(w) * quat_exp(Vec3(0, 0, roll));
          const Pose<frame::Sensor, frame::Sensor> swing(turn, p_look - turn * p_look);
          NetworkView c = v;
          if (network.is_sensor_fixed) {
            // the target on the flange swings the other way
            const Pose<frame::Flange, frame::Target> Y(state.T_place_target.q, state.T_place_target.p_mm);
            const Pose<frame::Base, frame::Sensor> Z(X.q, X.p_mm);
            c.T_base_flange = Z * swing.inverse() * C * Y.inverse();
          } else {
            const Pose<frame::Flange, frame::Sensor> F(X.q, X.p_mm);
            c.T_base_flange = v.T_base_flange * F * swing * F.inverse();
          }
          if (network.sight == Sight::plane) {  // the same rays meet the plane elsewhere
            const auto S = target_in_sensor(network, c, state);
            bool is_seen = true;
            for (Observation& o : c.observations) {
              const Vec3 n = S.q * Vec3::Unit(o.id);
              const double along = n.dot(o.z), t = along != 0 ? n.dot(S.p_mm) / along : -1;
              if (!(t > 0.2 && t < 3)) is_seen = false;
              else o.z *= t;
            }
            if (!is_seen) continue;
          }
          candidates.push_back(std::move(c));
        }
  }
  std::vector<Eigen::MatrixXd> each;
  for (const NetworkView& c : candidates) each.push_back(information_of_view(sds, network, c, state));
  std::vector<PoseToAdd> out;
  Eigen::MatrixXd H = information;
  const double lever = std::max(50.0, p_look.norm());
  for (int i = 0; i < count && !candidates.empty(); ++i) {
    std::size_t best = 0;
    double least = 1e300;
    for (std::size_t c = 0; c < each.size(); ++c) {
      const double size = size_of(covariance_of(network, H + each[c]).topLeftCorner<6, 6>(), lever);
      if (size < least - 1e-9) least = size, best = c;
    }
    H += each[best];
    const Mat6 C = covariance_of(network, H).topLeftCorner<6, 6>();
    const auto J = point_jacobian(p_look);
    out.push_back({candidates[best].T_base_flange, largest_sd(J * C * J.transpose()), largest_sd(C.bottomRightCorner<3, 3>())});
  }
  return out;
}

}  // namespace asbuilt
