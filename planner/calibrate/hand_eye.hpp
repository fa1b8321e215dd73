// SPDX-License-Identifier: GPL-3.0-or-later
// Hand-eye calibration of a sensor on the flange: three closed forms that check each other, then one joint solve in which the
// robot's pose error is modelled, with the covariance that follows. Frames: base, flange, sensor, target. mm, rad.
#pragma once

#include <string>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

/// One capture: the commanded flange pose and the target's points as the sensor saw them.
struct TargetView {
  std::string name;
  Pose<frame::Base, frame::Flange> T_base_flange;
  std::vector<Vec3> p_target;  // the target's points that were seen, in the target's frame
  std::vector<Vec3> p_sensor;  // parallel: as measured
};

/// Pose of the target in the sensor from the points of one view (Horn / Umeyama, no scale). Needs three points off a line.
Pose<frame::Sensor, frame::Target> target_pose(const TargetView& view);

struct HandEyeStart {
  std::string method;  // "park-martin", "andreff", "daniilidis"
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;
  double rotation_rms_rad = 0, translation_rms_mm = 0;  // of A X - X B over the motion pairs
};
/// Motion pairs with at least `min_motion_rad` of rotation enter. Empty when there are none.
/// Sources: [ParkMartin1994], [Andreff2001], [Daniilidis1999]; the dual quaternions' signs are made canonical before stacking.
std::vector<HandEyeStart> hand_eye_starts(const std::vector<TargetView>& views, double min_motion_rad);

struct HandEyeRecipe {
  double sensor_sd_mm = 0.01;         // of one target point
  double robot_sd_mm = 0.25;          // of the flange's position, per axis, per pose
  double robot_sd_rad = 5.2e-4;       // of the flange's orientation, per axis, per pose
  double min_motion_rad = 0.26;       // 15 degrees
  int held_out_every_count = 5;       // every n-th view is kept out of the solve and reports the accuracy
  double spread_min_rad = 0.14;       // the two largest independent rotations between views must reach this
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("sensor_sd", s.sensor_sd_mm), a("robot_sd", s.robot_sd_mm), a("robot_sd_angle", s.robot_sd_rad), a("min_motion", s.min_motion_rad);
    a("held_out_every", s.held_out_every_count), a("spread_min", s.spread_min_rad);
  }
};

struct ViewQuality {
  std::string name;
  bool is_held_out = false;
  double residual_rms_mm = 0;  // before the robot's error is taken out
  double robot_mm = 0, robot_rad = 0;  // the robot error that explains it best
  double chi2_ratio = 0;       // squared whitened residual per degree of freedom; above 4: look at this view
  double leverage_ratio = 0;   // 0..1, how much the answer hangs on this view
};

struct HandEye {
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;
  Pose<frame::Base, frame::Target> T_base_target;
  Mat6 covariance = Mat6::Zero();  // of T_flange_sensor, child frame, t then r
  double held_out_rms_mm = 0;      // the accuracy to quote
  double fit_rms_mm = 0;
  std::vector<HandEyeStart> starts;
  std::vector<ViewQuality> views;
  double spread_rad = 0;           // second-largest independent rotation between the views
};

/// Model      z = (T_base_flange exp(delta) X)^-1 Y a + noise, delta ~ N(0, robot) about the flange, marginalised per view.
/// Method     whitened Gauss-Newton (Ceres), Cauchy loss per view, restarted from each closed form; all must agree.
/// Refuses    calibrate.too_few_views, calibrate.motion_degenerate, calibrate.starts_disagree, calibrate.not_converged.
Result<Done<HandEye>> calibrate_hand_eye(const HandEyeRecipe& recipe, const std::vector<TargetView>& views);

}  // namespace asbuilt
