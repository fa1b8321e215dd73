// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/locate.hpp"

namespace asbuilt {
Result<Done<Location>> locate(const LocateRecipe&, const Job&, const MeasuredCloud&) {
  return refuse({.code = "locate.not_built", .stage = "locate"});
}
}  // namespace asbuilt
