// SPDX-License-Identifier: GPL-3.0-or-later
// Two streams of poses with clocks of their own, robot and sensor: their offset from the motion itself, and views for a solve.
#pragma once

#include <vector>

#include "planner/base/result.hpp"
#include "planner/calibrate/hand_eye.hpp"

namespace asbuilt {

struct TimedPose {
  double t_s = 0;
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Vec3 p_mm = Vec3::Zero();
};

struct MotionStreamRecipe {
  double offset_max_s = 1.0;    // searched both ways
  double step_s = 0.2;          // motion is compared over this long
  double gap_max_s = 0.1;       // no interpolation across longer gaps
  double second_peak_max_ratio = 0.8;
  double turn_min_rad = 0.02;   // a view every so much of turn
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("offset_max", s.offset_max_s), a("step", s.step_s), a("gap_max", s.gap_max_s), a("second_peak_max", s.second_peak_max_ratio), a("turn_min", s.turn_min_rad);
  }
};

struct StreamMatch {
  double offset_s = 0, offset_sd_s = 0;  // t_robot = t_sensor + offset
  double peak_ratio = 0;                 // correlation of the turning speeds at the offset
  double second_peak_ratio = 0;          // best other peak over it
};

/// Method  turning speed of both streams (which no hand-eye changes) correlated, then the squared difference of the turns minimised
///         over the offset; sd from its curvature.
/// Refuses calibrate.streams_do_not_match (too little motion, or two offsets as good).
Result<StreamMatch> match_streams(const MotionStreamRecipe& recipe, const std::vector<TimedPose>& robot, const std::vector<TimedPose>& sensor);

/// The pose at a time, by interpolation on SE(3); none across gaps and outside.
std::optional<TimedPose> pose_at(const std::vector<TimedPose>& stream, double t_s, double gap_max_s);

}  // namespace asbuilt
