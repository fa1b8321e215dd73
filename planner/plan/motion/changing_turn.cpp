// SPDX-License-Identifier: GPL-3.0-or-later
// Where no constant turn about the tool axis holds: a ladder over the path in which the turn may change.
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/plan/motion/ladder.hpp"
#include "planner/plan/motion/pass_search.hpp"

namespace asbuilt {
namespace {

constexpr double kNodeTurn_rad = rad_from_deg(10);
constexpr int kNodeTurns = 36;
constexpr double kTurnRate_rad_per_mm = rad_from_deg(3);
constexpr double kBlockTurn_rad = rad_from_deg(4.5);
constexpr std::size_t kRungs = 40, kNodesAtMost = 900;
constexpr int kRounds = 20;
constexpr double kNever = std::numeric_limits<double>::infinity();

struct Node {
  int turn = 0;  // of kNodeTurns, from -18 on
  int branch = 0;
  JointVector q{};
};

double turn_of(int k) { return (k - kNodeTurns / 2) * kNodeTurn_rad; }

/// The task with stations fine enough for the turns of the chosen rungs, and the turn at each.
void refine(const PassTask& task, const std::vector<std::size_t>& rungs, const std::vector<double>& rung_turn, PassTask& fine,
            std::vector<double>& turns) {
  fine = task;
  fine.stations.clear();
  turns.clear();
  for (std::size_t r = 0; r + 1 < rungs.size(); ++r) {
    double length = 0;
    for (std::size_t i = rungs[r]; i < rungs[r + 1]; ++i) length += (task.stations[i + 1].tip - task.stations[i].tip).norm();
    const double change = rung_turn[r + 1] - rung_turn[r];
    double s = 0;
    for (std::size_t i = rungs[r]; i < rungs[r + 1]; ++i) {
      const PassStation &a = task.stations[i], &b = task.stations[i + 1];
      const double step = (b.tip - a.tip).norm(), from = length > 0 ? s / length : 0, to = length > 0 ? (s + step) / length : 1;
      const bool is_turning = std::abs(change) > 1e-9;
      const int parts = std::max(1, static_cast<int>(std::ceil(std::abs(change) * (to - from) / kBlockTurn_rad)));
      for (int k = i == 0 && r == 0 ? -1 : 0; k < parts; ++k) {
        const double t = k < 0 ? 0 : static_cast<double>(k + 1) / parts;
        PassStation p = t < 1 ? a : b;
        p.tip = a.tip + t * (b.tip - a.tip);
        p.axis = (a.axis + t * (b.axis - a.axis)).normalized();
        p.feed_mm_s = k < 0 ? a.feed_mm_s : b.feed_mm_s;
        p.s_mm = a.s_mm + t * (b.s_mm - a.s_mm);
        p.is_emitted = is_turning || (t < 1 ? k < 0 : b.is_emitted);
        fine.stations.push_back(p);
        turns.push_back(rung_turn[r] + change * (from + t * (to - from)));
      }
      s += step;
    }
  }
}

}  // namespace

std::optional<PassMotion> search_changing_turn(const PassTask& task, const PassTools& tools, const JointVector& q_before, const TryPass& try_one) {
  const Robot& robot = *tools.robot;
  if (!robot.is_opw()) return std::nullopt;  // without all branches a ladder would be full of holes
  const std::size_t n = task.stations.size();
  std::vector<double> s(n, 0);
  for (std::size_t i = 1; i < n; ++i) s[i] = s[i - 1] + (task.stations[i].tip - task.stations[i - 1].tip).norm();
  std::vector<std::size_t> rungs{0};
  const double spacing = std::max(4.0, s.back() / static_cast<double>(kRungs));
  for (std::size_t i = 1; i + 1 < n; ++i)
    if (s[i] - s[rungs.back()] >= spacing && s.back() - s[i] >= 0.5 * spacing) rungs.push_back(i);
  if (n > 1) rungs.push_back(n - 1);

  const auto T_tool_flange = tools.T_flange_tool.inverse();
  // What hangs on the flange stands in the same place for every branch: looked at once for each turn.
  const auto is_blocked = [&](const JointVector& q) {
    const CollisionScene& scene = tools.cell->scene;
    for (const Watch& w : tools.cell->always) {
      const int a = scene.mount(w.a), b = scene.mount(w.b);
      if (std::min(a, b) != kMountBase || std::max(a, b) != kMountFlange) continue;
      if (scene.separation(w.a, w.b, q, w.margin_mm).distance_mm < w.margin_mm) return true;
    }
    return false;
  };
  std::vector<std::vector<Node>> nodes(rungs.size());
  std::vector<std::vector<double>> cost(rungs.size());
  for (std::size_t r = 0; r < rungs.size(); ++r) {
    for (int k = 0; k < kNodeTurns; ++k) {
      const auto solutions = robot.inverse(tool_pose(task, rungs[r], turn_of(k)) * T_tool_flange);
      if (solutions.empty() || is_blocked(solutions.front())) continue;
      for (const JointVector& q : solutions) {
        if (robot.joint_margin_rad(q) < tools.joint_margin_rad || nodes[r].size() >= kNodesAtMost) continue;
        nodes[r].push_back({k, robot.branch(q), q});
        const double singular = robot.singularity_ratio(q);
        cost[r].push_back(singular < kSingularityLimit_ratio ? kNever
                                                             : posture_cost_mm(robot, q) + 0.001 * std::abs(turn_of(k)) +
                                                                   (r == 0 ? 0.003 * largest_joint_step(q, q_before) : 0.0));
      }
    }
    if (nodes[r].empty()) return std::nullopt;
  }

  const auto& joints = robot.spec().joints;
  const auto neighbours = [&](std::size_t r, int node, std::vector<LadderStep>& steps) {
    const Node& to = nodes[r][static_cast<std::size_t>(node)];
    const double length = std::max(s[rungs[r]] - s[rungs[r - 1]], 0.1), time = length / std::max(task.feed_min_mm_s, 0.1);
    for (std::size_t f = 0; f < nodes[r - 1].size(); ++f) {
      const Node& from = nodes[r - 1][f];
      const int across = std::abs(to.turn - from.turn), turn = std::min(across, kNodeTurns - across);
      if (from.branch != to.branch || turn * kNodeTurn_rad > kTurnRate_rad_per_mm * length) continue;
      double most = 0;
      bool is_jump = false;
      for (int i = 0; i < 6; ++i) {
        const double d = std::abs(to.q[i] - from.q[i]);
        is_jump |= d > 1.0;
        if (joints[i].speed_rad_s > 0) most = std::max(most, d / (0.8 * joints[i].speed_rad_s * time));
      }
      if (is_jump || most > 1) continue;
      steps.push_back({static_cast<int>(f), 0.02 * turn * kNodeTurn_rad + 0.001 * most});
    }
  };

  for (int round = 0; round < kRounds; ++round) {
    const auto way = climb_ladder(cost, neighbours);
    if (!way) return std::nullopt;
    std::vector<double> rung_turn;
    for (std::size_t r = 0; r < rungs.size(); ++r) {
      double t = turn_of(nodes[r][static_cast<std::size_t>((*way)[r])].turn);
      if (r > 0) t = rung_turn.back() + std::remainder(t - rung_turn.back(), 2 * kPi);  // the short way about
      rung_turn.push_back(t);
    }
    PassTask fine;
    std::vector<double> turns;
    refine(task, rungs, rung_turn, fine, turns);
    const Attempt a = try_one(fine, turns, nodes[0][static_cast<std::size_t>((*way)[0])].q);
    if (a.motion) return a.motion;
    // Forbid what was met: the turn at the rungs beside the place, in every branch where the flange's own load is in the way.
    double at = 0;
    for (std::size_t i = 1; i <= a.station && i < fine.stations.size(); ++i) at += (fine.stations[i].tip - fine.stations[i - 1].tip).norm();
    std::size_t r = 0;
    while (r + 1 < rungs.size() && std::abs(s[rungs[r + 1]] - at) <= std::abs(s[rungs[r]] - at)) ++r;
    const double turn_met = turns[std::min(a.station, turns.size() - 1)];
    const int branch = nodes[r][static_cast<std::size_t>((*way)[r])].branch;
    for (std::size_t k = 0; k < nodes[r].size(); ++k) {
      const double off = std::abs(std::remainder(turn_of(nodes[r][k].turn) - turn_met, 2 * kPi));
      if (off <= 0.75 * kNodeTurn_rad && (a.is_turn_blocked || nodes[r][k].branch == branch)) cost[r][k] = kNever;
    }
    cost[r][static_cast<std::size_t>((*way)[r])] = kNever;
  }
  return std::nullopt;
}

}  // namespace asbuilt
