// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7a's artefact: where the tip goes, pass by pass, in the part's frame, with the feed. No robot yet.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

enum class PathPointKind { lead_in, cut, lead_out };
inline std::string_view name_of(PathPointKind k) {
  return k == PathPointKind::lead_in ? "lead_in" : k == PathPointKind::cut ? "cut" : "lead_out";
}

struct PathPoint {
  Vec3 tip_part = Vec3::Zero();    // TCP
  Vec3 axis_part = -Vec3::UnitZ(); // tool z, unit, from the spindle to the work
  double feed_mm_s = 0;            // speed of the TCP on the way TO this point; a multiple of 0.1 mm/s
  PathPointKind kind = PathPointKind::cut;
  double s_mm = 0;                 // station on the edge
  double leg_1_mm = 0, leg_2_mm = 0;       // chamfer legs this point is planned to leave (mean = recipe width)
  double probability_ratio = 1;            // that both legs are in tolerance here
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("tip", s.tip_part), a("axis", s.axis_part), a("feed", s.feed_mm_s), a("kind", s.kind), a("s", s.s_mm), a("leg_1", s.leg_1_mm);
    a("leg_2", s.leg_2_mm), a("probability", s.probability_ratio);
  }
};

/// One visit of the cutter: lead in, along one edge or a chain of edges, lead out. Never lifts in between.
struct CutPass {
  std::string feature, recipe, tool;  // ids
  std::vector<int> edges;             // indices into Features::edges, in cutting order
  int pass = 1, passes = 1;           // this pass, of how many over these edges
  std::vector<PathPoint> points;
  Vec3 retract_part = Vec3::UnitZ();  // unit, away from the material at both ends: approach and retract go along it
  double approach_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("feature", s.feature), a("recipe", s.recipe), a("tool", s.tool), a("edges", s.edges), a("pass", s.pass), a("passes", s.passes);
    a("points", s.points), a("retract", s.retract_part), a("approach", s.approach_mm);
  }
};

struct ToolPath {
  std::vector<CutPass> passes;               // in working order
  std::vector<std::vector<double>> edge_feed_mm_s;  // parallel to Features::edges and their s_mm: slowest planned feed at the station
  std::vector<int> edge_passes_count;               // parallel to Features::edges
  std::vector<double> edge_probability_ratio;       // parallel to Features::edges: P(whole edge in tolerance)
  std::vector<double> edge_share_ratio;             // parallel to Features::edges: expected share of the edge in tolerance (the gate)
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("passes", s.passes), a("edge_feed", s.edge_feed_mm_s), a("edge_passes", s.edge_passes_count);
    a("edge_probability", s.edge_probability_ratio), a("edge_share", s.edge_share_ratio);
  }
};

}  // namespace asbuilt
