// SPDX-License-Identifier: GPL-3.0-or-later
// One stage, run or taken from the store: key, time, peak memory, and what became of it, written into the item's record.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "planner/base/archive.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

/// Starts a new measurement of this process' peak memory, and reads it.
void reset_peak_memory();
double peak_memory_mib();

/// What a stage is given, for its key. An input's hash is its content's, not the key it came from.
struct StageInputs {
  std::string recipe;                                        // canonical bytes
  std::vector<std::pair<std::string, std::string>> inputs;   // name, content hash
};

class ItemRun {
 public:
  ItemRun(const std::string& batch_id, const std::string& item_id, const ItemOptions& options, const Watch& watch)
      : options_(options), watch_(watch), store_(options.out / "store") {
    record.batch_id = batch_id;
    record.item_id = item_id;
  }

  ItemRecord record;

  /// Runs `name` unless the store knows the answer. True: `out` holds the artefact and the next stage may go on.
  /// `blame` is the contract's name for reasons of this stage.
  template <class T>
  bool stage(const std::string& name, const std::string& blame, std::optional<T>& out, const StageInputs& given,
             const std::function<Result<Done<T>>()>& body, std::string* content = nullptr) {
    return guarded(name, blame, given, [&](const std::string& key) -> StageEvent::What {
      if (const auto known = key.empty() ? std::nullopt : store_.find(key)) {
        if (!known->is_done) return refused(blame, known->refusals);
        if (const auto bytes = store_.load(known->artefact_hash)) {
          out = from_bytes<T>(*bytes);
          if (content) *content = known->artefact_hash;
          keep_notes(known->notes);
          return StageEvent::What::from_store;
        }
      }
      Result<Done<T>> result = body();
      Outcome outcome;
      if (!result) {
        outcome.refusals = result.error();
        must(!outcome.refusals.empty(), name + " refused without a reason");
        if (!key.empty()) store_.keep(key, outcome);
        return refused(blame, outcome.refusals);
      }
      const std::string bytes = to_bytes(result->artefact);
      outcome.is_done = true;
      outcome.artefact_hash = sha256_hex(bytes);
      outcome.notes = result->notes;
      if (!key.empty()) {
        store_.keep_object(outcome.artefact_hash, bytes);
        store_.keep(key, outcome);
      }
      keep_notes(result->notes);
      out = std::move(result->artefact);
      if (content) *content = outcome.artefact_hash;
      return StageEvent::What::done;
    });
  }

  /// Work between stages that is not kept, counted to stage `name` and guarded all the same.
  bool step(const std::string& name, const std::string& blame, const std::function<void()>& body) {
    return guarded(name, blame, {}, [&](const std::string&) {
      body();
      return StageEvent::What::done;
    }, false);
  }

  /// Marks the item refused.
  void refuse_item(const std::string& blame, const Refusals& refusals) { refused(blame, refusals); }

 private:
  const ItemOptions& options_;
  const Watch& watch_;
  Store store_;

  bool guarded(const std::string& name, const std::string& blame, const StageInputs& given,
               const std::function<StageEvent::What(const std::string&)>& body, bool is_told = true);
  StageEvent::What refused(const std::string& blame, const Refusals& refusals);
  StageEvent::What failed(const std::string& blame, const std::string& code, const std::string& message);
  void keep_notes(const std::vector<Note>& notes) { record.notes.insert(record.notes.end(), notes.begin(), notes.end()); }
};

}  // namespace asbuilt
