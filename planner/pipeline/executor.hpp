// SPDX-License-Identifier: GPL-3.0-or-later
// Who runs the items: processes on this machine, or jobs of a SLURM cluster. An item's process writes its folder itself and
// tells each stage through a pipe; when it dies instead, its end says in which stage and of what.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "planner/pipeline/pipeline.hpp"

namespace asbuilt {

/// How an item's process ended. An empty code: it wrote its own result.json.
struct ItemEnd {
  std::string blame, code, message;
  std::map<std::string, double> timing_s, peak_memory_mib;
};
using ItemSteps = std::map<std::string, std::vector<StageEvent>>;
using ItemFinished = std::function<void(std::size_t index, const ItemEnd&)>;

struct ItemTask {
  std::filesystem::path batch_file;
  std::string item;
};
void run_items_here(const std::vector<ItemTask>& tasks, const BatchOptions& options, const ItemFinished& finished);

/// Writes OUT/slurm/ITEM.sbatch, submits them and waits for their results. Refuses input.no_slurm, input.slurm_refused.
Result<bool> run_items_on_slurm(const std::vector<ItemTask>& tasks, const BatchOptions& options, const ItemFinished& finished);

/// The order a worker is given, one line of JSON.
std::string order_json(const ItemTask& task, const BatchOptions& options, int events_fd);

/// The contract's stage that answers for a step of the pipeline ("program" -> "motion").
std::string blame_of(const std::string& stage);

}  // namespace asbuilt
