// SPDX-License-Identifier: GPL-3.0-or-later
// When the fit says no: what was not seen, what does not agree, what is not there any more.
#pragma once

#include "planner/base/result.hpp"
#include "planner/fit/finish.hpp"

namespace asbuilt::fitting {

/// After the first association: faces and edges with too little on them. fit.too_few_points, fit.edge_not_seen.
Refusals check_seen(const Setup& setup, const std::vector<Cell>& cells, const Job& job);
/// After tracing: fit.tangent (fitted faces hardly meet), fit.deviation_above_limit.
Refusals check_traced(const FitRecipe& recipe, const Setup& setup, const std::vector<Traced>& traced, const Job& job);
/// The two captures that put one face farthest apart, by their residuals where both saw it.
struct Disagreement {
  double distance_mm = 0, noise_mm = 0;  // noise: of a point of the sensors that decide
  int places_count = 0;                  // seen by both, 4 mm apart
  int slot = -1, capture_a = -1, capture_b = -1;
};
Disagreement worst_disagreement(const Setup& setup, const MeasuredCloud& cloud, const Location& location, const std::vector<Cell>& cells,
                                const Bundle& bundle);
/// Two captures that put one face in two places: fit.captures_contradict, with the worst pair.
Refusals check_captures(const Solved& solved);
/// Points where the material of the edge should be but is not: fit.edge_broken.
Refusals check_broken(const Solved& solved, const Features& features);

}  // namespace asbuilt::fitting
