// SPDX-License-Identifier: GPL-3.0-or-later
// What each edge of a body is: its two faces, their outward normals along it, the angle between them, convex or concave.
#pragma once

#include "planner/io/step/sample.hpp"

namespace asbuilt::step {

/// Edges in body order; face indices are those of the body. Samples run as face_1 uses the edge (interior on the left), so an
/// edge is convex where (n_1 x n_2) . tangent > 0.
std::vector<BrepEdge> classify_edges(const Body& body, double step_mm, double step_rad);

}  // namespace asbuilt::step
