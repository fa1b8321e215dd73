// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/fit.hpp"

namespace asbuilt {
Result<Done<Features>> fit(const FitRecipe&, const Job&, const MeasuredCloud&, const Location&) {
  return refuse({.code = "fit.not_built", .stage = "fit"});
}
}  // namespace asbuilt
