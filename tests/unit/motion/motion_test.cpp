// SPDX-License-Identifier: GPL-3.0-or-later
// What every motion must be: joints that make the poses, from home to home without a gap, on the path, inside limits, apart from
// everything, and near the reference posture.
#include "planner/plan/motion/motion.hpp"

#include <gtest/gtest.h>

#include <chrono>

#include "planner/robot/collision.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

using test::edge_pass;
using test::small_cell;
using test::SmallCell;

Result<Done<Motion>> plan(const SmallCell& c, const MotionRecipe& recipe = {}) {
  return plan_motion(recipe, c.job, c.location, c.features, c.burrs, c.path);
}

void expect_sound(const SmallCell& c, const Motion& m) {
  const Robot robot = *Robot::from(c.job.cell.robot);
  ASSERT_FALSE(m.segments.empty());
  JointVector at = c.job.cell.robot.home_rad;
  for (const MotionSegment& s : m.segments) {
    ASSERT_EQ(s.q_rad.size(), s.T_base_tool.size());
    ASSERT_EQ(s.q_rad.size(), s.speed_mm_s.size());
    ASSERT_GE(s.q_rad.size(), 2u);
    EXPECT_EQ(s.q_rad.front(), at);
    at = s.q_rad.back();
    EXPECT_EQ(s.pass < 0, s.kind == SegmentKind::transfer);
    for (std::size_t i = 0; i < s.q_rad.size(); ++i) {
      EXPECT_GE(robot.joint_margin_rad(s.q_rad[i]), 0.0);
      const auto T = robot.forward(s.q_rad[i]) * c.job.cell.tools[0].T_flange_tool;
      EXPECT_LT((T.p_mm - s.T_base_tool[i].p_mm).norm(), 1e-9);
      EXPECT_LT((T.rotation() - s.T_base_tool[i].rotation()).norm(), 1e-12);
      if (i > 0 && s.kind != SegmentKind::transfer) {
        EXPECT_LE(deg_from_rad(s.T_base_tool[i].q.angularDistance(s.T_base_tool[i - 1].q)), 5.0);
        EXPECT_GE(s.speed_mm_s[i], 3.0);
        EXPECT_NEAR(s.speed_mm_s[i] * 10, std::round(s.speed_mm_s[i] * 10), 1e-9);
      }
    }
    EXPECT_GE(s.clearance_mm, 1.42 - 1e-9);  // the cutter from fixture and obstacles; all else keeps 3 mm
  }
  EXPECT_EQ(at, c.job.cell.robot.home_rad);
}

/// The cut passes through the path's points with the path's axis.
void expect_on_path(const SmallCell& c, const Motion& m) {
  for (const MotionSegment& s : m.segments) {
    if (s.kind != SegmentKind::cut) continue;
    const CutPass& pass = c.path.passes[static_cast<std::size_t>(s.pass)];
    std::size_t k = 0;
    for (const PathPoint& p : pass.points) {
      const Vec3 tip = c.location.T_base_part.point(p.tip_part);
      while (k < s.q_rad.size() && (s.T_base_tool[k].p_mm - tip).norm() > 1e-6) ++k;
      ASSERT_LT(k, s.q_rad.size()) << "a path point is missing";
      EXPECT_LT((s.T_base_tool[k].direction(Vec3::UnitZ()) - c.location.T_base_part.direction(p.axis_part)).norm(), 1e-9);
      EXPECT_LE(s.speed_mm_s[k], p.feed_mm_s + 1e-9);
    }
  }
}

TEST(Motion, OneEdgeFromHomeToHome) {
  const SmallCell c = small_cell();
  const auto t0 = std::chrono::steady_clock::now();
  const auto m = plan(c);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - t0).count();
  ASSERT_TRUE(m.has_value()) << m.error()[0].code << ": " << m.error()[0].message;
  RecordProperty("seconds", std::to_string(seconds));
  expect_sound(c, m->artefact);
  expect_on_path(c, m->artefact);
  ASSERT_EQ(m->artefact.segments.size(), 5u);
  EXPECT_GT(m->artefact.duration_s, 5.0);
  EXPECT_GE(m->artefact.singularity_min_ratio, 0.02);
}

