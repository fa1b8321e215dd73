// SPDX-License-Identifier: GPL-3.0-or-later
// A triangle mesh: shared vertices, counter-clockwise seen from outside, mm.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

struct Box3 {
  Vec3 min_mm = Vec3::Constant(1e300), max_mm = Vec3::Constant(-1e300);
  void extend(const Vec3& p) { min_mm = min_mm.cwiseMin(p), max_mm = max_mm.cwiseMax(p); }
  bool is_empty() const { return (min_mm.array() > max_mm.array()).any(); }
  double diagonal_mm() const { return is_empty() ? 0.0 : (max_mm - min_mm).norm(); }
  Vec3 center_mm() const { return 0.5 * (min_mm + max_mm); }
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("min", s.min_mm), a("max", s.max_mm);
  }
};

struct Mesh {
  std::vector<Vec3> vertices;                // mm
  std::vector<std::array<int, 3>> triangles;

  Box3 box() const {
    Box3 b;
    for (const Vec3& v : vertices) b.extend(v);
    return b;
  }
  Vec3 triangle_normal(int t) const {  // unit, zero for a degenerate triangle
    const auto& f = triangles[t];
    const Vec3 n = (vertices[f[1]] - vertices[f[0]]).cross(vertices[f[2]] - vertices[f[0]]);
    const double l = n.norm();
    return l > 0 ? Vec3(n / l) : Vec3::Zero();
  }
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("vertices", s.vertices), a("triangles", s.triangles);
  }
};

/// The mesh with every vertex mapped by T.
template <class A, class B>
Mesh transformed(const Pose<A, B>& T_a_b, const Mesh& mesh_b) {
  Mesh m = mesh_b;
  for (Vec3& v : m.vertices) v = T_a_b.point(v);
  return m;
}

}  // namespace asbuilt
