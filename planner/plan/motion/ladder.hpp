// SPDX-License-Identifier: GPL-3.0-or-later
// Cheapest way up a ladder: one node of each rung, with a cost at every node and between nodes of neighbouring rungs.
#pragma once

#include <functional>
#include <optional>
#include <vector>

namespace asbuilt {

/// Index of the chosen node of each rung, or none where no way has a finite cost. Equal costs: the lower index.
///
/// Method    value-only dynamic programming: two rungs of values and back-pointers of all rungs. `neighbours` lists, for a rung
///           and one of its nodes, the nodes of the rung before that can lead to it with what the step costs.
struct LadderStep {
  int from = 0;
  double cost = 0;
};
std::optional<std::vector<int>> climb_ladder(const std::vector<std::vector<double>>& node_cost,
                                             const std::function<void(std::size_t rung, int node, std::vector<LadderStep>& steps)>& neighbours);

}  // namespace asbuilt
