// SPDX-License-Identifier: GPL-3.0-or-later
// The cutter as a solid of revolution: outline, signed distance, mesh. Frame tool: z from the spindle to the work, tip at 0.
#pragma once

#include <vector>

#include "planner/artefacts/job.hpp"

namespace asbuilt {

/// Outline from the tip's centre up to the collet: (radius, height above the tip), mm. Arcs are cut into chords.
struct CutterProfile {
  std::vector<Vec2> outline;
  double cutting_height_mm = 0;  // up to where it cuts: flank of a cone, ball, first diameter of a cylinder
  double length_mm = 0, radius_max_mm = 0;
};
CutterProfile profile_of(const Cutter& cutter);

/// Distance of the point from the solid's surface, negative inside. Exact for the outline.
double cutter_distance(const CutterProfile& profile, const Vec3& p_tool);

/// What is left of the solid when `by_mm` is taken off all round; empty outline where nothing is.
CutterProfile shrunk(const CutterProfile& profile, double by_mm);

/// The part of the solid between two heights, as a closed mesh that holds it (facets outside the true surface), in tool.
Mesh cutter_mesh(const CutterProfile& profile, double from_mm, double to_mm);

}  // namespace asbuilt
