// SPDX-License-Identifier: GPL-3.0-or-later
// Days of the Gregorian calendar as files write them: 2026-11-22, a time of day after it being ignored.
#pragma once

#include <optional>
#include <string_view>

namespace asbuilt::inputs {

/// Days since 1970-01-01 of "YYYY-MM-DD" or "YYYY-MM-DDT...", or nothing when that is no day.
std::optional<long> day_number(std::string_view text);

}  // namespace asbuilt::inputs
