// SPDX-License-Identifier: GPL-3.0-or-later
// A whole item with known truth for the verifier's tests: a box on a table in front of a six-axis arm, its path, a plain motion and
// the program of it.
#pragma once

#include <functional>
#include <stdexcept>

#include "planner/plan/path/path.hpp"
#include "planner/plan/program/program.hpp"
#include "planner/robot/robot.hpp"
#include "tests/unit/path/world.hpp"

namespace asbuilt::testing {

inline RobotSpec six_axis_arm() {
  RobotSpec r;
  OpwParameters o;
  o.a1_mm = 300, o.a2_mm = -150, o.b_mm = 0, o.c1_mm = 750, o.c2_mm = 1000, o.c3_mm = 1080, o.c4_mm = 220;
  o.offsets_rad = {0, rad_from_deg(-90), 0, 0, 0, 0};
  o.signs = {-1, 1, 1, -1, 1, -1};
  r.kinematics = o;
  const double limits[6][4] = {{-180, 180, 120, 350}, {-150, 20, 115, 350}, {-110, 150, 120, 350}, {-270, 270, 190, 600}, {-122, 122, 180, 600}, {-350, 350, 260, 800}};
  for (std::size_t i = 0; i < 6; ++i)
    r.joints[i] = {rad_from_deg(limits[i][0]), rad_from_deg(limits[i][1]), rad_from_deg(limits[i][2]), rad_from_deg(limits[i][3]), 0};
  r.home_rad = {0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};
  r.accuracy.short_term = {0.02, 0.01};
  return r;
}

struct Item {
  World world;
  ToolPath path;
  Motion motion;
  Program program;
};

inline Mesh tool_body() {  // a box around the spindle, in flange; the cutter sticks out below
  return box_mesh({-40, -40, 0}, {40, 40, 290});
}

/// `change` moves the part before the path is planned.
inline Item box_item(const std::function<void(World&)>& change = {}) {
  Item item;
  World& w = item.world;
  w = box_world();
  w.job.cell.robot = six_axis_arm();
  w.job.cell.tools[0].mesh_flange = tool_body();
  w.job.cell.tools[0].spindle.max_rpm = 16000;
  w.job.cell.obstacles.push_back({"table", box_mesh({900, -400, 560}, {1500, 400, 640})});
  w.job.fixture.T_base_fixture.p_mm = Vec3(1200, 0, 640);
  w.job.fixture.mesh_fixture = box_mesh({5, 5, 0}, {55, 35, 40});
  w.location.T_base_part.p_mm = Vec3(1200, 0, 700);
  w.location.T_base_part.q = quat_from_zyx(0.1, 0.004, -0.003);
  if (change) change(w);
  for (std::size_t k = 0; k < 4; ++k)
    w.burrs.edges[k] = make_burr(w.features.edges[k], [&](double s) { return 0.15 + 0.1 * std::sin(0.2 * s + static_cast<double>(k)); });
  const auto path = plan_path({}, w.job, w.location, w.features, w.burrs);
  if (!path) throw std::runtime_error(path.error().front().message);
  item.path = path->artefact;
  const Robot robot = *Robot::from(w.job.cell.robot);
  const Pose<frame::Tool, frame::Flange> T_tool_flange = w.job.cell.tools[0].T_flange_tool.inverse();
  JointVector q = w.job.cell.robot.home_rad;
  Motion& m = item.motion;
  for (int k = 0; k < static_cast<int>(item.path.passes.size()); ++k) {
    const CutPass& p = item.path.passes[static_cast<std::size_t>(k)];
    const auto at = [&](const Vec3& tip) {
      return Pose<frame::Base, frame::Tool>(quat_from_z(w.location.T_base_part.direction(p.points.front().axis_part), Vec3(0.9, 0.4, 0)),
                                            w.location.T_base_part.point(tip));
    };
    const auto solve = [&](const Pose<frame::Base, frame::Tool>& T) {
      const auto r = robot.inverse_near(T * T_tool_flange, q);
      if (!r) throw std::runtime_error("the test's box is out of reach");
      q = *r;
      return q;
    };
    const Vec3 lift = p.approach_mm * p.retract_part;
    MotionSegment transfer{SegmentKind::transfer, -1, {q}, {{}}, {0}, 0.3, 10}, approach, cut, retract;
    approach.kind = SegmentKind::approach, cut.kind = SegmentKind::cut, retract.kind = SegmentKind::retract;
    approach.pass = cut.pass = retract.pass = k;
    const auto add = [&](MotionSegment& s, const Pose<frame::Base, frame::Tool>& T, double v) {
      s.q_rad.push_back(solve(T)), s.T_base_tool.push_back(T), s.speed_mm_s.push_back(v);
    };
    add(approach, at(p.points.front().tip_part + lift), 50);
    transfer.q_rad.push_back(q), transfer.T_base_tool.push_back(approach.T_base_tool.front()), transfer.speed_mm_s.push_back(0);
    add(approach, at(p.points.front().tip_part), 50);
    for (const PathPoint& x : p.points) add(cut, at(x.tip_part), x.feed_mm_s);
    add(retract, at(p.points.back().tip_part), 50), add(retract, at(p.points.back().tip_part + lift), 50);
    m.segments.insert(m.segments.end(), {transfer, approach, cut, retract});
  }
  m.segments.push_back({SegmentKind::transfer, -1, {q, w.job.cell.robot.home_rad}, {{}, {}}, {0, 0}, 0.3, 10});
  const auto program = plan_program({}, w.job, w.location, item.path, m);
  if (!program) throw std::runtime_error(program.error().front().message);
  item.program = program->artefact;
  return item;
}

}  // namespace asbuilt::testing
