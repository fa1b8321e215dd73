// SPDX-License-Identifier: GPL-3.0-or-later
// Every file of ../shared/data/step (or $ASBUILT_STEP_DIR) written other ways that mean the same part (tests/unit/step/rewrite.hpp), each
// read again: faces, solids, area, volume, length of sharp convex edges, closed mesh. `study_rewrites NAME..` takes only such files.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/bench/step/corpus_files.hpp"
#include "tests/unit/step/rewrite_check.hpp"

namespace fs = std::filesystem;
using namespace asbuilt;

int main(int argc, char** argv) {
  const std::vector<fs::path> files = bench::corpus_files();
  if (files.empty()) return 0;
  struct Row {
    int files = 0, bad = 0;
    double area = 0, volume = 0, convex = 0;
  };
  const std::vector<test::Rewrite> ways = test::rewrites();
  std::vector<Row> rows(ways.size());
  int bad = 0;
  for (const fs::path& p : files) {
    const std::string name = p.filename().string();
    bool wanted = argc < 2;
    for (int k = 1; k < argc; ++k) wanted = wanted || name.find(argv[k]) != std::string::npos;
    if (!wanted) continue;
    std::ifstream in(p, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    const test::PartSums before = test::part_sums(bytes, 1);
    for (std::size_t w = 0; w < ways.size(); ++w) {
      const std::string text = ways[w].make(bytes);
      if (text.empty()) continue;
      const test::PartSums after = test::part_sums(text, ways[w].scale);
      const std::string difference = test::difference_of(before, after);
      Row& r = rows[w];
      ++r.files, r.bad += !difference.empty(), bad += !difference.empty();
      r.area = std::max(r.area, test::relative(after.area, before.area)),
      r.volume = std::max(r.volume, test::relative(after.volume, before.volume)),
      r.convex = std::max(r.convex, test::relative(after.convex, before.convex));
      if (!difference.empty())
        std::printf("BAD %-42s %-24s %s\n", name.c_str(), ways[w].name.c_str(), difference.c_str()), std::fflush(stdout);
    }
  }
  std::printf("%-26s %6s %6s %10s %10s %10s\n", "written", "files", "bad", "area", "volume", "convex");
  for (std::size_t w = 0; w < ways.size(); ++w)
    std::printf("%-26s %6d %6d %10.2g %10.2g %10.2g\n", ways[w].name.c_str(), rows[w].files, rows[w].bad, rows[w].area, rows[w].volume,
                rows[w].convex);
  return bad ? 1 : 0;
}
