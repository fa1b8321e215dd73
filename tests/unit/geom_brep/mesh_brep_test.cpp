// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/mesh_brep.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

namespace asbuilt {
namespace {

/// Prism over a polygon (counter-clockwise), every triangle with vertices of its own, as STL gives them.
Mesh prism(const std::vector<Vec2>& outline, double height) {
  Mesh m;
  const auto tri = [&](const Vec3& a, const Vec3& b, const Vec3& c) {
    const int k = static_cast<int>(m.vertices.size());
    m.vertices.insert(m.vertices.end(), {a, b, c});
    m.triangles.push_back({k, k + 1, k + 2});
  };
  Vec2 c = Vec2::Zero();
  for (const Vec2& p : outline) c += p / static_cast<double>(outline.size());
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 &p = outline[i], &q = outline[(i + 1) % outline.size()];
    const Vec3 a(p.x(), p.y(), 0), b(q.x(), q.y(), 0), up(0, 0, height);
    tri(a, b, b + up);
    tri(a, b + up, a + up);
    tri(Vec3(c.x(), c.y(), 0), b, a);
    tri(Vec3(c.x(), c.y(), height), a + up, b + up);
  }
  return m;
}

std::vector<Vec2> circle(double r, int n) {
  std::vector<Vec2> p;
  for (int i = 0; i < n; ++i) p.push_back({r * std::cos(2 * kPi * i / n), r * std::sin(2 * kPi * i / n)});
  return p;
}

std::map<std::string, int> kinds(const Brep& b) {
  std::map<std::string, int> m;
  for (const BrepEdge& e : b.edges) ++m[std::string(name_of(e.kind))];
  return m;
}

TEST(MeshBrep, BoxHasSixPlanesAndTwelveConvexEdges) {
  const Brep b = brep_from_mesh(prism({{0, 0}, {30, 0}, {30, 20}, {0, 20}}, 10));
  ASSERT_EQ(b.faces.size(), 6u);
  for (const BrepFace& f : b.faces) EXPECT_EQ(surface_type(f.surface), "plane");
  EXPECT_EQ(b.edges.size(), 12u);
  EXPECT_EQ(kinds(b)["sharp_convex"], 12);
  EXPECT_NEAR(b.volume_mm3, 6000, 1e-9);
  EXPECT_NEAR(b.area_mm2, 2 * (600 + 300 + 200), 1e-9);
  EXPECT_EQ(b.open_edges_count, 0);
  double length = 0;
  for (const BrepEdge& e : b.edges) {
    length += e.length_mm;
    EXPECT_NEAR(e.dihedral_rad, kPi / 2, 1e-9);
    EXPECT_EQ(e.curve_type, "line");
    EXPECT_GT(e.n_1[0].cross(e.n_2[0]).dot(e.tangent[0]), 0.99);  // walk of face_1, convex
    for (std::size_t i = 1; i < e.p.size(); ++i) EXPECT_LT((e.p[i] - e.p[i - 1]).norm(), 1.0 + 1e-9);
  }
  EXPECT_NEAR(length, 4 * 60, 1e-9);
}

TEST(MeshBrep, CylinderIsFoundWithItsAxisAndItsRimsAreCircles) {
  const Brep b = brep_from_mesh(prism(circle(12, 72), 25));
  ASSERT_EQ(b.faces.size(), 3u);
  int cylinders = 0;
  for (const BrepFace& f : b.faces)
    if (const auto* c = std::get_if<CylinderSurface>(&f.surface.shape)) {
      ++cylinders;
      EXPECT_NEAR(c->radius_mm, 12, 1e-9);
      EXPECT_NEAR(std::abs(c->at.z.z()), 1, 1e-9);
      EXPECT_TRUE(f.same_sense);
    }
  EXPECT_EQ(cylinders, 1);
  ASSERT_EQ(b.edges.size(), 2u);
  for (const BrepEdge& e : b.edges) {
    EXPECT_TRUE(e.is_closed);
    EXPECT_EQ(e.kind, EdgeKind::sharp_convex);
    EXPECT_EQ(e.p.front(), e.p.back());
    EXPECT_NEAR(e.length_mm, 2 * kPi * 12, 0.02);  // samples lie on the circle, not on the chords
    for (const Vec3& p : e.p) EXPECT_NEAR(p.head<2>().norm(), 12, 1e-6);
  }
}

TEST(MeshBrep, AHoleIsConcaveInSenseAndItsRimConvex) {
  // A ring: outer circle and inner circle joined by hand.
  const int n = 48;
  Mesh m;
  for (double r : {20.0, 8.0})
    for (double z : {0.0, 6.0})
      for (int i = 0; i < n; ++i) m.vertices.push_back({r * std::cos(2 * kPi * i / n), r * std::sin(2 * kPi * i / n), z});
  const auto id = [&](int ring, int level, int i) { return (ring * 2 + level) * n + i % n; };
  for (int i = 0; i < n; ++i) {
    const auto quad = [&](int a, int b, int c, int d) { m.triangles.push_back({a, b, c}), m.triangles.push_back({a, c, d}); };
    quad(id(0, 0, i), id(0, 0, i + 1), id(0, 1, i + 1), id(0, 1, i));
    quad(id(1, 1, i), id(1, 1, i + 1), id(1, 0, i + 1), id(1, 0, i));
    quad(id(0, 1, i), id(0, 1, i + 1), id(1, 1, i + 1), id(1, 1, i));
    quad(id(1, 0, i), id(1, 0, i + 1), id(0, 0, i + 1), id(0, 0, i));
  }
  const Brep b = brep_from_mesh(m);
  ASSERT_EQ(b.faces.size(), 4u);
  EXPECT_EQ(kinds(b)["sharp_convex"], 4);
  for (const BrepFace& f : b.faces)
    if (const auto* c = std::get_if<CylinderSurface>(&f.surface.shape)) {
      EXPECT_EQ(f.same_sense, c->radius_mm > 10);
    }
}

TEST(MeshBrep, AFilletDoesNotSwallowThePlanesBesideIt) {
  std::vector<Vec2> p{{0, 0}, {40, 0}, {40, 25}};
  for (int i = 1; i <= 9; ++i) p.push_back({35 + 5 * std::cos(i * kPi / 18), 25 + 5 * std::sin(i * kPi / 18)});
  p.push_back({0, 30});
  const Mesh m = prism(p, 12);
  const Brep b = brep_from_mesh(m);
  std::map<std::string, int> types;
  for (const BrepFace& f : b.faces) ++types[std::string(surface_type(f.surface))];
  EXPECT_EQ(types["plane"], 6);
  EXPECT_EQ(types["cylinder"], 1);
  EXPECT_EQ(types["facets"], 0);
}

TEST(MeshBrep, CurvedPatchKeepsItsTriangles) {
  Mesh m;  // a bump over a square, open
  const int n = 20;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j) m.vertices.push_back({i * 1.0, j * 1.0, 4 * std::exp(-0.02 * ((i - 10.0) * (i - 10) + (j - 9.0) * (j - 9)))});
  const auto id = [&](int i, int j) { return i * (n + 1) + j; };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) m.triangles.push_back({id(i, j), id(i + 1, j), id(i + 1, j + 1)}), m.triangles.push_back({id(i, j), id(i + 1, j + 1), id(i, j + 1)});
  const Brep b = brep_from_mesh(m);
  ASSERT_EQ(b.faces.size(), 1u);
  EXPECT_EQ(surface_type(b.faces[0].surface), "facets");
  EXPECT_EQ(kinds(b)["boundary"], static_cast<int>(b.edges.size()));
  const Vec3 q(7.3, 11.2, 6);
  const SurfaceFoot f = project(b.faces[0].surface, q);
  FacetSurface plain = std::get<FacetSurface>(b.faces[0].surface.shape);
  plain.query = nullptr;
  EXPECT_LT((project({plain}, q).p - f.p).norm(), 1e-9);  // with and without the search tree
  EXPECT_GT(f.signed_distance_mm, 0);
}

TEST(MeshBrep, EmptyMeshGivesNothing) { EXPECT_TRUE(brep_from_mesh({}).faces.empty()); }

}  // namespace
}  // namespace asbuilt
