// SPDX-License-Identifier: GPL-3.0-or-later
// Arcs, cuts at outputs and splines made from straight moves, and what the replay says of joints that are asked for too much in corners.
#include <gtest/gtest.h>

#include "planner/plan/program/arcs.hpp"
#include "planner/verify/verify.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt {
namespace {

using testing::six_axis_arm;

const Eigen::Quaterniond kDown(Eigen::AngleAxisd(kPi, Vec3::UnitX()));

/// Straight moves round a circle about p, in a tilted plane, each off the circle by up to `noise_mm`.
Program round(double radius, double turn, int count, double noise_mm) {
  Program p;
  p.name = "ROUND";
  const Eigen::Quaterniond tilt = quat_from_zyx(0.3, 0.2, -0.1);
  const auto at = [&](int i) {
    const double t = turn * i / count, r = radius + (i % 3 - 1) * noise_mm;
    return Pose<frame::Base, frame::Tool>(kDown, Vec3(1200, 0, 700) + tilt * Vec3(r * std::cos(t), r * std::sin(t), 0));
  };
  p.instructions = {SetTool{1, {}}, SetFrame{}, MoveJoint{six_axis_arm().home_rad, 0.3}, MoveLinear{at(0), 20, true, 0}};
  for (int i = 1; i <= count; ++i) p.instructions.emplace_back(MoveLinear{at(i), 20, i == count, i == count ? 0 : 0.1});
  p.instructions.emplace_back(MoveJoint{six_axis_arm().home_rad, 0.3});
  return p;
}
const auto kAnywhere = [](const Vec3&, const Vec3&, const Vec3&, const Pose<frame::Base, frame::Work>&) { return true; };
const auto kNowhere = [](const Vec3&, const Vec3&, const Vec3&, const Pose<frame::Base, frame::Work>&) { return false; };

double length_of(const Program& p) {
  double length = 0;
  Vec3 at = Vec3::Zero();
  bool has_start = false;
  for (const Instruction& i : p.instructions) {
    if (const auto* m = std::get_if<MoveLinear>(&i)) length += has_start ? (m->T_base_tool.p_mm - at).norm() : 0, at = m->T_base_tool.p_mm, has_start = true;
    if (const auto* m = std::get_if<MoveCircular>(&i)) {
      const Vec3 u = m->T_base_via.p_mm - at, v = m->T_base_tool.p_mm - m->T_base_via.p_mm;
      const double turn = 2 * std::atan2(u.cross(v).norm(), u.dot(v));
      length += (m->T_base_tool.p_mm - at).norm() / (2 * std::sin(turn / 2)) * turn, at = m->T_base_tool.p_mm;
    }
  }
  return length;
}
template <class T>
int count(const Program& p) {
  int n = 0;
  for (const Instruction& i : p.instructions) n += std::holds_alternative<T>(i);
  return n;
}

TEST(Arcs, straight_moves_on_a_circle_become_arcs_of_the_same_circle) {
  const Program p = round(50, 5.5, 280, 0);
  const Program q = with_arcs({}, p, kAnywhere);
  EXPECT_EQ(count<MoveCircular>(q), 3);  // 315 degrees by at most 120
  EXPECT_EQ(count<MoveLinear>(q), 1);
  EXPECT_NEAR(length_of(q), 50 * 5.5, 1e-6);
  for (const Instruction& i : q.instructions)
    if (const auto* m = std::get_if<MoveCircular>(&i)) {
      const Vec3 d = quat_from_zyx(0.3, 0.2, -0.1).conjugate() * (m->T_base_via.p_mm - Vec3(1200, 0, 700));
      EXPECT_NEAR(d.head<2>().norm(), 50, 1e-6);  // the middle is ON the arc, not where its tangents meet
      EXPECT_NEAR(d.z(), 0, 1e-6);
    }
  EXPECT_EQ(count<MoveCircular>(with_arcs({}, p, kNowhere)), 0);
  EXPECT_EQ(with_arcs({}, q, kAnywhere).instructions.size(), q.instructions.size());
}

TEST(Arcs, what_is_no_circle_stays_straight) {
  EXPECT_EQ(count<MoveCircular>(with_arcs({}, round(50, 3, 100, 0.02), kAnywhere)), 0);  // points off by more than the tolerance
  EXPECT_EQ(count<MoveCircular>(with_arcs({}, round(50, 3, 10, 0), kAnywhere)), 0);      // chords that leave their circle by 0.5 mm
  Program p = round(50, 3, 200, 0);
  for (std::size_t i = 0; i < p.instructions.size(); ++i)  // a speed of its own for each move
    if (auto* m = std::get_if<MoveLinear>(&p.instructions[i])) m->speed_mm_s = 10 + static_cast<double>(i);
  EXPECT_EQ(count<MoveCircular>(with_arcs({}, p, kAnywhere)), 0);
}

TEST(Arcs, outputs_on_the_path_cut_it_where_they_are) {
  Program p = with_arcs({}, round(50, 2, 100, 0), kAnywhere);
  std::size_t arc = 0;
  while (!std::holds_alternative<MoveCircular>(p.instructions[arc])) ++arc;
  p.instructions.insert(p.instructions.begin() + static_cast<long>(arc), {OutputOnPath{7, false, -10}, OutputOnPath{7, true, 30}, OutputOnPath{9, true, 0.1}});
  const Program q = cut_at_outputs(p);
  EXPECT_EQ(count<OutputOnPath>(q), 0);
  EXPECT_EQ(count<SetOutput>(q), 3);
  EXPECT_EQ(count<MoveCircular>(q), 3);
  EXPECT_NEAR(length_of(q), length_of(p), 1e-6);
  Program before = q;  // up to the output that goes on
  std::size_t on = 0;
  while (!(std::holds_alternative<SetOutput>(q.instructions[on]) && std::get<SetOutput>(q.instructions[on]).output == 7)) ++on;
  before.instructions.resize(on);
  EXPECT_NEAR(length_of(before), 30, 1e-6);
  EXPECT_TRUE(std::get<SetOutput>(q.instructions[on]).value);
}

TEST(Arcs, splines_go_through_the_same_points) {
  const Program p = round(50, 1, 40, 0), q = with_splines(p);
  EXPECT_EQ(count<MoveSpline>(q), 40);
  EXPECT_EQ(q.instructions.size(), p.instructions.size());
}

CellSpec cell() {
  CellSpec c;
  c.robot = six_axis_arm();
  ToolSpec t;
  t.number = 1, t.id = "t", t.spindle.max_rpm = 10000;
  c.tools = {t};
  return c;
}
double ratio(const Program& p, const char* name) {
  for (const Check& c : verify_program(cell(), p).checks)
    if (c.name == name) return c.measured;
  ADD_FAILURE() << name;
  return -1;
}
/// A right-angled corner at a speed, rounded within `blend_mm` (0: exact).
Program corner(double speed, double blend_mm) {
  Program p;
  p.name = "CORNER";
  const auto at = [](double x, double y) { return Pose<frame::Base, frame::Tool>(kDown, Vec3(1200 + x, y, 700)); };
  p.instructions = {SetTool{1, {}}, SetFrame{}, MoveJoint{six_axis_arm().home_rad, 0.3}, MoveLinear{at(-100, 0), 100, true, 0}, MoveLinear{at(0, 0), speed, blend_mm == 0, blend_mm},
                    MoveLinear{at(0, 100), speed, true, 0}, MoveJoint{six_axis_arm().home_rad, 0.3}};
  return p;
}

TEST(VerifyAcceleration, a_rounded_corner_asks_the_joints_for_the_turn_of_the_speed) {
  const double slow = ratio(corner(20, 2), "joints.acceleration"), fast = ratio(corner(400, 2), "joints.acceleration"), wide = ratio(corner(400, 40), "joints.acceleration");
  EXPECT_GT(slow, 0.001);
  EXPECT_LT(slow, 1);
  EXPECT_GT(fast, 1);            // 400 mm/s round a corner of 2 mm: the joints cannot
  EXPECT_LT(wide, 0.2 * fast);   // the same corner with room
  EXPECT_LT(ratio(corner(400, 0), "joints.acceleration"), 0.2 * fast);  // an exact stop ramps within the controller's own limits
}

TEST(VerifyAcceleration, a_feed_step_is_taken_in_the_corner) {
  Program p = corner(10, 2);
  std::get<MoveLinear>(p.instructions[5]).T_base_tool.p_mm = Vec3(1300, 0, 700);  // straight on
  const double even = ratio(p, "joints.acceleration");
  std::get<MoveLinear>(p.instructions[5]).speed_mm_s = 400;
  EXPECT_GT(ratio(p, "joints.acceleration"), 5 * even);
}

TEST(VerifySpline, sparse_points_leave_the_curve_open) {
  Program p = corner(20, 0);
  const auto at = [](double x, double y) { return Pose<frame::Base, frame::Tool>(kDown, Vec3(1200 + x, y, 700)); };
  p.instructions[5] = MoveSpline{at(3, 20), 20};
  p.instructions.insert(p.instructions.begin() + 6, {MoveSpline{at(60, 30), 20}, MoveSpline{at(62, 60), 20}});
  EXPECT_GT(ratio(p, "spline.rules"), 0.02);
  const Program dense = with_splines(round(100, 1, 200, 0));
  EXPECT_LT(ratio(dense, "spline.rules"), 0.001);
}

TEST(VerifyEquipment, what_stays_on_or_lies_beside_the_path_is_named) {
  Program p = corner(20, 0);
  p.instructions.insert(p.instructions.begin() + 4, SwitchOn{Equipment::arc, 1});
  EXPECT_EQ(ratio(p, "equipment.off_at_end"), 1);
  EXPECT_EQ(ratio(p, "equipment.order"), 1);  // a joint move with the arc on
  p = corner(20, 0);
  p.instructions.insert(p.instructions.begin() + 5, OutputOnPath{7, true, 101});
  EXPECT_EQ(ratio(p, "trigger.on_path"), 1);
  std::get<OutputOnPath>(p.instructions[5]).path_mm = -99;
  EXPECT_EQ(ratio(p, "trigger.on_path"), 0);
}

}  // namespace
}  // namespace asbuilt
