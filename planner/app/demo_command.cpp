// SPDX-License-Identifier: GPL-3.0-or-later
// demo: virtual parts with known truth, good ones and trapped ones, through the same batch as real ones, and how far what came
// out is from the truth. The planner is given the batches alone.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/base/number.hpp"
#include "planner/simulate/simulate.hpp"

namespace asbuilt {

namespace {

namespace fs = std::filesystem;

struct DemoItem {
  std::string item, about;
  Scenario scenario;
  std::vector<std::string> refused_by;  // stages that may refuse it; empty: it has to be emitted
};

std::vector<DemoItem> demo_items(std::uint64_t seed) {
  const auto scenario = [&](const char* part, std::uint64_t more, const char* trap, const char* item) {
    Scenario s;
    s.part = part, s.seed = seed + more, s.trap = trap, s.item_id = item;
    return s;
  };
  return {{"ring-0001", "a bearing ring with lugs", scenario("ring", 0, "", "ring-0001"), {}},
          {"ring-0002", "another ring, turned and tilted otherwise", scenario("ring", 3, "", "ring-0002"), {}},
          {"casting-0001", "a casting with flash, shrunk and bent", scenario("casting", 0, "", "casting-0001"), {}},
          {"freeform-0001", "a part with a free-form face", scenario("freeform", 3, "", "freeform-0001"), {}},
          {"ring-trap-unseen", "trap: one lug was never scanned in detail", scenario("ring", 3, "edge_unscanned", "ring-trap-unseen"), {"fit", "burr", "locate"}},
          {"ring-trap-no-lugs", "trap: the lugs are missing, nothing holds the turn", scenario("ring", 4, "lugs_missing", "ring-trap-no-lugs"), {"locate", "fit"}},
          {"ring-trap-old", "trap: the calibration is out of date", scenario("ring", 5, "expired", "ring-trap-old"), {"input"}}};
}

bool is_as_designed(const DemoItem& item, const BatchLine& line) {
  if (item.refused_by.empty()) return line.status == ItemStatus::emitted;
  if (line.status != ItemStatus::refused) return false;
  return std::any_of(line.reasons.begin(), line.reasons.end(), [&](const Refusal& r) {
    return std::find(item.refused_by.begin(), item.refused_by.end(), r.stage) != item.refused_by.end();
  });
}

}  // namespace

int demo_command(const DemoArguments& a, Console& console) {
  const fs::path out = a.out;
  const std::vector<DemoItem> items = demo_items(a.seed);
  std::vector<fs::path> batches;
  for (const DemoItem& item : items) {
    console.say("making " + item.item + ": " + item.about);
    const fs::path folder = out / "virtual" / item.item;
    std::error_code ignored;
    fs::remove_all(folder, ignored);
    const auto made = simulate(item.scenario, folder);
    if (!made) return console.complain(made.error()), 1;
    batches.push_back(made->artefact);
  }
  BatchOptions options = batch_options(a.out, console);
  options.item.languages = {Language::krl, Language::inform, Language::beckhoff};
  options.jobs_count = a.jobs_count;
  const auto outcome = run_batches(batches, fmt::format("demo, seed {}", a.seed), options);
  console.end_items();
  if (!outcome) return console.complain(outcome.error()), 1;

  std::vector<std::vector<std::string>> rows{{"item", "came out", "edge p95 mm", "drawing p95 mm", "chamfer in tolerance", "of the drawing", "burr rms mm"}};
  Json json{{"asbuilt", "demo/1"}, {"items", Json::array()}};
  std::string refusals;
  bool is_good = true;
  for (std::size_t k = 0; k < items.size(); ++k) {
    const BatchLine& line = outcome->lines[k];
    const bool as_designed = is_as_designed(items[k], line);
    is_good &= as_designed;
    Json row{{"item", line.item_id}, {"about", items[k].about}, {"status", std::string(name_of(line.status))}, {"as_designed", as_designed}};
    std::vector<std::string> cells{line.item_id, std::string(name_of(line.status)) + (as_designed ? "" : " (NOT as designed)")};
    if (line.status == ItemStatus::emitted) {
      const auto truth = compare_with_truth(out / line.item_id, batches[k].parent_path().parent_path() / "truth");
      if (truth) {
        const auto& t = truth->artefact;
        const auto cell = [&](const char* name, double scale, int decimals, const char* unit) {
          const auto v = t.find(name);
          cells.push_back(v == t.end() || !std::isfinite(v->second) ? "-" : fixed_number(scale * v->second, decimals) + unit);
        };
        cell("edge_p95_mm", 1, 3, ""), cell("edge_nominal_p95_mm", 1, 3, ""), cell("chamfer_within_ratio", 100, 1, " %"), cell("chamfer_nominal_within_ratio", 100, 1, " %");
        cell("burr_rms_mm", 1, 3, "");
        row["truth"] = to_json(t);
      } else {
        console.complain(truth.error());
      }
    } else if (!line.reasons.empty()) {
      const Refusal& r = line.reasons.front();
      refusals += "  " + line.item_id + " - " + items[k].about + "\n    " + r.stage + ": " + refusal_text(r) + "\n";
      row["reason"] = to_json(r);
    }
    rows.push_back(std::move(cells));
    json["items"].push_back(std::move(row));
  }
  json["as_designed"] = is_good;
  std::string text = text_table(rows);
  if (!refusals.empty()) text += "\nNo program was made for:\n" + refusals;
  text += "\n" + std::string(is_good ? "Every good part came out and every trap was refused." : "Something did not go as designed; see the reports.") + "\nreport: " + (out / "index.html").string() + "\n";
  console.answer(json, text);
  return is_good ? 0 : std::max(1, outcome->exit_status);
}

}  // namespace asbuilt
