// SPDX-License-Identifier: GPL-3.0-or-later
// Readings averaged in cells, in bounded memory. All sums are integers, so that the result is the same for any order of readings.
// A cell is one side of a surface: readings whose surface faces another of the six axis directions go to another cell, so that the two
// faces of a sharp edge are never averaged with each other. Frame: base. mm.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt::fuse_detail {

class Cells {
 public:
  /// `count_max`: when there would be more cells, all cells double their size (as often as it takes: the size in the end does not
  /// depend on the order).
  Cells(double cell_mm, std::size_t count_max);
  /// view: 0..63; weight: 1..1023. n: where the surface faces; zero where not known.
  void add(int view, const Vec3& p_base, const Eigen::Vector3f& n_base, int weight);
  struct Point {
    int view = 0;
    std::uint32_t readings_count = 0;
    Vec3 p_base = Vec3::Zero();
  };
  /// In the order of view, direction and place.
  std::vector<Point> points() const;
  double cell_mm() const { return cell_mm_; }
  std::size_t count() const { return count_; }
  std::size_t memory_bytes_count() const { return memory_most_; }

 private:
  struct Slot {
    std::uint64_t key = 0;  // 0: free
    std::int64_t x = 0, y = 0, z = 0, weight = 0;
    std::uint32_t readings = 0;
  };
  double cell_mm_ = 1;
  std::size_t count_max_ = 0, count_ = 0, memory_most_ = 0;
  std::vector<Slot> slots_;

  Slot& slot(std::vector<Slot>& slots, std::uint64_t key, bool& is_new);
  void grow();
  void coarsen();
};

}  // namespace asbuilt::fuse_detail
