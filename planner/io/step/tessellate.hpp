// SPDX-License-Identifier: GPL-3.0-or-later
// Faces to triangles that share the edge samples, with area and volume integrated over the exact surfaces.
#pragma once

#include "planner/io/step/chart.hpp"

namespace asbuilt::step {

struct BodyMesh {
  std::vector<Vec3> vertices;
  std::vector<std::array<int, 3>> triangles;  // outward
  std::vector<int> face;                      // of each triangle
  std::vector<double> area_mm2, volume_mm3;   // by face: exact area, its part of the volume integral about `origin`
  Vec3 origin = Vec3::Zero();
  double chord_max_mm = 0;
};

/// Samples the edges, flattens and triangulates every face, reports what had to be replaced in the faults of the faces.
BodyMesh tessellate(Body& body, const Tolerance& tolerance);

/// Sides of triangles that have no partner running the other way.
int count_open_edges(const std::vector<std::array<int, 3>>& triangles);

}  // namespace asbuilt::step
