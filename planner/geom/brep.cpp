// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/brep.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

std::string_view name_of(EdgeKind k) {
  switch (k) {
    case EdgeKind::sharp_convex: return "sharp_convex";
    case EdgeKind::sharp_concave: return "sharp_concave";
    case EdgeKind::near_tangent: return "near";
    case EdgeKind::smooth: return "smooth";
    case EdgeKind::boundary: return "boundary";
    case EdgeKind::mixed: return "mixed";
    default: return "nonmanifold";
  }
}

EdgeKind edge_kind(const std::vector<double>& s_mm, const std::vector<Vec3>& tangent, const std::vector<Vec3>& n_1,
                   const std::vector<Vec3>& n_2, double& dihedral_rad) {
  // Each sample stands for half the way to its neighbours.
  std::vector<std::pair<double, double>> angle_weight;
  double convex = 0, concave = 0, total = 0;
  for (std::size_t i = 0; i < tangent.size(); ++i) {
    const Vec3 c = n_1[i].cross(n_2[i]);
    const double a = std::atan2(c.norm(), n_1[i].dot(n_2[i]));
    const double w = 1e-12 + 0.5 * (s_mm[std::min(i + 1, tangent.size() - 1)] - s_mm[i > 0 ? i - 1 : 0]);
    angle_weight.emplace_back(a, w);
    total += w;
    if (a >= rad_from_deg(1)) (c.dot(tangent[i]) > 0 ? convex : concave) += w;
  }
  std::sort(angle_weight.begin(), angle_weight.end());
  const auto quantile = [&](double f) {
    double sum = 0;
    for (const auto& [a, w] : angle_weight)
      if ((sum += w) >= f * total) return a;
    return angle_weight.back().first;
  };
  dihedral_rad = quantile(0.5);
  // What an edge is at its sharpest: one that runs out tangentially is still an edge.
  const double top = quantile(0.98);
  if (top < rad_from_deg(1)) return EdgeKind::smooth;
  if (top < rad_from_deg(10)) return EdgeKind::near_tangent;
  if (convex > 0.05 * (convex + concave) && concave > 0.05 * (convex + concave)) return EdgeKind::mixed;
  return convex >= concave ? EdgeKind::sharp_convex : EdgeKind::sharp_concave;
}

}  // namespace asbuilt
