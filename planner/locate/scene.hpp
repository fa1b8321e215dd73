// SPDX-License-Identifier: GPL-3.0-or-later
// The measured cloud thinned for the search: one point by cell for matching, one by capture and cell for looking along rays;
// what lies on the known fixture and obstacles is told apart.
#pragma once

#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/geom/mesh_query.hpp"

namespace asbuilt {

struct ScenePoint {
  Vec3 p_base = Vec3::Zero(), n_base = Vec3::Zero();  // normal zero where unknown
  int capture = -1;
  double sigma_mm = 0;
  bool is_known = false;  // within reach of the fixture's or an obstacle's surface
};

struct Scene {
  std::vector<ScenePoint> points;  // for matching: without what is known, in an order that spreads over directions of normals
  std::vector<ScenePoint> rays;    // for looking along, known things included
  MeshQuery known;                 // fixture and obstacles, base
};

/// Method: means over cubic cells; known when within known_reach_mm of a known surface.
Scene make_scene(const Job& job, const MeasuredCloud& cloud, double cell_mm, double known_reach_mm);

}  // namespace asbuilt
