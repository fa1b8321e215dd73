// SPDX-License-Identifier: GPL-3.0-or-later
// What the fit starts from: the edges to be worked with their stations, the faces beside them, the captures worth using.
#pragma once

#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"
#include "planner/fit/associate.hpp"
#include "planner/fit/bundle.hpp"
#include "planner/fit/fit.hpp"

namespace asbuilt::fitting {

struct Setup {
  std::vector<EdgeModel> edges;        // in order of feature, then of Brep edge
  std::vector<FaceModel> faces;
  std::vector<CaptureModel> captures;  // parallel to MeasuredCloud::captures
  std::vector<char> is_fine;           // captures of the sensors that decide
  PolylineIndex all_edges;             // every edge of the part that is one
  std::vector<int> all_edges_index;    // line of all_edges -> Brep edge
  double band_mm = 0;                  // distance from an edge within which points are not trusted
  double reach_mm = 14;
};

/// Refuses fit.tangent (an edge whose faces hardly meet at an angle) and fit.no_face (an edge with one face only).
Result<Setup> prepare(const FitRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location);

}  // namespace asbuilt::fitting
