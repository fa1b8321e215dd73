// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 4: where the part really sits, found without any guess beyond the fixture's nominal pose and play.
#pragma once

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct LocateRecipe {
  double margin_min = 8.0;                  // log-likelihood ratio to the second-best hypothesis
  double inlier_ratio_min = 0.6;            // of the predicted-visible area
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("margin_min", s.margin_min), a("inlier_ratio_min", s.inlier_ratio_min);
  }
};

/// Refuses locate.ambiguous, locate.unobservable, locate.no_match, locate.captures_contradict, locate.outside_play, ...
Result<Done<Location>> locate(const LocateRecipe& recipe, const Job& job, const MeasuredCloud& cloud);

}  // namespace asbuilt
