// SPDX-License-Identifier: GPL-3.0-or-later
// inspect: from where to scan one item of a batch, as a checked robot program and as captures to be filled.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/app/commands.hpp"
#include "planner/base/number.hpp"
#include "planner/pipeline/inspect_item.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace {

std::string inspection_text(const InspectRecord& r) {
  if (!r.inspection) return "";
  std::vector<std::vector<std::string>> views{{"view", "kind", "edge", "tilt deg", "distance mm", "clearance mm", "sees edges"}};
  for (const ScanView& v : r.inspection->views)
    views.push_back({v.name, std::string(name_of(v.kind)), v.edge, fmt::format("{:.1f}", deg_from_rad(v.tilt_rad)), fmt::format("{:.0f}", v.distance_mm),
                     v.clearance_mm < 1e8 ? fmt::format("{:.1f}", v.clearance_mm) : "", fmt::format("{}", v.edges.size())});
  std::vector<std::vector<std::string>> edges{{"edge", "feature", "coverage %", "working %", "normal %", "sd mm", "limit mm"}};
  for (const EdgeForecast& f : r.inspection->edges)
    edges.push_back({f.id, f.feature, fmt::format("{:.1f}", 100 * f.coverage_ratio), fmt::format("{:.1f}", 100 * f.coverage_working_ratio), fmt::format("{:.1f}", 100 * f.coverage_normal_ratio),
                     fmt::format("{:.4f}", f.sd_worst_mm), f.sd_limit_mm > 0 ? fmt::format("{:.4f}", f.sd_limit_mm) : ""});
  return text_table(views) + text_table(edges) + fmt::format("{} views, moves {:.1f} s, least clearance {:.1f} mm\n", r.inspection->views.size(), r.inspection->motion.duration_s, r.inspection->motion.clearance_min_mm);
}

}  // namespace

int inspect_command(const InspectArguments& a, Console& console) {
  InputsRecipe inputs{a.allow_outside, today_iso()};
  const auto batch = load_batch(a.batch, inputs);
  if (!batch) return console.complain(batch.error()), 2;
  const auto& items = batch->artefact.items;
  if (std::none_of(items.begin(), items.end(), [&](const BatchItem& i) { return i.id == a.item; })) {
    std::string all;
    for (const BatchItem& i : items) all += (all.empty() ? "" : ", ") + i.id;
    return console.complain("--item " + a.item + ": the batch has no such item; it has " + all), 2;
  }
  std::string fault;
  const std::vector<Language> languages = languages_of(a.post, fault);
  if (!fault.empty()) return console.complain(fault), 2;
  InspectOptions options{{a.out, inputs, languages, own_code_tag(), ""}, a.at == "fixture"};
  const InspectRecord r = inspect_item(batch->artefact, a.item, options, [&](const StageEvent& e) {
    if (e.what != StageEvent::What::begun) console.say(fmt::format("{}: {} in {:.2f} s", e.stage, name_of(e.what), e.time_s));
  });
  write_inspection(a.out, r);
  for (const Note& n : r.notes) console.say((n.where.empty() ? "" : n.where + ": ") + n.text);
  for (const Refusal& why : r.reasons) console.complain(why.stage + ": " + refusal_text(why));
  const std::filesystem::path file = std::filesystem::path(a.out) / a.item / "inspection.json";
  const auto text = read_file_whole(file);
  console.answer_text(text.value_or("{}"), inspection_text(r) + file.string() + "\n");
  if (r.status == ItemStatus::emitted) return 0;
  BatchLine line;
  line.status = r.status, line.reasons = r.reasons;
  return exit_status_of(line);
}

}  // namespace asbuilt
