// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/scanned_part.hpp"

#include <algorithm>

#include "planner/geom/point_grid.hpp"

namespace asbuilt {

namespace {
constexpr double kFull_mm = 5, kNone_mm = 40;
}

Mesh scanned_part(const Mesh& nominal_part, const Features& features) {
  Mesh m = nominal_part;
  std::vector<Vec3> at, shift;
  for (const AdaptedEdge& e : features.edges)
    for (std::size_t i = 0; i < e.nominal.size() && i < e.adapted.size(); ++i)
      at.push_back(e.nominal[i]), shift.push_back(e.adapted[i] - e.nominal[i]);
  if (at.empty()) return m;
  const PointGrid grid(at, kNone_mm);
  for (Vec3& v : m.vertices) {
    const int k = grid.nearest(v, kNone_mm);
    if (k < 0) continue;
    const double d = (v - at[static_cast<std::size_t>(k)]).norm();
    v += std::clamp((kNone_mm - d) / (kNone_mm - kFull_mm), 0.0, 1.0) * shift[static_cast<std::size_t>(k)];
  }
  return m;
}

}  // namespace asbuilt
