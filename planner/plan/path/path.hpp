// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7a: adapted edges and burrs -> the path of the tip with its feed, in part. Includes the gate: P(chamfer in tolerance).
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct PathRecipe {
  double contact_height_ratio = 0.5;        // of the cone's flank, from the tip
  double contact_height_min_ratio = 0.12;   // how low the contact may go where the cutter would otherwise touch a wall
  double clear_mm = 1.0;                    // the leads end this far outside the burr's upper bound
  double stray_max_mm = 0.05;               // how deep the cutter may go into the drawing's part away from the edges
  double damage_mm = 0.10;                  // deeper than the deepest good chamfer by this is damage ...
  double damage_probability_max_ratio = 2e-3;  // ... and must be this unlikely at every station
  double end_left_max_mm = 1.001;            // what may stay uncut at an end that the cutter cannot reach
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("contact_height", s.contact_height_ratio), a("contact_height_min", s.contact_height_min_ratio), a("clear", s.clear_mm);
    a("stray_max", s.stray_max_mm), a("damage", s.damage_mm), a("damage_probability_max", s.damage_probability_max_ratio);
    a("end_left_max", s.end_left_max_mm);
  }
};

/// Plans where the tip goes to leave the recipe's chamfer on every adapted edge, and how fast.
///
/// Frames    in: edges in part, axis in base. out: tips and axes in part.
/// Units     mm, rad, mm/s (feeds are multiples of 0.1 mm/s).
/// Method    swept flank against the two fitted faces (algorithms B6.6); feed = removal rate over the upper bound of chamfer and burr
///           cross-section (B8); gate: expected share of the edge whose legs are both in tolerance (B11).
/// Assumes   edges convex, stations at most 0.5 mm apart.
/// Refuses   path.process, path.unmeasured, path.not_convex, path.tool_does_not_fit, path.burr_above_limit, path.feed_below_min, path.gate.
/// Promises  moving edge and location moves the path; a larger burr never gives a larger feed; mean of both legs = width.
Result<Done<ToolPath>> plan_path(const PathRecipe& recipe, const Job& job, const Location& location, const Features& features,
                                 const Burrs& burrs);

}  // namespace asbuilt
