// SPDX-License-Identifier: GPL-3.0-or-later
// The tabulated distance against the tree's, and the point grid against a plain search.
#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "planner/geom/distance_grid.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/geom/point_grid.hpp"

namespace asbuilt {
namespace {

Mesh star(int corners) {  // a prism over a star: concave and convex edges, slender triangles
  Mesh m;
  for (int i = 0; i < corners; ++i) {
    const double a = 2 * kPi * i / corners, r = i % 2 ? 25 : 40;
    for (const double z : {0.0, 15.0}) m.vertices.push_back({r * std::cos(a), r * std::sin(a), z});
  }
  m.vertices.push_back({0, 0, 0}), m.vertices.push_back({0, 0, 15});
  const int bottom = 2 * corners, top = bottom + 1;
  for (int i = 0; i < corners; ++i) {
    const int a = 2 * i, b = 2 * ((i + 1) % corners);
    m.triangles.push_back({a, b, b + 1}), m.triangles.push_back({a, b + 1, a + 1});
    m.triangles.push_back({a + 1, b + 1, top}), m.triangles.push_back({b, a, bottom});
  }
  return m;
}

TEST(DistanceGrid, agrees_with_the_tree) {
  const Mesh m = star(14);
  const DistanceGrid grid(m, 1.0, 10);
  const MeshQuery tree(m);
  Random r(5);
  int off = 0, sign_off = 0;
  constexpr int kCount = 4000;
  for (int i = 0; i < kCount; ++i) {
    const Vec3 p(r.uniform(-45, 45), r.uniform(-45, 45), r.uniform(-8, 23));
    const auto hit = grid.closest(p);
    ASSERT_TRUE(hit);
    const double truth = tree.closest(p).distance_mm;
    EXPECT_GE(std::abs(hit->distance_mm), truth - 1e-9);
    off += std::abs(hit->distance_mm) > truth + 1e-6;
    if (truth < 5) sign_off += (hit->distance_mm < 0) != tree.contains(p);
    EXPECT_NEAR(grid.distance(p), truth, 0.9);
  }
  EXPECT_LT(off, kCount / 100);
  EXPECT_LT(sign_off, kCount / 50);  // beside an edge the nearer triangle's normal may not tell
  EXPECT_FALSE(grid.closest({100, 0, 0}));
}

TEST(PointGrid, finds_the_nearest_within_reach) {
  Random r(6);
  std::vector<Vec3> points;
  for (int i = 0; i < 500; ++i) points.push_back({r.uniform(-10, 10), r.uniform(-10, 10), r.uniform(-10, 10)});
  const PointGrid grid(points, 2.0);
  for (int i = 0; i < 500; ++i) {
    const Vec3 q(r.uniform(-12, 12), r.uniform(-12, 12), r.uniform(-12, 12));
    int best = -1;
    double best_d = 1.7;
    for (std::size_t k = 0; k < points.size(); ++k)
      if ((points[k] - q).norm() < best_d) best_d = (points[k] - q).norm(), best = static_cast<int>(k);
    EXPECT_EQ(grid.nearest(q, 1.7), best);
  }
}

}  // namespace
}  // namespace asbuilt
