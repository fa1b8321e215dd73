// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/path.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "planner/geom/mesh_query.hpp"
#include "planner/plan/path/chamfer.hpp"
#include "planner/plan/path/gate.hpp"
#include "tests/unit/path/world.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt {
namespace {

using testing::append;
using testing::box_mesh;
using testing::box_world;
using testing::line_edge;
using testing::make_burr;
using testing::make_edge;
using testing::World;

Result<Done<ToolPath>> plan(const World& w, const PathRecipe& recipe = {}) { return plan_path(recipe, w.job, w.location, w.features, w.burrs); }

std::string code_of(const Result<Done<ToolPath>>& r) { return r ? "" : r.error().front().code; }

/// Distance from the path's cutting lines to the cutter's wanted legs: brute force at a point of an edge.
double swept_leg(const ToolPath& path, const Cutter& cutter, const Vec3& p, const Vec3& t) {
  double before = 0;
  for (int i = 0; i <= 300; ++i) {
    const double u = 0.005 * i;
    double gap = 1e9;
    for (const CutPass& pass : path.passes)
      for (std::size_t k = 1; k < pass.points.size(); ++k) {
        const Vec3 a = pass.points[k - 1].tip_part, d = pass.points[k].tip_part - a, up = -pass.points[k].axis_part;
        const double l = d.norm();
        if ((a - p).norm() > 15 + l) continue;
        const int n = std::max(1, static_cast<int>(l / 0.05));
        for (int j = 0; j <= n; ++j) {
          const Vec3 q = p + u * t - (a + d * (static_cast<double>(j) / n));
          const double h = q.dot(up);
          gap = std::min(gap, gap_mm(cutter, Vec3((q - h * up).norm(), 0, -h)));
        }
      }
    if (gap > 0) return i == 0 ? 0 : u - 0.005 * gap / (gap - before);
    before = gap;
  }
  return 1.5;
}

TEST(Path, a_box_is_cut_in_one_visit_with_full_legs_everywhere) {
  const World w = box_world();
  const auto r = plan(w);
  ASSERT_TRUE(r) << r.error().front().message;
  const ToolPath& path = r->artefact;
  ASSERT_EQ(path.passes.size(), 1u);
  EXPECT_EQ(path.passes[0].edges.size(), 4u);
  EXPECT_NEAR(path.passes[0].retract_part.z(), 1, 1e-9);
  for (const AdaptedEdge& e : w.features.edges)
    for (std::size_t i = 2; i + 2 < e.s_mm.size(); i += 7) {
      const EdgeStation s{e.adapted[i], e.tangent[i], e.n_1[i], e.n_2[i]};
      EXPECT_NEAR(swept_leg(path, testing::cone_cutter(), s.p, into_face(s, 1)), 0.4, 0.015) << e.id << " " << e.s_mm[i];
      EXPECT_NEAR(swept_leg(path, testing::cone_cutter(), s.p, into_face(s, 2)), 0.4, 0.015) << e.id << " " << e.s_mm[i];
    }
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_EQ(path.edge_passes_count[k], 1);
    EXPECT_EQ(path.edge_feed_mm_s[k].size(), w.features.edges[k].s_mm.size());
    for (double f : path.edge_feed_mm_s[k]) EXPECT_TRUE(f >= 3 && f <= 40);
  }
}

TEST(Path, climbs_whatever_the_drawing_says_about_the_direction) {
  World a = box_world(), b = box_world();
  for (AdaptedEdge& e : b.features.edges) {
    std::reverse(e.adapted.begin(), e.adapted.end()), std::reverse(e.nominal.begin(), e.nominal.end());
    for (Vec3& t : e.tangent) t = -t;
  }
  const auto pa = plan(a), pb = plan(b);
  ASSERT_TRUE(pa && pb);
  ASSERT_EQ(pb->artefact.passes.size(), 1u);
  // material on the right: clockwise about the part seen from above
  for (const auto* r : {&pa, &pb}) {
    double area = 0;
    const auto& pts = (*r)->artefact.passes[0].points;
    for (std::size_t i = 1; i < pts.size(); ++i) area += pts[i - 1].tip_part.cross(pts[i].tip_part).z();
    EXPECT_LT(area, 0);
  }
}

