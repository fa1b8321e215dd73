// SPDX-License-Identifier: GPL-3.0-or-later
// Many rays against one mesh: is anything in the way between two points? A binary tree of boxes split by surface-area cost over a
// flat list of triangles; several times quicker and smaller than a general distance tree, which is asked for by MeshQuery.
#pragma once

#include <memory>
#include <optional>

#include "planner/geom/mesh.hpp"

namespace asbuilt {

struct RayHit {
  double distance_mm = 0;  // along the unit ray
  int triangle = -1;       // of the mesh the tree was made from
};

/// Immutable after construction; queries are const and may be called from several threads. Triangles without area are left out.
class RayTree {
 public:
  RayTree() = default;
  explicit RayTree(const Mesh& mesh);
  bool is_empty() const;
  Box3 box() const;
  /// Anything on the ray p + t d (d unit) with from_mm < t < to_mm, either side of a triangle.
  bool is_blocked(const Vec3& p_mm, const Vec3& d, double from_mm, double to_mm) const;
  /// The first triangle on the ray with from_mm < t < to_mm.
  std::optional<RayHit> first_hit(const Vec3& p_mm, const Vec3& d, double from_mm, double to_mm) const;
  std::size_t memory_bytes() const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

}  // namespace asbuilt
