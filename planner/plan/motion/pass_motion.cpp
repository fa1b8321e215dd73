// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/pass_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/plan/motion/joint_feed.hpp"
#include "planner/plan/motion/pass_search.hpp"

namespace asbuilt {

using ToolPose = Pose<frame::Base, frame::Tool>;

namespace {

constexpr double kTurnStep_rad = rad_from_deg(5);
constexpr double kApproachStep_mm = 5;
constexpr double kFluteNear_mm = 0.4;  // the cutter's distance from the part where the approach ends, at least
constexpr std::size_t kDeclinedAtMost = 8, kSearchedAtMost = 2;
constexpr double kJointRatio = 0.8;    // of speed and acceleration limits

/// Refusals so far; the one nearest to success is told.
struct Trouble {
  int rank = -1;
  Refusal refusal;
  void add(int new_rank, Refusal r) {
    if (new_rank > rank) rank = new_rank, refusal = std::move(r);
  }
};

/// The approach from far to near, or the retract from near to far.
std::optional<std::vector<JointVector>> straight_out(const PassTask& task, const PassTools& tools, const ToolPose& T, const Vec3& direction,
                                                     const JointVector& q) {
  std::vector<JointVector> out{q};
  const int steps = std::max(1, static_cast<int>(std::ceil(task.approach_mm / kApproachStep_mm)));
  const auto T_tool_flange = tools.T_flange_tool.inverse();
  for (int k = 1; k <= steps; ++k) {
    ToolPose at = T;
    at.p_mm += direction * (task.approach_mm * k / steps);
    const auto next = tools.robot->inverse_near(at * T_tool_flange, out.back());
    if (!next || largest_joint_step(*next, out.back()) > kJumpLimit_rad || tools.robot->joint_margin_rad(*next) < tools.joint_margin_rad)
      return std::nullopt;
    out.push_back(*next);
  }
  return out;
}

Refusal collision(const PassTask& task, const CellScene& cell, const std::vector<Watch>& watches, const Certificate& c, const std::string& code,
                  const std::string& where, const std::string& what) {
  const Watch& w = watches[static_cast<std::size_t>(c.watch)];
  return {.code = code,
          .where = where,
          .message = pair_name(cell, w) + " come within " + text_mm(c.clearance_mm) + " mm of each other " + what + " (" + text_mm(w.margin_mm) +
                     " mm are wanted) near base " + text_point(c.p_base) + "; move what is in the way, or give the feature another tool or axis",
          .measured = c.clearance_mm,
          .limit = w.margin_mm,
          .unit = "mm",
          .stage = "motion"};
}

/// Approach and retract: the flute may be near only where the path begins.
Certificate certify_straight(const PassTask& task, const CellScene& cell, std::vector<JointVector> q_out, const Vec3& straight_point,
                             std::vector<Watch>& watches) {
  watches = cell.with_flute(kFluteNear_mm);
  Certificate near = cell.scene.certify(watches, {q_out, true, straight_point});
  if (!near.is_free) return near;
  const int steps = static_cast<int>(q_out.size()) - 1;
  const int first = std::min(steps, static_cast<int>(std::ceil(task.flute_near_mm / (task.approach_mm / steps))));
  const std::vector<Watch> flute{{cell.flute, cell.part, task.flute_approach_mm}};
  const Certificate far = cell.scene.certify(flute, {{q_out.begin() + first, q_out.end()}, true, straight_point});
  if (!far.is_free) {
    watches = flute;
    return far;
  }
  // What the segment keeps from everything but the part's edge: the flute's own nearness is the cut's.
  Certificate rest = cell.scene.certify(cell.always, {q_out, true, straight_point});
  return rest;
}

/// Follows the candidate point by point and certifies it.
Attempt realize(const PassTask& task, const PassTools& tools, const std::vector<double>& turns, const JointVector& q_first, Trouble& trouble) {
  Attempt out;
  PassMotion m;
  m.stations = task.stations;
  PathFault fault;
  const auto cut = follow_path(task, tools, turns, q_first, 1, fault);
  if (!cut) {
    out.station = fault.station;
    trouble.add(fault.rank, fault.refusal);
    return out;
  }
  m.cut = *cut;
  m.joint_margin_rad = fault.joint_margin_rad, m.singularity_ratio = fault.singularity_ratio;

  std::vector<Vec3> tips;
  for (const PassStation& s : task.stations) tips.push_back(s.tip), m.feed_mm_s.push_back(s.feed_mm_s);
  const auto& joints = tools.robot->spec().joints;
  if (const auto slow = follow_with_joints(joints, kJointRatio, m.cut, tips, task.feed_min_mm_s, m.feed_mm_s)) {
    out.station = slow->point;
    trouble.add(4, {.code = "motion.joint_speed",
                    .where = place(task, slow->point),
                    .message = "joint " + std::to_string(slow->joint + 1) + " can follow the path only at " + text_mm(slow->wanted_mm_s) +
                               " mm/s, below the recipe's least feed of " + text_mm(task.feed_min_mm_s) + " mm/s (" +
                               (slow->is_speed ? "speed" : "acceleration") + " limit); move the part away from the singular place or lower feed.min",
                    .measured = slow->wanted_mm_s, .limit = task.feed_min_mm_s, .unit = "mm/s", .stage = "motion"});
    return out;
  }

  const CellScene& cell = *tools.cell;
  const auto blocks_turn = [&](const Watch& w) {
    const int a = cell.scene.mount(w.a), b = cell.scene.mount(w.b);
    return std::min(a, b) == kMountBase && std::max(a, b) == kMountFlange;
  };
  for (const auto* watches : {&cell.always, &cell.core}) {
    const Certificate c = cell.scene.certify(*watches, {m.cut, true, tools.T_flange_tool.p_mm});
    if (!c.is_free) {
      out.station = c.block, out.is_turn_blocked = blocks_turn((*watches)[static_cast<std::size_t>(c.watch)]);
      trouble.add(5, collision(task, cell, *watches, c, "motion.collision", place(task, c.block + (c.at_ratio > 0.5)), "while cutting"));
      return out;
    }
    if (watches == &cell.always) m.cut_clearance_mm = c.clearance_mm;  // the core's nearness is the cut's own
  }

  std::array<std::vector<JointVector>, 2> ways;
  std::array<double, 2> clearance{};
  for (const int end : {0, 1}) {
    const std::size_t at = end == 0 ? 0 : task.stations.size() - 1;
    out.station = at;
    const std::string where = place(task, at);
    const ToolPose T = tool_pose(task, at, end == 0 ? turns.front() : turns.back());
    // The way the path asks for, or along the tool, or between the two.
    const Vec3 asked = task.retract_base, along = -task.stations[at].axis;
    std::optional<std::vector<JointVector>> way;
    Trouble no_way;
    bool is_turn_blocked = true;
    const std::array<Vec3, 3> directions{asked, along, (asked + along).normalized()};
    for (std::size_t d = 0; d < directions.size() && !way; ++d) {
      const Vec3& direction = directions[d];
      if (d > 0 && (direction - asked).norm() < 1e-6) continue;
      auto out_there = straight_out(task, tools, T, direction, end == 0 ? m.cut.front() : m.cut.back());
      if (!out_there) {
        no_way.add(0, {.code = "motion.no_approach",
                       .where = where,
                       .message = "the arm cannot follow the " + text_mm(task.approach_mm) + " mm " + (end == 0 ? "approach to" : "retract from") +
                                  " this point; shorten the recipe's approach or move the part",
                       .measured = task.approach_mm, .limit = task.approach_mm, .unit = "mm", .stage = "motion"});
        is_turn_blocked = false;
        continue;
      }
      std::vector<Watch> watches;
      const Certificate k = certify_straight(task, cell, *out_there, tools.T_flange_tool.p_mm, watches);
      if (k.is_free) {
        way = std::move(out_there), clearance[end] = k.clearance_mm;
        break;
      }
      is_turn_blocked = is_turn_blocked && blocks_turn(watches[static_cast<std::size_t>(k.watch)]);
      no_way.add(1, collision(task, cell, watches, k, "motion.no_approach", where, end == 0 ? "on the approach" : "on the retract"));
    }
    if (!way) {
      out.is_turn_blocked = is_turn_blocked;
      trouble.add(6, no_way.refusal);
      return out;
    }
    ways[end] = *way;
    for (const JointVector& q : *way) m.joint_margin_rad = std::min(m.joint_margin_rad, tools.robot->joint_margin_rad(q));
  }
  m.approach.assign(ways[0].rbegin(), ways[0].rend());
  m.retract = ways[1];
  m.approach_clearance_mm = clearance[0], m.retract_clearance_mm = clearance[1];
  // The straight moves as fast as asked and as the joints can.
  m.approach_speed_mm_s = task.approach_speed_mm_s;
  for (const auto& way : ways)
    for (std::size_t i = 1; i < way.size(); ++i)
      for (int j = 0; j < 6; ++j) {
        const double length = task.approach_mm / static_cast<double>(way.size() - 1), dq = std::abs(way[i][j] - way[i - 1][j]);
        if (joints[j].speed_rad_s > 0 && dq > 1e-12) m.approach_speed_mm_s = std::min(m.approach_speed_mm_s, kJointRatio * joints[j].speed_rad_s * length / dq);
      }
  m.approach_speed_mm_s = std::max(0.1, std::floor(m.approach_speed_mm_s * 10 + 1e-6) / 10);
  for (const std::size_t at : {std::size_t{0}, m.cut.size() / 2, m.cut.size() - 1}) m.departure_mm = std::max(m.departure_mm, departure_mm(task, tools, at, m.cut[at]));
  out.motion = std::move(m);
  return out;
}

}  // namespace

Result<PassMotion> plan_pass(const PassTask& task, const PassTools& tools, const JointVector& q_before, const AcceptPass& accept) {
  Trouble trouble;
  std::vector<PassMotion> declined;  // certified, but the way there needs a search
  const TryPass try_one = [&](const PassTask& at, const std::vector<double>& turns, const JointVector& q_first) {
    Attempt a = realize(at, tools, turns, q_first, trouble);
    if (!a.motion) return a;
    if (auto refusal = accept(*a.motion, false)) {
      trouble.add(7, *refusal);
      declined.push_back(std::move(*a.motion));
      a.motion.reset(), a.station = 0, a.is_turn_blocked = false;
    }
    return a;
  };
  const auto is_declined_often = [&] { return declined.size() >= kDeclinedAtMost; };
  // Turns near the reference first; the whole circle only where none of them holds.
  constexpr int kNear = 6, kAll = 36, kTriesNear = 16, kTriesAll = 72;
  std::vector<double> blocked;
  for (const bool is_all : {false, true}) {
    std::vector<PassCandidate> candidates;
    const int first = is_all ? kNear + 1 : 0, last = is_all ? kAll : kNear;
    for (int k = first; k <= last; ++k)
      for (const int sign : {1, -1}) {
        if (sign < 0 && (k == 0 || k == kAll)) continue;
        PathFault fault;
        add_candidates(task, tools, sign * k * kTurnStep_rad, q_before, candidates, fault);
        if (fault.rank >= 0) trouble.add(fault.rank, fault.refusal);
      }
    std::stable_sort(candidates.begin(), candidates.end(), [](const PassCandidate& a, const PassCandidate& b) { return a.cost_mm < b.cost_mm; });
    int tries = is_all ? kTriesAll : kTriesNear;
    for (const PassCandidate& c : candidates) {
      if (std::find(blocked.begin(), blocked.end(), c.turn_rad) != blocked.end()) continue;
      if (tries-- == 0 || is_declined_often()) break;
      const Attempt a = try_one(task, std::vector<double>(task.stations.size(), c.turn_rad), c.q_first);
      if (a.motion) return *a.motion;
      if (a.is_turn_blocked) blocked.push_back(c.turn_rad);
    }
  }
  if (!is_declined_often())
    if (auto m = search_changing_turn(task, tools, q_before, try_one)) return *m;
  for (std::size_t k = 0; k < std::min(declined.size(), kSearchedAtMost); ++k) {
    auto refusal = accept(declined[k], true);
    if (!refusal) return declined[k];
    trouble.add(8, *refusal);
  }
  must(trouble.rank >= 0, "a pass without candidates and without a reason");
  return refuse(trouble.refusal);
}

}  // namespace asbuilt
