// SPDX-License-Identifier: GPL-3.0-or-later
// The tour over the views as a neutral program: home, then to every view, stand still, let the picture be taken, on; home.
#pragma once

#include "planner/artefacts/inspection.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/program.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct InspectionProgramRecipe {
  double settle_s = 0.5;    // the arm comes to rest
  double exposure_s = 1.5;  // the picture is taken
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("settle", s.settle_s), a("exposure", s.exposure_s);
  }
};

/// Frames    as plan_program: joints, and the part's frame set for people who look at positions on the panel.
/// Refuses   inspect.no_motion, inspect.tool.
Result<Done<Program>> plan_inspection_program(const InspectionProgramRecipe& recipe, const Job& job, const Location& location, const Inspection& inspection);

/// Name of an item's inspection program: the item's with "_scan" behind, within what controllers take.
std::string inspection_program_name(const std::string& item_id);

}  // namespace asbuilt
