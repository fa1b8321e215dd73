// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/verify/checks.hpp"

namespace asbuilt::verifying {

namespace {

struct Target {  // a target of the program on the path; an arc carries its start and a point on the way
  Vec3 p;
  Vec3 axis;
  double speed;
  int instruction;
  bool is_arc = false;
  Pose<frame::Base, frame::Tool> from, to;
  Vec3 via = Vec3::Zero();
};

struct OnArc {
  double off_mm = 1e9, part = 0;  // distance from the arc, and how far along it, 0 to 1
};
OnArc on_arc(const Target& t, const Vec3& x) {
  const Vec3 a = t.from.p_mm, u = t.via - a, v = t.p - a, n = u.cross(v);
  if (n.norm() < 1e-9) return {};
  const Vec3 c = a + (v.squaredNorm() * n.cross(u) + u.squaredNorm() * v.cross(n)) / (2 * n.squaredNorm());
  const double radius = (a - c).norm();
  const Vec3 e_x = (a - c) / radius, e_y = n.normalized().cross(e_x);
  const auto angle = [&](const Vec3& p) {
    const double w = std::atan2((p - c).dot(e_y), (p - c).dot(e_x));
    return w < -1e-6 ? w + 2 * kPi : w;
  };
  const Vec3 d = x - c;
  return {std::hypot(d.norm() - radius, d.dot(n.normalized())), angle(x) / angle(t.p)};
}

std::vector<Target> targets_of(const Program& p) {
  std::vector<Target> targets;
  Pose<frame::Base, frame::Tool> at;
  for (std::size_t i = 0; i < p.instructions.size(); ++i) {
    const Pose<frame::Base, frame::Tool>* T = nullptr;
    Target t;
    if (const auto* m = std::get_if<MoveLinear>(&p.instructions[i])) T = &m->T_base_tool, t.speed = m->speed_mm_s;
    if (const auto* m = std::get_if<MoveSpline>(&p.instructions[i])) T = &m->T_base_tool, t.speed = m->speed_mm_s;
    if (const auto* m = std::get_if<MoveCircular>(&p.instructions[i])) T = &m->T_base_tool, t.speed = m->speed_mm_s, t.is_arc = true, t.via = m->T_base_via.p_mm;
    if (T == nullptr) continue;
    t.p = T->p_mm, t.axis = T->direction(Vec3::UnitZ()), t.instruction = static_cast<int>(i);
    t.from = at, t.to = *T;
    targets.push_back(t);
    at = *T;
  }
  return targets;
}

/// The program's targets against the planned points, pass by pass, in order. Every planned point has to be a target or lie on an arc; what
/// lies between two of them has to lie on the line; the speed between them is the planned one.
void check_path(Verdict& v, const ItemView& item, const Program& p, const Limits& limits) {
  const std::vector<Target> targets = targets_of(p);
  double worst_target = 0, worst_line = 0, worst_speed = 0, worst_axis = 0;
  int at_target = -1, at_line = -1, at_speed = -1, at_axis = -1;
  std::size_t k = 0, missing = 0, planned = 0;
  double part_done = -1;  // of the arc targets[k]
  std::string first_missing;
  for (const CutPass& pass : item.path.passes) {
    for (std::size_t j = 0; j < pass.points.size(); ++j) {
      ++planned;
      const Vec3 want = item.location.T_base_part.point(pass.points[j].tip_part);
      const Vec3 axis = item.location.T_base_part.direction(pass.points[j].axis_part);
      // the next target that is this point: straight on from here, at most as far as the program goes to it
      std::size_t found = targets.size();
      Vec3 axis_there = axis;
      double off = 0, part = -1;
      for (std::size_t t = k; t < targets.size(); ++t) {
        if ((targets[t].p - want).norm() <= limits.path_target_mm) {
          found = t, off = (targets[t].p - want).norm(), axis_there = targets[t].axis;
          break;
        }
        if (j == 0) continue;  // approach before a pass: any number of moves
        if (targets[t].is_arc) {
          const OnArc on = on_arc(targets[t], want);
          if (on.off_mm <= limits.path_error_mm && on.part > (t == k ? part_done : -1e-6) && on.part < 1) {
            found = t, off = 0, part = on.part;
            if (on.off_mm > worst_line) worst_line = on.off_mm, at_line = targets[t].instruction;
            axis_there = targets[t].from.q.slerp(on.part, targets[t].to.q) * Vec3::UnitZ();
          }
          if (found != t && on.off_mm > worst_line) worst_line = on.off_mm, at_line = targets[t].instruction;
          break;
        }
        const Vec3 from = item.location.T_base_part.point(pass.points[j - 1].tip_part), d = want - from;
        const double f = d.squaredNorm() > 0 ? std::clamp((targets[t].p - from).dot(d) / d.squaredNorm(), 0.0, 1.0) : 0.0;
        const double beside = (from + f * d - targets[t].p).norm();
        if (beside > worst_line) worst_line = beside, at_line = targets[t].instruction;
        if (beside > limits.path_error_mm) break;
      }
      if (found == targets.size()) {
        if (missing++ == 0) first_missing = "pass " + std::to_string(pass.pass) + " of " + pass.feature + ", point " + std::to_string(j + 1);
        continue;
      }
      if (off > worst_target) worst_target = off, at_target = targets[found].instruction;
      const double turn = std::atan2(axis.cross(axis_there).norm(), axis.dot(axis_there));
      if (turn > worst_axis) worst_axis = turn, at_axis = targets[found].instruction;
      if (j > 0)
        for (std::size_t t = k; t <= found; ++t) {
          const double d = std::abs(targets[t].speed - pass.points[j].feed_mm_s);
          // motion may slow down where the joints ask for it; never above the plan
          const double bad = targets[t].speed > pass.points[j].feed_mm_s ? d : targets[t].speed < 0.3 * pass.points[j].feed_mm_s ? d : 0.0;
          if (bad > worst_speed) worst_speed = bad, at_speed = targets[t].instruction;
        }
      k = part >= 0 ? found : found + 1;
      part_done = part;
    }
  }
  const auto place = [&](int i) { return i < 0 ? std::string() : place_of(p, i); };
  add_check(v, "path.points", static_cast<double>(missing), 0, "count", missing == 0 && planned > 0, first_missing);
  add_check(v, "path.error", std::max(worst_target, worst_line), limits.path_error_mm, "mm", std::max(worst_target, worst_line) <= limits.path_error_mm,
            place(worst_line > worst_target ? at_line : at_target));
  add_check(v, "path.axis", deg_from_rad(worst_axis), deg_from_rad(limits.axis_error_rad), "deg", worst_axis <= limits.axis_error_rad, place(at_axis));
  add_check(v, "path.feed", worst_speed, 0.051, "mm/s", worst_speed <= 0.051, place(at_speed));
  v.path_error_max_mm = std::max(worst_target, worst_line);
}

/// The frame of the program is the part's, or none: then the points are written in base.
void check_frame(Verdict& v, const ItemView& item, const Program& p, const Limits& limits) {
  double mm = 0, rad = 0;
  int where = -1;
  for (std::size_t i = 0; i < p.instructions.size(); ++i)
    if (const auto* s = std::get_if<SetFrame>(&p.instructions[i])) {
      if (s->T_base_work.p_mm.norm() == 0 && s->T_base_work.q.vec().norm() == 0) continue;
      const auto& T = item.location.T_base_part;
      mm = std::max(mm, (T.p_mm - s->T_base_work.p_mm).norm());
      rad = std::max(rad, turn_but_right_angles_rad(T.q, s->T_base_work.q)), where = static_cast<int>(i);
    }
  add_check(v, "frame.position", mm, limits.frame_mm, "mm", mm <= limits.frame_mm, where < 0 ? "" : place_of(p, where));
  add_check(v, "frame.orientation", deg_from_rad(rad), deg_from_rad(limits.frame_rad), "deg", rad <= limits.frame_rad, where < 0 ? "" : place_of(p, where));
}

/// Cutting speeds, spindle speed and chip load by recipe.
void check_feed(Verdict& v, const Program& p, const Recipe& r, const Cutter& cutter, const std::vector<CutPose>& poses, const Replay& replay,
                const std::vector<char>& is_cutting) {
  double high = 0, low = 1e9, chip = 0, rpm_off = 0;
  int high_at = -1, low_at = -1, rpm_at = -1;
  for (const CutPose& c : poses) {
    if (c.speed_mm_s > high) high = c.speed_mm_s, high_at = c.instruction;
    if (c.speed_mm_s < low) low = c.speed_mm_s, low_at = c.instruction;
  }
  for (std::size_t i = 0; i < replay.samples.size(); ++i)
    if (is_cutting[i] && r.spindle_rpm > 0) {
      const double off = std::abs(replay.samples[i].rpm - r.spindle_rpm) / r.spindle_rpm;
      if (off > rpm_off) rpm_off = off, rpm_at = replay.samples[i].instruction;
    }
  add_check(v, "feed.max", high, r.feed_max_mm_s, "mm/s", high <= r.feed_max_mm_s + 1e-6, high_at < 0 ? "" : place_of(p, high_at));
  add_check(v, "feed.min", low, r.feed_min_mm_s, "mm/s", !poses.empty() && low >= r.feed_min_mm_s - 0.051, low_at < 0 ? "" : place_of(p, low_at));
  add_check(v, "spindle.recipe", rpm_off, 0.01, "ratio", rpm_off <= 0.01, rpm_at < 0 ? "" : place_of(p, rpm_at));
  if (r.chip_load_mm && r.spindle_rpm > 0 && cutter.teeth_count > 0) {
    chip = high * 60 / (r.spindle_rpm * cutter.teeth_count);
    add_check(v, "chip_load", chip, *r.chip_load_mm, "mm", chip <= *r.chip_load_mm * 1.001, high_at < 0 ? "" : place_of(p, high_at));
  }
}

void check_chamfer(Verdict& v, const ItemView& item, const Program& p, const Recipe& r, const Cutter& cutter, const std::vector<CutPose>& poses,
                   const std::vector<std::string>& features, const Limits& limits) {
  double leg_off = 0, mean_off = 0, beyond = -1e9;
  std::size_t untouched = 0, stations = 0, overloads = 0;
  double rate_worst = 0;
  std::string leg_at, untouched_at, beyond_at, rate_at, mean_at;
  for (std::size_t k = 0; k < item.features.edges.size(); ++k) {
    const AdaptedEdge& e = item.features.edges[k];
    if (std::find(features.begin(), features.end(), e.feature) == features.end()) continue;
    const EdgeBurr* burr = k < item.burrs.edges.size() ? &item.burrs.edges[k] : nullptr;
    const EdgeCut c = cut_edge(e, burr, item.location.T_base_part, cutter, poses, r.width_mm, r.tolerance_mm);
    for (std::size_t i = 0; i < c.s_mm.size(); ++i) {
      if (!e.is_closed && (c.s_mm[i] - e.s_mm.front() < limits.end_mm || e.s_mm.back() - c.s_mm[i] < limits.end_mm)) continue;
      ++stations;
      const std::string here = "edge " + e.id + " at " + fixed_number(c.s_mm[i], 1) + " mm";
      if (c.leg_1_mm[i] <= 0 || c.leg_2_mm[i] <= 0) {
        if (untouched++ == 0) untouched_at = here;
        continue;
      }
      const double off = std::max(std::abs(c.leg_1_mm[i] - r.width_mm), std::abs(c.leg_2_mm[i] - r.width_mm));
      if (off > leg_off) leg_off = off, leg_at = here;
      const double mean = std::abs(0.5 * (c.leg_1_mm[i] + c.leg_2_mm[i]) - r.width_mm);
      if (mean > mean_off) mean_off = mean, mean_at = here;
      if (c.beyond_mm[i] > beyond) beyond = c.beyond_mm[i], beyond_at = here;
      if (c.rate_mm3_s[i] > r.removal_max_mm3_s * limits.removal_ratio) ++overloads;
      if (c.rate_mm3_s[i] > rate_worst) rate_worst = c.rate_mm3_s[i], rate_at = here;
    }
  }
  add_check(v, "chamfer.coverage", stations == 0 ? 0 : 1 - static_cast<double>(untouched) / static_cast<double>(stations), 1, "ratio",
            stations > 0 && untouched == 0, untouched_at);
  add_check(v, "chamfer.legs", leg_off, r.tolerance_mm, "mm", leg_off <= r.tolerance_mm, leg_at);
  add_check(v, "chamfer.mean_leg", mean_off, limits.mean_leg_mm, "mm", mean_off <= limits.mean_leg_mm, mean_at);
  add_check(v, "chamfer.gouge", stations == 0 ? 1 : beyond, 0, "mm", stations > 0 && beyond <= 0, beyond_at);
  const double share = stations == 0 ? 1 : static_cast<double>(overloads) / static_cast<double>(stations);
  add_check(v, "removal_rate", share, limits.removal_share_ratio, "ratio", share <= limits.removal_share_ratio,
            rate_at + " (" + fixed_number(rate_worst, 2) + " mm3/s)");
  (void)p;
}

/// The cutter near burrs where it does not cut: a burr reaches at most 1.42 heights from its edge.
void check_burr_clearance(Verdict& v, const ItemView& item, const Program& p, const Cutter& cutter, const Replay& r, const std::vector<char>& is_cutting,
                          const Limits& limits) {
  struct Ball {
    Vec3 p;
    double radius;
  };
  std::vector<Ball> balls;
  for (std::size_t k = 0; k < item.features.edges.size() && k < item.burrs.edges.size(); ++k)
    for (std::size_t i = 0; i < item.features.edges[k].s_mm.size(); ++i) {
      const double h = item.burrs.edges[k].height_upper_mm[i];
      if (std::isfinite(h) && h > 0) balls.push_back({item.location.T_base_part.point(item.features.edges[k].adapted[i]), 1.42 * h});
    }
  double least = 1e6;
  int where = -1;
  const CutterForm form(cutter);
  for (std::size_t i = 0; i < r.samples.size(); ++i) {
    if (is_cutting[i]) continue;
    const Vec3 tip = r.samples[i].T_base_tool.p_mm, axis = r.samples[i].T_base_tool.direction(Vec3::UnitZ());
    for (const Ball& b : balls) {
      const Vec3 d = b.p - tip;
      if (d.squaredNorm() > 3600) continue;
      const double u = -d.dot(axis);
      const double gap = form.gap(u, (d + u * axis).norm()) - b.radius;
      if (gap < least) least = gap, where = r.samples[i].instruction;
    }
  }
  add_check(v, "clearance.burr", least, limits.rapid_part_mm, "mm", least >= limits.rapid_part_mm, where < 0 ? "" : place_of(p, where));
}

}  // namespace

void check_item(Verdict& v, const ItemView& item, const Program& p, const Replay& r, const std::vector<char>& is_cutting, const Limits& limits) {
  check_frame(v, item, p, limits);
  check_path(v, item, p, limits);
  // the recipes and the tool of this program
  std::vector<const Recipe*> recipes;
  std::vector<std::vector<std::string>> features;
  const ToolSpec* tool = nullptr;
  for (const CutPass& pass : item.path.passes) {
    const Recipe* recipe = item.job.recipe(pass.recipe);
    if (recipe == nullptr) continue;
    tool = item.job.tool(pass.tool);
    auto it = std::find(recipes.begin(), recipes.end(), recipe);
    if (it == recipes.end()) recipes.push_back(recipe), features.emplace_back(), it = recipes.end() - 1;
    auto& f = features[static_cast<std::size_t>(it - recipes.begin())];
    if (std::find(f.begin(), f.end(), pass.feature) == f.end()) f.push_back(pass.feature);
  }
  if (tool == nullptr || recipes.empty()) {
    add_check(v, "path.recipe", 1, 0, "count", false, "no recipe or tool of the path is in the job");
    return;
  }
  std::vector<CutPose> poses;
  for (std::size_t i = 0; i < r.samples.size(); ++i)
    if (is_cutting[i])
      poses.push_back({r.samples[i].T_base_tool.p_mm, r.samples[i].T_base_tool.direction(Vec3::UnitZ()), r.samples[i].speed_mm_s, r.samples[i].instruction});
  add_check(v, "spindle.cutting", poses.empty() ? 1 : 0, 0, "count", !poses.empty(), "program " + p.name);
  const Cutter& cutter = tool->cutter;
  for (std::size_t k = 0; k < recipes.size(); ++k) {
    check_feed(v, p, *recipes[k], cutter, poses, r, is_cutting);
    check_chamfer(v, item, p, *recipes[k], cutter, poses, features[k], limits);
  }
  const Stray s = stray_cut(item.features, MeshQuery(item.job.part.brep.mesh), item.location.T_base_part, cutter, poses, recipes[0]->width_mm,
                            recipes[0]->tolerance_mm);
  add_check(v, "stray_cut", s.depth_mm, limits.stray_mm, "mm", s.depth_mm <= limits.stray_mm, s.instruction < 0 ? "" : place_of(p, s.instruction));
  check_burr_clearance(v, item, p, cutter, r, is_cutting, limits);
}

}  // namespace asbuilt::verifying
