// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7c: motion -> the neutral program.
#pragma once

#include <string>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/motion.hpp"
#include "planner/artefacts/program.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct ProgramRecipe {
  double spindle_settle_s = 1.0;
  double rapid_over_feed_ratio = 1.2;  // approach and retract are at least this much faster than feed.max: never mistaken for cutting
  double blend_max_mm = 0.5;           // corners of the cut are rounded at most within this, and never off the path by more than its tolerance
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("spindle_settle", s.spindle_settle_s), a("rapid_over_feed", s.rapid_over_feed_ratio), a("blend_max", s.blend_max_mm);
  }
};

/// Writes the motion as instructions: home, then for every pass transfer, spindle on, approach, cut, retract, spindle off; home.
///
/// Frames    everything in base; SetFrame carries the part's frame, rounded to the digits that are printed (0.001 mm, 0.0001 deg ZYX).
/// Units     mm, rad, mm/s (multiples of 0.1).
/// Refuses   path.no_motion, path.tool_does_not_fit (a pass without its tool in the cell).
Result<Done<Program>> plan_program(const ProgramRecipe& recipe, const Job& job, const Location& location, const ToolPath& path,
                                   const Motion& motion);

/// A program name that every controller takes: lower-case letters, digits and '_', first a letter, at most 24 characters. An id that
/// has to be changed gets a short hash, so that two ids never share a name.
std::string program_name(const std::string& item_id);

/// The pose with its position rounded to 0.001 mm and its ZYX angles to 0.0001 degree.
Pose<frame::Base, frame::Work> printed_frame(const Pose<frame::Base, frame::Part>& T_base_part);

}  // namespace asbuilt
