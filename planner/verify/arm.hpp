// SPDX-License-Identifier: GPL-3.0-or-later
// The verifier's own arm: forward kinematics as a product of joint screws, inverse by Newton steps from the posture before, the way a
// controller follows a straight line. Shares nothing with planner/robot. Frame base, mm, rad.
#pragma once

#include <array>
#include <optional>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/motion.hpp"

namespace asbuilt::verifying {

struct JointAxis {
  Vec3 point = Vec3::Zero(), direction = Vec3::UnitZ();
};

struct ArmState {
  std::array<Eigen::Isometry3d, 7> link;  // how a mesh drawn at joints = 0 moves: base, links 1..6
  std::array<JointAxis, 6> axis;          // in base; direction includes the joint's sign
  Eigen::Isometry3d flange = Eigen::Isometry3d::Identity();
};

class Arm {
 public:
  explicit Arm(const RobotSpec& spec);
  ArmState state(const JointVector& q_rad) const;
  Eigen::Isometry3d flange(const JointVector& q_rad) const { return state(q_rad).flange; }
  /// The joints that reach the flange pose, following on from `from_rad`; nothing where Newton's steps do not arrive.
  std::optional<JointVector> follow(const Eigen::Isometry3d& T_base_flange, const JointVector& from_rad) const;
  /// Smallest singular value of the Jacobian at the flange, lengths divided by the arm's reach.
  double singularity_ratio(const JointVector& q_rad) const;

 private:
  struct Screw {
    Vec3 point = Vec3::Zero(), direction = Vec3::UnitZ();  // at joints = 0, in base
    bool is_prismatic = false;
  };
  std::array<Screw, 6> screw_;
  Eigen::Isometry3d home_ = Eigen::Isometry3d::Identity();  // flange at joints = 0
  double reach_mm_ = 1;
};

}  // namespace asbuilt::verifying
