// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "planner/verify/checks.hpp"

namespace asbuilt::verifying {

void add_check(Verdict& v, const std::string& name, double measured, double limit, const std::string& unit, bool is_passed, const std::string& where) {
  Check c;
  c.name = name, c.measured = measured, c.limit = limit, c.unit = unit, c.where = where, c.is_passed = is_passed && std::isfinite(measured);
  v.checks.push_back(c);
}

namespace {

double count(std::size_t n) { return static_cast<double>(n); }

double joints_apart(const JointVector& a, const JointVector& b) {
  double d = 0;
  for (std::size_t i = 0; i < 6; ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

void check_order(Verdict& v, const CellSpec& cell, const Program& p, const Replay& r, const Limits& limits) {
  add_check(v, "order.moves", count(r.moves_count), 1, "count", r.moves_count > 0, "program " + p.name);
  add_check(v, "order.setup_first", count(r.before_setup.size()), 0, "count", r.before_setup.empty(),
            r.before_setup.empty() ? "" : place_of(p, r.before_setup.front()));
  add_check(v, "order.first_move_joint", r.is_first_joint ? 0 : 1, 0, "count", r.is_first_joint, place_of(p, r.first_motion));
  double start = 9, end = 9;
  if (r.first_motion >= 0)
    if (const auto* m = std::get_if<MoveJoint>(&p.instructions[static_cast<std::size_t>(r.first_motion)]))
      start = joints_apart(m->q_rad, cell.robot.home_rad);
  if (r.last_motion >= 0)
    if (const auto* m = std::get_if<MoveJoint>(&p.instructions[static_cast<std::size_t>(r.last_motion)]))
      end = joints_apart(m->q_rad, cell.robot.home_rad);
  add_check(v, "order.starts_at_home", deg_from_rad(start), deg_from_rad(limits.home_rad), "deg", start <= limits.home_rad, place_of(p, r.first_motion));
  add_check(v, "order.ends_at_home", deg_from_rad(end), deg_from_rad(limits.home_rad), "deg", end <= limits.home_rad, place_of(p, r.last_motion));
}

void check_tools(Verdict& v, const CellSpec& cell, const Program& p, const Limits& limits) {
  double worst_mm = 0, worst_rad = 0, unknown = 0;
  int where = -1;
  for (std::size_t i = 0; i < p.instructions.size(); ++i) {
    const auto* s = std::get_if<SetTool>(&p.instructions[i]);
    if (s == nullptr) continue;
    const auto it = std::find_if(cell.tools.begin(), cell.tools.end(), [&](const ToolSpec& t) { return t.number == s->number; });
    if (it == cell.tools.end()) {
      ++unknown, where = static_cast<int>(i);
      continue;
    }
    const Vec6 xi = twist_between(it->T_flange_tool, s->T_flange_tool);
    if (xi.head<3>().norm() > worst_mm) worst_mm = xi.head<3>().norm(), where = static_cast<int>(i);
    worst_rad = std::max(worst_rad, xi.tail<3>().norm());
  }
  const std::string place = where < 0 ? "" : place_of(p, where);
  add_check(v, "tool.known", unknown, 0, "count", unknown == 0, place);
  add_check(v, "tool.position", worst_mm, limits.tool_mm, "mm", worst_mm <= limits.tool_mm, place);
  add_check(v, "tool.orientation", deg_from_rad(worst_rad), deg_from_rad(limits.tool_rad), "deg", worst_rad <= limits.tool_rad, place);
}

void check_spindle(Verdict& v, const CellSpec& cell, const Program& p, const Replay& r) {
  add_check(v, "spindle.off_at_end", r.rpm_at_end, 0, "rpm", r.rpm_at_end == 0, "program " + p.name);
  const ToolSpec* tool = nullptr;
  double over = 0, limit = 0, transfers = 0;
  int where = -1, transfer_at = -1;
  double rpm = 0;
  for (std::size_t i = 0; i < p.instructions.size(); ++i) {
    if (const auto* s = std::get_if<SetTool>(&p.instructions[i])) {
      tool = nullptr;
      for (const ToolSpec& t : cell.tools)
        if (t.number == s->number) tool = &t;
    }
    if (const auto* s = std::get_if<SpindleOn>(&p.instructions[i])) {
      rpm = s->rpm;
      limit = tool != nullptr ? tool->spindle.max_rpm : 0;
      const double bad = s->rpm <= 0 ? 1e9 : limit > 0 ? std::max(0.0, s->rpm - limit) : 0.0;
      if (bad > over) over = bad, where = static_cast<int>(i);
    }
    if (std::holds_alternative<SpindleOff>(p.instructions[i])) rpm = 0;
    if (std::holds_alternative<MoveJoint>(p.instructions[i]) && rpm > 0) ++transfers, transfer_at = static_cast<int>(i);
  }
  add_check(v, "spindle.speed", over, 0, "rpm", over <= 0, where < 0 ? "" : place_of(p, where));
  add_check(v, "spindle.off_in_transfers", transfers, 0, "count", transfers == 0, transfer_at < 0 ? "" : place_of(p, transfer_at));
}

}  // namespace

void check_program(Verdict& v, const CellSpec& cell, const Program& p, const Replay& r, const Limits& limits) {
  check_order(v, cell, p, r, limits);
  check_tools(v, cell, p, limits);
  check_spindle(v, cell, p, r);
  const auto at = [&](const Extreme& e) { return e.instruction < 0 ? std::string() : place_of(p, e.instruction); };
  add_check(v, "reach", count(r.unreached.size()), 0, "count", r.unreached.empty(), r.unreached.empty() ? "" : place_of(p, r.unreached.front()));
  const double margin = r.samples.empty() ? -1 : r.limit_margin_rad.value;
  add_check(v, "joints.limits", deg_from_rad(margin), 0, "deg", margin >= 0, at(r.limit_margin_rad));
  add_check(v, "joints.speed", r.speed_ratio.value, 1, "ratio", r.speed_ratio.value <= 1, at(r.speed_ratio));
  add_check(v, "joints.acceleration", r.acceleration_ratio.value, 1, "ratio", r.acceleration_ratio.value <= 1, at(r.acceleration_ratio));
  add_check(v, "joints.jump", deg_from_rad(r.jump_rad.value), deg_from_rad(limits.jump_rad), "deg", r.jump_rad.value <= limits.jump_rad, at(r.jump_rad));
  const auto first_of = [&](const std::vector<int>& v) { return v.empty() ? std::string() : place_of(p, v.front()); };
  add_check(v, "trigger.on_path", count(r.off_path.size()), 0, "count", r.off_path.empty(), first_of(r.off_path));
  add_check(v, "equipment.order", count(r.arc_in_transfer.size()), 0, "count", r.arc_in_transfer.empty(), first_of(r.arc_in_transfer));
  const double still_on = static_cast<double>(std::count(r.is_on.begin(), r.is_on.end(), true));
  add_check(v, "equipment.off_at_end", still_on, 0, "count", still_on == 0, "program " + p.name);
  if (r.spline_rules_mm.instruction >= 0)
    add_check(v, "spline.rules", r.spline_rules_mm.value, limits.spline_rules_mm, "mm", r.spline_rules_mm.value <= limits.spline_rules_mm, at(r.spline_rules_mm));
  const bool has_linear = r.linear_speed_max_mm_s.instruction >= 0;
  if (has_linear) {
    add_check(v, "singularity", r.singularity_ratio.value, limits.singularity_ratio, "ratio",
              r.singularity_ratio.value >= limits.singularity_ratio, at(r.singularity_ratio));
    add_check(v, "orientation.step", deg_from_rad(r.orientation_step_rad.value), deg_from_rad(limits.orientation_step_rad), "deg",
              r.orientation_step_rad.value <= limits.orientation_step_rad, at(r.orientation_step_rad));
    add_check(v, "orientation.rules", deg_from_rad(r.orientation_rules_rad.value), deg_from_rad(limits.orientation_rules_rad), "deg",
              r.orientation_rules_rad.value <= limits.orientation_rules_rad, at(r.orientation_rules_rad));
    add_check(v, "speed.positive", r.linear_speed_min_mm_s.value, 0, "mm/s", r.linear_speed_min_mm_s.value > 0, at(r.linear_speed_min_mm_s));
    add_check(v, "speed.limit", r.linear_speed_max_mm_s.value, limits.linear_speed_max_mm_s, "mm/s",
              r.linear_speed_max_mm_s.value <= limits.linear_speed_max_mm_s, at(r.linear_speed_max_mm_s));
  }
  double slowest = 1;
  int slow_at = -1;
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (const auto* m = std::get_if<MoveJoint>(&p.instructions[i]))
      if (m->speed_ratio < slowest) slowest = m->speed_ratio, slow_at = static_cast<int>(i);
  add_check(v, "speed.joint", slowest, 0, "ratio", slowest > 0, slow_at < 0 ? "" : place_of(p, slow_at));
  v.joint_margin_min_rad = margin, v.singularity_min_ratio = r.singularity_ratio.value, v.speed_ratio_max = r.speed_ratio.value;
  v.duration_s = r.duration_s, v.points_count = r.moves_count;
}

void check_clearance(Verdict& v, const CellSpec& cell, const Arm& arm, const Program& p, const Replay& r, const std::vector<char>& is_cutting,
                     const Cutter* cutter, const Pose<frame::Flange, frame::Tool>& T_flange_tool, const std::vector<Standing>& world,
                     const Standing* part, const Limits& limits) {
  if (r.samples.empty()) return;
  const std::vector<ArmState> states = states_of(arm, r.samples);
  std::vector<Body> links, held;
  std::vector<Standing> own;
  for (const LinkMesh& l : cell.robot.links) {
    if (l.mesh.triangles.empty()) continue;
    if (l.joint >= 1) links.emplace_back("link " + std::to_string(l.joint), l.joint, l.mesh);
    if (l.joint <= 3) own.emplace_back("link " + std::to_string(l.joint), l.mesh, l.joint);
  }
  for (const ToolSpec& t : cell.tools)
    if (!t.mesh_flange.triangles.empty()) held.emplace_back("tool " + t.id, 7, t.mesh_flange);
  for (const SensorSpec& s : cell.sensors)
    if (!s.mesh_flange.triangles.empty()) held.emplace_back("sensor " + s.id, 7, s.mesh_flange);
  std::vector<Body> blade;
  if (cutter != nullptr) blade.emplace_back("cutter", 7, transformed(T_flange_tool, cutter_mesh(*cutter)));

  const auto run = [&](const std::string& name, const std::vector<PairRule>& rules, bool is_overall) {
    ClearanceResult worst;
    double limit = 0;
    bool is_ok = true;
    std::string place;
    for (const PairRule& rule : rules) {
      const ClearanceResult c = follow_clearance(arm, r.samples, states, is_cutting, rule);
      limit = rule.least_mm;
      const bool holds = c.least_mm >= rule.least_mm && c.is_certain;
      const double shown = c.is_certain ? c.least_mm : std::min(c.least_mm, c.uncertain_mm);
      if (shown < worst.least_mm) {
        worst = c, worst.least_mm = shown;
        place = c.pair + ", " + place_of(p, c.instruction);
      }
      is_ok = is_ok && holds;
    }
    if (rules.empty()) return;
    add_check(v, name, std::min(worst.least_mm, 1e6), limit, "mm", is_ok, place);
    if (is_overall) v.clearance_min_mm = std::min(v.clearance_min_mm, worst.least_mm);
  };
  std::vector<const Standing*> all;
  for (const Standing& s : world) all.push_back(&s);
  if (part != nullptr) all.push_back(part);
  std::vector<PairRule> held_rules, link_rules, self_rules, cutter_rules, rapid_rules;
  for (const Standing* s : all) {
    const double least = limits.clearance_mm + (s == part ? limits.part_margin_mm : 0.0);
    for (const Body& b : held) held_rules.push_back({&b, s, least, false});
    for (const Body& b : links) link_rules.push_back({&b, s, least, false});
  }
  for (const Standing& s : own) {
    for (const Body& b : held) self_rules.push_back({&b, &s, limits.self_mm, false});
    for (const Body& b : blade) self_rules.push_back({&b, &s, limits.self_mm, false});
  }
  for (const Body& b : blade) {
    for (const Standing& s : world) cutter_rules.push_back({&b, &s, limits.cutter_fixture_mm, false});
    if (part != nullptr) rapid_rules.push_back({&b, part, limits.rapid_part_mm, true});
  }
  run("clearance.tool", held_rules, true);
  run("clearance.links", link_rules, true);
  run("clearance.self", self_rules, false);
  run("clearance.cutter", cutter_rules, false);
  run("clearance.rapid", rapid_rules, false);
}

}  // namespace asbuilt::verifying
