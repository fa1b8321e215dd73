// SPDX-License-Identifier: GPL-3.0-or-later
// A batch: which items, who runs them, what came out.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <ctime>

#include "planner/base/archive.hpp"
#include "planner/pipeline/executor.hpp"
#include "planner/pipeline/history.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace fs = std::filesystem;

int exit_status_of(const BatchLine& line) {
  if (line.status == ItemStatus::emitted) return 0;
  if (line.status == ItemStatus::failed) return 4;
  // A calibration that is too old is a good file and a refusal; every other reason of `input` is a file that has to be mended.
  for (const Refusal& r : line.reasons)
    if (r.stage == "input" && r.code != "input.calibration_expired") return 2;
  return 3;
}

int worst_exit_status(const std::vector<int>& statuses) {
  for (const int wins : {1, 2, 4, 3})
    if (std::find(statuses.begin(), statuses.end(), wins) != statuses.end()) return wins;
  return 0;
}

std::string own_code_tag() {
  const auto bytes = read_file_whole("/proc/self/exe");
  must(bytes.has_value(), "the running program cannot be read");
  return sha256_hex(*bytes);
}

std::string today_iso() {
  const std::time_t now = std::time(nullptr);
  std::tm t{};
  gmtime_r(&now, &t);
  return fmt::format("{:04}-{:02}-{:02}", t.tm_year + 1900, t.tm_mon + 1, t.tm_mday);
}

namespace {

/// One run at a time may write a folder.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& file) : fd_(::open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644)) {
    is_held_ = fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) == 0;
  }
  ~FolderLock() {
    if (fd_ >= 0) ::close(fd_);
  }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;
  bool is_held() const { return is_held_; }

 private:
  int fd_;
  bool is_held_ = false;
};

bool is_folder_name(const std::string& id) {
  if (id.empty() || id.size() > 100 || id.front() == '.' || id == "store" || id == "slurm") return false;
  return std::all_of(id.begin(), id.end(), [](unsigned char c) { return std::isalnum(c) || c == '-' || c == '_' || c == '.'; });
}

BatchLine line_from_disk(const fs::path& out, const std::string& item_id) {
  BatchLine line;
  line.item_id = item_id;
  const auto text = read_file_whole(out / item_id / "result.json");
  must(text.has_value(), "an item ended without its result.json");
  line.result_json = *text;
  const Json json = Json::parse(*text);
  const std::string status = json.at("status");
  line.status = status == "emitted" ? ItemStatus::emitted : status == "refused" ? ItemStatus::refused : ItemStatus::failed;
  for (const Json& r : json.at("reasons")) {
    Refusal reason;
    reason.stage = r.value("stage", ""), reason.code = r.value("code", ""), reason.message = r.value("message", "");
    reason.where = r.value("where", ""), reason.unit = r.value("unit", "");
    if (r.contains("value") && r["value"].is_number()) reason.measured = r["value"];
    if (r.contains("limit") && r["limit"].is_number()) reason.limit = r["limit"];
    line.reasons.push_back(std::move(reason));
  }
  for (const auto& [stage, time] : json.at("timing_s").items())
    if (time.is_number()) line.timing_s[stage] = time;
  return line;
}

ItemRecord failed_record(const std::string& batch_id, const std::string& item_id, const ItemEnd& end) {
  ItemRecord r;
  r.batch_id = batch_id;
  r.item_id = item_id;
  r.status = ItemStatus::failed;
  r.reasons.push_back({.code = end.code, .where = item_id, .message = end.message, .stage = end.blame});
  r.timing_s = end.timing_s;
  r.peak_memory_mib = end.peak_memory_mib;
  return r;
}

}  // namespace

Result<BatchOutcome> run_batch(const fs::path& batch_file, const BatchOptions& options) { return run_batches({batch_file}, "", options); }

