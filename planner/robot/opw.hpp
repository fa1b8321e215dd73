// SPDX-License-Identifier: GPL-3.0-or-later
// Closed-form inverse of arms with an ortho-parallel basis and a spherical wrist (Brandstoetter, Angerer, Hofbaur 2014), and
// how to find their constants in a chain of axes. Internal to the room.
#pragma once

#include <array>
#include <optional>

#include "planner/artefacts/job.hpp"
#include "planner/robot/kinematic_chain.hpp"

namespace asbuilt {

/// T_base_flange = T_base_arm * OPW(theta) * T_wrist_flange; theta_i = signs_i * q_i - offsets_i.
struct OpwArm {
  OpwParameters constants;
  Rigid T_base_arm, T_wrist_flange;
};

struct OpwSolutions {
  std::array<JointVector, 8> q_rad;   // within (-pi, pi]
  std::array<bool, 8> is_valid{};
  bool is_wrist_singular = false;     // of any valid branch: joints 4 and 6 turn about one line and joint 4 was set to theta 0
};

KinematicChain chain_of(const OpwParameters& constants);
/// Eight branches before limits, each checked by forward kinematics. Order: shoulder front/back, elbow, wrist unflipped/flipped.
OpwSolutions solve_opw(const OpwArm& arm, const Rigid& T_base_flange);
/// The constants of a chain that is ortho-parallel with a spherical wrist within the tolerances; none otherwise.
std::optional<OpwArm> opw_of(const KinematicChain& chain, const Rigid& flange_at_zero, double tolerance_mm, double tolerance_rad);

}  // namespace asbuilt