TEST(Motion, FourEdgesInTwoPassesEach) {
  SmallCell c = small_cell();
  c.path.passes.clear();
  const Vec3 p[4] = {{0, 0, 40}, {100, 0, 40}, {100, 60, 40}, {0, 60, 40}};
  const Vec3 inward[4] = {Vec3::UnitY(), -Vec3::UnitX(), -Vec3::UnitY(), Vec3::UnitX()};
  for (int k = 0; k < 4; ++k)
    for (const double width : {0.1, 0.4}) c.path.passes.push_back(edge_pass(p[k], p[(k + 1) % 4], inward[k], width));
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value()) << m.error()[0].code << ": " << m.error()[0].message;
  expect_sound(c, m->artefact);
  expect_on_path(c, m->artefact);
}

TEST(Motion, WhatIsNotDrawnIsTold) {
  SmallCell c = small_cell();
  c.job.cell.robot.links.pop_back();
  c.job.fixture.mesh_fixture = {};
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value());
  ASSERT_EQ(m->notes.size(), 1u);
  EXPECT_EQ(m->notes[0].code, "motion.not_drawn");
  EXPECT_NE(m->notes[0].text.find("fixture, robot link 6"), std::string::npos) << m->notes[0].text;
}

TEST(Motion, SameInputsSameMotion) {
  const SmallCell c = small_cell();
  const auto a = plan(c), b = plan(c);
  ASSERT_TRUE(a && b);
  ASSERT_EQ(a->artefact.segments.size(), b->artefact.segments.size());
  for (std::size_t i = 0; i < a->artefact.segments.size(); ++i) EXPECT_EQ(a->artefact.segments[i].q_rad, b->artefact.segments[i].q_rad);
}

TEST(Motion, TheReferencePostureIsKept) {
  for (const double turn : {0.0, 1.0, -2.0}) {
    SmallCell c = small_cell();
    Pose<frame::Base, frame::Tool> T(quat_from_z(-Vec3::UnitZ(), Vec3(std::cos(turn), std::sin(turn), 0)), c.location.T_base_part.point({50, 0, 40}));
    c.features.T_base_tool_reference["top"] = T;
    const auto m = plan(c);
    ASSERT_TRUE(m.has_value()) << turn << m.error()[0].code << ": " << m.error()[0].message;
    for (const MotionSegment& s : m->artefact.segments) {
      if (s.kind != SegmentKind::cut) continue;
      for (const auto& at : s.T_base_tool) EXPECT_LT(deg_from_rad(at.q.angularDistance(T.q)), 1e-6) << turn;
    }
    for (const Note& n : m->notes) EXPECT_NE(n.code, "motion.left_reference");
  }
}

/// A post beside the edge where the sensor would be in the reference posture: the tool turns away and says what that costs.
TEST(Motion, AnObstacleTurnsTheToolAwayAndTheCostIsTold) {
  SmallCell c = small_cell();
  c.job.cell.robot.accuracy.absolute.mean_mm = 0.1;  // small beside the chamfer's tolerance
  const auto before = plan(c);
  ASSERT_TRUE(before.has_value());
  Pose<frame::Base, frame::Tool> T(quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()), c.location.T_base_part.point({50, 0, 40}));
  c.features.T_base_tool_reference["top"] = T;
  const Robot robot = *Robot::from(c.job.cell.robot);
  const Vec3 tip = c.location.T_base_part.point({50, 0, 40});
  // the sensor's box is 62..195 mm along tool x and ends 135 mm above the tip
  c.job.cell.obstacles.push_back({"post", test::box_mesh(tip + Vec3(150, -20, -20), tip + Vec3(170, 20, 160))});
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value()) << m.error()[0].code << ": " << m.error()[0].message;
  expect_sound(c, m->artefact);
  bool is_told = false;
  for (const Note& n : m->notes) is_told |= n.code == "motion.left_reference";
  EXPECT_TRUE(is_told);
}

/// The same post with a chamfer that has no room for that cost: nothing is cut, except by a named person's word.
TEST(Motion, APostureThatCostsTheToleranceIsRefused) {
  SmallCell c = small_cell();
  c.job.cell.robot.accuracy.absolute.mean_mm = 2.0;
  Pose<frame::Base, frame::Tool> T(quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()), c.location.T_base_part.point({50, 0, 40}));
  c.features.T_base_tool_reference["top"] = T;
  for (Recipe& r : c.job.recipes) r.gate_probability_ratio = 0.95, r.tolerance_mm = 0.05;
  for (CutPass& pass : c.path.passes)
    for (PathPoint& p : pass.points) p.probability_ratio = 0.99;
  const auto undisturbed = plan(c);
  ASSERT_TRUE(undisturbed.has_value()) << undisturbed.error()[0].message;
  const Vec3 tip = c.location.T_base_part.point({50, 0, 40});
  c.job.cell.obstacles.push_back({"post", test::box_mesh(tip + Vec3(150, -20, -20), tip + Vec3(170, 20, 160))});
  const auto m = plan(c);
  ASSERT_FALSE(m.has_value());
  EXPECT_EQ(m.error()[0].code, "motion.left_reference");
  EXPECT_LT(m.error()[0].measured, 0.95);
}

