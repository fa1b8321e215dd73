// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7b: tool path -> joint motion from home to home: turn about the tool axis, branch, approach, retract, transfers,
// limits, singularity, and a clearance certificate for every segment.
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/motion.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct MotionRecipe {
  double clearance_mm = 3.0;           // everything but the cutter at its edge: holds what the robot's own error can take of it
  double joint_margin_rad = 0.02;      // from the joint limits, everywhere
  double transfer_speed_ratio = 0.3;   // of the joints' limits
  double approach_speed_mm_s = 50;     // of approach and retract
  int planner_iterations_count = 20000;  // of the search for a free move, where neither the straight nor a raised one holds
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("clearance", s.clearance_mm), a("joint_margin", s.joint_margin_rad), a("transfer_speed", s.transfer_speed_ratio);
    a("approach_speed", s.approach_speed_mm_s), a("planner_iterations", s.planner_iterations_count);
  }
};

/// Plans every pass in the path's order: turn about the tool axis and branch of the arm (near the posture that the points were
/// corrected for, else near home), approach and retract along a straight line, the cut, and the free moves between, from home to
/// home. Every motion is certified as it will be driven, not sampled.
///
/// Frames    base.
/// Units     mm, rad, mm/s (multiples of 0.1), s.
/// Method    turns at 5 degrees and all branches of the closed-form inverse, followed and costed; the cheapest that is certified
///           wins; a ladder (dynamic programming) where no constant turn holds. Clearance certificates after Schwarzer, Saha and
///           Latombe (2005) on the part's mesh as it was measured. Feeds go down, never below the recipe's, where joints need it.
/// Refuses   motion.unreachable (how far), motion.joint_limit (which joint), motion.singular, motion.collision (which pair, where,
///           how near), motion.no_approach, motion.left_reference, motion.no_transfer, motion.joint_speed, motion.tool_change, motion.nothing_to_do,
///           robot.bad_kinematics.
Result<Done<Motion>> plan_motion(const MotionRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs, const ToolPath& path);

}  // namespace asbuilt