TEST(Path, moves_with_the_part) {
  const World a = box_world();
  World b = box_world();
  const Pose<frame::Part, frame::Part> T(quat_from_zyx(0.4, 0, 0), Vec3(3, -2, 5));
  for (AdaptedEdge& e : b.features.edges) {
    for (auto* v : {&e.adapted, &e.nominal})
      for (Vec3& p : *v) p = T.point(p);
    for (auto* v : {&e.tangent, &e.n_1, &e.n_2})
      for (Vec3& d : *v) d = T.direction(d);
  }
  b.job.part.brep.mesh = transformed(T, b.job.part.brep.mesh);
  const auto pa = plan(a), pb = plan(b);
  ASSERT_TRUE(pa && pb);
  const auto &x = pa->artefact.passes[0].points, &y = pb->artefact.passes[0].points;
  ASSERT_EQ(x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_LT((T.point(x[i].tip_part) - y[i].tip_part).norm(), 1e-6);
    EXPECT_EQ(x[i].feed_mm_s, y[i].feed_mm_s);
  }
}

TEST(Path, a_larger_burr_never_gives_a_larger_feed) {
  World w = box_world();
  const auto small = plan(w);
  for (std::size_t k = 0; k < 4; ++k)
    w.burrs.edges[k] = make_burr(w.features.edges[k], [&](double s) { return 0.15 + (s > 15 && s < 25 ? 0.5 : 0.0); });
  const auto large = plan(w);
  ASSERT_TRUE(small && large);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto &a = small->artefact.edge_feed_mm_s[k], &b = large->artefact.edge_feed_mm_s[k];
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_LE(b[i], a[i] + 1e-9);
    EXPECT_LT(b[40], 0.8 * a[40]);  // 20 mm
    // cross-section times feed within the recipe
    for (std::size_t i = 0; i < b.size(); ++i)
      EXPECT_LE(b[i] * (0.08 + w.burrs.edges[k].area_mm2[i]), 3.0 + 1e-6);
  }
}

TEST(Path, leads_start_and_end_clear_of_part_and_burr) {
  World w = box_world();
  const auto r = plan(w);
  ASSERT_TRUE(r);
  const MeshQuery part(w.job.part.brep.mesh);
  const auto& pts = r->artefact.passes[0].points;
  for (const PathPoint* p : {&pts.front(), &pts.back()}) {
    EXPECT_NE(p->kind, PathPointKind::cut);
    double least = 1e9;
    for (double u = 0; u <= 20; u += 0.25)
      for (int k = 0; k < 48; ++k) {
        const double a = 2 * kPi * k / 48;
        const double rad = radius_mm(testing::cone_cutter(), u);
        least = std::min(least, part.signed_distance(p->tip_part + Vec3(rad * std::cos(a), rad * std::sin(a), u)));
      }
    EXPECT_GT(least, 0.5);
  }
}

TEST(Path, big_burrs_take_several_passes_and_every_one_holds_the_rate) {
  World w = box_world();
  w.job.recipes[0].burr_max_height_mm = 4;
  EdgeBurr b = make_burr(w.features.edges[0], [](double) { return 2.5; });
  for (double& a : b.area_mm2) a = 1.3;  // 3 mm3/s at 3 mm/s: at most 1 mm2
  w.burrs.edges[0] = b;
  const auto r = plan(w);
  ASSERT_TRUE(r) << r.error().front().message;
  EXPECT_GE(r->artefact.edge_passes_count[0], 2);
  EXPECT_EQ(r->artefact.edge_passes_count[2], 1);
  EXPECT_EQ(r->artefact.passes.back().pass, r->artefact.passes.back().passes);
  EXPECT_EQ(r->artefact.passes.back().edges.size(), 4u);
  EXPECT_EQ(r->artefact.passes.front().edges, (std::vector<int>{0}));
}

TEST(Path, a_ring_edge_is_closed_over_its_start) {
  World w = box_world();
  w.features.edges.clear(), w.burrs.edges.clear();
  w.job.part.brep.mesh = box_mesh({-50, -50, -20}, {50, 50, -10});  // the disc itself is not meshed: nothing else to touch
  w.add(make_edge("#9", "top", 2 * kPi * 20, [](double t, Vec3& p, Vec3& tau, Vec3& n_1, Vec3& n_2) {
    const double a = 2 * kPi * t;
    const Vec3 r(std::cos(a), std::sin(a), 0);
    p = 20 * r, tau = Vec3(-std::sin(a), std::cos(a), 0), n_1 = Vec3::UnitZ(), n_2 = r;
  }, 0.03, true));
  const auto r = plan(w);
  ASSERT_TRUE(r) << r.error().front().message;
  const AdaptedEdge& e = w.features.edges[0];
  for (std::size_t i = 0; i < e.s_mm.size(); i += 11) {
    const EdgeStation s{e.adapted[i], e.tangent[i], e.n_1[i], e.n_2[i]};
    EXPECT_NEAR(swept_leg(r->artefact, testing::cone_cutter(), s.p, into_face(s, 1)), 0.4, 0.02);
  }
}

