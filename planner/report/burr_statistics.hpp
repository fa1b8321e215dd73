// SPDX-License-Identifier: GPL-3.0-or-later
// What may be said of a whole row of measured heights: its mean, how many of its stations count as independent, and whether it is
// equivalent to a reference within a margin. Not to differ significantly proves nothing; equivalence has to be shown (two
// one-sided tests, Schuirmann 1987).
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"

namespace asbuilt {

struct Equivalence {
  std::size_t count = 0;
  double count_effective = 0;  // from the correlation along the row
  double mean = 0, sd = 0, standard_error = 0;
  double margin = 0, p = 1;    // of "the mean lies outside +-margin"
  bool is_equivalent = false;  // p < 0.05
};

/// NaN values are left out; neighbours in the list are neighbours along the edge.
///
/// Method    effective count n / (1 + 2 sum of autocorrelations while they are positive); Student's t with that many - 1 degrees.
/// Promises  never more effective values than values; a longer run of the same values gives no smaller p of a mean outside.
Equivalence equivalence_to_zero(const std::vector<double>& values, double margin);

struct FeatureBurr {
  std::string feature;
  double mean_mm = 0, max_mm = 0, seen_ratio = 0, bare_ratio = 0;  // of the stations
  Equivalence to_none;                                             // mean height against no burr at all
};
std::vector<FeatureBurr> burr_by_feature(const Features& features, const Burrs& burrs, double margin_mm = 0.05);

}  // namespace asbuilt
