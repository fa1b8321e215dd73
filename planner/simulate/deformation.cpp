// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/deformation.hpp"

#include <Eigen/LU>
#include <cmath>

namespace asbuilt::simulate_detail {

Vec3 Deformation::point(const Vec3& p) const {
  Vec3 out = p + scale * (p - center);
  for (const Wave& w : waves) out += w.amplitude_mm * std::sin(w.wave_per_mm.dot(p) + w.phase);
  return out;
}

Mat3 Deformation::gradient(const Vec3& p) const {
  Mat3 j = Mat3::Identity() * (1 + scale);
  for (const Wave& w : waves) j += w.amplitude_mm * (std::cos(w.wave_per_mm.dot(p) + w.phase) * w.wave_per_mm).transpose();
  return j;
}

Vec3 Deformation::normal(const Vec3& p, const Vec3& n) const { return (gradient(p).inverse().transpose() * n).normalized(); }

void add_waves(Deformation& d, int count, double rms_mm, double length_min_mm, double length_max_mm, Random& random) {
  for (int k = 0; k < count; ++k) {
    Vec3 a, w;
    for (int i = 0; i < 3; ++i) a[i] = random.normal(), w[i] = random.normal();
    const double length = length_min_mm * std::pow(length_max_mm / length_min_mm, random.uniform());
    // a sine of amplitude a has rms a / sqrt 2
    d.waves.push_back({a * (rms_mm * std::sqrt(2.0 / count)), w.normalized() * (2 * kPi / length), random.uniform(0, 2 * kPi)});
  }
}

}  // namespace asbuilt::simulate_detail
