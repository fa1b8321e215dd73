// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/verify.hpp"

#include <gtest/gtest.h>

#include "tests/unit/verify/item.hpp"

namespace asbuilt {
namespace {

using testing::box_item;
using testing::box_mesh;
using testing::Item;

Verdict verify(const Item& i) { return verify_item(i.world.job, i.world.location, i.world.features, i.world.burrs, i.path, i.program); }

std::string failed(const Verdict& v) {
  std::string s;
  for (const Check& c : v.checks)
    if (!c.is_passed) s += c.name + " (" + std::to_string(c.measured) + " / " + std::to_string(c.limit) + " " + c.unit + " at " + c.where + ") ";
  return s;
}
bool fails(const Verdict& v, const std::string& name) {
  for (const Check& c : v.checks)
    if (c.name == name) return !c.is_passed;
  return false;
}

template <class T>
T& nth(Program& p, int n) {
  for (Instruction& i : p.instructions)
    if (auto* x = std::get_if<T>(&i))
      if (n-- == 0) return *x;
  throw std::runtime_error("no such instruction");
}
template <class T>
void erase_first(Program& p) {
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (std::holds_alternative<T>(p.instructions[i])) {
      p.instructions.erase(p.instructions.begin() + static_cast<std::ptrdiff_t>(i));
      return;
    }
}

TEST(Verify, a_good_program_passes_every_check_and_says_how_well) {
  const Item item = box_item();
  const Verdict v = verify(item);
  EXPECT_TRUE(v.is_ok()) << failed(v);
  EXPECT_GT(v.checks.size(), 30u);
  EXPECT_LT(v.path_error_max_mm, 0.001);
  EXPECT_GT(v.clearance_min_mm, 1);
  EXPECT_LT(v.clearance_min_mm, 200);
  EXPECT_GT(v.duration_s, 5);
  EXPECT_GT(v.joint_margin_min_rad, 0);
  const Verdict alone = verify_program(item.world.job.cell, item.program);
  EXPECT_TRUE(alone.is_ok()) << failed(alone);
}

TEST(Verify, a_clamp_over_the_edge_is_seen) {
  Item item = box_item();
  testing::append(item.world.job.fixture.mesh_fixture, box_mesh({20, -15, 50}, {30, 5, 75}));
  const Verdict v = verify(item);
  EXPECT_FALSE(v.is_ok());
  EXPECT_TRUE(fails(v, "clearance.cutter") || fails(v, "clearance.tool")) << failed(v);
}

TEST(Verify, an_obstacle_in_the_way_of_a_joint_move_is_seen_by_the_cell_alone) {
  Item item = box_item();
  const Robot robot = *Robot::from(item.world.job.cell.robot);
  const MotionSegment& t = item.motion.segments.front();
  JointVector q;
  for (std::size_t i = 0; i < 6; ++i) q[i] = 0.5 * (t.q_rad.front()[i] + t.q_rad.back()[i]);
  const Vec3 p = robot.forward(q).point(Vec3(0, 0, 150));
  item.world.job.cell.obstacles.push_back({"post", box_mesh(p - Vec3(10, 10, 10), p + Vec3(10, 10, 10))});
  EXPECT_TRUE(fails(verify_program(item.world.job.cell, item.program), "clearance.tool"));
}

TEST(Verify, names_what_is_wrong) {
  const Item good = box_item();
  const auto check = [&](const std::string& name, auto&& change) {
    Item item = good;
    change(item.program);
    const Verdict v = verify(item);
    EXPECT_FALSE(v.is_ok()) << name;
    EXPECT_TRUE(fails(v, name)) << name << ": " << failed(v);
  };
  check("order.setup_first", [](Program& p) { erase_first<SetTool>(p); });
  check("order.setup_first", [](Program& p) { erase_first<SetFrame>(p); });
  check("order.starts_at_home", [](Program& p) { erase_first<MoveJoint>(p); });
  check("order.ends_at_home", [](Program& p) { p.instructions.pop_back(); });
  check("order.first_move_joint", [](Program& p) { p.instructions.insert(p.instructions.begin() + 2, nth<MoveLinear>(p, 0)); });
  check("spindle.off_at_end", [](Program& p) { erase_first<SpindleOff>(p); });
  check("spindle.cutting", [](Program& p) { erase_first<SpindleOn>(p); });
  check("clearance.rapid", [](Program& p) { erase_first<SpindleOn>(p); });
  check("spindle.recipe", [](Program& p) { nth<SpindleOn>(p, 0).rpm = 9000; });
  check("spindle.speed", [](Program& p) { nth<SpindleOn>(p, 0).rpm = 20000; });
  check("tool.known", [](Program& p) { nth<SetTool>(p, 0).number = 7; });
  check("tool.position", [](Program& p) { nth<SetTool>(p, 0).T_flange_tool.p_mm.z() += 1; });
  check("frame.position", [](Program& p) { nth<SetFrame>(p, 0).T_base_work.p_mm.x() += 1; });
  check("path.feed", [](Program& p) { nth<MoveLinear>(p, 12).speed_mm_s *= 1.1; });
  check("feed.min", [](Program& p) { nth<MoveLinear>(p, 12).speed_mm_s = 0.5; });
  check("speed.positive", [](Program& p) { nth<MoveLinear>(p, 12).speed_mm_s = 0; });
  check("path.error", [](Program& p) { nth<MoveLinear>(p, 12).T_base_tool.p_mm.y() += 1; });
  check("path.axis", [](Program& p) {
    auto& T = nth<MoveLinear>(p, 12).T_base_tool;
    T.q = T.q * Eigen::Quaterniond(Eigen::AngleAxisd(0.002, Vec3::UnitX()));
  });
  check("orientation.step", [](Program& p) {
    auto& T = nth<MoveLinear>(p, 12).T_base_tool;
    T.q = T.q * Eigen::Quaterniond(Eigen::AngleAxisd(0.2, Vec3::UnitX()));
  });
  check("blend", [](Program& p) {
    for (Instruction& i : p.instructions)
      if (auto* m = std::get_if<MoveLinear>(&i)) m->is_exact = false, m->blend_mm = 2;
  });
  check("reach", [](Program& p) { nth<MoveLinear>(p, 12).T_base_tool.p_mm.x() += 5000; });
  check("joints.limits", [](Program& p) { nth<MoveJoint>(p, 1).q_rad[4] = 2.5; });
  check("speed.joint", [](Program& p) { nth<MoveJoint>(p, 1).speed_ratio = 0; });
  check("joints.speed", [](Program& p) { nth<MoveJoint>(p, 1).speed_ratio = 1.5; });
  check("numbers", [](Program& p) { nth<MoveLinear>(p, 3).T_base_tool.p_mm.x() = std::nan(""); });
}

TEST(Verify, sees_what_the_cutter_leaves) {
  const Item good = box_item();
  const auto sunk = [&](const Vec3& d) {
    Item item = good;  // path and program agree, both wrong
    for (CutPass& p : item.path.passes)
      for (PathPoint& x : p.points) x.tip_part += d;
    for (Instruction& i : item.program.instructions)
      if (auto* m = std::get_if<MoveLinear>(&i)) m->T_base_tool.p_mm += item.world.location.T_base_part.direction(d);
    return verify(item);
  };
  EXPECT_TRUE(sunk({0, 0, 0}).is_ok());
  EXPECT_TRUE(fails(sunk({0, 0, -0.25}), "chamfer.gouge"));
  EXPECT_TRUE(fails(sunk({0, 0, 0.25}), "chamfer.legs"));
  EXPECT_TRUE(fails(sunk({0, 0, 0.6}), "chamfer.coverage"));
  EXPECT_TRUE(fails(sunk({0, 0, -0.06}), "chamfer.mean_leg"));
}

TEST(Verify, sees_a_cut_away_from_the_edges) {
  Item item = box_item();
  // a boss beside the edge that nobody told the path about
  testing::append(item.world.job.part.brep.mesh, box_mesh({25, -6, -20}, {30, -1.5, 5}));
  const Verdict v = verify(item);
  EXPECT_TRUE(fails(v, "stray_cut")) << failed(v);
}

TEST(Verify, sees_a_feed_too_high_for_the_burr) {
  Item item = box_item();
  for (EdgeBurr& b : item.world.burrs.edges)
    for (double& a : b.area_mm2) a += 0.1;
  EXPECT_TRUE(fails(verify(item), "removal_rate"));
}

TEST(Compare, equal_programs_are_equal_and_every_change_is_named) {
  const Item item = box_item();
  const PrintedSteps steps{.speed_mm_s = 0.1};
  EXPECT_TRUE(compare_programs(item.program, item.program, steps).is_ok());
  Program noisy = item.program;
  for (Instruction& i : noisy.instructions)
    if (auto* m = std::get_if<MoveLinear>(&i)) m->T_base_tool.p_mm.x() += 0.0004, m->is_exact = true;
  EXPECT_TRUE(compare_programs(item.program, noisy, steps).is_ok());
  Program in_base = item.program;  // a dialect that writes its points in base, and says so late
  std::swap(in_base.instructions[1], in_base.instructions[2]);
  std::get<SetFrame>(in_base.instructions[2]).T_base_work = {};
  EXPECT_TRUE(compare_programs(item.program, in_base, steps).is_ok());
  EXPECT_TRUE(verify_item(item.world.job, item.world.location, item.world.features, item.world.burrs, item.path, in_base).is_ok());
  const auto check = [&](const std::string& name, auto&& change) {
    Program p = item.program;
    change(p);
    EXPECT_TRUE(fails(compare_programs(item.program, p, steps), name)) << name;
  };
  check("compare.count", [](Program& p) { erase_first<Wait>(p); });
  check("compare.order", [](Program& p) { std::swap(p.instructions[0], p.instructions[2]); });
  check("compare.position", [](Program& p) { nth<SetFrame>(p, 0).T_base_work.p_mm.x() += 0.002; });
  check("compare.position", [](Program& p) { nth<MoveLinear>(p, 5).T_base_tool.p_mm.z() += 0.002; });
  check("compare.coordinate", [](Program& p) { nth<MoveLinear>(p, 5).T_base_tool.p_mm += nth<SetFrame>(p, 0).T_base_work.q * Vec3(0, 0.0007, 0); });
  check("compare.orientation", [](Program& p) {
    auto& T = nth<MoveLinear>(p, 5).T_base_tool;
    T.q = T.q * quat_exp(Vec3(0, 0, 1e-5));
  });
  check("compare.joints", [](Program& p) { nth<MoveJoint>(p, 1).q_rad[2] += 1e-5; });
  check("compare.speed", [](Program& p) { nth<MoveLinear>(p, 5).speed_mm_s += 0.1; });
  check("compare.joint_speed", [](Program& p) { nth<MoveJoint>(p, 1).speed_ratio += 0.01; });
  check("compare.spindle", [](Program& p) { nth<SpindleOn>(p, 0).rpm += 1; });
  check("compare.wait", [](Program& p) { nth<Wait>(p, 0).time_s += 0.006; });
  check("compare.events", [](Program& p) { nth<SetTool>(p, 0).number = 2; });
  check("compare.blend", [](Program& p) { nth<MoveLinear>(p, 0).is_exact = false, nth<MoveLinear>(p, 0).blend_mm = 1; });
}

}  // namespace
}  // namespace asbuilt
