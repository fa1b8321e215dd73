// SPDX-License-Identifier: GPL-3.0-or-later
// What each edge of a body is: its two faces, their outward normals along it, the angle between them, convex or concave.
#pragma once

#include "planner/io/step/sample.hpp"

namespace asbuilt::step {

/// Edges in body order; face indices are those of the body. Samples run as face_1 uses the edge (interior on the left), so an
/// edge is convex where (n_1 x n_2) . tangent > 0.
std::vector<BrepEdge> classify_edges(const Body& body, double step_mm, double step_rad);

/// Kind from angle and sign per sample; shared with parts given as meshes.
/// The kind is what the edge is at its sharpest (98 % of its length), the dihedral angle the median along the length.
EdgeKind kind_of(const std::vector<double>& s_mm, const std::vector<Vec3>& tangent, const std::vector<Vec3>& n_1,
                 const std::vector<Vec3>& n_2, double& dihedral_rad);

}  // namespace asbuilt::step
