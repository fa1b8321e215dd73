// SPDX-License-Identifier: GPL-3.0-or-later
// AP242 bodies given as triangles: TESSELLATED_SOLID and _SHELL with their TRIANGULATED_FACE items.
#pragma once

#include <unordered_map>

#include "planner/geom/brep.hpp"
#include "planner/io/step/bind.hpp"

namespace asbuilt::step {

struct TriangleBody {
  Mesh mesh;                                                    // vertices as given, not welded between faces
  std::vector<int> group;                                       // face of each triangle
  std::vector<std::string> ids;                                 // "#417" of each face
  std::unordered_map<std::int64_t, std::pair<int, int>> lists;  // COORDINATES_LIST -> first vertex and count, read once a body
};

/// Appends the triangles of an item (solid, shell, face, surface set). What cannot be read goes to `unread`.
void read_triangles(const Binder& b, std::int64_t id, TriangleBody& out, std::vector<Unread>& unread, int depth = 0);

}  // namespace asbuilt::step
