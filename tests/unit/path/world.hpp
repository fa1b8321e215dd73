// SPDX-License-Identifier: GPL-3.0-or-later
// A small world with known truth for the path's tests: a box whose top edges are to be chamfered, measured without error.
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"

namespace asbuilt::testing {

inline Mesh box_mesh(const Vec3& lo, const Vec3& hi) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.vertices.push_back({i & 1 ? hi.x() : lo.x(), i & 2 ? hi.y() : lo.y(), i & 4 ? hi.z() : lo.z()});
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4}, {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return m;
}

inline void append(Mesh& a, const Mesh& b) {
  const int n = static_cast<int>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& t : b.triangles) a.triangles.push_back({t[0] + n, t[1] + n, t[2] + n});
}

inline Cutter cone_cutter() {
  Cutter c;
  c.shape = CutterShape::cone, c.included_angle_rad = kPi / 2, c.tip_diameter_mm = 1, c.diameter_mm = 8, c.length_mm = 55, c.shank_diameter_mm = 8;
  c.teeth_count = 4;
  return c;
}

inline Recipe recipe_04() {
  Recipe r;
  r.id = "deburr-0.4", r.tool = "cone-90", r.spindle_rpm = 12000, r.width_mm = 0.4, r.tolerance_mm = 0.1;
  r.feed_min_mm_s = 3, r.feed_max_mm_s = 40, r.removal_max_mm3_s = 3, r.chip_load_mm = 0.06;
  r.burr_max_height_mm = 1.5, r.burr_max_passes_count = 3, r.approach_mm = 25, r.lead_mm = 2, r.path_tolerance_mm = 0.01;
  r.gate_probability_ratio = 0.8;
  return r;
}

/// An edge along the curve p(t), t in [0, 1], with constant covariance sd^2 I.
template <class P>
AdaptedEdge make_edge(const std::string& id, const std::string& feature, double length_mm, const P& at, double sd_mm, bool is_closed = false) {
  AdaptedEdge e;
  e.id = id, e.feature = feature, e.is_closed = is_closed;
  const int n = std::max(2, static_cast<int>(std::ceil(length_mm / 0.5)) + 1);
  for (int i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) / (n - 1);
    Vec3 p, tau, n_1, n_2;
    at(t, p, tau, n_1, n_2);
    e.s_mm.push_back(t * length_mm);
    e.nominal.push_back(p), e.adapted.push_back(p), e.tangent.push_back(tau), e.n_1.push_back(n_1), e.n_2.push_back(n_2);
    e.sigma_mm.push_back(sd_mm), e.covariance.push_back(sd_mm * sd_mm * Mat3::Identity());
    e.status.push_back(StationStatus::measured);
    e.rigid_mm.push_back(0), e.feature_mm.push_back(0), e.local_mm.push_back(0);
  }
  return e;
}

inline AdaptedEdge line_edge(const std::string& id, const std::string& feature, const Vec3& a, const Vec3& b, const Vec3& n_1, const Vec3& n_2,
                             double sd_mm = 0.03) {
  return make_edge(id, feature, (b - a).norm(), [&](double t, Vec3& p, Vec3& tau, Vec3& m_1, Vec3& m_2) {
    p = a + t * (b - a), tau = (b - a).normalized(), m_1 = n_1, m_2 = n_2;
  }, sd_mm);
}

/// height(s) mm; area a third of height times 0.1 mm at the root.
template <class H>
EdgeBurr make_burr(const AdaptedEdge& e, const H& height) {
  EdgeBurr b;
  b.edge_id = e.id;
  for (double s : e.s_mm) {
    const double h = height(s);
    b.height_mm.push_back(h), b.height_sd_mm.push_back(0.02), b.width_mm.push_back(0.1), b.area_mm2.push_back(0.1 * h);
    b.height_upper_mm.push_back(h + 0.03), b.coverage_ratio.push_back(1);
  }
  return b;
}

struct World {
  Job job;
  Location location;
  Features features;
  Burrs burrs;
  void add(const AdaptedEdge& e, double burr_mm = 0.15) {
    features.edges.push_back(e);
    burrs.edges.push_back(make_burr(e, [&](double) { return burr_mm; }));
  }
};

/// A box 60 x 40 x 20 with its top at z = 0, and its four top edges as feature "top".
inline World box_world(double sd_mm = 0.03) {
  World w;
  w.job.batch_id = "b", w.job.item_id = "box", w.job.taken = "2026-11-22";
  w.job.recipes = {recipe_04()};
  ToolSpec tool;
  tool.id = "cone-90", tool.number = 1, tool.T_flange_tool.p_mm = Vec3(0, 0, 350), tool.cutter = cone_cutter();
  tool.covariance.topLeftCorner<3, 3>() = 4.8e-5 * Mat3::Identity();
  w.job.cell.tools = {tool};
  w.job.cell.robot.accuracy.short_term = {0.02, 0.01};
  w.job.part.id = "box";
  w.job.part.brep.mesh = box_mesh({0, 0, -20}, {60, 40, 0});
  w.job.part.features = {{"top", "deburr-0.4", {}}};
  w.location.T_base_part.p_mm = Vec3(1200, 0, 700);
  const Vec3 up = Vec3::UnitZ(), x = Vec3::UnitX(), y = Vec3::UnitY();
  w.add(line_edge("#1", "top", {0, 0, 0}, {60, 0, 0}, up, -y, sd_mm));
  w.add(line_edge("#2", "top", {60, 0, 0}, {60, 40, 0}, up, x, sd_mm));
  w.add(line_edge("#3", "top", {60, 40, 0}, {0, 40, 0}, up, y, sd_mm));
  w.add(line_edge("#4", "top", {0, 40, 0}, {0, 0, 0}, up, -x, sd_mm));
  return w;
}

}  // namespace asbuilt::testing
