// SPDX-License-Identifier: GPL-3.0-or-later
// The heights along one edge from its section: which way the fin leans, how the captures look at it, how far each capture that does
// not see one of the two faces is off over it, and the chain of heights over all of them.
#pragma once

#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/burr/profile.hpp"
#include "planner/burr/section.hpp"

namespace asbuilt::burring {

/// Reorders v; 0 of an empty one.
double quantile(std::vector<double>& v, double q);

struct HeightOptions {
  double threshold_mm = 0.03;  // samples below are not reported
  double limit_mm = 0;         // tallest burr that the recipe removes: the grid of heights reaches beyond it
};

struct EdgeHeights {
  ChainPosterior posterior;
  std::vector<double> lean_rad;    // by station: the fin's angle of (f_1, f_2); NaN where none was found on the whole edge
  std::vector<double> density;     // samples per mm^2 of fin to be expected; 0 where nothing was seen
  std::vector<double> least;       // and on a fin leaning the worst way, where the lean is not known
  std::vector<double> shared_sd_mm;  // of what is common to neighbouring stations: zeros of captures
  std::vector<HeightSample> samples;
};

/// `section.proud` sorted by s_mm; the zeros that are found are taken off its points, and what then does not stand out is removed.
/// Method: captures that see both faces first; then, one by one, each other capture at the zero under which its samples agree best
/// with the heights so far (maximum a posteriori, prior from the location).
EdgeHeights find_heights(const HeightOptions& options, const MeasuredCloud& cloud, const AdaptedEdge& edge, EdgeSection& section,
                         const std::vector<double>& coverage);

}  // namespace asbuilt::burring
