// SPDX-License-Identifier: GPL-3.0-or-later
// Edges that run on as each other over their ends: one workable edge each.
#pragma once

#include <string>
#include <vector>

#include "planner/geom/brep.hpp"

namespace asbuilt {

struct EdgeChain {
  std::string id;  // of its first edge
  EdgeKind kind = EdgeKind::sharp_convex;
  std::vector<int> edges;        // in order along the chain
  std::vector<bool> is_forward;  // against the samples of the edge when false
  bool is_closed = false;
  double length_mm = 0;
};

/// Chains of the sharp convex and the sharp concave edges. Frame: part. Two edges of one kind are joined where they end at one point, turn
/// by at most `turn_rad` there, and each is the other's straightest continuation (one that a third edge rivals within a degree is left
/// open). Every such edge is in exactly one chain; a closed edge is a chain of its own. Sorted by the first edge.
std::vector<EdgeChain> edge_chains(const Brep& brep, double turn_rad = rad_from_deg(30));

}  // namespace asbuilt
