// SPDX-License-Identifier: GPL-3.0-or-later
// Product and manufacturing information that stands in the file as data: tolerances, dimensions, datums, one line of text each.
#pragma once

#include <string>
#include <vector>

#include "planner/io/step/bind.hpp"

namespace asbuilt::step {

/// "flatness 0.1 mm #88", "position 0.2 mm | A | B M #91", "diameter 12 mm -0.02 +0.05 mm #93", "datum A #12"; in file order.
/// The faces an item is about follow as "faces #417 #420" where the file links them.
std::vector<std::string> read_pmi(const Binder& b);

}  // namespace asbuilt::step
