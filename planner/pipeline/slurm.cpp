// SPDX-License-Identifier: GPL-3.0-or-later
// Items as jobs of a SLURM cluster: one script an item, submitted with sbatch, awaited by the file it leaves.
#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <thread>

#include "planner/pipeline/executor.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace fs = std::filesystem;

namespace {

bool has_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::string rest = path ? path : "";
  while (!rest.empty()) {
    const std::size_t end = rest.find(':');
    const std::string folder = rest.substr(0, end);
    if (!folder.empty() && ::access((folder + "/" + name).c_str(), X_OK) == 0) return true;
    rest = end == std::string::npos ? "" : rest.substr(end + 1);
  }
  return false;
}

std::string quoted(const std::string& word) {
  std::string q = "'";
  for (const char c : word) q += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return q + "'";
}

}  // namespace

Result<bool> run_items_on_slurm(const std::vector<ItemTask>& tasks, const BatchOptions& options, const ItemFinished& finished) {
  if (!has_program("sbatch"))
    return refuse({.code = "input.no_slurm",
                   .where = "--executor slurm",
                   .message = "--executor slurm: there is no sbatch on this machine; run it on a submit host, or use --executor local",
                   .stage = "input"});
  const fs::path folder = fs::absolute(options.item.out) / "slurm";
  fs::create_directories(folder);
  for (const ItemTask& task : tasks) {
    const std::string& item = task.item;
    std::string command;
    for (const std::string& word : options.worker) command += quoted(word) + " ";
    command += quoted(order_json(task, options, -1));
    const fs::path script = folder / (item + ".sbatch"), ended = folder / (item + ".ended");
    fs::remove(ended);
    const int minutes = options.timeout_s > 0 ? static_cast<int>(options.timeout_s / 60) + 1 : 60;
    write_file_whole(script, fmt::format("#!/bin/sh\n#SBATCH --job-name=asbuilt-{}\n#SBATCH --cpus-per-task=2\n#SBATCH --time={}\n"
                                         "#SBATCH --output={}\n{}\necho $? > {}\n",
                                         item, minutes, quoted((folder / (item + ".log")).string()), command, quoted(ended.string())));
    if (std::system(("sbatch --parsable " + quoted(script.string()) + " >&2").c_str()) != 0)
      return refuse({.code = "input.slurm_refused", .where = script.string(), .message = "sbatch did not take the job of item " + item, .stage = "input"});
  }
  std::vector<bool> is_finished(tasks.size(), false);
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t left = tasks.size(); left > 0;) {
    std::this_thread::sleep_for(std::chrono::seconds(2));
    const double age_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      if (is_finished[k]) continue;
      const auto status = read_file_whole(folder / (tasks[k].item + ".ended"));
      ItemEnd end;
      if (!status) {
        if (options.timeout_s <= 0 || age_s < options.timeout_s + 600) continue;
        end = {"input", "failed.timeout", "the cluster's job left no result in time; see slurm/" + tasks[k].item + ".log", {}, {}};
      } else if (!fs::exists(options.item.out / tasks[k].item / "result.json")) {
        end = {"input", "failed.exit", "the cluster's job ended with status " + *status + " and no result; see slurm/" + tasks[k].item + ".log", {}, {}};
      }
      is_finished[k] = true;
      --left;
      finished(k, end);
    }
  }
  return true;
}

}  // namespace asbuilt
