// SPDX-License-Identifier: GPL-3.0-or-later
// Set cover and tour against what trying everything gives; the ray tree against the distance tree.
#include "planner/plan/inspect/cover.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/geom/ray_tree.hpp"

namespace asbuilt::inspecting {
namespace {

std::vector<Bits> random_sets(Random& r, int sets, int elements, double share) {
  std::vector<Bits> out;
  for (int i = 0; i < sets; ++i) {
    Bits b(static_cast<std::size_t>(elements));
    for (int k = 0; k < elements; ++k)
      if (r.uniform() < share) b.set(static_cast<std::size_t>(k));
    out.push_back(b);
  }
  return out;
}
Bits union_of(const std::vector<Bits>& sets, const std::vector<int>& chosen) {
  Bits all(sets.front().size());
  for (const int c : chosen) all.add(sets[static_cast<std::size_t>(c)]);
  return all;
}

TEST(Cover, covers_all_that_can_be_covered_with_no_set_to_spare_and_nearly_the_fewest) {
  Random r(3);
  int extra = 0;
  for (int round = 0; round < 60; ++round) {
    const auto sets = random_sets(r, 11, 70, 0.3);
    std::vector<double> price(sets.size());
    for (double& p : price) p = r.uniform();
    const std::vector<char> allowed(sets.size(), 1);
    const auto chosen = cover(sets, price, allowed);
    std::vector<int> everything(sets.size());
    std::iota(everything.begin(), everything.end(), 0);
    const Bits all = union_of(sets, everything);
    EXPECT_EQ(all.count_beyond(union_of(sets, chosen)), 0u);
    for (const int c : chosen) {
      std::vector<int> rest = chosen;
      std::erase(rest, c);
      EXPECT_GT(all.count_beyond(union_of(sets, rest)), 0u);
    }
    std::size_t fewest = sets.size();
    for (unsigned mask = 1; mask < (1u << sets.size()); ++mask) {
      std::vector<int> some;
      for (std::size_t i = 0; i < sets.size(); ++i)
        if (mask >> i & 1) some.push_back(static_cast<int>(i));
      if (some.size() < fewest && all.count_beyond(union_of(sets, some)) == 0) fewest = some.size();
    }
    ASSERT_LE(chosen.size(), fewest + 1);
    extra += static_cast<int>(chosen.size() - fewest);
  }
  EXPECT_LE(extra, 12);  // of 60
}

TEST(Cover, a_set_that_is_not_allowed_is_not_used_and_more_sets_never_cover_less) {
  Random r(4);
  const auto sets = random_sets(r, 20, 90, 0.15);
  const std::vector<double> price(sets.size(), 1.0);
  std::size_t before = 0;
  for (std::size_t n = 1; n <= sets.size(); ++n) {
    std::vector<char> allowed(sets.size(), 0);
    std::fill(allowed.begin(), allowed.begin() + static_cast<std::ptrdiff_t>(n), 1);
    const auto chosen = cover(sets, price, allowed);
    for (const int c : chosen) EXPECT_LT(c, static_cast<int>(n));
    const std::size_t covered = union_of(sets, chosen).count();
    EXPECT_GE(covered, before);
    before = covered;
  }
}

TEST(Tour, is_the_shortest_of_all_where_all_can_be_tried_and_no_two_legs_can_be_swapped_beyond) {
  Random r(5);
  const auto places = [&](int n) {
    std::vector<std::vector<double>> cost(static_cast<std::size_t>(n), std::vector<double>(static_cast<std::size_t>(n)));
    std::vector<Vec2> p;
    for (int i = 0; i < n; ++i) p.emplace_back(r.uniform(), r.uniform());
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) cost[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] = (p[static_cast<std::size_t>(i)] - p[static_cast<std::size_t>(k)]).norm();
    return cost;
  };
  for (int round = 0; round < 5; ++round) {
    const auto cost = places(8);
    const auto order = closed_tour(cost);
    std::vector<int> all{1, 2, 3, 4, 5, 6, 7};
    double best = 1e9;
    do best = std::min(best, tour_cost(cost, all));
    while (std::next_permutation(all.begin(), all.end()));
    EXPECT_NEAR(tour_cost(cost, order), best, 1e-9);
  }
  const auto cost = places(30);
  auto order = closed_tour(cost);
  ASSERT_EQ(order.size(), 29u);
  const double length = tour_cost(cost, order);
  for (std::size_t i = 0; i < order.size(); ++i)
    for (std::size_t k = i + 1; k < order.size(); ++k) {
      auto o = order;
      std::reverse(o.begin() + static_cast<std::ptrdiff_t>(i), o.begin() + static_cast<std::ptrdiff_t>(k) + 1);
      EXPECT_GE(tour_cost(cost, o), length - 1e-9);
    }
  std::sort(order.begin(), order.end());
  for (int i = 0; i < 29; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], i + 1);
}

TEST(RayTree, answers_as_trying_every_triangle_does) {
  Random r(6);
  Mesh m;
  for (int i = 0; i < 900; ++i) {
    const Vec3 c(r.uniform(800, 1200), r.uniform(-200, 200), r.uniform(500, 900));
    for (int k = 0; k < 3; ++k) m.vertices.push_back(c + Vec3(r.normal(0, 15), r.normal(0, 15), r.normal(0, 15)));
    m.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  const RayTree tree(m);
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const Vec3 p(r.uniform(700, 1300), r.uniform(-300, 300), r.uniform(400, 1000));
    const Vec3 d = Vec3(r.normal(), r.normal(), r.normal()).normalized();
    const double to = r.uniform(10, 600);
    double nearest = 1e9;
    int which = -1;
    for (std::size_t t = 0; t < m.triangles.size(); ++t) {
      const auto& f = m.triangles[t];
      Mat3 a;
      const Vec3 v = m.vertices[static_cast<std::size_t>(f[0])];
      a << m.vertices[static_cast<std::size_t>(f[1])] - v, m.vertices[static_cast<std::size_t>(f[2])] - v, -d;
      const Vec3 x = a.inverse() * (p - v);
      if (x[0] >= 0 && x[1] >= 0 && x[0] + x[1] <= 1 && x[2] > 0 && x[2] < to && x[2] < nearest) nearest = x[2], which = static_cast<int>(t);
    }
    const auto hit = tree.first_hit(p, d, 0, to);
    ASSERT_EQ(hit.has_value(), which >= 0) << i;
    EXPECT_EQ(tree.is_blocked(p, d, 0, to), which >= 0);
    if (!hit) continue;
    ++hits;
    EXPECT_NEAR(hit->distance_mm, nearest, 1e-6);
    EXPECT_EQ(hit->triangle, which);
  }
  EXPECT_GT(hits, 300);
  EXPECT_FALSE(RayTree(Mesh()).is_blocked(Vec3::Zero(), Vec3::UnitX(), 0, 1e9));
}

}  // namespace
}  // namespace asbuilt::inspecting
