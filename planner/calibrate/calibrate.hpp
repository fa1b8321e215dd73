// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 2: captures of a known target -> where a sensor or tool really sits, how well that is known, and what was wrong.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/base/result.hpp"
#include "planner/calibrate/arm.hpp"
#include "planner/calibrate/solve.hpp"

namespace asbuilt {

/// What was seen of the target in one capture.
struct SeenLine {
  std::string name, text;
  bool is_seen = true;
};

/// Against the calibration until now.
struct DriftLine {
  std::string file, created;
  double shift_mm = 0, turn_rad = 0;      // at the point the sensor looks at, and the turn
  double shift_sd_mm = 0, turn_sd_rad = 0;
  double probability_ratio = 1;           // that a sensor which did not move shows this much
};

struct CalibrationResult {
  Calibrated solved;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;  // of a tool: flange, tool; of a fixed sensor: base, sensor
  Mat6 covariance = Mat6::Zero();
  double accuracy_mm = 0;                              // held out
  std::optional<CameraConstants> camera;               // where it was solved for or given
  std::optional<double> scale_ratio, scale_sd_ratio;   // lengths of the sensor by the robot's moves (of a camera: of the board)
  std::optional<double> length_ratio, length_sd_ratio; // by the target's own known lengths
  std::optional<double> radius_mm, radius_sd_mm;       // of a ball, when it is left free
  std::optional<DriftLine> drift;
  std::vector<SeenLine> seen;
  std::vector<ReferenceView> references;
  std::vector<ArmLine> arm;                            // Subject::robot
  std::vector<std::string> arm_held;                   // directions the captures say nothing about
  std::optional<OpwParameters> arm_additions;          // to the cell's constants
};

/// Frames    T_flange_sensor and its covariance as in the calibration file: child frame, translation first.
/// Units     mm, rad, px.
/// Method    detection by kind of target; closed forms as starts; one joint solve (network.hpp); held-out views.
/// Refuses   calibrate.target_not_seen, calibrate.no_start, calibrate.intrinsics_stale, calibrate.scale_wrong, calibrate.corner_not_square,
///           calibrate.motions_incongruent, calibrate.target_not_supported, calibrate.arm_not_opw and those of calibrate_network.
Result<Done<CalibrationResult>> calibrate(const CalibrationRequest& request, const CalibrateRecipe& recipe = {});

/// The report for people, from the same numbers.
std::string calibration_report(const CalibrationRequest& request, const CalibrationResult& result);

}  // namespace asbuilt