/// A disc with a hole, top at z = 0.
Mesh holed_disc(double hole_mm, double outer_mm, int n) {
  Mesh m;
  for (int k = 0; k < n; ++k) {
    const double a = 2 * kPi * k / n;
    const Vec3 r(std::cos(a), std::sin(a), 0);
    for (const Vec3& p : {Vec3(hole_mm * r), Vec3(outer_mm * r), Vec3(outer_mm * r - Vec3(0, 0, 10)), Vec3(hole_mm * r - Vec3(0, 0, 10))}) m.vertices.push_back(p);
  }
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < 4; ++i) {
      const int a = 4 * k + i, b = 4 * k + (i + 1) % 4, c = 4 * ((k + 1) % n) + i, d = 4 * ((k + 1) % n) + (i + 1) % 4;
      m.triangles.push_back({a, b, d}), m.triangles.push_back({a, d, c});
    }
  return m;
}

TEST(Path, the_edge_of_a_hole_is_cut_from_inside_without_touching_its_wall) {
  for (double hole : {8.0, 15.0}) {
    World w = box_world();
    w.features.edges.clear(), w.burrs.edges.clear();
    w.job.part.brep.mesh = holed_disc(hole, 40, 256);
    w.add(make_edge("#9", "top", 2 * kPi * hole, [&](double t, Vec3& p, Vec3& tau, Vec3& n_1, Vec3& n_2) {
      const double a = 2 * kPi * t;
      const Vec3 r(std::cos(a), std::sin(a), 0);
      p = hole * r, tau = Vec3(-std::sin(a), std::cos(a), 0), n_1 = Vec3::UnitZ(), n_2 = -r;
    }, 0.03, true));
    const auto r = plan(w);
    ASSERT_TRUE(r) << r.error().front().message;
    for (const PathPoint& p : r->artefact.passes[0].points) EXPECT_LT(p.tip_part.head<2>().norm(), hole);
    const AdaptedEdge& e = w.features.edges[0];
    for (std::size_t i = 0; i < e.s_mm.size(); i += 5) {
      const EdgeStation s{e.adapted[i], e.tangent[i], e.n_1[i], e.n_2[i]};
      EXPECT_NEAR(swept_leg(r->artefact, testing::cone_cutter(), s.p, into_face(s, 1)), 0.4, 0.03);
      EXPECT_NEAR(swept_leg(r->artefact, testing::cone_cutter(), s.p, into_face(s, 2)), 0.4, 0.03);
    }
  }
  World narrow = box_world();
  narrow.features.edges.clear(), narrow.burrs.edges.clear();
  narrow.job.part.brep.mesh = holed_disc(0.3, 40, 256);
  narrow.add(make_edge("#9", "top", 2 * kPi * 0.3, [&](double t, Vec3& p, Vec3& tau, Vec3& n_1, Vec3& n_2) {
    const double a = 2 * kPi * t;
    const Vec3 r(std::cos(a), std::sin(a), 0);
    p = 0.3 * r, tau = Vec3(-std::sin(a), std::cos(a), 0), n_1 = Vec3::UnitZ(), n_2 = -r;
  }, 0.03, true));
  EXPECT_EQ(code_of(plan(narrow)), "path.tool_does_not_fit");
}

