// SPDX-License-Identifier: GPL-3.0-or-later
// Which of many polylines pass near a point, and where on them the nearest place is. A voxel table is filled once; a query then
// looks at a few segments only, so that hundreds of thousands of points can be asked.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

struct PolylineFoot {
  int line = -1, segment = 0;
  double t = 0;            // 0..1 on the segment
  double s_mm = 0;         // arc length
  double distance_mm = 0;
  bool is_beyond = false;  // the nearest place is an open end and the query lies past it
  Vec3 p = Vec3::Zero();
};

/// Immutable after construction; queries are const and may be called from several threads.
class PolylineIndex {
 public:
  PolylineIndex() = default;
  /// Lines with fewer than two points are never found. A line whose last point equals its first is closed.
  PolylineIndex(std::vector<std::vector<Vec3>> lines, double reach_mm);
  /// Every line within reach of p, in order of line; `out` is cleared first.
  void near(const Vec3& p, std::vector<PolylineFoot>& out) const;
  const std::vector<Vec3>& line(int i) const { return lines_[i]; }
  const std::vector<double>& arc_length(int i) const { return s_mm_[i]; }

 private:
  struct Hint {
    int line, segment;
    float distance_mm;
  };
  std::int64_t key_of(const Vec3& p) const;
  PolylineFoot foot_near(const Vec3& p, int line, int segment) const;
  std::vector<std::vector<Vec3>> lines_;
  std::vector<std::vector<double>> s_mm_;
  std::vector<char> closed_;
  double reach_mm_ = 0, cell_mm_ = 1;
  std::unordered_map<std::int64_t, std::vector<Hint>> table_;
};

}  // namespace asbuilt
