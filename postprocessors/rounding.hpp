// SPDX-License-Identifier: GPL-3.0-or-later
// What becomes of rounding distances on the way through a dialect.
#pragma once

#include <string>

#include "postprocessors/post.hpp"

namespace asbuilt {

/// Whether a rounding distance comes back as it was planned: not from a dialect without rounding, nor from zones by number.
inline bool keeps_rounding(const Post& post, const PostContext& context) {
  return post.has_rounding && !context.cell.controller.options.count(std::string(name_of(post.language)) + ".position_levels");
}

}  // namespace asbuilt
