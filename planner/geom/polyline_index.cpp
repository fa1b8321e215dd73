// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/polyline_index.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

namespace {
std::int64_t pack(std::int64_t x, std::int64_t y, std::int64_t z) {
  constexpr std::int64_t kHalf = 1 << 20;
  return ((x + kHalf) << 42) | ((y + kHalf) << 21) | (z + kHalf);
}
}  // namespace

PolylineIndex::PolylineIndex(std::vector<std::vector<Vec3>> lines, double reach_mm)
    : lines_(std::move(lines)), reach_mm_(reach_mm), cell_mm_(std::max(reach_mm / 3, 0.5)) {
  s_mm_.resize(lines_.size());
  closed_.assign(lines_.size(), 0);
  const int around = static_cast<int>(std::ceil(reach_mm_ / cell_mm_)) + 1;
  const double far = reach_mm_ + 0.9 * cell_mm_;
  for (std::size_t l = 0; l < lines_.size(); ++l) {
    const auto& line = lines_[l];
    s_mm_[l].assign(line.size(), 0);
    for (std::size_t i = 1; i < line.size(); ++i) s_mm_[l][i] = s_mm_[l][i - 1] + (line[i] - line[i - 1]).norm();
    if (line.size() < 2) continue;
    closed_[l] = line.size() > 2 && (line.front() - line.back()).norm() < 1e-9;
    for (std::size_t i = 0; i + 1 < line.size(); ++i) {
      const double length = (line[i + 1] - line[i]).norm();
      const int steps = std::max(1, static_cast<int>(std::ceil(length / (0.5 * cell_mm_))));
      for (int k = 0; k < steps; ++k) {
        const Vec3 p = line[i] + (line[i + 1] - line[i]) * ((k + 0.5) / steps);
        const Eigen::Array3d c = (p / cell_mm_).array().floor();
        for (int dx = -around; dx <= around; ++dx)
          for (int dy = -around; dy <= around; ++dy)
            for (int dz = -around; dz <= around; ++dz) {
              const Eigen::Array3d cell = c + Eigen::Array3d(dx, dy, dz);
              const double d = ((cell + 0.5).matrix() * cell_mm_ - p).norm();
              if (d > far + 0.25 * cell_mm_) continue;
              auto& hints = table_[pack(static_cast<std::int64_t>(cell.x()), static_cast<std::int64_t>(cell.y()),
                                        static_cast<std::int64_t>(cell.z()))];
              if (hints.empty() || hints.back().line != static_cast<int>(l))
                hints.push_back({static_cast<int>(l), static_cast<int>(i), static_cast<float>(d)});
              else if (d < hints.back().distance_mm)
                hints.back().segment = static_cast<int>(i), hints.back().distance_mm = static_cast<float>(d);
            }
      }
    }
  }
}

std::int64_t PolylineIndex::key_of(const Vec3& p) const {
  const Eigen::Array3d c = (p / cell_mm_).array().floor();
  return pack(static_cast<std::int64_t>(c.x()), static_cast<std::int64_t>(c.y()), static_cast<std::int64_t>(c.z()));
}

PolylineFoot PolylineIndex::foot_near(const Vec3& p, int line, int segment) const {
  const auto& points = lines_[line];
  const int count = static_cast<int>(points.size()) - 1;
  const bool closed = closed_[line];
  PolylineFoot best;
  best.line = line;
  best.distance_mm = 1e300;
  const auto look = [&](int i) {
    const Vec3 d = points[i + 1] - points[i];
    const double l2 = d.squaredNorm();
    const double raw = l2 > 0 ? (p - points[i]).dot(d) / l2 : 0.0;
    const double t = std::clamp(raw, 0.0, 1.0);
    const Vec3 q = points[i] + d * t;
    const double r = (p - q).norm();
    if (r >= best.distance_mm) return false;
    best.segment = i, best.t = t, best.p = q, best.distance_mm = r;
    best.s_mm = s_mm_[line][i] + t * std::sqrt(l2);
    best.is_beyond = !closed && ((i == 0 && raw < 0) || (i == count - 1 && raw > 1));
    return true;
  };
  const auto wrapped = [&](int i) { return closed ? ((i % count) + count) % count : i; };
  look(segment);
  for (const int step : {1, -1}) {  // downhill, looking a little past every rise
    double walked = 0;
    int misses = 0;
    for (int k = 1; k <= count; ++k) {
      const int raw = segment + step * k;
      if (!closed && (raw < 0 || raw >= count)) break;
      const int i = wrapped(raw);
      misses = look(i) ? 0 : misses + 1;
      walked += s_mm_[line][i + 1] - s_mm_[line][i];
      if (misses > 3 && walked > 2 * cell_mm_) break;
    }
  }
  return best;
}

void PolylineIndex::near(const Vec3& p, std::vector<PolylineFoot>& out) const {
  out.clear();
  const auto found = table_.find(key_of(p));
  if (found == table_.end()) return;
  for (const Hint& h : found->second) {
    const PolylineFoot f = foot_near(p, h.line, h.segment);
    if (f.distance_mm <= reach_mm_) out.push_back(f);
  }
}

}  // namespace asbuilt
