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
  double clearance_mm = 3.0;          // everything but the cutter at its edge
  double joint_margin_rad = 0.02;
  double transfer_speed_ratio = 0.3;
  double approach_speed_mm_s = 50;
  int planner_iterations_count = 20000;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("clearance", s.clearance_mm), a("joint_margin", s.joint_margin_rad), a("transfer_speed", s.transfer_speed_ratio);
    a("approach_speed", s.approach_speed_mm_s), a("planner_iterations", s.planner_iterations_count);
  }
};

/// Refuses motion.unreachable, motion.singular, motion.collision, motion.no_approach, motion.no_transfer, motion.joint_speed, ...
Result<Done<Motion>> plan_motion(const MotionRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs, const ToolPath& path);

}  // namespace asbuilt
