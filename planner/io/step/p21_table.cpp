// SPDX-License-Identifier: GPL-3.0-or-later
// The table of instances by id, and the names of keywords.
#include <algorithm>

#include "planner/io/step/p21.hpp"

namespace asbuilt::p21 {
namespace {

constexpr std::string_view kNames[] = {
#define X(name) #name,
    ASBUILT_STEP_KEYWORDS(X)
#undef X
};

void duplicate(File& file, const Instance& i) {
  ++file.faults_count;
  if (file.faults.size() < 100) file.faults.push_back({i.line, i.id, "the id is used twice; the first one counts"});
}

}  // namespace

std::string_view known_keyword(std::uint32_t k) { return kNames[k]; }

void index_instances(File& file) {
  std::int64_t top = 0;
  for (const Instance& i : file.instances) top = std::max(top, i.id);
  const std::int64_t n = static_cast<std::int64_t>(file.instances.size());
  if (top < 8 * n + 1024) {
    file.dense.assign(static_cast<std::size_t>(top) + 1, -1);
    for (std::int64_t k = 0; k < n; ++k) {
      auto& slot = file.dense[static_cast<std::size_t>(file.instances[k].id)];
      if (slot >= 0)
        duplicate(file, file.instances[k]);
      else
        slot = static_cast<std::int32_t>(k);
    }
  } else {
    for (std::int64_t k = 0; k < n; ++k) file.sparse.emplace_back(file.instances[k].id, static_cast<std::int32_t>(k));
    std::stable_sort(file.sparse.begin(), file.sparse.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t k = 1; k < file.sparse.size(); ++k)
      if (file.sparse[k].first == file.sparse[k - 1].first) duplicate(file, file.instances[file.sparse[k].second]);
  }
}

const Instance* File::find(std::int64_t id) const {
  if (!dense.empty()) {
    if (id < 0 || static_cast<std::size_t>(id) >= dense.size() || dense[static_cast<std::size_t>(id)] < 0) return nullptr;
    return &instances[static_cast<std::size_t>(dense[static_cast<std::size_t>(id)])];
  }
  const auto it = std::lower_bound(sparse.begin(), sparse.end(), id, [](const auto& a, std::int64_t b) { return a.first < b; });
  return it != sparse.end() && it->first == id ? &instances[static_cast<std::size_t>(it->second)] : nullptr;
}

std::string_view File::keyword_name(std::uint32_t k) const {
  if (k < K_known_count) return kNames[k];
  return k - K_known_count < extra.size() ? extra[k - K_known_count] : std::string_view("?");
}

}  // namespace asbuilt::p21
