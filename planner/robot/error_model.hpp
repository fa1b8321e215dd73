// SPDX-License-Identifier: GPL-3.0-or-later
// How far the real arm is from its model, as a linear Gaussian model over its kinematic parameters: axis shifts and tilts,
// joint zeros, gear waves, sag. Errors at two postures are correlated by the arm itself, so the error of a scan relative to the
// cut falls out: covariance of (J(q_scan) - J(q_cut)) eta plus the scatter of single motions.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "planner/robot/robot.hpp"

namespace asbuilt {

class RobotErrorModel {
 public:
  /// Scaled so that the mean length of the error at the tool over the working volume, after the best rigid fit of the base, is
  /// the cell's `accuracy.absolute.mean`; the scatter between motions of one batch is `accuracy.short_term`.
  RobotErrorModel(const Robot& robot, const Pose<frame::Flange, frame::Tool>& T_flange_tool);

  /// Number of parameters; each is standard normal a priori. Per joint: shift of its axis (3), tilt (2), zero, gear wave
  /// (sin q, cos q, sin 2q, cos 2q); then sag under gravity of joints 2 and 3. The rigid motion of the whole base that a tracker
  /// would find and take away is taken away here too.
  int size() const;
  /// How far the typical magnitudes were stretched to meet the cell's accuracy.
  double scale_ratio() const;
  /// 6 x size: twist of the flange in its own frame (translation mm, then rotation rad) per unit of each parameter:
  /// T_base_flange_true = T_base_flange_commanded.disturbed(twist(q) * eta + scatter).
  Eigen::MatrixXd twist(const JointVector& q_rad) const;
  /// Covariance of the scatter of one motion, flange frame, same order.
  Mat6 scatter(const JointVector& q_rad) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace asbuilt
