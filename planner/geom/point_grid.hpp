// SPDX-License-Identifier: GPL-3.0-or-later
// Points in a hash of cubic cells: is anything within reach, and which point is nearest.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

/// Immutable after construction; queries may run in parallel. Radii up to the cell's size.
class PointGrid {
 public:
  PointGrid() = default;
  PointGrid(std::vector<Vec3> points_mm, double cell_mm);

  const std::vector<Vec3>& points() const { return points_; }
  bool is_empty() const { return points_.empty(); }
  /// Index of the nearest point within radius_mm (at most the cell's size), or -1. Equal distances: the lower index.
  int nearest(const Vec3& p_mm, double radius_mm) const;
  bool any_within(const Vec3& p_mm, double radius_mm) const;

 private:
  std::uint64_t key(int i, int j, int k) const;

  double cell_mm_ = 1;
  std::vector<Vec3> points_;
  std::vector<std::uint32_t> order_;
  std::unordered_map<std::uint64_t, std::pair<std::uint32_t, std::uint32_t>> cells_;  // looked up, never iterated
};

/// Cell index of a point as one number, for grouping points by voxel.
std::uint64_t voxel_key(const Vec3& p_mm, double cell_mm);

}  // namespace asbuilt
