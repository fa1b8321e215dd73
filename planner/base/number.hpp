// SPDX-License-Identifier: GPL-3.0-or-later
// The one door through which numbers become text: no locale, fixed digits, no "-0.000".
#pragma once

#include <string>

namespace asbuilt {

/// Fixed notation with exactly `decimals` digits after the point; negative zero is written as zero. Must be finite.
std::string fixed_number(double value, int decimals);

/// Shortest text that reads back to the same double; "0" for negative zero. Must be finite.
std::string shortest_number(double value);

/// value rounded to a multiple of 10^-decimals, without negative zero.
double rounded(double value, int decimals);

}  // namespace asbuilt
