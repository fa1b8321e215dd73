// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/fuse.hpp"

namespace asbuilt {
Result<Done<MeasuredCloud>> fuse(const FuseRecipe&, const Job&) { return refuse({.code = "fuse.not_built", .stage = "fuse"}); }
}  // namespace asbuilt
