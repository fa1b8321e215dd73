// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/motion.hpp"

namespace asbuilt {
Result<Done<Motion>> plan_motion(const MotionRecipe&, const Job&, const Location&, const Features&, const Burrs&, const ToolPath&) {
  return refuse({.code = "motion.not_built", .stage = "motion"});
}
}  // namespace asbuilt
