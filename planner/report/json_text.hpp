// SPDX-License-Identifier: GPL-3.0-or-later
// JSON as text that a person can read and a program can rely on: rows of numbers stay on one line, numbers leave through
// planner/base/number.hpp, what is not finite is null.
#pragma once

#include <string>

#include "planner/base/archive.hpp"

namespace asbuilt {

/// Short objects and rows on one line, the rest indented by one space a level; ends with a newline.
std::string readable_json(const Json& json);
/// No white space at all (for data inside a page).
std::string compact_json(const Json& json);

/// A number rounded to `decimals`; null when it is not finite.
Json number(double value, int decimals);
/// A number with `digits` significant digits; null when it is not finite.
Json significant(double value, int digits);
Json numbers(const std::vector<double>& values, int decimals);
Json point(const Vec3& p, int decimals);
Json points(const std::vector<Vec3>& p, int decimals);

}  // namespace asbuilt
