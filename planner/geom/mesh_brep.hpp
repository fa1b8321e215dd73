// SPDX-License-Identifier: GPL-3.0-or-later
// A part given as triangles (STL, PLY, OBJ, 3MF) as faces and edges: regions bounded by sharp edges, planes and cylinders where
// the triangles lie on them, patches of triangles elsewhere.
#pragma once

#include "planner/geom/brep.hpp"

namespace asbuilt {

/// Frames: as the mesh (part). Units: mm, rad.
/// Method: vertices are welded; triangles are joined over edges whose normals differ by less than sharp_rad; coplanar groups inside
/// a region become faces of their own, so that a fillet does not swallow the planes beside it; each face is fitted by a plane or a
/// cylinder when all its vertices lie within max(0.005 mm, 1e-5 of the diagonal), else it stays a patch (FacetSurface). Edges are
/// chains of mesh edges between two faces; samples are moved onto both surfaces where these are exact.
/// Face ids are "face_1", .., edge ids "edge_1", ..; volume is that of the closed mesh.
Brep brep_from_mesh(const Mesh& mesh, double sharp_rad = 0.5235987755982988);

/// The same where the faces are given: group[t] is the index into `ids` of triangle t. A group that falls apart becomes several faces.
Brep brep_from_mesh(const Mesh& mesh, const std::vector<int>& group, const std::vector<std::string>& ids,
                    double sharp_rad = 0.5235987755982988);

}  // namespace asbuilt
