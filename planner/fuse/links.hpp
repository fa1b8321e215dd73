// SPDX-License-Identifier: GPL-3.0-or-later
// What ties the captures to each other: surface that two of them saw, and which relative motions that surface tells.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/cloud.hpp"

namespace asbuilt {

struct LinkRecipe {
  double cell_mm = 3;         // surface is compared in cells of this size; coarser captures in cells of four spacings
  int points_min_count = 5;   // of a capture in a cell
  double turn_max_rad = 0.35; // between the normals of the two: more is another face
};

/// Two captures and the surface they share, as a link of a pose graph with point-to-plane factors.
struct CaptureLink {
  int first = 0, second = 0;       // indices into MeasuredCloud::captures, first < second
  int cells_count = 0;             // shared
  double rms_mm = 0;               // distance of the two along the normal, before any refinement
  std::array<double, 6> sd_mm{};   // of their relative pose by the shared surface alone, ascending; turns through the shared part's size
  Vec6 weakest = Vec6::Zero();     // the direction of the last: shift and turn (times size), base, about the shared part's middle
  std::string text;                // the same in words
};

/// Every pair with at least six shared cells, in order of first and second. The same for any order of points.
/// Method    cells of both averaged; normal equations of the point-to-plane distance in all six relative motions, noise of both captures.
std::vector<CaptureLink> capture_links(const MeasuredCloud& cloud, const LinkRecipe& recipe = {});

}  // namespace asbuilt
