// SPDX-License-Identifier: GPL-3.0-or-later
// What stages made, by content: DIR/keys/<ab>/<key> says what came out for a key, DIR/objects/<ab>/<hash> holds the bytes.
// A file is written aside and renamed, never changed; two processes may use one store at the same time.
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt {

/// What a stage gave for one key: an artefact (by content hash) with its notes, or refusals. Crashes are never kept.
struct Outcome {
  bool is_done = false;
  std::string artefact_hash;
  std::vector<Note> notes;
  Refusals refusals;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("done", s.is_done), a("artefact", s.artefact_hash), a("notes", s.notes), a("refusals", s.refusals);
  }
};

class Store {
 public:
  explicit Store(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// None where the key is unknown or what it names is not there in full; then the stage simply runs again.
  std::optional<Outcome> find(const std::string& key) const;
  /// The bytes of an artefact, checked against their hash; none where they are missing or damaged.
  std::optional<std::string> load(const std::string& artefact_hash) const;
  void keep(const std::string& key, const Outcome& outcome);
  /// Deletes what none of `keys` leads to, unless it is younger than `days`. Returns how many files went.
  std::size_t prune(const std::set<std::string>& keys, double days);
  void keep_object(const std::string& artefact_hash, const std::string& bytes);

 private:
  std::filesystem::path folder_;
};

/// Writes the bytes beside the file and renames: a reader sees the old file or the whole new one. Throws on a full or lost disk.
void write_file_whole(const std::filesystem::path& file, const std::string& bytes);
/// None where the file is not there.
std::optional<std::string> read_file_whole(const std::filesystem::path& file);

}  // namespace asbuilt
