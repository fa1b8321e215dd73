// SPDX-License-Identifier: GPL-3.0-or-later
// Feet on surfaces without a closed form, many of them: the domain is found once, the search starts next to the answer.
#pragma once

#include <memory>

#include "planner/geom/surface.hpp"

namespace asbuilt {

/// Where on a free-form surface to start looking for a foot: found once per 4 mm cell, on the drawing's surface, so that the
/// answer does not depend on who asks first. May be used from several threads.
class FootSeeds {
 public:
  explicit FootSeeds(Surface nominal);
  Vec2 at(const Vec3& p) const;
  /// Signed distance and natural normal of the same surface moved rigidly, sought from there.
  double distance(const Surface& moved, const Vec3& p, Vec3& n) const;
  /// The foot on the surface itself.
  SurfaceFoot foot(const Vec3& p) const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace asbuilt
