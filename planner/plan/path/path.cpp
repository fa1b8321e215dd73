// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/path.hpp"

namespace asbuilt {
Result<Done<ToolPath>> plan_path(const PathRecipe&, const Job&, const Location&, const Features&, const Burrs&) {
  return refuse({.code = "path.not_built", .stage = "path"});
}
}  // namespace asbuilt
