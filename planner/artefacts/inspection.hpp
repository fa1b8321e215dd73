// SPDX-License-Identifier: GPL-3.0-or-later
// From where the sensor looks at every edge that is to be worked, in the order of the tour, and what it will see there: predicted
// points, coverage and standard deviation, station by station.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "planner/artefacts/motion.hpp"
#include "planner/base/frames.hpp"

namespace asbuilt {

/// working: the flange stands as it will when the edge is worked; normal: the sensor looks along the mean normal of the edge's faces.
enum class ViewKind { working, normal };
inline std::string_view name_of(ViewKind k) { return k == ViewKind::working ? "working" : "normal"; }

struct ScanView {
  std::string name;                  // "detail_03": also of the capture's cloud
  int sensor = -1;                   // index into CellSpec::sensors
  ViewKind kind = ViewKind::working;
  std::string feature, edge;         // what it was made for
  double s_from_mm = 0, s_to_mm = 0; // the stretch of that edge
  double tilt_rad = 0;               // away from the wanted direction; 0: as wanted
  double turn_rad = 0;               // about the tool's axis (working) or the line of sight (normal)
  double distance_mm = 0;            // from the sensor to the stretch's middle, along its z
  JointVector q_rad{};
  Pose<frame::Base, frame::Flange> T_base_flange;  // forward of q
  double clearance_mm = 1e9;         // at the stop
  double joint_margin_rad = 0;
  std::vector<std::string> edges;    // every edge it sees a station of
  std::vector<double> edges_ratio;   // parallel: share of that edge's stations
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("sensor", s.sensor), a("kind", s.kind), a("feature", s.feature), a("edge", s.edge), a("s_from", s.s_from_mm);
    a("s_to", s.s_to_mm), a("tilt", s.tilt_rad), a("turn", s.turn_rad), a("distance", s.distance_mm), a("q", s.q_rad);
    a("base_flange", s.T_base_flange), a("clearance", s.clearance_mm), a("joint_margin", s.joint_margin_rad), a("edges", s.edges);
    a("edges_ratio", s.edges_ratio);
  }
};

/// Arrays are parallel to s_mm.
struct EdgeForecast {
  int edge = -1;                     // index into Brep::edges
  std::string id, feature;
  std::vector<double> s_mm;
  std::vector<Vec3> p_part;
  std::vector<double> points_1_count, points_2_count;  // expected in the station's window on each face, over all views
  std::vector<int> views_count;                        // that see both faces here
  std::vector<int> seen_working, seen_normal;          // 1: both faces seen from views of that kind
  std::vector<double> sd_mm;                           // 1 sd of the chamfer's leg: sensor, mount, arm between scan and work, tool
  double coverage_ratio = 0, coverage_working_ratio = 0, coverage_normal_ratio = 0;
  double sd_worst_mm = 0, sd_limit_mm = 0;             // the limit: what the recipe's tolerance and gate leave
  double share_ratio = 0;                              // expected share of the edge in tolerance
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edge", s.edge), a("id", s.id), a("feature", s.feature), a("s", s.s_mm), a("p", s.p_part), a("points_1", s.points_1_count);
    a("points_2", s.points_2_count), a("views", s.views_count), a("seen_working", s.seen_working), a("seen_normal", s.seen_normal);
    a("sd", s.sd_mm), a("coverage", s.coverage_ratio), a("coverage_working", s.coverage_working_ratio);
    a("coverage_normal", s.coverage_normal_ratio), a("sd_worst", s.sd_worst_mm), a("sd_limit", s.sd_limit_mm), a("share", s.share_ratio);
  }
};

/// A direction that was tried for a stretch and what came of it.
struct TriedView {
  std::string edge, sensor;
  ViewKind kind = ViewKind::working;
  double s_from_mm = 0, s_to_mm = 0, tilt_rad = 0, distance_mm = 0;
  std::string outcome;               // "chosen", "sees too little", "unreachable", "collision", ...
  int turns_count = 0;               // turns about the line of sight that ended so
  double measured = 0, limit = 0;    // the best of them
  std::string unit;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edge", s.edge), a("sensor", s.sensor), a("kind", s.kind), a("s_from", s.s_from_mm), a("s_to", s.s_to_mm), a("tilt", s.tilt_rad);
    a("distance", s.distance_mm), a("outcome", s.outcome), a("turns", s.turns_count), a("measured", s.measured), a("limit", s.limit), a("unit", s.unit);
  }
};

struct Inspection {
  std::vector<ScanView> views;       // in the order of the tour
  std::vector<EdgeForecast> edges;   // in order of feature, then of edge id
  std::vector<TriedView> tried;
  std::vector<std::string> assumed;  // what the cell does not say about its sensors and was assumed
  Motion motion;                     // from home over every view to home; transfers only
  std::vector<int> stops;            // parallel to motion.segments: index of the view its end stops at; -1: none
  double aim_margin_mm = 0;          // how far the part may lie off without a view losing what it is for
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("views", s.views), a("edges", s.edges), a("tried", s.tried), a("assumed", s.assumed), a("motion", s.motion), a("stops", s.stops);
    a("aim_margin", s.aim_margin_mm);
  }
};

}  // namespace asbuilt
