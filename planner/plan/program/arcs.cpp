// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/program/arcs.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace asbuilt {

namespace {

using Tcp = Pose<frame::Base, frame::Tool>;

struct Circle {
  Vec3 center = Vec3::Zero(), x = Vec3::UnitX(), y = Vec3::UnitY();  // x towards the start, y along the way
  double radius = 0, turn = 0;                                      // start to end

  double angle_of(const Vec3& p) const { return std::atan2((p - center).dot(y), (p - center).dot(x)); }
  double off(const Vec3& p) const {
    const Vec3 d = p - center;
    return std::hypot(std::hypot(d.dot(x), d.dot(y)) - radius, d.dot(x.cross(y)));
  }
  Vec3 at(double angle) const { return center + radius * (std::cos(angle) * x + std::sin(angle) * y); }
};

std::optional<Circle> circle_through(const Vec3& a, const Vec3& via, const Vec3& b) {
  const Vec3 u = via - a, v = b - a, n = u.cross(v);
  if (n.norm() < 1e-9 * std::max(1.0, v.squaredNorm())) return std::nullopt;
  Circle c;
  c.center = a + (v.squaredNorm() * n.cross(u) + u.squaredNorm() * v.cross(n)) / (2 * n.squaredNorm());
  c.radius = (a - c.center).norm();
  c.x = (a - c.center) / c.radius;
  c.y = n.normalized().cross(c.x);
  c.turn = c.angle_of(b);
  return c.turn > 0 ? std::optional(c) : std::nullopt;
}

double turn_between(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) { return quat_log(a.conjugate() * b).norm(); }

/// Whether the moves from `start` over points[0..n) are the arc of their circle.
std::optional<Circle> arc_of(const ArcRecipe& recipe, const Tcp& start, const std::vector<const MoveLinear*>& points, std::size_t n) {
  const Tcp& end = points[n - 1]->T_base_tool;
  const auto c = circle_through(start.p_mm, points[n / 2 - 1]->T_base_tool.p_mm, end.p_mm);
  if (!c || c->radius > recipe.radius_max_mm || c->turn > recipe.turn_max_rad || turn_between(start.q, end.q) > 0.08) return std::nullopt;
  double before = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const Tcp& T = points[i]->T_base_tool;
    const double angle = i + 1 == n ? c->turn : c->angle_of(T.p_mm), chord = 2 * c->radius * std::sin(0.5 * (angle - before));
    if (angle <= before || c->off(T.p_mm) > recipe.tolerance_mm || chord * chord / (8 * c->radius) > recipe.tolerance_mm) return std::nullopt;
    if (turn_between(start.q.slerp(angle / c->turn, end.q), T.q) > recipe.axis_rad) return std::nullopt;
    before = angle;
  }
  return c;
}

}  // namespace

Program with_arcs(const ArcRecipe& recipe, const Program& program,
                  const std::function<bool(const Vec3&, const Vec3&, const Vec3&, const Pose<frame::Base, frame::Work>&)>& is_allowed) {
  Program out;
  out.name = program.name, out.header = program.header;
  Pose<frame::Base, frame::Work> T_base_work;
  std::optional<Tcp> at;
  const auto& in = program.instructions;
  for (std::size_t i = 0; i < in.size();) {
    if (const auto* f = std::get_if<SetFrame>(&in[i])) T_base_work = f->T_base_work;
    const auto* line = std::get_if<MoveLinear>(&in[i]);
    if (line == nullptr || !at) {
      if (line) at = line->T_base_tool;
      if (const auto* m = std::get_if<MoveCircular>(&in[i])) at = m->T_base_tool;
      if (const auto* m = std::get_if<MoveSpline>(&in[i])) at = m->T_base_tool;
      if (std::holds_alternative<MoveJoint>(in[i]) || std::holds_alternative<SetTool>(in[i])) at.reset();
      out.instructions.push_back(in[i++]);
      continue;
    }
    // the moves of one speed from here on that are rounded into each other
    std::vector<const MoveLinear*> run;
    for (std::size_t k = i; k < in.size(); ++k) {
      const auto* m = std::get_if<MoveLinear>(&in[k]);
      if (m == nullptr || m->speed_mm_s != line->speed_mm_s) break;
      run.push_back(m);
      if (m->is_exact) break;
    }
    std::size_t best = 0;
    std::optional<Circle> arc;
    for (std::size_t n = static_cast<std::size_t>(recipe.moves_min_count); n <= run.size(); ++n) {
      const auto c = arc_of(recipe, *at, run, n);
      if (!c) break;
      if (c->turn >= recipe.turn_min_rad && is_allowed(at->p_mm, c->at(0.5 * c->turn), run[n - 1]->T_base_tool.p_mm, T_base_work)) best = n, arc = c;
    }
    if (best == 0) {
      at = line->T_base_tool;
      out.instructions.push_back(in[i++]);
      continue;
    }
    const MoveLinear& last = *run[best - 1];
    out.instructions.push_back(MoveCircular{{at->q.slerp(0.5, last.T_base_tool.q), arc->at(0.5 * arc->turn)}, last.T_base_tool, last.speed_mm_s, last.is_exact, last.blend_mm});
    at = last.T_base_tool;
    i += best;
  }
  return out;
}