Result<BatchOutcome> run_batches(const std::vector<fs::path>& batch_files, const std::string& id, const BatchOptions& options) {
  BatchOutcome outcome;
  outcome.batch_id = id;
  std::vector<ItemTask> tasks;
  std::vector<std::string> batch_ids;  // parallel to tasks
  std::set<std::string> known;
  for (const fs::path& file : batch_files) {
    auto loaded = load_batch(file, options.item.inputs);
    if (!loaded) return refuse_all(loaded.error());
    const Batch& batch = loaded->artefact;
    outcome.notes.insert(outcome.notes.end(), loaded->notes.begin(), loaded->notes.end());
    if (id.empty()) outcome.batch_id = batch.id;
    for (const BatchItem& item : batch.items) {
      must(known.insert(item.id).second, "two items of one run have the same id");
      if (!is_folder_name(item.id))
        return refuse({.code = "input.bad_item_id",
                       .where = file.string() + ": item " + item.id,
                       .message = "an item's id names its folder: letters, digits, '-', '_' and '.', not first a '.', at most 100, and not store or slurm",
                       .stage = "input"});
      if (!options.only.empty() && !options.only.contains(item.id)) continue;
      tasks.push_back({fs::absolute(file), item.id});
      batch_ids.push_back(batch.id);
    }
  }
  for (const std::string& only : options.only)
    if (!known.contains(only)) {
      std::string all;
      for (const std::string& k : known) all += (all.empty() ? "" : ", ") + k;
      return refuse({.code = "input.unknown_item", .where = batch_files.front().string(), .message = "--only " + only + ": the batch has no such item; it has " + all, .stage = "input"});
    }

  const fs::path& out = options.item.out;
  std::error_code fault;
  fs::create_directories(out, fault);
  const FolderLock lock(out / ".lock");
  if (!lock.is_held())
    return refuse({.code = "input.out_not_usable",
                   .where = out.string(),
                   .message = "--out " + out.string() + ": " +
                              (fault ? fault.message() : "another run is writing there, or the folder cannot be written") + "; wait for it or name another folder",
                   .stage = "input"});
  for (const ItemTask& task : tasks) withdraw_item(out, task.item);
  if (options.items_known) options.items_known(tasks.size());

  History history(out / "store" / "history.sqlite");
  std::vector<BatchLine> lines(tasks.size());
  std::vector<int> statuses;
  ItemSteps steps;
  BatchOptions watched = options;
  watched.watch = [&](const StageEvent& event) {
    if (event.what != StageEvent::What::begun) steps[event.item].push_back(event);
    if (options.watch) options.watch(event);
  };
  const auto finished = [&](std::size_t index, const ItemEnd& end) {
    const std::string& item = tasks[index].item;
    if (!end.code.empty()) write_item(out, failed_record(batch_ids[index], item, end));
    lines[index] = line_from_disk(out, item);
    for (const StageEvent& e : steps[item]) {
      double& peak = lines[index].peak_memory_mib[e.stage];
      peak = std::max(peak, e.peak_memory_mib);
    }
    statuses.push_back(exit_status_of(lines[index]));
    history.add(lines[index], steps[item]);
    if (options.item_finished) options.item_finished(lines[index]);
  };
  if (options.use_slurm) {
    if (auto ran = run_items_on_slurm(tasks, watched, finished); !ran) return refuse_all(ran.error());
  } else {
    run_items_here(tasks, watched, finished);
  }
  constexpr int kRunsKept = 10;
  constexpr double kDaysKept = 7;
  if (const auto keys = history.latest_keys(kRunsKept)) Store(out / "store").prune(*keys, kDaysKept);
  outcome.lines = std::move(lines);
  outcome.exit_status = worst_exit_status(statuses);
  write_file_whole(out / "batch.json", batch_json(outcome.batch_id, outcome.lines));
  write_file_whole(out / "index.html", index_html(outcome.batch_id, outcome.lines));
  return outcome;
}

}  // namespace asbuilt
