// SPDX-License-Identifier: GPL-3.0-or-later
// A free way between two postures where the straight one is blocked: OMPL's RRTConnect (any way) or BIT* (a short one) with a fixed
// seed and a fixed number of steps, shortened, every leg certified.
#pragma once

#include <optional>
#include <vector>

#include "planner/robot/collision.hpp"

namespace asbuilt {

/// Postures from start to goal; each leg, straight in joint space, is certified free. None where the budget did not suffice.
/// The same inputs give the same postures: own sampler, linear nearest neighbours, no clock.
std::optional<std::vector<JointVector>> find_free_move(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start,
                                                       const JointVector& q_goal, int iterations_count);

/// The same by BIT* (Gammell, Srinivasa, Barfoot 2015), which looks on for shorter ways inside what the best one so far leaves open,
/// until `certificates_count` legs were tried. Shortest: in the joints' lengths.
std::optional<std::vector<JointVector>> find_short_move(const CollisionScene& scene, const std::vector<Watch>& watches, const JointVector& q_start,
                                                        const JointVector& q_goal, int certificates_count);

}  // namespace asbuilt
