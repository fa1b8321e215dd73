// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/brep.hpp"

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

}  // namespace asbuilt
