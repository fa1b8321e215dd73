// SPDX-License-Identifier: GPL-3.0-or-later
// From the solved bundle to the artefact: stations, normals, sigma, status, what moved by how much; and the checks that refuse.
#pragma once

#include <vector>

#include "planner/artefacts/features.hpp"
#include "planner/fit/edge_curve.hpp"
#include "planner/fit/prepare.hpp"

namespace asbuilt::fitting {

/// Everything known when the last bundle is solved.
struct Solved {
  const FitRecipe& recipe;
  const Job& job;
  const MeasuredCloud& cloud;
  const Location& location;
  const Setup& setup;
  const std::vector<Cell>& cells;
  const Bundle& bundle;
  const std::vector<Traced>& traced;  // parallel to setup.edges
};

Features finish(const Solved& solved);

/// Share of each face's side of every station that was seen: 0 none, 1 beside it, 2 within reach.
StationStatus station_status(double nearest_1_mm, double nearest_2_mm);

}  // namespace asbuilt::fitting
