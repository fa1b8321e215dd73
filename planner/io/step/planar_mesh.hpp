// SPDX-License-Identifier: GPL-3.0-or-later
// Constrained Delaunay triangulation of a region of the plane given by closed polygons (CGAL behind a small interface).
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt::step {

class PlanarMesh {
 public:
  PlanarMesh();
  ~PlanarMesh();
  /// Inserts the points and the segments between them. Returns the number of crossings and coincident points found:
  /// 0 means that every segment is an edge between exactly its two points.
  int build(const std::vector<Vec2>& points, const std::vector<std::array<int, 2>>& segments);
  /// Inserts free points (indices continue) after the last `inside` call; points that coincide with others are dropped (-1).
  std::vector<int> insert(const std::vector<Vec2>& points);
  /// Those of the points that lie inside the region, at least `gap` away from the corners of their triangle.
  std::vector<Vec2> filter_inside(const std::vector<Vec2>& points, double gap);
  /// Triangles inside the region by even-odd crossing of segments, counter-clockwise, and for each side k (from corner k to k+1)
  /// whether it is a constraint.
  struct Inside {
    std::vector<std::array<int, 3>> triangles;
    std::vector<std::array<bool, 3>> is_border;
  };
  Inside inside();
  /// Points so far: those given, then crossings made by the triangulation, then inserted ones.
  int size() const;
  Vec2 point(int index) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace asbuilt::step
