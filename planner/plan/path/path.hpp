// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7a: adapted edges and burrs -> the path of the tip with its feed, in part. Includes the gate: P(chamfer in tolerance).
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct PathRecipe {
  double contact_height_ratio = 0.5;  // of the cone's flank, from the tip
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("contact_height", s.contact_height_ratio);
  }
};

/// Refuses path.tool_does_not_fit, path.burr_above_limit, path.gate, path.feed_below_min, ...
Result<Done<ToolPath>> plan_path(const PathRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs);

}  // namespace asbuilt
