// SPDX-License-Identifier: GPL-3.0-or-later
// The numbers the report's scripts draw from, small enough to sit inside the page. Frame: part, mm.
#pragma once

#include "planner/artefacts/report.hpp"
#include "planner/base/archive.hpp"

namespace asbuilt {

/// |adapted - nominal| at each station.
std::vector<double> deviation_mm(const AdaptedEdge& edge);
/// Everything the 3D view and the curves need; absent artefacts leave their fields out.
Json page_data(const ItemRecord& record);
/// The mesh with at most `most` triangles (vertices merged on a grid as fine as that allows); unchanged when it has no more.
Mesh thinned(const Mesh& mesh, std::size_t most);
std::string base64(const std::string& bytes);

}  // namespace asbuilt
