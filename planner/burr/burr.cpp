// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/burr.hpp"

namespace asbuilt {
Result<Done<Burrs>> measure_burrs(const BurrRecipe&, const Job&, const MeasuredCloud&, const Location&, const Features&) {
  return refuse({.code = "burr.not_built", .stage = "burr"});
}
}  // namespace asbuilt
