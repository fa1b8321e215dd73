// SPDX-License-Identifier: GPL-3.0-or-later
// One chain of edges at one depth -> the points of one visit of the cutter: joints, corners, start of a ring, leads, feed. Frame: part.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/tool_path.hpp"
#include "planner/plan/feed/feed.hpp"
#include "planner/plan/path/chain.hpp"
#include "planner/plan/path/tool_fit.hpp"

namespace asbuilt {

/// What is known at every station of an edge beside its shape; arrays parallel to AdaptedEdge::s_mm.
struct EdgeFacts {
  std::vector<BurrBound> burr;
  std::vector<double> probability_ratio;
  std::vector<Vec3> shift;  // adapted minus nominal
};

struct PassSettings {
  double outer_mm = 1e9, inner_mm = 0;  // planes between which the burr is taken; inner 0: finishing
  double lead_mm = 2, clear_mm = 1.0, chord_mm = 0.01;
  double feed_min_mm_s = 1, feed_ceiling_mm_s = 1, removal_max_mm3_s = 1;
};

struct BuiltPass {
  std::vector<PathPoint> points;
  Vec3 retract = Vec3::UnitZ();
  std::vector<int> edges;                        // index into Features::edges, in cutting order
  std::vector<std::vector<double>> feed_mm_s;    // parallel to `edges`, then to the edge's stations; 0 where it does not pass
  Intrusion worst;                               // of the cutter into the part, beyond what is allowed
  int worst_edge = -1;                           // where, and at which station's arc length
  double worst_s_mm = 0;
};

/// `facts` by index into Features::edges. `fit` may be null: no check against the part.
BuiltPass build_pass(const Chain& chain, const std::vector<PlacedEdge>& edges, const std::vector<EdgeFacts>& facts,
                     const PassSettings& settings, const ToolFit* fit);

}  // namespace asbuilt
