// SPDX-License-Identifier: GPL-3.0-or-later
// Distance, ray and containment queries on a triangle mesh (CGAL's AABB tree behind a plain interface).
#pragma once

#include <memory>
#include <optional>

#include "planner/geom/mesh.hpp"

namespace asbuilt {

struct MeshHit {
  Vec3 p_mm = Vec3::Zero();
  int triangle = -1;
  double distance_mm = 0;  // from the query point, or along the unit ray
};

/// Immutable after construction; queries are const and may be called from several threads.
class MeshQuery {
 public:
  MeshQuery() = default;
  explicit MeshQuery(Mesh mesh);
  const Mesh& mesh() const;
  bool is_empty() const;
  /// Nearest point of the surface to p.
  MeshHit closest(const Vec3& p_mm) const;
  /// First hit of the ray from p along the unit direction d, within [0, reach].
  std::optional<MeshHit> first_hit(const Vec3& p_mm, const Vec3& d, double reach_mm = 1e9) const;
  /// True when p lies inside the closed surface (ray parity, several directions vote).
  bool contains(const Vec3& p_mm) const;
  /// Distance to the surface, negative inside.
  double signed_distance(const Vec3& p_mm) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace asbuilt
