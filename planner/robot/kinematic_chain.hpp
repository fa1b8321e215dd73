// SPDX-License-Identifier: GPL-3.0-or-later
// Six revolute axes in a row: forward kinematics, Jacobian, and a damped Newton inverse from a given start. Internal to the
// room. Frame base, mm, rad. Joint frames are chosen so that z is the axis: T(q) = A1 Rz(q1) A2 Rz(q2) .. A6 Rz(q6) A7.
#pragma once

#include <array>
#include <optional>

#include "planner/artefacts/motion.hpp"
#include "planner/base/frames.hpp"

namespace asbuilt {

struct Rigid {  // a pose as matrix and vector: the arithmetic here is all matrices
  Mat3 R = Mat3::Identity();
  Vec3 p = Vec3::Zero();
  Rigid operator*(const Rigid& o) const { return {R * o.R, R * o.p + p}; }
  Rigid inverse() const { return {R.transpose(), -(R.transpose() * p)}; }
};
template <class A, class B>
Rigid rigid_of(const Pose<A, B>& T) {
  return {T.rotation(), T.p_mm};
}

struct KinematicChain {
  std::array<Vec3, 6> axis;   // unit, in base, every joint at 0
  std::array<Vec3, 6> point;  // a point of each axis, in base, every joint at 0
  std::array<Rigid, 7> link;  // A1 .. A7
  std::array<Rigid, 6> zero_inverse;  // inverse of the joint frames at 0
  double reach_mm = 0;        // axis 1 to flange, stretched: the length that makes Jacobians dimensionless

  static KinematicChain from_axes(const std::array<Vec3, 6>& axis, const std::array<Vec3, 6>& point, const Rigid& flange_at_zero);
};

/// Frames of the six joints after their own rotation, in base, and the flange last.
std::array<Rigid, 7> joint_frames(const KinematicChain& chain, const JointVector& q_rad);
Rigid flange_of(const KinematicChain& chain, const JointVector& q_rad);

/// Joints near `start` that reach the pose, by Levenberg-Marquardt steps on the pose error; none if it does not converge to
/// 1e-9 mm and 1e-12 rad (or the rounding floor of the arm's size).
std::optional<JointVector> newton_inverse(const KinematicChain& chain, const Rigid& T_base_flange, JointVector start, int iterations_count);

}  // namespace asbuilt