/// Walls such that the sensor fits on one side at the start and on another at the end: the turn has to change on the way.
TEST(Motion, TheTurnChangesWhereNoConstantOneHolds) {
  SmallCell c = small_cell({1000, -30, 660});
  c.job.part.brep.mesh = test::box_mesh(Vec3::Zero(), {400, 60, 40});
  c.job.fixture.mesh_fixture = {};
  c.path.passes = {edge_pass({0, 0, 40}, {400, 0, 40}, Vec3::UnitY())};
  const Vec3 o = c.location.T_base_part.point({0, 0, 40});
  const auto wall = [&](const char* name, Vec3 lo, Vec3 hi) {
    lo.z() = 60, hi.z() = 260;
    c.job.cell.obstacles.push_back({name, test::box_mesh(o + lo, o + hi)});
  };
  wall("a", {-250, 100, 0}, {150, 110, 0});
  wall("b", {250, -110, 0}, {650, -100, 0});
  wall("c", {500, -300, 0}, {510, 300, 0});
  wall("d", {-110, -300, 0}, {-100, 300, 0});
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value()) << m.error()[0].code << ": " << m.error()[0].message;
  expect_sound(c, m->artefact);
  expect_on_path(c, m->artefact);
  double turned = 0;
  for (const MotionSegment& s : m->artefact.segments)
    if (s.kind == SegmentKind::cut) turned = deg_from_rad(s.T_base_tool.front().q.angularDistance(s.T_base_tool.back().q));
  EXPECT_GT(turned, 30);
}

/// Tall walls between home and the block: neither the straight nor a raised move gets out, the search does.
TEST(Motion, ASearchFindsTheWayAroundWalls) {
  SmallCell c = small_cell();
  const Vec3 at = c.location.T_base_part.p_mm;
  c.job.cell.obstacles = {{"wall a", test::box_mesh(at + Vec3(-900, -420, 60), at + Vec3(900, -410, 3500))},
                          {"wall b", test::box_mesh(at + Vec3(-900, 410, 60), at + Vec3(900, 420, 3500))}};
  c.job.cell.robot.home_rad[0] = rad_from_deg(90);
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value()) << m.error()[0].code << ": " << m.error()[0].message;
  expect_sound(c, m->artefact);
  expect_on_path(c, m->artefact);
  EXPECT_GT(m->artefact.segments.front().q_rad.size(), 2u);
  const auto again = plan(c);
  ASSERT_TRUE(again.has_value());
  EXPECT_EQ(m->artefact.segments.front().q_rad, again->artefact.segments.front().q_rad);
}

TEST(Motion, ClearanceHoldsInADenseReplay) {
  SmallCell c = small_cell();
  c.job.cell.obstacles.push_back({"wall", test::box_mesh({1100, 140, 600}, {1400, 160, 900})});
  const auto m = plan(c);
  ASSERT_TRUE(m.has_value()) << m.error()[0].message;
  const Robot robot = *Robot::from(c.job.cell.robot);
  CollisionScene scene(robot);
  std::vector<int> moving, standing;
  moving.push_back(scene.add("tool", kMountFlange, c.job.cell.tools[0].mesh_flange));
  moving.push_back(scene.add("sensor", kMountFlange, c.job.cell.sensors[0].mesh_flange));
  for (const LinkMesh& l : c.job.cell.robot.links)
    if (l.joint > 0) moving.push_back(scene.add("link", l.joint, l.mesh));
  standing.push_back(scene.add("part", 0, transformed(c.location.T_base_part, c.job.part.brep.mesh)));
  for (const auto& o : c.job.cell.obstacles) standing.push_back(scene.add(o.name, 0, o.mesh_base));
  for (const MotionSegment& s : m->artefact.segments)
    for (std::size_t i = 1; i < s.q_rad.size(); ++i)
      for (int k = 0; k <= 5; ++k) {
        JointVector q;
        for (int j = 0; j < 6; ++j) q[j] = s.q_rad[i - 1][j] + (s.q_rad[i][j] - s.q_rad[i - 1][j]) * k / 5;
        for (const int a : moving)
          for (const int b : standing) EXPECT_GE(scene.separation(a, b, q, 10).distance_mm, std::min(10.0, s.clearance_mm) - 0.05);
      }
}

}  // namespace
}  // namespace asbuilt
