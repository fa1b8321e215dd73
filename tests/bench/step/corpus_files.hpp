// SPDX-License-Identifier: GPL-3.0-or-later
// The STEP files that studies and benches go through: of $ASBUILT_STEP_DIR, else of ../shared/data/step, by name.
#pragma once

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <vector>

namespace asbuilt::bench {

/// Empty, and said so on standard output, where the folder is not there.
inline std::vector<std::filesystem::path> corpus_files() {
  const char* dir = std::getenv("ASBUILT_STEP_DIR");
  const std::filesystem::path root = dir ? dir : "../shared/data/step";
  std::vector<std::filesystem::path> files;
  if (!std::filesystem::exists(root)) return std::printf("no %s here\n", root.c_str()), files;
  for (const auto& e : std::filesystem::directory_iterator(root))
    if (e.path().extension() == ".step" || e.path().extension() == ".stp") files.push_back(e.path());
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace asbuilt::bench
