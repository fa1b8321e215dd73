// SPDX-License-Identifier: GPL-3.0-or-later
// The nearest triangle of a mesh, tabulated on a grid: one look-up and a few exact triangle distances instead of a tree
// search. Made once per mesh, used for millions of points.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "planner/geom/mesh.hpp"

namespace asbuilt {

struct SurfaceHit {
  Vec3 p_mm = Vec3::Zero();  // foot on the mesh
  Vec3 n = Vec3::UnitZ();    // of its triangle
  int triangle = -1;
  double distance_mm = 0;    // positive outside, by the triangle's normal
};

/// Immutable after construction; queries may run in parallel.
class DistanceGrid {
 public:
  DistanceGrid() = default;
  /// Frames: of the mesh. Nodes every step_mm out to margin_mm around its box (coarser where the table would exceed 12 million nodes).
  /// Method: triangles' samples seed their nodes, then eight-way sweeps hand each node's triangle on to its neighbours.
  DistanceGrid(const Mesh& mesh, double step_mm, double margin_mm);

  bool is_empty() const { return triangle_.empty(); }
  double step_mm() const { return step_mm_; }
  /// Unsigned distance, interpolated between nodes; the largest tabulated distance outside the grid.
  float distance(const Vec3& p_mm) const;
  /// Nearest point among the triangles that the eight surrounding nodes know; none outside the grid.
  std::optional<SurfaceHit> closest(const Vec3& p_mm) const;
  /// Nearest point of the triangle that the nearest node knows: cheaper, exact on large triangles.
  std::optional<SurfaceHit> closest_rough(const Vec3& p_mm) const;

 private:
  struct Corner {
    Vec3 a, ab, ac, n;
    double d00, d01, d11;
  };
  Vec3 foot(int triangle, const Vec3& p) const;
  std::size_t node(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(count_[1]) +
        static_cast<std::size_t>(j)) * static_cast<std::size_t>(count_[0]) +
           static_cast<std::size_t>(i);
  }
  Vec3 at(int i, int j, int k) const { return origin_ + step_mm_ * Vec3(i, j, k); }
  SurfaceHit hit(int triangle, const Vec3& p, const Vec3& foot) const;

  double step_mm_ = 1, far_mm_ = 0;
  Vec3 origin_ = Vec3::Zero();
  int count_[3] = {0, 0, 0};
  std::vector<Corner> corners_;
  std::vector<std::int32_t> triangle_;  // by node; -1 where none was handed on
  std::vector<float> distance_;
};

}  // namespace asbuilt
