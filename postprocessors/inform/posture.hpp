// SPDX-License-Identifier: GPL-3.0-or-later
// The form of the arm that a joint vector has, as INFORM's RCONF names it (dialect.md, section "Posture").
#pragma once

#include <array>

#include "postprocessors/post.hpp"

namespace asbuilt::inform {

/// How flip and no-flip are told apart; the documents disagree, so it is a machine option (`inform.flip`).
enum class FlipRule { r_axis, b_axis };

struct Posture {
  bool is_no_flip = false, is_lower_arm = false, is_rear = false;
  bool is_r_beyond = false, is_t_beyond = false, is_s_beyond = false;  // outside (-180, 180] degrees
};

/// Frames: base. Units: rad. Source: the joint positions by forward kinematics of the cell's own model.
Posture posture_of(const RobotSpec& robot, const JointVector& q_rad, FlipRule rule);

}  // namespace asbuilt::inform
