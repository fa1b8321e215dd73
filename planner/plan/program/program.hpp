// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7c: motion -> the neutral program.
#pragma once

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/motion.hpp"
#include "planner/artefacts/program.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct ProgramRecipe {
  double spindle_settle_s = 1.0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("spindle_settle", s.spindle_settle_s);
  }
};

Result<Done<Program>> plan_program(const ProgramRecipe& recipe, const Job& job, const Location& location, const ToolPath& path,
                                   const Motion& motion);

}  // namespace asbuilt
