// SPDX-License-Identifier: GPL-3.0-or-later
// Feet of points that follow each other: each is sought from the one before, over the whole surface only where that leads off.
#pragma once

#include <algorithm>
#include <optional>

#include "planner/geom/surface.hpp"

namespace asbuilt::step {

class FootWalk {
 public:
  FootWalk(const Surface& s, const SurfaceDomain& d) : s_(s), d_(d), is_exact_(has_closed_form_foot(s)) {}

  SurfaceFoot at(const Vec3& p, const std::optional<Vec2>& seed) {
    SurfaceFoot g = project(s_, d_, p, seed);
    const double off = (g.p - p).norm();
    if (!seed || is_exact_ || off <= 1e-3) return g;
    if (skip_ > 0) return --skip_, g;
    const SurfaceFoot h = project(s_, d_, p);
    if ((h.p - p).norm() < 0.9 * off)
      misses_ = 0, g = h;
    else  // the points lie off the surface: the whole of it is looked at ever more rarely
      misses_ = std::min(misses_ + 1, 6), skip_ = (1 << misses_) - 1;
    return g;
  }

 private:
  const Surface& s_;
  const SurfaceDomain& d_;
  bool is_exact_ = false;
  int misses_ = 0, skip_ = 0;
};

}  // namespace asbuilt::step
