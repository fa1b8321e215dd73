// SPDX-License-Identifier: GPL-3.0-or-later
// Colours and layers of bodies, shells, faces and representations, by their ids.
#pragma once

#include <string>
#include <unordered_map>

#include "planner/io/step/bind.hpp"

namespace asbuilt::step {

struct Styles {
  std::unordered_map<std::int64_t, std::string> color;  // "#rrggbb" of a surface style
  std::unordered_map<std::int64_t, std::string> layer;
};
/// Looks at STYLED_ITEM, OVER_RIDING_STYLED_ITEM and PRESENTATION_LAYER_ASSIGNMENT; what cannot be followed gives no colour.
Styles read_styles(const Binder& b);

}  // namespace asbuilt::step
