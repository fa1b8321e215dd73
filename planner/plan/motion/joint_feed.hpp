// SPDX-License-Identifier: GPL-3.0-or-later
// Feeds that the joints can follow: lowered where a joint's speed or acceleration would be exceeded.
#pragma once

#include <optional>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/motion.hpp"

namespace asbuilt {

/// Where the joints ask for a feed below the least allowed.
struct FeedFault {
  std::size_t point = 0;  // the block that ends here
  int joint = 0;          // 0..5
  double wanted_mm_s = 0; // what the joint could follow
  bool is_speed = true;   // else acceleration
};

/// Lowers `feed_mm_s` (on the way TO each point; multiples of 0.1 mm/s) until every joint keeps `ratio` of its speed and
/// acceleration limits. A limit of 0 in the cell is no limit.
///
/// Method    joint speed of a block = |dq| feed / length; acceleration at a point = change of joint speed over the mean time of
///           its two blocks, at least 20 ms (controllers smooth below that). Feeds of the two blocks go down together until it
///           fits.
std::optional<FeedFault> follow_with_joints(const std::array<JointSpec, 6>& joints, double ratio, const std::vector<JointVector>& q_rad,
                                            const std::vector<Vec3>& tip_mm, double feed_min_mm_s, std::vector<double>& feed_mm_s);

}  // namespace asbuilt
