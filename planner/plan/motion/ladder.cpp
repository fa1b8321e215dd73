// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/ladder.hpp"

#include <limits>

namespace asbuilt {

std::optional<std::vector<int>> climb_ladder(const std::vector<std::vector<double>>& node_cost,
                                             const std::function<void(std::size_t, int, std::vector<LadderStep>&)>& neighbours) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  if (node_cost.empty()) return std::nullopt;
  std::vector<double> value = node_cost.front(), next;
  std::vector<std::vector<int>> back(node_cost.size());
  std::vector<LadderStep> steps;
  for (std::size_t r = 1; r < node_cost.size(); ++r) {
    next.assign(node_cost[r].size(), kNever);
    back[r].assign(node_cost[r].size(), -1);
    for (std::size_t n = 0; n < node_cost[r].size(); ++n) {
      if (!(node_cost[r][n] < kNever)) continue;
      steps.clear();
      neighbours(r, static_cast<int>(n), steps);
      for (const LadderStep& s : steps) {
        const double v = value[static_cast<std::size_t>(s.from)] + s.cost + node_cost[r][n];
        if (v < next[n] || (v == next[n] && v < kNever && s.from < back[r][n])) next[n] = v, back[r][n] = s.from;
      }
    }
    value = next;
  }
  int best = -1;
  for (std::size_t n = 0; n < value.size(); ++n)
    if (value[n] < kNever && (best < 0 || value[n] < value[static_cast<std::size_t>(best)])) best = static_cast<int>(n);
  if (best < 0) return std::nullopt;
  std::vector<int> way(node_cost.size());
  for (std::size_t r = node_cost.size(); r-- > 0;) {
    way[r] = best;
    if (r > 0) best = back[r][static_cast<std::size_t>(best)];
  }
  return way;
}

}  // namespace asbuilt
