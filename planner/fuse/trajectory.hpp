// SPDX-License-Identifier: GPL-3.0-or-later
// Where the flange was at any time between the samples of a robot log. Poses are interpolated as poses (SE(3)), never angle by angle.
#pragma once

#include <vector>

#include "planner/artefacts/job.hpp"

namespace asbuilt::fuse_detail {

/// log and exp of rigid motions, translation first: exp(log(T)) = T, exp(s log(T)) is the screw motion's part s.
Vec6 screw_log(const Eigen::Isometry3d& T);
Eigen::Isometry3d screw_exp(const Vec6& xi);

struct PoseAt {
  bool is_known = false;                     // inside the log, no gap too wide
  Pose<frame::Base, frame::Flange> T_base_flange;
  Vec3 velocity_mm_s = Vec3::Zero();         // of the flange's origin, base
  Vec3 turn_rad_s = Vec3::Zero();            // base
  double gap_s = 0;                          // between the samples around it
  double sigma_mm = 0;                       // what the interpolation may miss: a h^2 / 8
};

class Trajectory {
 public:
  /// `gap_max_s`: wider gaps are not bridged (a log whose own cycle is longer may be bridged over two cycles).
  Trajectory(const RobotTrack& track, double gap_max_s);
  double begin_s() const { return t_.front(); }
  double end_s() const { return t_.back(); }
  /// Cubic on the screw coordinates of the four samples around (Catmull-Rom, times need not be even): once differentiable,
  /// exact for a motion of constant twist.
  PoseAt at(double t_s) const;
  int lost_count() const { return lost_count_; }      // samples that are missing between those that are there
  double gap_widest_s() const { return gap_widest_s_; }
  double gap_widest_at_s() const { return gap_widest_at_s_; }
  double speed_max_mm_s() const;

 private:
  std::vector<double> t_;
  std::vector<Eigen::Isometry3d> T_;
  std::vector<double> acceleration_mm_s2_;            // around each sample
  double gap_max_s_ = 0, gap_widest_s_ = 0, gap_widest_at_s_ = 0;
  int lost_count_ = 0;
};

}  // namespace asbuilt::fuse_detail
