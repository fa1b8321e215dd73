// SPDX-License-Identifier: GPL-3.0-or-later
// How a part comes out of a mould or off a machine: a smooth displacement of the drawing's points, with its derivative, so that
// normals of the deformed part are known as exactly as its points. Frame: part. mm.
#pragma once

#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/random.hpp"

namespace asbuilt::simulate_detail {

struct Deformation {
  Vec3 center = Vec3::Zero();
  double scale = 0;  // shrinkage left over: relative
  struct Wave {
    Vec3 amplitude_mm, wave_per_mm;
    double phase;
  };
  std::vector<Wave> waves;

  Vec3 point(const Vec3& p) const;
  Mat3 gradient(const Vec3& p) const;  // d point / d p
  /// A surface normal at p after the deformation, unit.
  Vec3 normal(const Vec3& p, const Vec3& n) const;
};

/// Adds `count` waves of random direction, lengths between the two, whose sum has `rms_mm` per axis.
void add_waves(Deformation& d, int count, double rms_mm, double length_min_mm, double length_max_mm, Random& random);

}  // namespace asbuilt::simulate_detail