Program cut_at_outputs(const Program& program) {
  Program out;
  out.name = program.name, out.header = program.header;
  std::vector<OutputOnPath> waiting;
  std::optional<Tcp> at;
  for (const Instruction& i : program.instructions) {
    if (const auto* o = std::get_if<OutputOnPath>(&i)) {
      waiting.push_back(*o);
      continue;
    }
    const auto* line = std::get_if<MoveLinear>(&i);
    const auto* curve = std::get_if<MoveCircular>(&i);
    const auto arc = curve && at ? circle_through(at->p_mm, curve->T_base_via.p_mm, curve->T_base_tool.p_mm) : std::nullopt;
    if (waiting.empty() || !at || (!line && !arc)) {
      if (line) at = line->T_base_tool;
      if (curve) at = curve->T_base_tool;
      if (const auto* m = std::get_if<MoveSpline>(&i)) at = m->T_base_tool;
      if (std::holds_alternative<MoveJoint>(i)) at.reset();
      for (const OutputOnPath& o : waiting)
        if (line || curve || std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveSpline>(i)) out.instructions.push_back(o);  // refused by the post
      if (line || curve || std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveSpline>(i)) waiting.clear();
      out.instructions.push_back(i);
      continue;
    }
    const Tcp from = *at, to = line ? line->T_base_tool : curve->T_base_tool;
    const double length = line ? (to.p_mm - from.p_mm).norm() : arc->radius * arc->turn;
    const double speed = line ? line->speed_mm_s : curve->speed_mm_s;
    for (OutputOnPath& o : waiting) o.path_mm = std::clamp(o.path_mm < 0 ? length + o.path_mm : o.path_mm, 0.0, length);
    std::stable_sort(waiting.begin(), waiting.end(), [](const OutputOnPath& a, const OutputOnPath& b) { return a.path_mm < b.path_mm; });
    double done = 0;
    const auto piece = [&](double to_mm, bool is_last) {
      const double f = to_mm / length, half = 0.5 * (done + to_mm) / length;
      const auto place = [&](double part) { return line ? Vec3(from.p_mm + part * (to.p_mm - from.p_mm)) : arc->at(part * arc->turn); };
      const Tcp end = is_last ? to : Tcp(from.q.slerp(f, to.q), place(f));
      const double d = std::floor(10 * std::min({1.0, 0.4 * (to_mm - done), 0.4 * (length - to_mm)})) / 10;  // along the path, so nothing is cut off
      const bool is_exact = is_last ? (line ? line->is_exact : curve->is_exact) : d < 0.1;
      const double blend = is_last ? (line ? line->blend_mm : curve->blend_mm) : is_exact ? 0 : d;
      if (line) out.instructions.push_back(MoveLinear{end, speed, is_exact, blend});
      else out.instructions.push_back(MoveCircular{{from.q.slerp(half, to.q), place(half)}, end, speed, is_exact, blend});
      done = to_mm;
    };
    std::vector<SetOutput> at_end;
    for (const OutputOnPath& o : waiting) {
      if (length - o.path_mm < 0.25) {
        at_end.push_back({o.output, o.value});
        continue;
      }
      if (o.path_mm - done >= 0.25) piece(o.path_mm, false);
      out.instructions.push_back(SetOutput{o.output, o.value});
    }
    piece(length, true);
    for (const SetOutput& o : at_end) out.instructions.push_back(o);
    waiting.clear();
    at = to;
  }
  for (const OutputOnPath& o : waiting) out.instructions.push_back(o);
  return out;
}

Program with_splines(const Program& program) {
  Program out = program;
  auto& list = out.instructions;
  bool was_exact_path = false;  // the tool stands at the end of a path motion
  for (std::size_t i = 0; i < list.size(); ++i) {
    const auto* first = std::get_if<MoveLinear>(&list[i]);
    if (was_exact_path && first && !first->is_exact) {
      std::size_t end = i;
      while (end < list.size() && std::holds_alternative<MoveLinear>(list[end]) && !std::get<MoveLinear>(list[end]).is_exact) ++end;
      if (end < list.size() && std::holds_alternative<MoveLinear>(list[end])) {
        for (std::size_t k = i; k <= end; ++k) {
          const MoveLinear m = std::get<MoveLinear>(list[k]);
          list[k] = MoveSpline{m.T_base_tool, m.speed_mm_s};
        }
        i = end;
        was_exact_path = true;
        continue;
      }
    }
    if (first) was_exact_path = first->is_exact;
    if (const auto* m = std::get_if<MoveCircular>(&list[i])) was_exact_path = m->is_exact;
    if (std::holds_alternative<MoveJoint>(list[i])) was_exact_path = false;
  }
  return out;
}

}  // namespace asbuilt
