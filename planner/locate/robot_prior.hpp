// SPDX-License-Identifier: GPL-3.0-or-later
// The robot's error as prior of the adjustment: what the arm's parameters do to the points of a capture, and what they do to
// the tool where it will cut. Small motions are twists about one common point: a point p of base moves by t + w x (p - center).
#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {

/// Parameters: the arm's (each standard normal), then six of a frame error that all calibrations on this flange share, then
/// six by sensor in use (hand-eye), then six by capture (scatter of its motion). Twists: translation mm, rotation rad, base.
struct RobotPrior {
  Vec3 center_base = Vec3::Zero();
  int arm_count = 0, size = 0;
  int flange_at = 0;                     // first of the six shared ones
  std::vector<int> sensor_at;            // by CellSpec::sensors; -1: not in use
  std::vector<int> capture_at;           // by capture
  std::vector<Eigen::MatrixXd> capture;  // 6 x size: twist that takes a capture's points from where they were placed to where they are
  std::vector<Eigen::MatrixXd> cut;      // 6 x size, by capture: twist of the tool's error at the cut around what the capture saw
  Eigen::MatrixXd cut_part;              // the same, averaged over all features
  Eigen::VectorXd sd;                    // a priori, of every parameter
  Eigen::MatrixXd covariance;            // a priori; diagonal but for the hand-eye and scatter blocks
  std::map<std::string, Pose<frame::Base, frame::Tool>> T_base_tool_reference;
  std::vector<Note> notes;
};

struct PriorRequest {
  const Job* job = nullptr;
  const MeasuredCloud* cloud = nullptr;
  Pose<frame::Base, frame::Part> T_base_part;  // good to some mm
};

/// Method: RobotErrorModel::twist at the capture's joints and at the cut's; the cut's posture has the tool along the recipe's
/// axis and turned as in that capture of the feature (tool axis within 15 deg of the flange's) whose predicted error relative
/// to the cut is smallest. Refuses what Robot::from refuses.
Result<RobotPrior> make_robot_prior(const PriorRequest& request);

/// Where a point of base goes under a twist about center.
Vec3 moved(const Vec6& twist, const Vec3& center, const Vec3& p);
/// The same as a pose.
Pose<frame::Base, frame::Base> pose_of_twist(const Vec6& twist, const Vec3& center);

}  // namespace asbuilt
