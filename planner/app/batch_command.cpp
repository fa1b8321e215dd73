// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

std::vector<Language> languages_of(const std::vector<std::string>& words, std::string& fault) {
  std::vector<Language> languages;
  std::string list;
  for (const Language l : kLanguages) list += (list.empty() ? "" : ", ") + std::string(name_of(l));
  for (const std::string& word : words) {
    bool is_known = false;
    for (const Language l : kLanguages)
      if (name_of(l) == word) {
        is_known = true;
        if (std::find(languages.begin(), languages.end(), l) == languages.end()) languages.push_back(l);
      }
    if (!is_known) fault = "--post " + word + ": there is no such language; use " + list;
  }
  return languages;
}

std::vector<std::string> own_worker_command() { return {std::filesystem::read_symlink("/proc/self/exe").string(), "worker"}; }

BatchOptions batch_options(const std::string& out, Console& console) {
  BatchOptions options;
  options.item.out = out;
  options.item.inputs.today = today_iso();
  options.item.code_tag = own_code_tag();
  options.worker = own_worker_command();
  options.watch = [&](const StageEvent& event) { console.stage(event); };
  options.item_finished = [&](const BatchLine& line) { console.item(line); };
  options.items_known = [&](std::size_t count) { console.begin_items(count); };
  return options;
}

std::string batch_table(const BatchOutcome& outcome, const std::string& out) {
  std::vector<std::vector<std::string>> rows{{"item", "status", "s", "MiB", "reason"}};
  for (const BatchLine& line : outcome.lines) {
    double time_s = 0, memory_mib = 0;
    for (const auto& [stage, t] : line.timing_s) time_s += t;
    for (const auto& [stage, m] : line.peak_memory_mib) memory_mib = std::max(memory_mib, m);
    std::string reason;
    if (!line.reasons.empty()) {
      reason = line.reasons.front().stage + ": " + refusal_text(line.reasons.front());
      if (line.reasons.size() > 1) reason += fmt::format(" (and {} more)", line.reasons.size() - 1);
    }
    rows.push_back({line.item_id, std::string(name_of(line.status)), fmt::format("{:.1f}", time_s), fmt::format("{:.0f}", memory_mib), reason});
  }
  return text_table(rows) + "report: " + (std::filesystem::path(out) / "index.html").string() + "\n";
}

int batch_command(const BatchArguments& a, Console& console) {
  BatchOptions options = batch_options(a.out, console);
  std::string fault;
  options.item.languages = languages_of(a.post, fault);
  if (!fault.empty()) return console.complain(fault), 2;
  options.item.inputs.allow_outside = a.allow_outside;
  options.jobs_count = a.jobs_count;
  options.only = {a.only.begin(), a.only.end()};
  options.use_slurm = a.executor == "slurm";
  options.timeout_s = a.timeout_s;
  const auto outcome = run_batch(a.batch, options);
  console.end_items();
  if (!outcome) return console.complain(outcome.error()), 2;
  for (const Note& note : outcome->notes) console.say(note.where + ": " + note.text);
  console.answer_text(read_file_whole(std::filesystem::path(a.out) / "batch.json").value_or("{}\n"), batch_table(*outcome, a.out));
  return outcome->exit_status;
}

}  // namespace asbuilt