TEST(Path, the_sharp_corners_of_a_pocket_are_reached_with_the_lower_flank_or_refused) {
  // a pocket 40 x 20 x 10 in a block, as five boxes; its top edges look inward
  World w = box_world();
  w.features.edges.clear(), w.burrs.edges.clear();
  Mesh& m = w.job.part.brep.mesh;
  m = box_mesh({-30, -30, -20}, {70, 0, 0});
  append(m, box_mesh({-30, 20, -20}, {70, 50, 0}));
  append(m, box_mesh({-30, 0, -20}, {0, 20, 0}));
  append(m, box_mesh({40, 0, -20}, {70, 20, 0}));
  append(m, box_mesh({0, 0, -20}, {40, 20, -10}));
  const Vec3 up = Vec3::UnitZ(), x = Vec3::UnitX(), y = Vec3::UnitY();
  w.add(line_edge("#1", "top", {0, 0, 0}, {40, 0, 0}, up, y));
  w.add(line_edge("#2", "top", {40, 0, 0}, {40, 20, 0}, up, -x));
  w.add(line_edge("#3", "top", {40, 20, 0}, {0, 20, 0}, up, -y));
  w.add(line_edge("#4", "top", {0, 20, 0}, {0, 0, 0}, up, x));
  const auto r = plan(w);
  ASSERT_TRUE(r) << r.error().front().message;
  for (const AdaptedEdge& e : w.features.edges)
    for (double s_mm : {1.5, 5.0, e.s_mm.back() - 1.5}) {
      const auto i = static_cast<std::size_t>(std::lround(s_mm / e.s_mm.back() * static_cast<double>(e.s_mm.size() - 1)));
      const EdgeStation s{e.adapted[i], e.tangent[i], e.n_1[i], e.n_2[i]};
      EXPECT_GT(swept_leg(r->artefact, testing::cone_cutter(), s.p, into_face(s, 1)), 0.3) << e.id << " " << s_mm;
      EXPECT_LT(swept_leg(r->artefact, testing::cone_cutter(), s.p, into_face(s, 1)), 0.55) << e.id << " " << s_mm;
    }
  w.job.cell.tools[0].cutter.tip_diameter_mm = 4;  // too blunt for the corners
  EXPECT_EQ(code_of(plan(w)), "path.tool_does_not_fit");
}

TEST(Path, refuses_a_wall_beside_the_end_of_an_edge) {
  World w = box_world();
  w.features.edges.resize(1), w.burrs.edges.resize(1);
  append(w.job.part.brep.mesh, box_mesh({60, -10, -20}, {80, 40, 30}));  // the edge y = 0 runs into it
  const auto r = plan(w);
  EXPECT_EQ(code_of(r), "path.tool_does_not_fit");
  EXPECT_NE(r.error().front().where.find("#1"), std::string::npos);
  EXPECT_GT(r.error().front().measured, 0.05);
}

TEST(Path, refuses_what_the_axis_cannot_reach) {
  World w = box_world();
  w.job.recipes[0].axis_base = Vec3::UnitZ();  // from below
  EXPECT_EQ(code_of(plan(w)), "path.tool_does_not_fit");
  World steep = box_world();
  steep.features.edges.resize(1), steep.burrs.edges.resize(1);
  for (Vec3& n : steep.features.edges[0].n_2) n = Vec3(0, -std::sin(0.9), std::cos(0.9));
  EXPECT_EQ(code_of(plan(steep)), "path.tool_does_not_fit");  // legs too different
  steep.job.recipes[0].orientation = OrientationMode::tilt, steep.job.recipes[0].cone_rad = rad_from_deg(30);
  const auto r = plan(steep);
  ASSERT_TRUE(r) << r.error().front().message;
  for (const PathPoint& p : r->artefact.passes[0].points)
    if (p.kind == PathPointKind::cut) {
      EXPECT_NEAR(p.leg_1_mm, p.leg_2_mm, 1e-6);
    }
}

TEST(Path, refuses_what_was_not_measured) {
  World w = box_world();
  for (std::size_t i = 30; i < 40; ++i) w.features.edges[1].status[i] = StationStatus::nominal;
  const auto r = plan(w);
  EXPECT_EQ(code_of(r), "path.unmeasured");
  EXPECT_NEAR(r.error().front().measured, 5, 0.6);
}

TEST(Path, refuses_burrs_over_the_limit_seen_or_hidden) {
  World w = box_world();
  w.burrs.edges[2].height_mm[20] = 1.8;
  EXPECT_EQ(code_of(plan(w)), "path.burr_above_limit");
  World hidden = box_world();
  for (std::size_t i = 20; i < 40; ++i)
    hidden.burrs.edges[2].height_mm[i] = std::numeric_limits<double>::quiet_NaN(), hidden.burrs.edges[2].height_upper_mm[i] = 3;
  EXPECT_EQ(code_of(plan(hidden)), "path.burr_above_limit");
  World thick = box_world();
  for (double& a : thick.burrs.edges[0].area_mm2) a = 50;
  EXPECT_EQ(code_of(plan(thick)), "path.burr_above_limit");
}

TEST(Path, refuses_feeds_under_the_minimum) {
  World w = box_world();
  w.job.recipes[0].removal_max_mm3_s = 0.1;
  EXPECT_EQ(code_of(plan(w)), "path.feed_below_min");
  World chip = box_world();
  chip.job.recipes[0].chip_load_mm = 0.001;
  EXPECT_EQ(code_of(plan(chip)), "path.feed_below_min");
}

