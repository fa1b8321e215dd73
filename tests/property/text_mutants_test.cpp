// SPDX-License-Identifier: GPL-3.0-or-later
// Programs of whole items with one token changed: a sample of what tests/bench/post/study_mutants does to every token.
#include <gtest/gtest.h>

#include "tests/support/item_mutants.hpp"

namespace asbuilt {
namespace {

TEST(TextMutants, a_changed_token_of_an_item_is_seen) {
  support::MutantCount count;
  int k = 0;
  for (const Post& post : posts()) {
    if (post.language != Language::krl && post.language != Language::inform && post.language != Language::beckhoff) continue;
    support::count_mutants(count, support::subject_of(support::numbered_item(1), post), ++k, {.every = 13, .is_all_kinds = true, .replays_at_most = 4});
  }
  support::print(count);
  EXPECT_GE(count.mutants, 1500);
  EXPECT_TRUE(count.unexplained.empty());
  EXPECT_LE(count.survivors(), 0.01 * count.mutants);
}

}  // namespace
}  // namespace asbuilt
