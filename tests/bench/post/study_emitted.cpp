// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that `asbuilt batch` emitted, every token changed in every way, through reading, rules, comparison with the plan, replay of the item.
//
//   study_emitted EVERY JOBS [BATCH.yaml OUT]..     EVERY 1: each token. JOBS: welding, scanning, relative jobs, splines, drawn at random (no item).
//                                               OUT: what `asbuilt batch BATCH.yaml --out OUT --post krl,inform,beckhoff` wrote
//
// The plan comes from OUT/store (or is made anew); the text written from it has to be the emitted files byte for byte.
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "planner/base/hash.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/store.hpp"
#include "tests/support/item_mutants.hpp"

namespace {

using namespace asbuilt;

/// The keys of the store hold the code that filled it: the program beside this one.
std::string code_tag() {
  const auto bytes = read_file_whole(std::filesystem::read_symlink("/proc/self/exe").parent_path() / "asbuilt");
  return bytes ? sha256_hex(*bytes) : own_code_tag();
}

}  // namespace

int main(int argc, char** argv) {
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
  for (int a = 3; a + 1 < argc; a += 2) {
    ItemOptions options;
    options.out = argv[a + 1];
    options.inputs.today = today_iso();
    options.code_tag = code_tag();
    options.languages = {Language::krl, Language::inform, Language::beckhoff};
    const auto batch = load_batch(argv[a], options.inputs);
    if (!batch) return std::fprintf(stderr, "%s\n", support::text_of(batch.error()).c_str()), 2;
    for (const BatchItem& item : batch->artefact.items) {
      const ItemRecord r = run_item(batch->artefact, item.id, options);
      if (r.status != ItemStatus::emitted) {
        std::fprintf(stderr, "%s: nothing was emitted, so nothing can be changed\n", item.id.c_str());
        continue;
      }
      Job planned = *r.job;
      planned.cell.controller = {};
      const PostContext context{r.job->cell, r.job->taken.empty() ? options.inputs.today : r.job->taken};
      for (const ReleasedProgram& released : r.programs) {
        const Post& post = *find_post(released.text.language);
        auto shaped = shaped_for(post, *r.program, context);
        if (!shaped) return std::fprintf(stderr, "%s\n", support::text_of(shaped.error()).c_str()), 1;
        support::MutantSubject s{item.id + "/" + std::string(name_of(post.language)), &post, context, released.text, std::move(*shaped), {}};
        for (const ProgramFile& f : s.text.files)
          if (read_file_whole(options.out / item.id / "programs" / std::string(name_of(post.language)) / f.name) != f.bytes)
            return std::fprintf(stderr, "%s: %s is not what was emitted\n", s.name.c_str(), f.name.c_str()), 1;
        s.is_replayed_ok = [&](const Program& p) { return verify_item(planned, *r.location, *r.features, *r.burrs, *r.tool_path, p).is_ok(); };
        support::count_mutants(count, s, ++seed, {.every = every, .is_all_kinds = true});
        std::fprintf(stderr, "%s: %d mutants so far, %d survive\n", s.name.c_str(), count.mutants, count.survivors());
      }
    }
  }
  support::print(count);
  return count.unexplained.empty() ? 0 : 1;
}
