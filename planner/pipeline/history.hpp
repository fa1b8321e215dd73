// SPDX-License-Identifier: GPL-3.0-or-later
// What was run when, of what: a small SQLite file beside the store, written by the batch alone. `why` reads it.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "planner/pipeline/pipeline.hpp"

namespace asbuilt {

class History {
 public:
  /// A file that cannot be opened is no reason to stop a batch: nothing is recorded then.
  explicit History(const std::filesystem::path& file);
  void add(const BatchLine& line, const std::vector<StageEvent>& stages);
  /// The store's keys of the latest `runs_count` runs of each item; none where there is no history to go by.
  std::optional<std::set<std::string>> latest_keys(int runs_count) const;
  /// None where the item was never run.
  std::optional<Why> why(const std::string& item_id) const;

 private:
  std::shared_ptr<void> database_;
};

}  // namespace asbuilt
