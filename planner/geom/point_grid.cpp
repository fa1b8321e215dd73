// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/point_grid.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

int cell_of(double x, double cell) { return static_cast<int>(std::floor(x / cell)); }

std::uint64_t pack(int i, int j, int k) {
  const auto part = [](int x) { return static_cast<std::uint64_t>(static_cast<std::int64_t>(x) + (1 << 20)) & 0x1fffff; };
  return part(i) | part(j) << 21 | part(k) << 42;
}

}  // namespace

std::uint64_t voxel_key(const Vec3& p, double cell) { return pack(cell_of(p.x(), cell), cell_of(p.y(), cell), cell_of(p.z(), cell)); }

std::uint64_t PointGrid::key(int i, int j, int k) const { return pack(i, j, k); }

PointGrid::PointGrid(std::vector<Vec3> points_mm, double cell_mm) : cell_mm_(cell_mm), points_(std::move(points_mm)) {
  std::vector<std::pair<std::uint64_t, std::uint32_t>> keyed(points_.size());
  for (std::size_t i = 0; i < points_.size(); ++i) keyed[i] = {voxel_key(points_[i], cell_mm_), static_cast<std::uint32_t>(i)};
  std::sort(keyed.begin(), keyed.end());
  order_.resize(keyed.size());
  for (std::size_t i = 0; i < keyed.size();) {
    std::size_t j = i;
    for (; j < keyed.size() && keyed[j].first == keyed[i].first; ++j) order_[j] = keyed[j].second;
    cells_[keyed[i].first] = {static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(j)};
    i = j;
  }
}

int PointGrid::nearest(const Vec3& p, double radius_mm) const {
  int best = -1;
  double best_d2 = radius_mm * radius_mm;
  const int i0 = cell_of(p.x() - radius_mm, cell_mm_), i1 = cell_of(p.x() + radius_mm, cell_mm_);
  const int j0 = cell_of(p.y() - radius_mm, cell_mm_), j1 = cell_of(p.y() + radius_mm, cell_mm_);
  const int k0 = cell_of(p.z() - radius_mm, cell_mm_), k1 = cell_of(p.z() + radius_mm, cell_mm_);
  for (int k = k0; k <= k1; ++k) {
    for (int j = j0; j <= j1; ++j) {
      for (int i = i0; i <= i1; ++i) {
        const auto found = cells_.find(key(i, j, k));
        if (found == cells_.end()) continue;
        for (std::uint32_t m = found->second.first; m < found->second.second; ++m) {
          const int index = static_cast<int>(order_[m]);
          const double d2 = (points_[order_[m]] - p).squaredNorm();
          if (d2 < best_d2 || (d2 == best_d2 && (best < 0 || index < best))) best_d2 = d2, best = index;
        }
      }
    }
  }
  return best;
}

bool PointGrid::any_within(const Vec3& p, double radius_mm) const { return nearest(p, radius_mm) >= 0; }

}  // namespace asbuilt
