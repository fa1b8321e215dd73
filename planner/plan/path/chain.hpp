// SPDX-License-Identifier: GPL-3.0-or-later
// Edges of one feature, put one after the other so that the cutter need not lift: along smooth joints, and around outer corners by
// running both lines on to where they meet. Frame: part.
#pragma once

#include <vector>

#include "planner/artefacts/features.hpp"
#include "planner/plan/path/chamfer.hpp"

namespace asbuilt {

/// An edge in the direction of cutting, with the cutter placed at every station.
struct PlacedEdge {
  int edge = -1;                   // index into Features::edges
  bool is_reversed = false;
  bool is_closed = false;
  std::vector<EdgeStation> station;
  std::vector<CutterPlacement> at;       // finishing depth
  std::vector<double> s_mm;        // of the adapted edge (falls where reversed)
  std::vector<int> index;          // station index in the adapted edge
};

enum class Joint { none, smooth, corner };
struct ChainLink {
  int placed = -1;                 // index into the placed edges
  Joint to_next = Joint::none;
  Vec3 corner_out = Vec3::Zero(), corner_in = Vec3::Zero();  // tips at a corner: on this edge's line, on the next one's
};
struct Chain {
  std::vector<ChainLink> links;
  bool is_closed = false;          // the last link joins the first
};

/// The tangent's direction for climb milling: material on the right of the feed for a spindle turning clockwise seen from above.
bool is_climb(const EdgeStation& station, const CutterPlacement& at);

/// Every placed edge ends up in exactly one chain; order by first edge, deterministic.
std::vector<Chain> chain_edges(const std::vector<PlacedEdge>& edges, double reach_mm);

}  // namespace asbuilt
