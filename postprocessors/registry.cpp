// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/post.hpp"

namespace asbuilt {

const std::vector<Post>& posts() {
  static const std::vector<Post> table = {};
  return table;
}
const Post* find_post(Language language) {
  for (const Post& p : posts())
    if (p.language == language) return &p;
  return nullptr;
}

}  // namespace asbuilt
