// SPDX-License-Identifier: GPL-3.0-or-later
// Calibration balls in a cloud: robust centres with the certified radius held, and who is who by their distances.
#pragma once

#include <optional>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/random.hpp"

namespace asbuilt {

struct SphereFit {
  Vec3 center = Vec3::Zero();   // in the cloud's frame, radius held
  Mat3 covariance = Mat3::Zero();
  double rms_mm = 0;
  double free_radius_mm = 0;    // a health number only: of the same points with the radius free
  double cap_rad = 0;           // half angle of the seen cap
  std::size_t points_count = 0;
};

struct SphereRecipe {
  double radius_mm = 4.3655;
  double sigma_mm = 0.01;       // of a point
  double cap_min_rad = 0.61;    // 35 degrees
  int points_min_count = 100;
  int balls_max_count = 4;
};

/// Balls of the given radius in the cloud, best supported first. Sequential RANSAC on four points, then Cauchy-weighted
/// refinement with the radius held (a free radius makes the centre 10 to 25 times worse along the view).
std::vector<SphereFit> find_spheres(const SphereRecipe& recipe, const std::vector<Vec3>& points, std::uint64_t seed);

/// Which ball of the target each fit is, by mutual distances within `tolerance_mm`; proper rotations only. Needs three.
/// Result: for each fit the index into `target`, or none.
std::vector<std::optional<int>> identify_balls(const std::vector<Vec3>& centers, const std::vector<Vec3>& target, double tolerance_mm);

}  // namespace asbuilt
