// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 6: what stands proud of the fitted faces along every edge, in numbers, with what was not seen.
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct BurrRecipe {
  double window_mm = 0.5;         // half length of a station's window along the edge
  double coverage_min_ratio = 0.5;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("window", s.window_mm), a("coverage_min", s.coverage_min_ratio);
  }
};

/// Refuses burr.above_limit (taller than the recipe may remove), burr.not_seen.
Result<Done<Burrs>> measure_burrs(const BurrRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location,
                                  const Features& features);

}  // namespace asbuilt
