// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/trajectory.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt::fuse_detail {
namespace {

/// V of exp(xi) = [R, V v] for the rotation vector w.
Mat3 left_jacobian(const Vec3& w) {
  const double a = w.norm();
  const Mat3 k = skew(w);
  if (a < 1e-6) return Mat3::Identity() + 0.5 * k + k * k / 6;
  return Mat3::Identity() + (1 - std::cos(a)) / (a * a) * k + (a - std::sin(a)) / (a * a * a) * k * k;
}

}  // namespace

Vec6 screw_log(const Eigen::Isometry3d& T) {
  Vec6 xi;
  const Vec3 w = quat_log(Eigen::Quaterniond(T.rotation()).normalized());
  xi.tail<3>() = w;
  xi.head<3>() = left_jacobian(w).inverse() * T.translation();
  return xi;
}

Eigen::Isometry3d screw_exp(const Vec6& xi) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = quat_exp(xi.tail<3>()).toRotationMatrix();
  T.translation() = left_jacobian(xi.tail<3>()) * xi.head<3>();
  return T;
}

Trajectory::Trajectory(const RobotTrack& track, double gap_max_s) {
  must(track.samples.size() >= 2, "a trajectory needs two samples");
  for (const RobotSample& s : track.samples) t_.push_back(s.t_s), T_.push_back(s.T_base_flange.matrix());
  gap_max_s_ = std::max(gap_max_s, 2.5 * track.cycle_s);
  acceleration_mm_s2_.assign(t_.size(), 0);
  for (std::size_t i = 0; i + 1 < t_.size(); ++i) {
    const double step = t_[i + 1] - t_[i];
    if (track.cycle_s > 0) lost_count_ += std::max(0, static_cast<int>(std::lround(std::min(1e6, step / track.cycle_s))) - 1);
    if (step > gap_widest_s_) gap_widest_s_ = step, gap_widest_at_s_ = t_[i];
    if (i == 0) continue;
    const double before = t_[i] - t_[i - 1];
    const Vec3 v_before = (T_[i].translation() - T_[i - 1].translation()) / before, v_after = (T_[i + 1].translation() - T_[i].translation()) / step;
    acceleration_mm_s2_[i] = 2 * (v_after - v_before).norm() / (before + step);
  }
}

PoseAt Trajectory::at(double t_s) const {
  PoseAt out;
  if (!(t_s >= t_.front() && t_s <= t_.back())) return out;
  const std::size_t k = std::min(t_.size() - 2, static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, std::upper_bound(t_.begin(), t_.end(), t_s) - t_.begin() - 1)));
  const double h = t_[k + 1] - t_[k], s = (t_s - t_[k]) / h;
  const Eigen::Isometry3d from = T_[k].inverse();
  const Vec6 x1 = screw_log(from * T_[k + 1]);
  // slopes at both ends from the samples on either side, weighted for uneven times; the chord where there is none
  const auto slope = [&](const Vec6& a, const Vec6& b, double ha, double hb) -> Vec6 { return (a / ha * hb + b / hb * ha) / (ha + hb); };
  Vec6 m0 = x1 / h, m1 = m0;
  if (k > 0 && t_[k] - t_[k - 1] < gap_max_s_) {
    const double ha = t_[k] - t_[k - 1];
    m0 = slope(-screw_log(from * T_[k - 1]), x1, ha, h);
  }
  if (k + 2 < t_.size() && t_[k + 2] - t_[k + 1] < gap_max_s_) {
    const double hb = t_[k + 2] - t_[k + 1];
    m1 = slope(x1, screw_log(from * T_[k + 2]) - x1, h, hb);
  }
  const double s2 = s * s, s3 = s2 * s;
  const Vec6 x = (s3 - 2 * s2 + s) * h * m0 + (3 * s2 - 2 * s3) * x1 + (s3 - s2) * h * m1;
  const Vec6 dx = (3 * s2 - 4 * s + 1) * m0 + (6 * s - 6 * s2) / h * x1 + (3 * s2 - 2 * s) * m1;
  out.T_base_flange = Pose<frame::Base, frame::Flange>(T_[k] * screw_exp(x));
  out.velocity_mm_s = T_[k].rotation() * dx.head<3>();
  out.turn_rad_s = T_[k].rotation() * dx.tail<3>();
  out.gap_s = h;
  const double a = std::max(acceleration_mm_s2_[k], acceleration_mm_s2_[k + 1]);
  out.sigma_mm = a * h * h / 8;
  out.is_known = h <= gap_max_s_;
  return out;
}

double Trajectory::speed_max_mm_s() const {
  std::vector<double> speed;
  for (std::size_t i = 0; i + 1 < t_.size(); ++i) speed.push_back((T_[i + 1].translation() - T_[i].translation()).norm() / (t_[i + 1] - t_[i]));
  const std::size_t k = static_cast<std::size_t>(0.99 * static_cast<double>(speed.size() - 1));
  std::nth_element(speed.begin(), speed.begin() + static_cast<std::ptrdiff_t>(k), speed.end());
  return speed[k];
}

}  // namespace asbuilt::fuse_detail
