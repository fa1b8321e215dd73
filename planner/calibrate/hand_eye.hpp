// SPDX-License-Identifier: GPL-3.0-or-later
// Closed forms for A X = X B and A X = Y B from whole poses: they check each other and start the joint solve. mm, rad.
#pragma once

#include <string>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/calibrate/network.hpp"

namespace asbuilt {

/// One view as a pair of whole poses.
struct MotionView {
  std::string name;
  Pose<frame::Place, frame::Mount> T_place_mount;      // by the robot
  Pose<frame::Sensor, frame::Target> T_sensor_target;  // by the sensor
};

struct MotionStart {
  std::string method;  // "park-martin", "andreff", "daniilidis", "shah"
  Pose<frame::Mount, frame::Sensor> T_mount_sensor;
  Pose<frame::Place, frame::Target> T_place_target;
  double rotation_rms_rad = 0, translation_rms_mm = 0;  // of A X - Y B over the views
};

/// The robot's pose of a view as place-mount: base-flange, or flange-base where the sensor is fixed.
Pose<frame::Place, frame::Mount> place_mount(const Pose<frame::Base, frame::Flange>& T_base_flange, bool is_sensor_fixed);

/// Pose of a set of points from where they were measured (Horn / Umeyama, no scale). Needs three points off a line.
Pose<frame::Sensor, frame::Target> pose_of_points(const std::vector<Vec3>& p_target, const std::vector<Vec3>& p_sensor);

/// Motion pairs with at least `min_motion_rad` of rotation enter. Empty when there are none.
/// Sources: [ParkMartin1994], [Andreff2001], [Daniilidis1999], [Shah2013]; the dual quaternions' signs are made canonical before
/// they are stacked.
std::vector<MotionStart> motion_starts(const std::vector<MotionView>& views, double min_motion_rad);

/// Robot and sensor must have turned by the same angle between two views, whatever X and Y are. For each view the median over its
/// pairs of that difference (rad): a wrong pose or image stands out alone, a wrong angle convention in all of them.
std::vector<double> motion_disagreement_rad(const std::vector<MotionView>& views);

/// The turns of the robot between the views: principal axes in the mount's frame (columns, largest first) and root mean square
/// turn about each (rad).
struct MotionSpread {
  Mat3 axes = Mat3::Identity();
  Vec3 rms_rad = Vec3::Zero();
};
MotionSpread motion_spread(const std::vector<Pose<frame::Place, frame::Mount>>& views);

/// Where a board looks the same after half a turn (or a quarter), an image does not say which: picks for each view the turn
/// about its z that agrees best with the robot's motions. `turned[k][i]`: the view's pose after the i-th turn.
std::vector<int> choose_turns(const std::vector<Pose<frame::Place, frame::Mount>>& robot, const std::vector<std::vector<Pose<frame::Sensor, frame::Target>>>& turned);

}  // namespace asbuilt
