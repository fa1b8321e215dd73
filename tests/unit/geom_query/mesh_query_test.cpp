// SPDX-License-Identifier: GPL-3.0-or-later
// Queries on a box whose distances are known in closed form, and on overlapping boxes.
#include "planner/geom/mesh_query.hpp"

#include <gtest/gtest.h>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

void add_box(Mesh& m, const Vec3& lo, const Vec3& hi) {
  const int o = static_cast<int>(m.vertices.size());
  for (int i = 0; i < 8; ++i) m.vertices.push_back({i & 1 ? hi.x() : lo.x(), i & 2 ? hi.y() : lo.y(), i & 4 ? hi.z() : lo.z()});
  const int quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& q : quads) {
    m.triangles.push_back({o + q[0], o + q[1], o + q[2]});
    m.triangles.push_back({o + q[0], o + q[2], o + q[3]});
  }
}

double box_distance(const Vec3& p, const Vec3& half) {  // signed, box about the origin
  const Vec3 d = p.cwiseAbs() - half;
  return d.cwiseMax(0).norm() + std::min(0.0, d.maxCoeff());
}

TEST(MeshQuery, distances_of_a_box) {
  Mesh m;
  const Vec3 half(30, 20, 10);
  add_box(m, -half, half);
  m.triangles.push_back({0, 0, 1});  // a degenerate triangle does no harm
  const MeshQuery q(m);
  Random r(1);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 p(r.uniform(-50, 50), r.uniform(-50, 50), r.uniform(-50, 50));
    EXPECT_NEAR(q.signed_distance(p), box_distance(p, half), 1e-9);
    EXPECT_EQ(q.contains(p), box_distance(p, half) < 0);
  }
}

TEST(MeshQuery, first_hit_is_the_nearest_and_within_reach) {
  Mesh m;
  add_box(m, {-1, -1, 5}, {1, 1, 6});
  add_box(m, {-1, -1, 8}, {1, 1, 9});
  const MeshQuery q(m);
  const auto hit = q.first_hit({0.1, 0.2, 0}, Vec3::UnitZ());
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->distance_mm, 5, 1e-12);
  EXPECT_LT(m.triangle_normal(hit->triangle).z(), -0.9);
  EXPECT_FALSE(q.first_hit({0.1, 0.2, 0}, Vec3::UnitZ(), 4.9));
  EXPECT_FALSE(q.first_hit({0.1, 0.2, 0}, -Vec3::UnitZ()));
  EXPECT_FALSE(q.first_hit({5, 0, 0}, Vec3::UnitZ()));
}

TEST(MeshQuery, overlapping_bodies_are_inside_too) {
  Mesh m;
  add_box(m, {0, 0, 0}, {10, 10, 10});
  add_box(m, {5, 2, 2}, {15, 8, 8});
  const MeshQuery q(m);
  EXPECT_TRUE(q.contains({7, 5, 5}));
  EXPECT_TRUE(q.contains({1, 1, 1}));
  EXPECT_TRUE(q.contains({12, 5, 5}));
  EXPECT_FALSE(q.contains({12, 9, 9}));
}

TEST(MeshQuery, an_empty_mesh_answers) {
  const MeshQuery q{Mesh{}};
  EXPECT_TRUE(q.is_empty());
  EXPECT_FALSE(q.contains(Vec3::Zero()));
  EXPECT_FALSE(q.first_hit(Vec3::Zero(), Vec3::UnitX()));
  EXPECT_EQ(q.closest(Vec3::Zero()).triangle, -1);
}

}  // namespace
}  // namespace asbuilt
