// SPDX-License-Identifier: GPL-3.0-or-later
// The items of batches that `asbuilt batch` ran, with what was planned and the programs that were emitted. Header only.
#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>

#include "planner/base/hash.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/posted.hpp"
#include "planner/pipeline/store.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt::support {

/// The keys of the store hold the code that filled it: the program beside this one.
inline std::string code_tag_of_asbuilt() {
  const auto bytes = read_file_whole(std::filesystem::read_symlink("/proc/self/exe").parent_path() / "asbuilt");
  return bytes ? sha256_hex(*bytes) : own_code_tag();
}

/// Every emitted item of [BATCH.yaml OUT].. ; the plan comes from OUT/store, or is made anew. The text written from it has to be the emitted
/// files byte for byte. False where it is not, or a batch cannot be read.
inline bool for_each_emitted(int argc, char** argv, int from,
                             const std::function<void(const ItemRecord&, const PostContext&, const std::vector<std::pair<const Post*, Program>>& shaped)>& body) {
  for (int a = from; a + 1 < argc; a += 2) {
    ItemOptions options;
    options.out = argv[a + 1];
    options.inputs.today = today_iso();
    options.code_tag = code_tag_of_asbuilt();
    options.languages = {Language::krl, Language::inform, Language::beckhoff};
    const auto batch = load_batch(argv[a], options.inputs);
    if (!batch) return std::fprintf(stderr, "%s\n", text_of(batch.error()).c_str()), false;
    for (const BatchItem& item : batch->artefact.items) {
      const ItemRecord r = run_item(batch->artefact, item.id, options);
      if (r.status != ItemStatus::emitted) {
        std::fprintf(stderr, "%s: nothing was emitted\n", item.id.c_str());
        continue;
      }
      const PostContext context{r.job->cell, r.job->taken.empty() ? options.inputs.today : r.job->taken};
      std::vector<std::pair<const Post*, Program>> shaped;
      for (const ReleasedProgram& released : r.programs) {
        const Post& post = *find_post(released.text.language);
        auto program = shaped_for(post, *r.program, context);
        if (!program) return std::fprintf(stderr, "%s\n", text_of(program.error()).c_str()), false;
        for (const ProgramFile& f : released.text.files)
          if (read_file_whole(options.out / item.id / "programs" / std::string(name_of(post.language)) / f.name) != f.bytes)
            return std::fprintf(stderr, "%s: %s is not what was emitted\n", item.id.c_str(), f.name.c_str()), false;
        shaped.emplace_back(&post, std::move(*program));
      }
      body(r, context, shaped);
    }
  }
  return true;
}

}  // namespace asbuilt::support
