// SPDX-License-Identifier: GPL-3.0-or-later
// The part's mesh as it was measured: the drawing's mesh moved near the measured edges to where they really are.
#pragma once

#include "planner/artefacts/features.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt {

/// Frames    part.
/// Method    a vertex moves by the shift (adapted minus nominal) of the nearest station of any adapted edge, in full within 5 mm
///           and fading to nothing at 40 mm.
Mesh scanned_part(const Mesh& nominal_part, const Features& features);

}  // namespace asbuilt
