// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/stage_run.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <fstream>
#include <new>

namespace asbuilt {

std::string_view name_of(StageEvent::What what) {
  switch (what) {
    case StageEvent::What::begun: return "begun";
    case StageEvent::What::done: return "done";
    case StageEvent::What::from_store: return "from store";
    case StageEvent::What::refused: return "refused";
    default: return "failed";
  }
}

void reset_peak_memory() {
  std::ofstream refs("/proc/self/clear_refs");
  refs << "5\n";
}

double peak_memory_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024.0;
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

StageEvent::What ItemRun::refused(const std::string& blame, const Refusals& refusals) {
  const bool has_failed = record.status == ItemStatus::failed && !record.reasons.empty();
  if (!has_failed) record.status = ItemStatus::refused;
  for (Refusal r : refusals) {
    if (r.stage.empty()) r.stage = blame;
    record.reasons.push_back(std::move(r));
  }
  return StageEvent::What::refused;
}

StageEvent::What ItemRun::failed(const std::string& blame, const std::string& code, const std::string& message) {
  record.status = ItemStatus::failed;
  record.reasons.push_back({.code = code, .where = record.item_id, .message = message, .stage = blame});
  return StageEvent::What::failed;
}

bool ItemRun::guarded(const std::string& name, const std::string& blame, const StageInputs& given,
                      const std::function<StageEvent::What(const std::string&)>& body, bool is_told) {
  StageEvent event;
  event.item = record.item_id;
  event.stage = name;
  if (watch_ && is_told) watch_(event);
  bool has_key = !given.inputs.empty();
  if (has_key) {
    event.parts["code"] = options_.code_tag;
    event.parts["recipe"] = sha256_hex(given.recipe);
    for (const auto& [input, hash] : given.inputs) {
      event.parts["input: " + input] = hash;
      if (hash.empty()) has_key = false;  // an input nobody could name: nothing may be kept under it
    }
    if (has_key) event.key = sha256_hex(name + '\n' + to_bytes(event.parts));
  }
  reset_peak_memory();
  const auto start = std::chrono::steady_clock::now();
  try {
    event.what = body(event.key);
  } catch (const std::bad_alloc&) {
    event.what = failed(blame, "failed.memory", fmt::format("stage {} ran out of memory; run fewer items at once (-j) or thin the scans", name));
  } catch (const Bug& bug) {
    event.what = failed(blame, "failed.bug", fmt::format("stage {} broke a promise of its own: {}; please report it with this item", name, bug.what()));
  } catch (const std::exception& fault) {
    event.what = failed(blame, "failed.exception", fmt::format("stage {} failed: {}", name, fault.what()));
  }
  event.time_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  event.peak_memory_mib = peak_memory_mib();
  record.timing_s[name] += event.time_s;
  double& peak = record.peak_memory_mib[name];
  peak = std::max(peak, event.peak_memory_mib);
  if (watch_ && (is_told || event.what == StageEvent::What::failed)) watch_(event);
  return event.what == StageEvent::What::done || event.what == StageEvent::What::from_store;
}

}  // namespace asbuilt
