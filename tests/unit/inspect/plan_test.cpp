// SPDX-License-Identifier: GPL-3.0-or-later
// Whole plans: the laws they keep, and every way in which one is refused.
#include <gtest/gtest.h>

#include "planner/base/archive.hpp"
#include "planner/base/random.hpp"
#include "planner/plan/inspect/forecast.hpp"
#include "planner/plan/inspect/inspect.hpp"
#include "planner/plan/inspect/program.hpp"
#include "planner/plan/motion/cell_scene.hpp"
#include "planner/robot/free_move.hpp"
#include "planner/verify/verify.hpp"
#include "tests/support/inspect_scene.hpp"

namespace asbuilt {
namespace {

using namespace test;

/// Only the worked edge at y = 0.
void keep_front_edge(InspectScene& s) {
  std::erase_if(s.job.part.features[0].edges, [&](int i) {
    const BrepEdge& e = s.job.part.brep.edges[static_cast<std::size_t>(i)];
    return std::abs(e.p.front().y()) > 1e-6 || std::abs(e.p.back().y()) > 1e-6;
  });
}

std::string code_of(const Result<Done<Inspection>>& r) { return r ? "" : r.error().front().code; }

TEST(Inspect, a_block_is_planned_covered_from_both_kinds_and_its_program_passes_the_verifier) {
  const InspectScene s = block_scene();
  const auto plan = plan_inspection({}, s.job, s.location);
  ASSERT_TRUE(plan.has_value()) << plan.error()[0].code << " " << plan.error()[0].message;
  const Inspection& p = plan->artefact;
  ASSERT_EQ(p.edges.size(), 4u);
  for (const EdgeForecast& f : p.edges) {
    EXPECT_GE(f.coverage_ratio, 0.95) << f.id;
    EXPECT_GE(f.coverage_normal_ratio, 0.95) << f.id;
    EXPECT_GT(f.sd_worst_mm, 0.01);
    EXPECT_LT(f.sd_worst_mm, f.sd_limit_mm);
    for (std::size_t k = 0; k < f.s_mm.size(); ++k) EXPECT_EQ(f.views_count[k] > 0 || f.coverage_ratio < 1, true);
  }
  EXPECT_GE(p.views.size(), 4u);
  EXPECT_LE(p.views.size(), 20u);
  ASSERT_EQ(p.stops.size(), p.motion.segments.size());
  EXPECT_GE(p.motion.clearance_min_mm, 1.0);
  const auto program = plan_inspection_program({}, s.job, s.location, p);
  ASSERT_TRUE(program.has_value());
  const Verdict v = verify_inspection(s.job, s.location, p, program->artefact);
  for (const Check& c : v.checks) EXPECT_TRUE(c.is_passed) << c.name << " " << c.measured << " limit " << c.limit << " " << c.where;
  EXPECT_GT(v.checks.size(), 15u);

  const auto fails = [&](const Program& bad, const std::string& name) {
    for (const Check& c : verify_inspection(s.job, s.location, p, bad).checks)
      if (c.name == name) return !c.is_passed;
    return false;
  };
  // what does not keep the plan is found: a stop moved, a stop left out, the arm through the table
  Program moved = program->artefact;
  std::size_t last_move = 0;
  for (std::size_t i = 0; i + 1 < moved.instructions.size(); ++i)
    if (std::holds_alternative<MoveJoint>(moved.instructions[i]) && std::holds_alternative<Wait>(moved.instructions[i + 1])) last_move = i;
  std::get<MoveJoint>(moved.instructions[last_move]).q_rad[0] += rad_from_deg(0.02);
  EXPECT_TRUE(fails(moved, "views.position") && fails(moved, "views.orientation"));
  Program without = program->artefact;
  std::erase_if(without.instructions, [](const Instruction& i) { return std::holds_alternative<Wait>(i); });
  EXPECT_TRUE(fails(without, "views.stops"));
  Program low = program->artefact;
  std::get<MoveJoint>(low.instructions[last_move]).q_rad[1] += rad_from_deg(12);
  EXPECT_FALSE(verify_inspection(s.job, s.location, p, low).is_ok());
  Program spinning = program->artefact;
  spinning.instructions.insert(spinning.instructions.begin() + static_cast<std::ptrdiff_t>(last_move) + 1, SpindleOn{1000});
  EXPECT_TRUE(fails(spinning, "views.spindle_off"));
}

TEST(Inspect, the_same_plan_twice_and_with_edges_shuffled) {
  InspectScene s = block_scene();
  keep_front_edge(s);
  const InspectScene all = block_scene();
  for (const int i : all.job.part.features[0].edges)
    if (s.job.part.features[0].edges.size() < 2 && i != s.job.part.features[0].edges[0]) s.job.part.features[0].edges.push_back(i);
  const auto a = plan_inspection({}, s.job, s.location), b = plan_inspection({}, s.job, s.location);
  ASSERT_TRUE(a.has_value());
  EXPECT_EQ(content_hash(a->artefact), content_hash(b->artefact));
  InspectScene t = s;
  std::reverse(t.job.part.brep.edges.begin(), t.job.part.brep.edges.end());
  for (int& i : t.job.part.features[0].edges) i = static_cast<int>(t.job.part.brep.edges.size()) - 1 - i;
  const auto c = plan_inspection({}, t.job, t.location);
  ASSERT_TRUE(c.has_value());
  ASSERT_EQ(c->artefact.views.size(), a->artefact.views.size());
  for (std::size_t k = 0; k < a->artefact.views.size(); ++k) {
    EXPECT_EQ(c->artefact.views[k].q_rad, a->artefact.views[k].q_rad);
    EXPECT_EQ(c->artefact.views[k].edge, a->artefact.views[k].edge);
  }
  EXPECT_EQ(to_bytes(c->artefact.motion), to_bytes(a->artefact.motion));
}

TEST(Inspect, a_blocked_direction_gives_an_alternative_in_the_cone) {
  // a wall behind the edge into which the spindle would run when it stands upright over the edge
  InspectScene s = block_scene();
  keep_front_edge(s);
  s.job.cell.robot.accuracy.absolute.mean_mm = 0.3;  // a leaning view is allowed the arm's error of another posture
  Obstacle wall{"wall", transformed(s.location.T_base_part, box_mesh({-40, 14, kBlockZ + 1}, {140, 30, kBlockZ + 100}))};
  s.job.cell.obstacles.push_back(wall);
  for (Recipe& r : s.job.recipes) r.tolerance_mm *= 1.5;  // an arm tilted away from the working posture costs accuracy: that is the budget's own test
  InspectRecipe recipe;
  const auto plan = plan_inspection(recipe, s.job, s.location);
  ASSERT_TRUE(plan.has_value()) << plan.error()[0].code << " " << plan.error()[0].message;
  bool has_collision = false;
  for (const TriedView& t : plan->artefact.tried) has_collision |= t.kind == ViewKind::working && t.tilt_rad == 0 && t.outcome.rfind("collision", 0) == 0;
  EXPECT_TRUE(has_collision);
  double most = 0;
  for (const ScanView& v : plan->artefact.views) {
    most = std::max(most, v.tilt_rad);
    EXPECT_LE(v.tilt_rad, recipe.cone_rad + 1e-9);
    EXPECT_GE(v.clearance_mm, recipe.clearance_mm - 1e-9);
  }
  EXPECT_GT(deg_from_rad(most), 3);
  EXPECT_GE(plan->artefact.edges[0].coverage_ratio, 0.95);
}

TEST(Inspect, more_views_never_cover_less_nor_know_less) {
  const InspectScene s = block_scene();
  const Robot robot = *Robot::from(s.job.cell.robot);
  InspectRecipe recipe;
  inspecting::Workshop shop;
  shop.recipe = &recipe, shop.cell_spec = &s.job.cell, shop.robot = &robot, shop.tool = &s.job.cell.tools[0], shop.margin_mm = 1.5;
  shop.edges = inspecting::stations_of(s.job, s.location, recipe.station_mm);
  for (const auto& e : shop.edges) shop.first_station.push_back(shop.stations_count), shop.stations_count += e.stations.size();
  shop.eyes.push_back(inspecting::eye_of(s.job.cell.sensors[0]));
  shop.blockers.standing_base = RayTree(transformed(s.location.T_base_part, s.job.part.brep.mesh));
  const RobotErrorModel errors(robot, shop.tool->T_flange_tool);
  Random r(9);
  std::vector<inspecting::ViewCandidate> views;
  for (int i = 0; i < 60 && views.size() < 12; ++i) {
    inspecting::ViewCandidate v;
    v.kind = ViewKind::normal;
    const Vec3 target = s.location.T_base_part.point({r.uniform(0, kBlockX), r.uniform(0, kBlockY), kBlockZ});
    v.T_base_flange = inspecting::aimed_normal(s.job.cell.sensors[0], Vec3(r.normal(0, 0.5), r.normal(0, 0.5), -1).normalized(), r.uniform(0, 6.28), target, 206);
    const auto q = robot.inverse_near(v.T_base_flange, s.job.cell.robot.home_rad);
    if (!q) continue;
    v.q = *q;
    inspecting::Stand stand;
    stand.T_base_sensor = v.T_base_flange * s.job.cell.sensors[0].T_flange_sensor;
    v.points = inspecting::expected_points(shop, stand, 0, shop.stations_count);
    views.push_back(v);
  }
  ASSERT_GE(views.size(), 8u);
  std::vector<const inspecting::ViewCandidate*> some;
  auto before = inspecting::forecast(shop, errors, some);
  double seen = 0;
  for (const auto& v : views) {
    some.push_back(&v);
    const auto now = inspecting::forecast(shop, errors, some);
    for (std::size_t e = 0; e < now.size(); ++e) {
      EXPECT_GE(now[e].coverage_ratio, before[e].coverage_ratio);
      EXPECT_GE(now[e].coverage_normal_ratio, before[e].coverage_normal_ratio);
      for (std::size_t k = 0; k < now[e].s_mm.size(); ++k) {
        EXPECT_GE(now[e].points_1_count[k], before[e].points_1_count[k]);
        EXPECT_GE(now[e].views_count[k], before[e].views_count[k]);
        if (std::isfinite(before[e].sd_mm[k])) {
          EXPECT_LE(now[e].sd_mm[k], before[e].sd_mm[k] + 1e-12);
        }
      }
      seen = std::max(seen, now[e].coverage_ratio);
    }
    before = now;
  }
  EXPECT_GT(seen, 0.3);
}

TEST(Inspect, every_refusal_has_its_case) {
  InspectScene s = block_scene();
  keep_front_edge(s);
  {
    InspectScene t = s;
    t.job.part.features[0].edges.clear();
    EXPECT_EQ(code_of(plan_inspection({}, t.job, t.location)), "inspect.nothing_to_do");
  }
  {
    InspectScene t = s;
    t.job.cell.sensors[0].pixels_count = {60, 40};
    const auto r = plan_inspection({}, t.job, t.location);
    EXPECT_EQ(code_of(r), "inspect.sensor");
    EXPECT_LT(r.error()[0].measured, r.error()[0].limit);
    t = s;
    t.job.cell.sensors[0].kind = SensorKind::profile;
    EXPECT_EQ(code_of(plan_inspection({}, t.job, t.location)), "inspect.sensor");
  }
  {
    InspectScene t = s;
    t.job.recipes[0].tool = "another";
    EXPECT_EQ(code_of(plan_inspection({}, t.job, t.location)), "inspect.tool");
    EXPECT_EQ(plan_inspection_program({}, t.job, t.location, Inspection{}).error()[0].code, "inspect.no_motion");
    Inspection some;
    some.motion.segments.emplace_back(), some.stops.push_back(-1);
    EXPECT_EQ(plan_inspection_program({}, t.job, t.location, some).error()[0].code, "inspect.tool");
  }
  {
    InspectScene t = s;
    t.location.covariance.diagonal().head<3>().setConstant(400);
    const auto r = plan_inspection({}, t.job, t.location);
    EXPECT_EQ(code_of(r), "inspect.part_not_located");
    EXPECT_GT(r.error()[0].measured, r.error()[0].limit);
    t.job.fixture.play_rad = {0.01, 0.01, std::nullopt};
    EXPECT_EQ(location_of_fixture(t.job).error()[0].code, "inspect.part_not_located");
    t.job.fixture.play_rad[2] = 0.01;
    t.job.fixture.play_mm = Vec3(3, 3, 1);
    const auto l = location_of_fixture(t.job);
    ASSERT_TRUE(l.has_value());
    EXPECT_NEAR(l->covariance(0, 0), 3, 1e-12);
    EXPECT_NEAR(l->covariance(5, 5), 1e-4 / 3, 1e-12);
  }
  {
    InspectScene t = s;  // a roof over the edge
    t.job.cell.obstacles.push_back({"roof", transformed(t.location.T_base_part, box_mesh({-60, -80, kBlockZ + 14}, {160, 140, kBlockZ + 22}))});
    const auto r = plan_inspection({}, t.job, t.location);
    ASSERT_EQ(code_of(r), "inspect.not_covered");
    EXPECT_NE(r.error()[0].where.find("edge " + t.job.part.brep.edges[static_cast<std::size_t>(t.job.part.features[0].edges[0])].id), std::string::npos);
    EXPECT_LT(r.error()[0].measured, 0.95);
    EXPECT_NE(r.error()[0].message.find("of the views that were tried"), std::string::npos);
  }
  {
    InspectScene t = s;  // a mount that is known to half a millimetre
    t.job.cell.sensors[0].covariance.diagonal().head<3>().setConstant(0.25);
    const auto r = plan_inspection({}, t.job, t.location);
    EXPECT_EQ(code_of(r), "inspect.budget");
    EXPECT_GT(r.error()[0].measured, r.error()[0].limit);
  }
  {
    InspectScene t = s;
    const Robot robot = *Robot::from(t.job.cell.robot);
    const Vec3 p = robot.forward(t.job.cell.robot.home_rad).p_mm;
    t.job.cell.obstacles.push_back({"post", box_mesh(p - Vec3(30, 30, 30), p + Vec3(30, 30, 30))});
    EXPECT_EQ(code_of(plan_inspection({}, t.job, t.location)), "inspect.home");
    t = s;
    t.job.cell.robot.home_rad[0] = 4;
    EXPECT_EQ(code_of(plan_inspection({}, t.job, t.location)), "inspect.home");
  }
}

TEST(Inspect, an_arm_that_cannot_leave_home_is_refused_with_what_is_in_the_way) {
  InspectScene s = block_scene();
  keep_front_edge(s);
  // a cage about all that moves beyond the forearm at home, with a window for the forearm
  const Robot robot = *Robot::from(s.job.cell.robot);
  const auto home = s.job.cell.robot.home_rad;
  const auto links = robot.link_motion(home);
  const auto flange = robot.forward(home);
  Box3 inside, arm;
  for (const LinkMesh& l : s.job.cell.robot.links)
    for (const Vec3& v : l.mesh.vertices) (l.joint >= 5 ? inside : arm).extend(l.joint >= 4 ? links[static_cast<std::size_t>(l.joint)].point(v) : Vec3(links[4].point(s.job.cell.robot.links[4].mesh.vertices[0])));
  for (const Vec3& v : s.job.cell.tools[0].mesh_flange.vertices) inside.extend(flange.point(v));
  for (const Vec3& v : s.job.cell.sensors[0].mesh_flange.vertices) inside.extend(flange.point(v));
  inside.extend(flange.point(s.job.cell.tools[0].T_flange_tool.p_mm));
  inside.min_mm.array() -= 40, inside.max_mm.array() += 40, arm.min_mm.array() -= 20, arm.max_mm.array() += 20;
  const Vec3 a = inside.min_mm, b = inside.max_mm;
  const auto wall = [&](const Vec3& lo, const Vec3& hi) {
    if ((hi - lo).minCoeff() > 1) s.job.cell.obstacles.push_back({"cage", box_mesh(lo, hi)});
  };
  wall({a.x(), a.y(), a.z() - 10}, {b.x(), b.y(), a.z()}), wall({a.x(), a.y(), b.z()}, {b.x(), b.y(), b.z() + 10});
  wall({b.x(), a.y(), a.z()}, {b.x() + 10, b.y(), b.z()});
  wall({a.x(), a.y() - 10, a.z()}, {b.x(), a.y(), b.z()}), wall({a.x(), b.y(), a.z()}, {b.x(), b.y() + 10, b.z()});
  wall({a.x() - 10, a.y(), a.z()}, {a.x(), b.y(), std::min(arm.min_mm.z(), b.z())}), wall({a.x() - 10, a.y(), std::max(a.z(), arm.max_mm.z())}, {a.x(), b.y(), b.z()});
  wall({a.x() - 10, a.y(), a.z()}, {a.x(), std::max(a.y(), arm.min_mm.y()), b.z()}), wall({a.x() - 10, std::min(b.y(), arm.max_mm.y()), a.z()}, {a.x(), b.y(), b.z()});
  // and turned aside with the arm, away from the part
  s.job.cell.robot.home_rad[0] += rad_from_deg(80);
  const Pose<frame::Base, frame::Base> aside(Eigen::Quaterniond(Eigen::AngleAxisd(-rad_from_deg(80), Vec3::UnitZ())), Vec3::Zero());  // axis 1 turns against base
  for (Obstacle& o : s.job.cell.obstacles)
    if (o.name == "cage") o.mesh_base = transformed(aside, o.mesh_base);
  InspectRecipe recipe;
  recipe.planner_iterations_count = 10, recipe.short_move_count = 3;
  const auto r = plan_inspection(recipe, s.job, s.location);
  ASSERT_FALSE(r.has_value());
  bool is_said = false;
  for (const Refusal& why : r.error()) is_said |= why.code == "inspect.no_transfer" && why.message.find("cage") != std::string::npos;
  EXPECT_TRUE(is_said) << r.error().front().code << " " << r.error().front().where << " " << r.error().front().message;
}

TEST(ShortMove, goes_round_what_is_in_the_way_certified_and_the_same_every_time) {
  InspectScene s = block_scene();
  const Robot robot = *Robot::from(s.job.cell.robot);
  const JointVector home = s.job.cell.robot.home_rad;
  JointVector a = home, b = home;
  a[0] -= 0.45, b[0] += 0.45;
  const Vec3 p = robot.forward(home).p_mm;
  s.job.cell.obstacles.push_back({"post", box_mesh(p + Vec3(-60, -60, -900), p + Vec3(60, 60, -150))});
  const CellScene cell = cell_scene(robot, s.job, s.job.part.brep.mesh, s.location, s.job.cell.tools[0], 3, 1.5, 1);
  const auto watches = cell.with_flute(3);
  EXPECT_FALSE(cell.scene.certify(watches, {{a, b}, false}).is_free);
  const auto q = find_short_move(cell.scene, watches, a, b, 80), again = find_short_move(cell.scene, watches, a, b, 80);
  ASSERT_TRUE(q.has_value());
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(*q, *again);
  EXPECT_EQ(q->front(), a);
  EXPECT_EQ(q->back(), b);
  EXPECT_TRUE(cell.scene.certify(watches, {*q, false}).is_free);
  EXPECT_GE(q->size(), 3u);
  // no way at all: into the post
  JointVector inside = home;
  EXPECT_FALSE(find_short_move(cell.scene, watches, a, inside, 20).has_value());
}

}  // namespace
}  // namespace asbuilt
