// SPDX-License-Identifier: GPL-3.0-or-later
// The nominal robot: forward and inverse kinematics, Jacobian, limits. Angles rad, lengths mm, frame base.
#pragma once

#include <memory>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/motion.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

class Robot {
 public:
  /// From the cell's robot: OPW constants, or a URDF chain (whose OPW constants are derived where it has them; else the
  /// inverse is numeric). Refuses robot.bad_kinematics.
  static Result<Robot> from(const RobotSpec& spec);

  const RobotSpec& spec() const;
  bool is_opw() const;
  Pose<frame::Base, frame::Flange> forward(const JointVector& q_rad) const;
  /// How a mesh drawn in base with every joint at 0 moves: base (identity), then links 1..6.
  std::array<Pose<frame::Base, frame::Base>, 7> link_motion(const JointVector& q_rad) const;
  /// Every solution inside the joint limits, all full turns included, in a fixed order. Each reproduces the pose to 1e-6 mm.
  std::vector<JointVector> inverse(const Pose<frame::Base, frame::Flange>& T_base_flange) const;
  /// The solution nearest to `near` (largest joint difference), or none.
  std::optional<JointVector> inverse_near(const Pose<frame::Base, frame::Flange>& T_base_flange, const JointVector& near_rad) const;
  /// Geometric Jacobian of the point p (fixed to the flange, given in base): rows v (mm/rad), then w, in base.
  Mat6 jacobian(const JointVector& q_rad, const Vec3& p_base) const;
  /// Smallest singular value of the Jacobian at the flange with lengths divided by the arm's reach.
  double singularity_ratio(const JointVector& q_rad) const;
  /// Smallest distance to a joint limit; negative outside.
  double joint_margin_rad(const JointVector& q_rad) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace asbuilt
