// SPDX-License-Identifier: GPL-3.0-or-later
// The order of the stages for one item, and a batch of items each in a process of its own. No geometry, no mathematics.
// What stages made is kept by content under OUT/store: a second run takes up where the first one ended, and a changed input
// runs again only what it changes.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "planner/artefacts/report.hpp"
#include "planner/base/result.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/report/report.hpp"

namespace asbuilt {

/// One stage of one item, as it went.
struct StageEvent {
  enum class What { begun, done, from_store, refused, failed };
  std::string item, stage;
  What what = What::begun;
  double time_s = 0, peak_memory_mib = 0;
  std::string key;                           // of the store
  std::map<std::string, std::string> parts;  // what the key was made of: "code", "recipe", "input: location", ...
};
std::string_view name_of(StageEvent::What what);
using Watch = std::function<void(const StageEvent&)>;

struct ItemOptions {
  std::filesystem::path out;          // DIR of the contract
  InputsRecipe inputs;
  std::vector<Language> languages;    // empty: the cell's own
  std::string code_tag;               // changes when the code may behave differently: the hash of the executable
  std::string last_stage;             // "": all of them; else stop after this one, nothing is emitted
};

/// All stages of one item, in order, from the store where nothing changed. Never throws: a refusal or a fault is in the record.
ItemRecord run_item(const Batch& batch, const std::string& item_id, const ItemOptions& options, const Watch& watch = {});

/// Writes DIR/ITEM: result.json, report.html, and programs/ only when the record says emitted. Throws where the disk fails.
void write_item(const std::filesystem::path& out, const ItemRecord& record);
/// Takes back what an earlier run emitted for the item: programs, result and report.
void withdraw_item(const std::filesystem::path& out, const std::string& item_id);

struct BatchOptions {
  ItemOptions item;
  int jobs_count = 1;
  std::set<std::string> only;              // empty: every item
  bool use_slurm = false;
  double timeout_s = 0;                    // of one item; 0: none
  std::vector<std::string> worker;         // command that answers `COMMAND.. ORDER` with run_order(ORDER)
  Watch watch;                             // every stage of every item
  std::function<void(std::size_t count)> items_known;  // once, before the first item
  std::function<void(const BatchLine&)> item_finished;
};

struct BatchOutcome {
  std::string batch_id;
  std::vector<BatchLine> lines;  // in the batch file's order, those asked for
  std::vector<Note> notes;
  int exit_status = 0;           // contract: 0, or the highest of 1, 2, 4, 3
};

/// Every item in a process of its own, `jobs_count` at a time; a crash, a signal or a time limit in one is that item's failure.
/// Writes DIR/batch.json and DIR/index.html. Refuses what is wrong with the batch file itself (input.*).
Result<BatchOutcome> run_batch(const std::filesystem::path& batch_file, const BatchOptions& options);
/// The items of several batch files into one DIR under the given name; an item's id may occur once.
Result<BatchOutcome> run_batches(const std::vector<std::filesystem::path>& batch_files, const std::string& id, const BatchOptions& options);

/// The worker's side: runs the item of an order made by run_batch, writes it, and returns 0 | 3 | 4.
int run_order(const std::string& order_json);

/// Exit status of one item: 0 emitted, 2 an input file is wrong, 3 refused, 4 failed.
int exit_status_of(const BatchLine& line);
/// The one that wins: the highest of 1, 2, 4, 3 (in this order); 0 when all are 0.
int worst_exit_status(const std::vector<int>& statuses);

/// SHA-256 of the running program.
std::string own_code_tag();
/// Today's date, ISO.
std::string today_iso();

/// Why a stage of the latest run of an item ran again, or did not.
struct WhyLine {
  std::string stage, what;            // "from store", "done", "refused", "failed"
  std::vector<std::string> changed;   // "code", "recipe", "input: cloud"; "first run" where there is nothing to compare with
  double time_s = 0, peak_memory_mib = 0;
};
struct Why {
  std::vector<WhyLine> stages;
  std::vector<std::string> files;  // "part.yaml: changed", "scans.yaml: new"
};
/// The item's latest run against the one before, from DIR's history. None where the item was never run there.
std::optional<Why> why_item(const std::filesystem::path& out, const std::string& item_id);

}  // namespace asbuilt
