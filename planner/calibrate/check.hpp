// SPDX-License-Identifier: GPL-3.0-or-later
// The interim check: does the sensor still see the target where its calibration says. One capture is enough.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct CheckRecipe {
  double alarm_probability_ratio = 1e-3;  // a sensor that has not moved alarms this often
  double near_mm = 2, near_rad = 0.0052;  // a reference this near was taken from the same pose: only the robot's repeatability counts
  double scale_max_ratio = 0.005;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("alarm_probability", s.alarm_probability_ratio), a("near", s.near_mm), a("near_angle", s.near_rad), a("scale_max", s.scale_max_ratio);
  }
};

struct CheckLine {
  std::string name, reference;
  bool is_same_pose = false;     // the reference was taken from there
  double shift_mm = 0, shift_sd_mm = 0;  // of what the sensor looks at
  double turn_rad = 0, turn_sd_rad = 0;  // 0 where the target tells no turn
  double probability_ratio = 1;  // that an unmoved sensor shows this much
  double shift_seen_mm = 0, turn_seen_rad = 0;  // smallest that would alarm nine times of ten
};

struct CheckResult {
  std::vector<CheckLine> lines;
  double probability_ratio = 1;  // of all captures together
  std::optional<double> length_ratio, length_sd_ratio;  // by the target's own lengths
  std::optional<double> move_ratio, move_sd_ratio;      // by known moves of the robot, with two captures or more
};

/// Frames    shifts and turns are those of the sensor against what carries it, in the sensor's frame.
/// Method    the target's pose now against the reference's carried over by the commanded poses; covariance of both measurements
///           and of the robot (repeatability where the pose is the reference's, else absolute).
/// Refuses   calibrate.no_reference, calibrate.target_not_seen, calibrate.sensor_moved, calibrate.scale_wrong.
Result<Done<CheckResult>> check_calibration(const CalibrationRequest& request, const EarlierCalibration& calibration, const CheckRecipe& recipe = {});

std::string check_report(const CalibrationRequest& request, const CheckResult& result);

}  // namespace asbuilt
