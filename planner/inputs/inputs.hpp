// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 1: files -> Job. The only stage that opens files (through planner/io). All faults of all files at once.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct InputsRecipe {
  bool allow_outside = false;  // paths that leave the batch's folder
  std::string today;           // ISO date, used where a scans file names no date for the calibration's age
};

struct BatchItem {
  std::string id, part, fixture, scans;  // files as written in the batch file
  std::vector<Override> overrides;
};
struct Batch {
  std::string id;
  std::filesystem::path file;  // of the batch file
  std::string cell, calibration;
  std::vector<std::string> recipes;
  std::vector<BatchItem> items;
};

/// Reads and checks the batch file itself: ids unique, every named file present. Refuses input.*.
Result<Done<Batch>> load_batch(const std::filesystem::path& file, const InputsRecipe& recipe);

/// Reads and checks everything one item needs. A fault of a shared file (cell, calibration, recipe) is reported for every item.
Result<Done<Job>> load_job(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe);

/// SHA-256 over the bytes of every file the item reads, in order of path, without parsing clouds or CAD: the item's cache key.
std::string job_inputs_hash(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe);

/// JSON Schema of a kind of file ("part", "recipe", "cell", "fixture", "calibration", "scans", "batch", "captures"), from the
/// same field list that the loader checks against. Empty for an unknown kind.
std::string schema_json(const std::string& kind);

}  // namespace asbuilt
