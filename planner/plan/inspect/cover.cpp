// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/cover.hpp"

#include <algorithm>
#include <bit>
#include <numeric>

namespace asbuilt::inspecting {

std::size_t Bits::count() const {
  std::size_t n = 0;
  for (const std::uint64_t w : words_) n += static_cast<std::size_t>(std::popcount(w));
  return n;
}
std::size_t Bits::count_beyond(const Bits& other) const {
  std::size_t n = 0;
  for (std::size_t i = 0; i < words_.size(); ++i) n += static_cast<std::size_t>(std::popcount(words_[i] & ~other.words_[i]));
  return n;
}
void Bits::add(const Bits& other) {
  for (std::size_t i = 0; i < words_.size(); ++i) words_[i] |= other.words_[i];
}

namespace {

Bits union_of(const std::vector<Bits>& sets, const std::vector<int>& chosen, int without_1 = -1, int without_2 = -1) {
  Bits all(sets.front().size());
  for (const int c : chosen)
    if (c != without_1 && c != without_2) all.add(sets[static_cast<std::size_t>(c)]);
  return all;
}

}  // namespace

std::vector<int> cover(const std::vector<Bits>& sets, const std::vector<double>& price, const std::vector<char>& is_allowed) {
  std::vector<int> chosen;
  if (sets.empty()) return chosen;
  std::vector<char> is_used(sets.size(), 0);
  Bits done(sets.front().size());
  for (;;) {
    int best = -1;
    std::size_t best_gain = 0;
    for (std::size_t i = 0; i < sets.size(); ++i) {
      if (!is_allowed[i] || is_used[i]) continue;
      const std::size_t gain = sets[i].count_beyond(done);
      if (gain == 0) continue;
      if (best < 0 || gain > best_gain || (gain == best_gain && price[i] < price[static_cast<std::size_t>(best)])) best = static_cast<int>(i), best_gain = gain;
    }
    if (best < 0) break;
    chosen.push_back(best), is_used[static_cast<std::size_t>(best)] = 1;
    done.add(sets[static_cast<std::size_t>(best)]);
  }
  if (chosen.size() < 2) return chosen;
  // what the others cover as well goes, dearest first
  const auto drop_superfluous = [&] {
    std::vector<int> by_price = chosen;
    std::stable_sort(by_price.begin(), by_price.end(), [&](int a, int b) { return price[static_cast<std::size_t>(a)] > price[static_cast<std::size_t>(b)]; });
    for (const int c : by_price) {
      if (chosen.size() < 2) break;
      if (sets[static_cast<std::size_t>(c)].count_beyond(union_of(sets, chosen, c)) == 0) chosen.erase(std::find(chosen.begin(), chosen.end(), c));
    }
  };
  drop_superfluous();
  for (bool is_better = true; is_better && chosen.size() >= 3;) {
    is_better = false;
    for (std::size_t a = 0; a < chosen.size() && !is_better; ++a)
      for (std::size_t b = a + 1; b < chosen.size() && !is_better; ++b) {
        const Bits rest = union_of(sets, chosen, chosen[a], chosen[b]);
        for (std::size_t i = 0; i < sets.size() && !is_better; ++i) {
          if (!is_allowed[i] || std::find(chosen.begin(), chosen.end(), static_cast<int>(i)) != chosen.end()) continue;
          Bits with = rest;
          with.add(sets[i]);
          if (done.count_beyond(with) != 0) continue;
          chosen[a] = static_cast<int>(i);
          chosen.erase(chosen.begin() + static_cast<std::ptrdiff_t>(b));
          is_better = true;
        }
      }
    if (is_better) drop_superfluous();
  }
  return chosen;
}

double tour_cost(const std::vector<std::vector<double>>& cost, const std::vector<int>& order) {
  double sum = 0;
  int at = 0;
  for (const int i : order) sum += cost[static_cast<std::size_t>(at)][static_cast<std::size_t>(i)], at = i;
  return sum + cost[static_cast<std::size_t>(at)][0];
}

namespace {

std::vector<int> exact_tour(const std::vector<std::vector<double>>& cost) {
  const std::size_t m = cost.size() - 1, all = std::size_t{1} << m;
  std::vector<double> best(all * m, 1e300);
  std::vector<int> from(all * m, -1);
  for (std::size_t i = 0; i < m; ++i) best[(std::size_t{1} << i) * m + i] = cost[0][i + 1];
  for (std::size_t set = 1; set < all; ++set)
    for (std::size_t i = 0; i < m; ++i) {
      const double here = best[set * m + i];
      if (!((set >> i) & 1) || here >= 1e300) continue;
      for (std::size_t j = 0; j < m; ++j) {
        if ((set >> j) & 1) continue;
        const std::size_t next = (set | (std::size_t{1} << j)) * m + j;
        if (here + cost[i + 1][j + 1] < best[next]) best[next] = here + cost[i + 1][j + 1], from[next] = static_cast<int>(i);
      }
    }
  std::size_t last = 0;
  for (std::size_t i = 1; i < m; ++i)
    if (best[(all - 1) * m + i] + cost[i + 1][0] < best[(all - 1) * m + last] + cost[last + 1][0] - 1e-12) last = i;
  std::vector<int> order;
  for (std::size_t set = all - 1, i = last;;) {
    order.push_back(static_cast<int>(i) + 1);
    const int before = from[set * m + i];
    set &= ~(std::size_t{1} << i);
    if (before < 0) break;
    i = static_cast<std::size_t>(before);
  }
  std::reverse(order.begin(), order.end());
  return order;
}

}  // namespace

std::vector<int> closed_tour(const std::vector<std::vector<double>>& cost) {
  const std::size_t n = cost.size();
  if (n <= 1) return {};
  if (n == 2) return {1};
  if (n <= 12) return exact_tour(cost);
  std::vector<int> order;
  std::vector<char> is_done(n, 0);
  int at = 0;
  while (order.size() + 1 < n) {
    int next = -1;
    for (std::size_t i = 1; i < n; ++i)
      if (!is_done[i] && (next < 0 || cost[static_cast<std::size_t>(at)][i] < cost[static_cast<std::size_t>(at)][static_cast<std::size_t>(next)])) next = static_cast<int>(i);
    order.push_back(next), is_done[static_cast<std::size_t>(next)] = 1, at = next;
  }
  double now = tour_cost(cost, order);
  for (bool is_better = true; is_better;) {
    is_better = false;
    const auto try_order = [&](const std::vector<int>& o) {
      const double c = tour_cost(cost, o);
      if (c < now - 1e-9) order = o, now = c, is_better = true;
    };
    for (std::size_t i = 0; i < order.size(); ++i)
      for (std::size_t k = i + 1; k < order.size(); ++k) {
        std::vector<int> o = order;
        std::reverse(o.begin() + static_cast<std::ptrdiff_t>(i), o.begin() + static_cast<std::ptrdiff_t>(k) + 1);
        try_order(o);
      }
    for (std::size_t run = 1; run <= 3; ++run)
      for (std::size_t i = 0; i + run <= order.size(); ++i)
        for (std::size_t k = 0; k + run <= order.size(); ++k) {
          if (k == i) continue;
          std::vector<int> o = order;
          const std::vector<int> piece(o.begin() + static_cast<std::ptrdiff_t>(i), o.begin() + static_cast<std::ptrdiff_t>(i + run));
          o.erase(o.begin() + static_cast<std::ptrdiff_t>(i), o.begin() + static_cast<std::ptrdiff_t>(i + run));
          o.insert(o.begin() + static_cast<std::ptrdiff_t>(k), piece.begin(), piece.end());
          try_order(o);
        }
  }
  return order;
}

}  // namespace asbuilt::inspecting
