// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/program/program.hpp"

namespace asbuilt {
Result<Done<Program>> plan_program(const ProgramRecipe&, const Job&, const Location&, const ToolPath&, const Motion&) {
  return refuse({.code = "path.not_built", .stage = "path"});
}
}  // namespace asbuilt
