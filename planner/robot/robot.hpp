// SPDX-License-Identifier: GPL-3.0-or-later
// The nominal robot: forward and inverse kinematics, Jacobian, limits. Angles rad, lengths mm, frame base.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <utility>
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
  /// The inverse is closed form: every solution is found.
  bool is_opw() const;
  /// The constants in use: the cell's, or those derived from the chain (then of the arm between its own base and wrist frames).
  const OpwParameters* opw() const;
  /// Axis 1 to flange with the arm stretched: the length that makes Jacobians dimensionless.
  double reach_mm() const;
  Pose<frame::Base, frame::Flange> forward(const JointVector& q_rad) const;
  /// How a mesh drawn in base with every joint at 0 moves: base (identity), then links 1..6.
  std::array<Pose<frame::Base, frame::Base>, 7> link_motion(const JointVector& q_rad) const;
  /// Every solution inside the joint limits, all full turns included, in a fixed order. Each reproduces the pose to 1e-6 mm.
  /// Closed form where the arm is OPW (joint 4 at the middle of its arc where the wrist is exactly singular); otherwise
  /// damped Newton from many fixed starts, which finds what it finds.
  std::vector<JointVector> inverse(const Pose<frame::Base, frame::Flange>& T_base_flange) const;
  /// The solution nearest to `near` (largest joint difference), or none. With an exactly singular wrist joint 4 stays at
  /// `near`'s and joint 6 takes the rest.
  std::optional<JointVector> inverse_near(const Pose<frame::Base, frame::Flange>& T_base_flange, const JointVector& near_rad) const;
  /// The solution that an operator would expect who last saw the arm at `like`: its shoulder and elbow where there is one such, then
  /// the least way of the axes, main axes counting more. For poses far from `like`, where the largest difference says little.
  std::optional<JointVector> inverse_like(const Pose<frame::Base, frame::Flange>& T_base_flange, const JointVector& like_rad) const;
  /// Where a solution belongs: shoulder front or back, elbow up or down, wrist unflipped or flipped (0..7); -1 without OPW.
  int branch(const JointVector& q_rad) const;
  /// Geometric Jacobian of the point p (fixed to the flange, given in base): rows v (mm/rad), then w, in base.
  Mat6 jacobian(const JointVector& q_rad, const Vec3& p_base) const;
  /// Smallest singular value of the Jacobian at the flange with lengths divided by the arm's reach.
  double singularity_ratio(const JointVector& q_rad) const;
  /// Axes of the six joints at this posture, base: unit direction and a point of it.
  std::array<std::pair<Vec3, Vec3>, 6> axes(const JointVector& q_rad) const;
  /// Smallest distance to a joint limit; negative outside.
  double joint_margin_rad(const JointVector& q_rad) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace asbuilt
