// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/verify.hpp"

#include <algorithm>
#include <cmath>

#include "planner/verify/checks.hpp"

namespace asbuilt {

namespace {

using namespace verifying;

/// Cutting: spindle on, a linear move, no faster than the recipes' feeds.
std::vector<char> cutting_samples(const Replay& r, double feed_max_mm_s) {
  std::vector<char> out(r.samples.size());
  for (std::size_t i = 0; i < out.size(); ++i)
    out[i] = !r.samples[i].is_joint && r.samples[i].rpm > 0 && r.samples[i].speed_mm_s <= feed_max_mm_s;
  return out;
}

const ToolSpec* tool_of(const CellSpec& cell, const Program& program) {
  for (const Instruction& i : program.instructions)
    if (const auto* s = std::get_if<SetTool>(&i))
      for (const ToolSpec& t : cell.tools)
        if (t.number == s->number) return &t;
  return nullptr;
}

std::vector<Standing> obstacles_of(const CellSpec& cell) {
  std::vector<Standing> out;
  for (const Obstacle& o : cell.obstacles)
    if (!o.mesh_base.triangles.empty()) out.emplace_back(o.name.empty() ? "obstacle" : o.name, o.mesh_base);
  return out;
}

/// How far the real part may be from the drawing where it lies: the greatest deviation seen on an edge with three times its sigma. At most
/// half a millimetre: what is beyond that the planner has kept clear of by its 3 mm from the part as it was scanned.
double part_margin_mm(const Features& features) {
  double margin = 0;
  for (const AdaptedEdge& e : features.edges)
    for (std::size_t i = 0; i < e.adapted.size() && i < e.nominal.size(); ++i) {
      const double sigma = i < e.sigma_mm.size() ? e.sigma_mm[i] : 0.0, off = (e.adapted[i] - e.nominal[i]).norm() + 3 * sigma;
      if (std::isfinite(off)) margin = std::max(margin, std::min(0.5, off));
    }
  return margin;
}

bool is_finite(const Program& p) {
  const auto pose_ok = [](const auto& T) { return T.p_mm.allFinite() && T.q.coeffs().allFinite() && std::abs(T.q.norm() - 1) < 1e-6; };
  for (const Instruction& i : p.instructions) {
    if (const auto* m = std::get_if<MoveLinear>(&i))
      if (!pose_ok(m->T_base_tool) || !std::isfinite(m->speed_mm_s)) return false;
    if (const auto* m = std::get_if<MoveCircular>(&i))
      if (!pose_ok(m->T_base_tool) || !pose_ok(m->T_base_via) || !std::isfinite(m->speed_mm_s)) return false;
    if (const auto* m = std::get_if<MoveSpline>(&i))
      if (!pose_ok(m->T_base_tool) || !std::isfinite(m->speed_mm_s)) return false;
    if (const auto* m = std::get_if<OutputOnPath>(&i))
      if (!std::isfinite(m->path_mm)) return false;
    if (const auto* m = std::get_if<MoveJoint>(&i)) {
      if (!std::isfinite(m->speed_ratio)) return false;
      for (double q : m->q_rad)
        if (!std::isfinite(q) || std::abs(q) > 50) return false;
    }
    if (const auto* m = std::get_if<SetTool>(&i))
      if (!pose_ok(m->T_flange_tool)) return false;
    if (const auto* m = std::get_if<SetFrame>(&i))
      if (!pose_ok(m->T_base_work)) return false;
  }
  return true;
}

}  // namespace

Verdict verify_program(const CellSpec& cell, const Program& program) {
  Verdict v;
  const Limits limits;
  add_check(v, "numbers", is_finite(program) ? 0 : 1, 0, "count", is_finite(program), "program " + program.name);
  if (!v.checks.back().is_passed) return v;
  const Arm arm(cell.robot);
  ReplaySettings settings;
  settings.cutting_step_mm = 1.0;
  const Replay r = replay(cell, arm, program, settings);
  check_program(v, cell, program, r, limits);
  const ToolSpec* tool = tool_of(cell, program);
  check_clearance(v, cell, arm, program, r, cutting_samples(r, settings.cutting_speed_max_mm_s), tool != nullptr ? &tool->cutter : nullptr,
                  tool != nullptr ? tool->T_flange_tool : Pose<frame::Flange, frame::Tool>(), obstacles_of(cell), nullptr, limits);
  return v;
}

Verdict verify_item(const Job& job, const Location& location, const Features& features, const Burrs& burrs, const ToolPath& path, const Program& program) {
  Verdict v;
  Limits limits;
  limits.part_margin_mm = part_margin_mm(features);
  add_check(v, "numbers", is_finite(program) ? 0 : 1, 0, "count", is_finite(program), "program " + program.name);
  if (!v.checks.back().is_passed) return v;
  double feed_max = 0;
  for (const CutPass& p : path.passes)
    if (const Recipe* r = job.recipe(p.recipe)) feed_max = std::max(feed_max, r->feed_max_mm_s);
  const Arm arm(job.cell.robot);
  ReplaySettings settings;
  settings.cutting_speed_max_mm_s = 1.06 * feed_max;
  const Replay r = replay(job.cell, arm, program, settings);
  check_program(v, job.cell, program, r, limits);
  add_check(v, "blend", r.blend_off_mm.value, limits.blend_off_mm, "mm", r.blend_off_mm.value <= limits.blend_off_mm,
            r.blend_off_mm.instruction < 0 ? "" : place_of(program, r.blend_off_mm.instruction));
  const std::vector<char> is_cutting = cutting_samples(r, settings.cutting_speed_max_mm_s);
  std::vector<Standing> world = obstacles_of(job.cell);
  if (!job.fixture.mesh_fixture.triangles.empty())
    world.emplace_back("fixture", transformed(job.fixture.T_base_fixture, job.fixture.mesh_fixture));
  const Standing part("part", transformed(location.T_base_part, job.part.brep.mesh));
  const ToolSpec* tool = tool_of(job.cell, program);
  check_clearance(v, job.cell, arm, program, r, is_cutting, tool != nullptr ? &tool->cutter : nullptr,
                  tool != nullptr ? tool->T_flange_tool : Pose<frame::Flange, frame::Tool>(), world, &part, limits);
  check_item(v, {job, location, features, burrs, path}, program, r, is_cutting, limits);
  return v;
}

Verdict verify_inspection(const Job& job, const Location& location, const Inspection& inspection, const Program& program) {
  Verdict v;
  const Limits limits;
  add_check(v, "numbers", is_finite(program) ? 0 : 1, 0, "count", is_finite(program), "program " + program.name);
  if (!v.checks.back().is_passed) return v;
  const Arm arm(job.cell.robot);
  const Replay r = replay(job.cell, arm, program, {});
  check_program(v, job.cell, program, r, limits);
  std::vector<Standing> world = obstacles_of(job.cell);
  if (!job.fixture.mesh_fixture.triangles.empty())
    world.emplace_back("fixture", transformed(job.fixture.T_base_fixture, job.fixture.mesh_fixture));
  const Standing part("part", transformed(location.T_base_part, job.part.brep.mesh));
  const ToolSpec* tool = tool_of(job.cell, program);
  check_clearance(v, job.cell, arm, program, r, std::vector<char>(r.samples.size(), 0), tool != nullptr ? &tool->cutter : nullptr,
                  tool != nullptr ? tool->T_flange_tool : Pose<frame::Flange, frame::Tool>(), world, &part, limits);
  // stops: where a joint move is followed by a wait
  std::vector<std::pair<JointVector, int>> stops;
  double spindle = 0;
  for (std::size_t i = 0; i < program.instructions.size(); ++i) {
    if (std::holds_alternative<SpindleOn>(program.instructions[i])) ++spindle;
    const auto* m = std::get_if<MoveJoint>(&program.instructions[i]);
    if (m == nullptr) continue;
    for (std::size_t k = i + 1; k < program.instructions.size(); ++k) {
      if (std::holds_alternative<Wait>(program.instructions[k])) {
        stops.emplace_back(m->q_rad, static_cast<int>(i));
        break;
      }
      if (std::holds_alternative<MoveJoint>(program.instructions[k]) || std::holds_alternative<MoveLinear>(program.instructions[k])) break;
    }
  }
  const double missing = std::abs(static_cast<double>(stops.size()) - static_cast<double>(inspection.views.size()));
  add_check(v, "views.stops", missing, 0, "count", missing == 0, "program " + program.name);
  double worst_mm = 0, worst_rad = 0;
  int at = -1;
  for (std::size_t k = 0; k < std::min(stops.size(), inspection.views.size()); ++k) {
    const Vec6 xi = twist_between(inspection.views[k].T_base_flange, Pose<frame::Base, frame::Flange>(arm.flange(stops[k].first)));
    if (xi.head<3>().norm() > worst_mm) worst_mm = xi.head<3>().norm(), at = stops[k].second;
    worst_rad = std::max(worst_rad, xi.tail<3>().norm());
  }
  const std::string place = at < 0 ? "" : place_of(program, at);
  add_check(v, "views.position", worst_mm, limits.view_mm, "mm", worst_mm <= limits.view_mm, place);
  add_check(v, "views.orientation", deg_from_rad(worst_rad), deg_from_rad(limits.view_rad), "deg", worst_rad <= limits.view_rad, place);
  add_check(v, "views.spindle_off", spindle, 0, "count", spindle == 0, "program " + program.name);
  return v;
}

}  // namespace asbuilt
