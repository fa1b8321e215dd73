// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that `asbuilt batch` emitted, every token changed in every way, through reading, rules, comparison with the plan, replay of the item.
//
//   study_emitted EVERY JOBS [BATCH.yaml OUT]..     EVERY 1: each token. JOBS: welding, scanning, relative jobs, splines, drawn at random (no item).
//                                               OUT: what `asbuilt batch BATCH.yaml --out OUT --post krl,inform,beckhoff` wrote
//
// The plan comes from OUT/store (or is made anew); the text written from it has to be the emitted files byte for byte.
#include <cstdio>
#include <cstdlib>
#include "tests/bench/post/emitted.hpp"
#include "tests/support/item_mutants.hpp"

int main(int argc, char** argv) {
  using namespace asbuilt;
  if (argc < 3 || argc % 2 != 1) return std::fprintf(stderr, "usage: study_emitted EVERY JOBS [BATCH.yaml OUT]..\n"), 2;
  const std::size_t every = static_cast<std::size_t>(std::max(1, std::atoi(argv[1])));
  support::MutantCount count;
  int seed = 0;
  for (int k = 0; k < std::atoi(argv[2]); ++k) {
    const Post& post = posts()[static_cast<std::size_t>(k) % 3];
    support::MutantSubject s{"job " + std::to_string(k + 1), &post, support::post_context(), {}, {}, {}};
    if (k / 3 % 2 == 0) s.context.cell.controller.options["inform.relative"] = "yes", s.context.cell.controller.options["inform.user_frame"] = "5";
    s.planned = support::random_program(static_cast<std::uint64_t>(500 + k), support::mix_for(post, {.sections = 2, .points = 15, .has_new_frames = false, .has_splines = k / 3 % 2 != 0, .has_triggers = true}));
    const auto text = post.write(s.planned, s.context);
    if (!text) return std::fprintf(stderr, "%s\n", support::text_of(text.error()).c_str()), 1;
    s.text = *text;
    support::count_mutants(count, s, ++seed, {.every = every, .is_all_kinds = true});
  }
  const bool is_read = support::for_each_emitted(argc, argv, 3, [&](const ItemRecord& r, const PostContext& context, const auto& shaped) {
    Job planned = *r.job;
    planned.cell.controller = {};
    for (std::size_t k = 0; k < shaped.size(); ++k) {
      const Post& post = *shaped[k].first;
      support::MutantSubject s{r.item_id + "/" + std::string(name_of(post.language)), &post, context, r.programs[k].text, shaped[k].second, {}};
      s.is_replayed_ok = [&](const Program& p) { return verify_item(planned, *r.location, *r.features, *r.burrs, *r.tool_path, p).is_ok(); };
      support::count_mutants(count, s, ++seed, {.every = every, .is_all_kinds = true});
      std::fprintf(stderr, "%s: %d mutants so far, %d survive\n", s.name.c_str(), count.mutants, count.survivors());
    }
  });
  support::print(count);
  return is_read && count.unexplained.empty() ? 0 : 1;
}
