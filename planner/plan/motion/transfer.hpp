// SPDX-License-Identifier: GPL-3.0-or-later
// Free moves between passes: straight in joint space, certified as they will be driven.
#pragma once

#include <string>
#include <vector>

#include "planner/base/result.hpp"
#include "planner/plan/motion/pass_motion.hpp"

namespace asbuilt {

struct Transfer {
  std::vector<JointVector> q_rad;  // from start to goal, each leg straight in joint space
  double clearance_mm = 0;
};

/// From one posture to another without touching anything.
///
/// Method    the straight joint move; else by way of raised postures at either end (50 to 400 mm up), straight or over home; else
///           a search (free_move.hpp) of a fixed number of steps and its shortening. Whatever comes out is certified leg by leg.
/// Refuses   motion.no_transfer with the pair that was in the way of the straight move.
Result<Transfer> plan_transfer(const JointVector& q_from, const JointVector& q_to, const PassTools& tools, const std::vector<Watch>& watches,
                               int iterations_count, const std::string& where);

}  // namespace asbuilt
