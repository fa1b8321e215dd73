// SPDX-License-Identifier: GPL-3.0-or-later
// The verifier must see every change of an emitted program: each token of the text is changed, removed or doubled, and reading,
// linting or comparing with the plan must object, or the change must be one that is known to do nothing, with its reason.
// POST_MUTATION_PROGRAMS sets the number of programs a dialect (the long run: 30).
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>

#include "tests/support/post_programs.hpp"
#include "tests/support/text_mutants.hpp"

namespace asbuilt {
namespace {

using namespace support;

TEST(PostMutation, every_changed_token_is_seen) {
  const char* asked = std::getenv("POST_MUTATION_PROGRAMS");
  const int programs = asked ? std::atoi(asked) : 2;
  const PostContext context = post_context();
  for (const Post& post : posts()) {
    const Tolerance tolerance = tolerance_of(post, context);
    int mutants = 0, refused = 0, different = 0, linted = 0, unexplained = 0;
    std::map<std::string, int> reasons;
    for (int seed = 1; seed <= programs; ++seed) {
      const Program p = random_program(1000 + seed, mix_for(post, {.sections = 1, .points = 6}));
      const auto text = post.write(p, context);
      ASSERT_TRUE(text) << text_of(text.error());
      Random random = Random::stream(seed, "mutation");
      for (const TextToken& t : tokens_of(*text)) {
        const std::string token = text->files[t.file].bytes.substr(t.begin, t.end - t.begin);
        for (const std::string& change : changes_of(token, random)) {
          ProgramText mutant = *text;
          mutant.files[t.file].bytes.replace(t.begin, t.end - t.begin, change);
          ++mutants;
          const auto back = post.read(mutant, context);
          if (!back) {
            ++refused;
            continue;
          }
          if (!difference(p, *back, tolerance, prints_in_base(post, context)).empty()) {
            ++different;
            continue;
          }
          bool is_linted = false;
          for (const Check& c : post.lint(mutant, context)) is_linted |= !c.is_passed;
          if (is_linted) {
            ++linted;
            continue;
          }
          const std::string before = line_around(text->files[t.file].bytes, t.begin), after = line_around(mutant.files[t.file].bytes, t.begin);
          const std::string why = harmless(post.language, before, token, change);
          if (!why.empty()) {
            ++reasons[why];
          } else if (++unexplained <= 20) {
            std::printf("%s not seen:\n  %s\n  %s\n", std::string(name_of(post.language)).c_str(), before.c_str(), after.c_str());
          }
        }
      }
    }
    const int harmless_count = mutants - refused - different - linted - unexplained;
    std::printf("%s: %d mutants of %d programs, refused %d, different %d, lint %d, harmless %d (%.2f %%), unexplained %d\n",
                std::string(name_of(post.language)).c_str(), mutants, programs, refused, different, linted, harmless_count, 100.0 * harmless_count / mutants, unexplained);
    for (const auto& [why, n] : reasons) std::printf("  %5d %s\n", n, why.c_str());
    EXPECT_EQ(unexplained, 0) << name_of(post.language);
  }
}

}  // namespace
}  // namespace asbuilt
