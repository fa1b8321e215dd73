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

/// Frames    cloud in base as commanded; out: everything as the controller has to be told (the robot's error at the cut is taken
///           off), see Location.
/// Method    starts over the fixture's play (every rotation by votes where the turn is open, or where nothing fits in the play),
///           descent on the drawing's distance grid, likelihood along rays; then one adjustment of part, arm, hand-eye and the
///           part's own imperfection (robust Gauss-Newton, captures tied by shared cells).
/// Refuses   locate.no_match, locate.ambiguous, locate.not_converged, locate.captures_contradict, locate.unobservable,
///           locate.outside_play, and what Robot::from refuses.
/// Promises  same bytes for same bytes and for points in any order; moving the scan moves the answer.
Result<Done<Location>> locate(const LocateRecipe& recipe, const Job& job, const MeasuredCloud& cloud);

}  // namespace asbuilt