TEST(Path, refuses_inner_edges_wrong_processes_and_empty_work) {
  World w = box_world();
  BrepEdge inner;
  inner.kind = EdgeKind::sharp_concave;
  w.job.part.brep.edges = {inner};
  w.features.edges[0].edge = 0;
  EXPECT_EQ(code_of(plan(w)), "path.not_convex");
  World weld = box_world();
  weld.job.recipes[0].process = Process::weld;
  EXPECT_EQ(code_of(plan(weld)), "path.process");
  World none = box_world();
  none.features.edges.clear(), none.burrs.edges.clear();
  EXPECT_EQ(code_of(plan(none)), "path.nothing_to_do");
}

TEST(Gate, emits_good_edges_and_refuses_blurred_ones_with_a_budget) {
  EXPECT_TRUE(plan(box_world(0.03)));
  EXPECT_TRUE(plan(box_world(0.045)));
  const auto r = plan(box_world(0.12));
  ASSERT_EQ(code_of(r), "path.gate");
  EXPECT_EQ(r.error().size(), 4u);
  EXPECT_NE(r.error().front().message.find("measured edge"), std::string::npos);
  EXPECT_LT(r.error().front().measured, r.error().front().limit);
}

TEST(Gate, a_named_person_may_pass_one_edge_until_the_day_it_expires) {
  World w = box_world(0.03);
  for (Mat3& c : w.features.edges[1].covariance) c = 0.07 * 0.07 * Mat3::Identity();
  PathRecipe recipe;
  EXPECT_EQ(code_of(plan(w, recipe)), "path.gate");
  w.job.overrides = {{"#2", "A. Turner", "trial part", "2026-11-21"}};
  EXPECT_EQ(code_of(plan(w, recipe)), "path.gate");
  w.job.overrides[0].expires = "2026-11-22";
  const auto r = plan(w, recipe);
  ASSERT_TRUE(r);
  bool is_noted = false;
  for (const Note& n : r->notes) is_noted = is_noted || (n.code == "path.gate_override" && n.text.find("A. Turner") != std::string::npos);
  EXPECT_TRUE(is_noted);
}

TEST(Gate, a_tool_tilted_away_from_the_scanning_posture_brings_the_arms_error_in) {
  World w = box_world(0.02);
  w.job.cell.robot = testing::six_axis_arm();
  w.job.cell.robot.accuracy.absolute = {0.42, 0.2}, w.job.cell.robot.accuracy.short_term = {0.02, 0.01};
  w.job.recipes[0].orientation = OrientationMode::tilt, w.job.recipes[0].cone_rad = rad_from_deg(30);
  w.job.cell.tools[0].cutter.included_angle_rad = rad_from_deg(60);  // has to lean 15 degrees for a 45 degree chamfer
  EXPECT_TRUE(plan(w));                                              // no reference: nothing is known about it
  Pose<frame::Base, frame::Tool> reference(quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()), w.location.T_base_part.point(Vec3(30, 20, 0)));
  w.features.T_base_tool_reference["top"] = reference;
  const auto r = plan(w);
  ASSERT_EQ(code_of(r), "path.gate");
  EXPECT_NE(r.error().front().message.find("scanning posture"), std::string::npos);
  // upright, the same job is as good as measured
  w.job.recipes[0].orientation = OrientationMode::fixed, w.job.cell.tools[0].cutter.included_angle_rad = rad_from_deg(90);
  EXPECT_TRUE(plan(w));
}

TEST(Gate, probability_is_that_of_the_normal_law) {
  CutterPlacement at;
  at.leg_1_mm = at.leg_2_mm = 0.4, at.m = Vec3(0, -1, 1).normalized();
  at.slope_1 = at.slope_2 = at.m * std::sqrt(2.0);
  const double sd = 0.05;
  const double expected = std::erf(0.1 / std::sqrt(2.0) / sd / std::sqrt(2.0));
  EXPECT_NEAR(leg_probability(at, sd * sd * Mat3::Identity(), 0.4, 0.1), expected, 1e-9);
  // two legs that err independently
  at.slope_1 = Vec3(0, 1, 0), at.slope_2 = Vec3(0, 0, 1);
  const double one = std::erf(0.1 / sd / std::sqrt(2.0));
  EXPECT_NEAR(leg_probability(at, sd * sd * Mat3::Identity(), 0.4, 0.1), one * one, 1e-6);
  EXPECT_NEAR(leg_probability(at, Mat3::Zero(), 0.4, 0.1), 1, 1e-12);
}

}  // namespace
}  // namespace asbuilt
