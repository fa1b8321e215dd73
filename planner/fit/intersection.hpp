// SPDX-License-Identifier: GPL-3.0-or-later
// Closed forms of surface-surface intersection, where they exist: plane with plane, cylinder, cone, sphere; coaxial surfaces of
// revolution. Used to check the tracing and to name the curve that an edge is.
#pragma once

#include <optional>
#include <variant>
#include <vector>

#include "planner/geom/surface.hpp"

namespace asbuilt::fitting {

/// All branches of the intersection; empty when the surfaces miss each other; none when there is no closed form here.
std::optional<std::vector<Curve>> closed_form_intersection(const Surface& a, const Surface& b);

}  // namespace asbuilt::fitting
