// SPDX-License-Identifier: GPL-3.0-or-later
// Every refusal of this room, provoked.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "planner/plan/motion/motion.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

using test::small_cell;
using test::SmallCell;

Refusal refusal_of(const SmallCell& c, const MotionRecipe& recipe = {}) {
  const auto m = plan_motion(recipe, c.job, c.location, c.features, c.burrs, c.path);
  if (m) return {.code = "planned"};
  for (const Refusal& r : m.error()) {
    EXPECT_FALSE(r.message.empty());
    EXPECT_EQ(r.stage, "motion");
  }
  return m.error().front();
}

TEST(MotionRefusals, OutOfReach) {
  const Refusal r = refusal_of(small_cell({2500, 0, 660}));
  EXPECT_EQ(r.code, "motion.unreachable");
  EXPECT_NE(r.where.find("#88"), std::string::npos) << r.where;
  EXPECT_GT(r.measured, 50);
  EXPECT_LT(r.measured, 700);
}

TEST(MotionRefusals, OutsideTheJointLimits) {
  SmallCell c = small_cell();
  c.job.cell.robot.joints[4].min_rad = rad_from_deg(-30), c.job.cell.robot.joints[4].max_rad = rad_from_deg(30);
  c.job.cell.robot.home_rad[4] = 0.2;
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.joint_limit");
  EXPECT_NE(r.message.find("joint 5"), std::string::npos) << r.message;
}

TEST(MotionRefusals, HalfAnEdgeBeyondAJointLimit) {
  // an edge across the arm's front; joint 1 (which counts against base z) may not follow to its far half
  SmallCell c = small_cell();
  c.path.passes = {test::edge_pass({0, 60, 40}, {0, 0, 40}, Vec3::UnitX())};
  c.job.cell.robot.joints[0].max_rad = std::atan2(0.0, 1180.0) + 0.02 + 0.001;
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.joint_limit");
  EXPECT_NE(r.message.find("joint 1"), std::string::npos) << r.message;
  const std::string mm = r.where.substr(r.where.rfind(" at ") + 4);
  EXPECT_GT(std::stod(mm), 20) << r.where;
  EXPECT_LT(std::stod(mm), 45) << r.where;
}

TEST(MotionRefusals, AtTheEndOfTheStretchedArm) {
  // the wrist centre a hair inside the stretched arm: the elbow is singular at every turn
  SmallCell c = small_cell();
  const double reach = 1000 + std::hypot(1080.0, 150.0), dz = 660 + 40 - 1.95 + 570 - 750;
  const double x = 300 + std::sqrt((reach - 0.05) * (reach - 0.05) - dz * dz);
  c = small_cell({x + 2.05, -50, 660});
  c.job.cell.robot.joints[2].min_rad = -kPi, c.job.cell.robot.joints[2].max_rad = kPi;
  c.path.passes = {test::edge_pass({0, 47, 40}, {0, 53, 40}, Vec3::UnitX())};
  EXPECT_EQ(refusal_of(c).code, "motion.singular");
}

TEST(MotionRefusals, AClampOverTheEdge) {
  SmallCell c = small_cell();
  const Vec3 at = c.location.T_base_part.point({50, 0, 40});
  c.job.cell.obstacles.push_back({"clamp", test::box_mesh(at + Vec3(-8, -15, 2), at + Vec3(8, 15, 20))});
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.collision");
  EXPECT_NE(r.message.find("obstacle clamp"), std::string::npos) << r.message;
  EXPECT_NE(r.where.find("mm"), std::string::npos);
  EXPECT_LT(r.measured, r.limit);
}

TEST(MotionRefusals, APathThatDigsIntoThePart) {
  SmallCell c = small_cell();
  for (PathPoint& p : c.path.passes[0].points)
    if (p.kind == PathPointKind::cut && std::abs(p.s_mm - 50) < 1) p.tip_part += Vec3(0, 2.5, 0);
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.collision");
  EXPECT_NE(r.message.find("cutter core and part"), std::string::npos) << r.message;
}

TEST(MotionRefusals, HomeInsideAnObstacle) {
  SmallCell c = small_cell();
  c.job.cell.obstacles.push_back({"hall", test::box_mesh({-4000, -4000, -500}, {4000, 4000, 4000})});
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.collision");
  EXPECT_EQ(r.where, "robot.home");
  EXPECT_EQ(r.measured, 0);
}

TEST(MotionRefusals, HomeOutsideTheLimits) {
  SmallCell c = small_cell();
  c.job.cell.robot.home_rad[3] = 6;
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.joint_limit");
  EXPECT_EQ(r.where, "robot.home");
}

TEST(MotionRefusals, ARoofOverTheApproach) {
  SmallCell c = small_cell();
  c.path.passes[0].approach_mm = 200;
  const Vec3 at = c.location.T_base_part.p_mm;
  // too high to be met while cutting, in the way of the spindle 200 mm higher
  c.job.cell.obstacles.push_back({"roof", test::box_mesh(at + Vec3(-400, 150, 300), at + Vec3(500, 170, 1400))});
  c.job.cell.obstacles.push_back({"lintel", test::box_mesh(at + Vec3(-10, -90, 425), at + Vec3(110, -75, 440))});
  const Refusal r = refusal_of(c);
  EXPECT_TRUE(r.code == "motion.no_approach" || r.code == "motion.collision") << r.code << r.message;
}

TEST(MotionRefusals, NoApproachWhereTheRetractLeavesTheReach) {
  SmallCell c = small_cell();
  c.path.passes[0].approach_mm = 3000;
  EXPECT_EQ(refusal_of(c).code, "motion.no_approach");
}

/// The same walls that a search of the usual length finds its way around.
TEST(MotionRefusals, NoTransferWithTooShortASearch) {
  SmallCell c = small_cell();
  const Vec3 at = c.location.T_base_part.p_mm;
  const double z0 = 60, z1 = 3500;
  c.job.cell.obstacles = {{"wall a", test::box_mesh(at + Vec3(-900, -420, z0), at + Vec3(900, -410, z1))},
                          {"wall b", test::box_mesh(at + Vec3(-900, 410, z0), at + Vec3(900, 420, z1))}};
  c.job.cell.robot.home_rad[0] = rad_from_deg(90);
  MotionRecipe recipe;
  recipe.planner_iterations_count = 20;
  const Refusal r = refusal_of(c, recipe);
  EXPECT_EQ(r.code, "motion.no_transfer") << r.message;
}

TEST(MotionRefusals, JointTooSlow) {
  SmallCell c = small_cell();
  c.job.cell.robot.joints[0].speed_rad_s = rad_from_deg(0.05);
  const Refusal r = refusal_of(c);
  EXPECT_EQ(r.code, "motion.joint_speed");
  EXPECT_NE(r.message.find("joint 1"), std::string::npos);
}

TEST(MotionRefusals, NothingToDo) {
  SmallCell c = small_cell();
  c.path.passes.clear();
  EXPECT_EQ(refusal_of(c).code, "motion.nothing_to_do");
}

TEST(MotionRefusals, TwoToolsInOneItem) {
  SmallCell c = small_cell();
  c.job.cell.tools.push_back(c.job.cell.tools[0]);
  c.job.cell.tools[1].id = "other";
  c.path.passes.push_back(c.path.passes[0]);
  c.path.passes[1].tool = "other";
  EXPECT_EQ(refusal_of(c).code, "motion.tool_change");
}

}  // namespace
}  // namespace asbuilt
