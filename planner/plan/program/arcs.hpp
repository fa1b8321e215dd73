// SPDX-License-Identifier: GPL-3.0-or-later
// Straight moves that lie on a circle become arcs.
#pragma once

#include <functional>

#include "planner/artefacts/program.hpp"

namespace asbuilt {

struct ArcRecipe {
  double tolerance_mm = 0.005;   // no point of the straight moves is farther from its arc, and no straight move
  double turn_max_rad = 2.1;     // of one arc
  double turn_min_rad = 0.035;
  double radius_max_mm = 2000;
  int moves_min_count = 4;
  double axis_rad = 1e-4;        // no orientation is farther from the one between the arc's ends
};

/// The program with every run of straight moves of one speed that lies on a circle written as arcs, through a point ON the arc.
///
/// Frames    everything in base; `is_allowed` gets start, middle and end of an arc and the work frame: a controller may know planes only.
/// Method    greedy: from each point the longest run whose points lie on the circle through its first, middle and last one; the straight
///           moves leave it by c^2 / 8R, which has to be within the tolerance too.
/// Promises  targets that are left are the same ones; nothing is rounded more.  (unit/program/arcs)
Program with_arcs(const ArcRecipe& recipe, const Program& program,
                  const std::function<bool(const Vec3&, const Vec3&, const Vec3&, const Pose<frame::Base, frame::Work>&)>& is_allowed);

/// The program with every output at a place on the path (OutputOnPath) as an output between two motions: the motion is cut there, its
/// halves go on into each other. A place nearer than 0.25 mm to an end of the motion moves to that end.
Program cut_at_outputs(const Program& program);

/// The program with every run of rounded straight moves as a spline through the same points, beginning and ending at exact stops.
Program with_splines(const Program& program);

}  // namespace asbuilt
