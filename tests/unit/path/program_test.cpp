// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/program/program.hpp"

#include <gtest/gtest.h>

#include <set>

#include "planner/plan/path/path.hpp"
#include "tests/unit/path/world.hpp"

namespace asbuilt {
namespace {

Motion motion_for(const testing::World& w, const ToolPath& path) {
  Motion m;
  const JointVector home = w.job.cell.robot.home_rad, near_part{0.1, -1.5, 1.4, 0, 1.2, 0};
  const Eigen::Quaterniond down = quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
  m.segments.push_back({SegmentKind::transfer, -1, {home, near_part}, {{}, {}}, {0, 0}, 0.3, 10});
  for (int k = 0; k < static_cast<int>(path.passes.size()); ++k) {
    const CutPass& p = path.passes[static_cast<std::size_t>(k)];
    MotionSegment approach, cut, retract;
    const auto at = [&](const Vec3& tip) { return Pose<frame::Base, frame::Tool>(down, w.location.T_base_part.point(tip)); };
    const Vec3 lift = p.approach_mm * p.retract_part;
    approach.kind = SegmentKind::approach, cut.kind = SegmentKind::cut, retract.kind = SegmentKind::retract;
    approach.pass = cut.pass = retract.pass = k;
    approach.T_base_tool = {at(p.points.front().tip_part + lift), at(p.points.front().tip_part)}, approach.speed_mm_s = {0, 50};
    for (const PathPoint& x : p.points) cut.T_base_tool.push_back(at(x.tip_part)), cut.speed_mm_s.push_back(x.feed_mm_s);
    retract.T_base_tool = {at(p.points.back().tip_part), at(p.points.back().tip_part + lift)}, retract.speed_mm_s = {0, 45};
    for (MotionSegment* s : {&approach, &cut, &retract}) s->q_rad.assign(s->T_base_tool.size(), near_part);
    m.segments.insert(m.segments.end(), {approach, cut, retract});
  }
  m.segments.push_back({SegmentKind::transfer, -1, {near_part, home}, {{}, {}}, {0, 0}, 0.3, 10});
  return m;
}

TEST(Program, starts_and_ends_at_home_and_spins_only_where_it_works) {
  const testing::World w = testing::box_world();
  const auto path = plan_path({}, w.job, w.location, w.features, w.burrs);
  ASSERT_TRUE(path);
  const auto r = plan_program({}, w.job, w.location, path->artefact, motion_for(w, path->artefact));
  ASSERT_TRUE(r);
  const Program& p = r->artefact;
  ASSERT_TRUE(std::holds_alternative<SetTool>(p.instructions[0]));
  ASSERT_TRUE(std::holds_alternative<SetFrame>(p.instructions[1]));
  ASSERT_TRUE(std::holds_alternative<MoveJoint>(p.instructions[2]));
  EXPECT_EQ(std::get<MoveJoint>(p.instructions[2]).q_rad, w.job.cell.robot.home_rad);
  ASSERT_TRUE(std::holds_alternative<MoveJoint>(p.instructions.back()));
  EXPECT_EQ(std::get<MoveJoint>(p.instructions.back()).q_rad, w.job.cell.robot.home_rad);
  bool is_spinning = false;
  std::size_t cutting = 0;
  for (const Instruction& i : p.instructions) {
    if (const auto* on = std::get_if<SpindleOn>(&i)) {
      is_spinning = true;
      EXPECT_EQ(on->rpm, 12000);
    }
    if (std::holds_alternative<SpindleOff>(i)) is_spinning = false;
    if (std::holds_alternative<MoveJoint>(i)) {
      EXPECT_FALSE(is_spinning);
    }
    if (const auto* l = std::get_if<MoveLinear>(&i)) {
      EXPECT_TRUE(is_spinning);
      EXPECT_NEAR(l->speed_mm_s * 10, std::round(l->speed_mm_s * 10), 1e-9);
      EXPECT_TRUE(l->speed_mm_s <= 40 || l->speed_mm_s >= 48);
      cutting += l->speed_mm_s <= 40;
    }
  }
  EXPECT_FALSE(is_spinning);
  EXPECT_EQ(cutting, path->artefact.passes[0].points.size() - 1);
  bool says_not_run = false;
  for (const std::string& h : p.header) {
    says_not_run = says_not_run || h.find("not run on a controller") != std::string::npos;
    for (char c : h) EXPECT_TRUE(c >= 0x20 && c < 0x7F);
  }
  EXPECT_TRUE(says_not_run);
}

TEST(Program, names_are_legal_and_never_shared) {
  std::set<std::string> names;
  const std::string ids[] = {"ring-0001", "ring_0001", "RING-0001", "Ring-0001", "1st", "a-very-long-name-of-an-item-0001",
                             "a-very-long-name-of-an-item-0002", "", "for", "x", "\xC3\xA4pfel"};
  for (const std::string& id : ids) {
    const std::string n = program_name(id);
    EXPECT_LE(n.size(), 24u);
    EXPECT_TRUE(n[0] >= 'a' && n[0] <= 'z') << n;
    for (char c : n) EXPECT_TRUE((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_') << n;
    EXPECT_TRUE(names.insert(n).second) << n;
  }
  EXPECT_EQ(program_name("ring_0001"), "ring_0001");
}

TEST(Program, the_frame_holds_printed_digits_only) {
  Pose<frame::Base, frame::Part> T(quat_from_zyx(0.123456789, -0.3456789, 0.0123456), Vec3(1234.56789, -0.0004, 3.14159265));
  const auto F = printed_frame(T);
  EXPECT_NEAR(F.p_mm.x(), 1234.568, 1e-12);
  EXPECT_LT(twist_between(Pose<frame::Base, frame::Work>(T.q, T.p_mm), F).tail<3>().norm(), rad_from_deg(0.0001));
  const auto G = printed_frame(Pose<frame::Base, frame::Part>(F.q, F.p_mm));
  EXPECT_LT(twist_between(F, G).norm(), 1e-9);
}

TEST(Program, refuses_nothing_to_write_and_two_tools) {
  const testing::World w = testing::box_world();
  auto path = plan_path({}, w.job, w.location, w.features, w.burrs);
  ASSERT_TRUE(path);
  EXPECT_EQ(plan_program({}, w.job, w.location, path->artefact, {}).error().front().code, "path.no_motion");
  const Motion m = motion_for(w, path->artefact);
  testing::World two = w;
  two.job.cell.tools.push_back(two.job.cell.tools[0]);
  two.job.cell.tools[1].id = "other";
  path->artefact.passes.push_back(path->artefact.passes[0]);
  path->artefact.passes[1].tool = "other";
  EXPECT_EQ(plan_program({}, two.job, two.location, path->artefact, m).error().front().code, "path.one_tool");
  path->artefact.passes[1].tool = "missing";
  EXPECT_EQ(plan_program({}, two.job, two.location, path->artefact, m).error().front().code, "path.tool_does_not_fit");
}

}  // namespace
}  // namespace asbuilt
