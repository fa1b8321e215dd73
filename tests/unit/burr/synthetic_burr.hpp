// SPDX-License-Identifier: GPL-3.0-or-later
// A plate with fins along the edge y = 0 of its top: exact features (no fit in between) and clouds with truth by construction.
#pragma once

#include "planner/artefacts/features.hpp"
#include "tests/unit/fit/synthetic_part.hpp"

namespace asbuilt::synthetic {

/// Features of the plate's edge 0 as drawn: z up over the top, -y out of the side.
inline Features plate_features(const Plate& plate) {
  Features f;
  AdaptedEdge e;
  e.edge = 0, e.id = "#20", e.feature = "rim";
  const int count = static_cast<int>(std::lround(plate.length / 0.5));
  for (int i = 0; i <= count; ++i) {
    e.s_mm.push_back(0.5 * i);
    e.nominal.emplace_back(0.5 * i, 0, 0), e.adapted.emplace_back(0.5 * i, 0, 0), e.tangent.push_back(Vec3::UnitX());
    e.n_1.push_back(Vec3::UnitZ()), e.n_2.push_back(-Vec3::UnitY());
    e.sigma_mm.push_back(0.003), e.covariance.push_back(Mat3::Identity() * 1e-5), e.status.push_back(StationStatus::measured);
  }
  e.surface_1.surface_part.shape = PlaneSurface{placed({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())};
  e.surface_2.surface_part.shape = PlaneSurface{placed({0, 0, 0}, -Vec3::UnitY(), Vec3::UnitX())};
  f.edges.push_back(e);
  return f;
}

struct Fin {
  std::function<double(double)> height;  // by arc length, largest of the heights over the two faces
  double lean_rad = 0.7;                 // from the top's normal towards the side's
  double root_mm = 0.1;
};

/// Points on a flank of the fin, on a square grid of the given pitch, shifted and turned at random: what one capture sees.
inline void add_fin(Scan& scan, const Fin& fin, double from, double to, double pitch_mm, Random& random) {
  const Vec3 along = Vec3(0, -std::sin(fin.lean_rad), std::cos(fin.lean_rad)), across = Vec3(0, std::cos(fin.lean_rad), std::sin(fin.lean_rad));
  const double reach = std::max(std::cos(fin.lean_rad), std::sin(fin.lean_rad)), turn = random.uniform(0, kPi / 2);
  const double phase_u = random.uniform(0, pitch_mm), phase_v = random.uniform(0, pitch_mm), range = to - from + 10;
  for (double u = -range + phase_u; u < range; u += pitch_mm)
    for (double v = -range + phase_v; v < range; v += pitch_mm) {
      const double s = from + std::cos(turn) * u - std::sin(turn) * v, l = std::sin(turn) * u + std::cos(turn) * v;
      if (s < from || s > to || l < 0) continue;
      const double length = fin.height(s) / reach;
      if (l > length) continue;
      const double half = 0.5 * fin.root_mm * (1 - 0.6 * l / length);
      scan.p_part.push_back(Vec3(s, 0, 0) + along * l + across * half), scan.n_part.push_back(across);
    }
}

}  // namespace asbuilt::synthetic
