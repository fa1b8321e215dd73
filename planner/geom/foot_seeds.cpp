// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/foot_seeds.hpp"

#include <tbb/concurrent_unordered_map.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

namespace asbuilt {

struct FootSeeds::Impl {
  Surface nominal;
  SurfaceDomain domain;
  struct Sample {
    Vec3 p;
    Vec2 uv;
  };
  std::vector<Sample> samples;  // an even grid over the domain, evaluated once
  tbb::concurrent_unordered_map<std::int64_t, Vec2> table;
};

FootSeeds::FootSeeds(Surface nominal) : impl_(std::make_shared<Impl>()) {
  impl_->nominal = std::move(nominal);
  SurfaceDomain& d = impl_->domain;
  d = asbuilt::domain(impl_->nominal);
  const bool is_finite = d.u0 > -1e200 && d.u1 < 1e200 && d.v0 > -1e200 && d.v1 < 1e200;
  constexpr int kGrid = 48;
  for (int i = 0; is_finite && i <= kGrid; ++i)
    for (int j = 0; j <= kGrid; ++j) {
      const Vec2 uv(d.u0 + (d.u1 - d.u0) * i / kGrid, d.v0 + (d.v1 - d.v0) * j / kGrid);
      impl_->samples.push_back({evaluate(impl_->nominal, uv.x(), uv.y()).p, uv});
    }
}

Vec2 FootSeeds::at(const Vec3& p) const {
  constexpr double kCell_mm = 4;
  const Eigen::Array3d c = (p / kCell_mm).array().floor();
  const std::int64_t key = (static_cast<std::int64_t>(c.x() + 1048576) << 42) | (static_cast<std::int64_t>(c.y() + 1048576) << 21) |
                           static_cast<std::int64_t>(c.z() + 1048576);
  const auto found = impl_->table.find(key);
  if (found != impl_->table.end()) return found->second;
  const Vec3 middle = (c + 0.5).matrix() * kCell_mm;
  std::optional<Vec2> start;
  double nearest = 1e300;
  for (const Impl::Sample& s : impl_->samples)
    if (const double d = (s.p - middle).squaredNorm(); d < nearest) nearest = d, start = s.uv;
  const SurfaceFoot foot = project(impl_->nominal, impl_->domain, middle, start);
  const Vec2 uv(foot.u, foot.v);
  impl_->table.insert({key, uv});
  return uv;
}

SurfaceFoot FootSeeds::foot(const Vec3& p) const { return project(impl_->nominal, impl_->domain, p, at(p)); }

double FootSeeds::distance(const Surface& moved, const Vec3& p, Vec3& n) const {
  const SurfaceFoot foot = project(moved, impl_->domain, p, at(p));
  n = foot.n;
  return foot.signed_distance_mm;
}

}  // namespace asbuilt
