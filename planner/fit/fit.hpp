// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 5: the actual edges: robust surface fits with the nominal as prior, and their intersection, with sigma.
#pragma once

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct FitRecipe {
  double station_mm = 0.5;
  double deviation_max_mm = 3.0;  // a fitted edge farther than this from its drawing at the located place is refused
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("station", s.station_mm), a("deviation_max", s.deviation_max_mm);
  }
};

/// Refuses fit.edge_not_seen, fit.too_few_points, fit.tangent, fit.deviation_above_limit, fit.captures_contradict, ...
Result<Done<Features>> fit(const FitRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location);

}  // namespace asbuilt
