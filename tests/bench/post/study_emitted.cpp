// SPDX-License-Identifier: GPL-3.0-or-later
// Programs that `asbuilt batch` emitted, every token changed in every way, through reading, rules, comparison with the plan, replay of the item.
//
//   study_emitted EVERY [BATCH.yaml OUT]..     EVERY 1: each token. OUT: what `asbuilt batch BATCH.yaml --out OUT --post krl,inform,beckhoff` wrote
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
  if (argc < 4 || argc % 2 != 0) return std::fprintf(stderr, "usage: study_emitted EVERY [BATCH.yaml OUT]..\n"), 2;
  const std::size_t every = static_cast<std::size_t>(std::max(1, std::atoi(argv[1])));
  support::MutantCount count;
  int seed = 0;
  for (int a = 2; a + 1 < argc; a += 2) {
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
