// SPDX-License-Identifier: GPL-3.0-or-later
// simulate, schema, show, why.
#include <fmt/format.h>

#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/pipeline/store.hpp"
#include "planner/simulate/simulate.hpp"

namespace asbuilt {

int simulate_command(const std::string& file, const std::string& out, Console& console) {
  const auto scenario = load_scenario(file);
  if (!scenario) return console.complain(scenario.error()), 2;
  const auto made = simulate(scenario->artefact, out);
  if (!made) return console.complain(made.error()), 2;
  const std::string truth = (std::filesystem::path(out) / "truth").string();
  console.answer({{"asbuilt", "simulated/1"}, {"batch", made->artefact.string()}, {"truth", truth}}, "batch: " + made->artefact.string() + "\ntruth: " + truth + "\n");
  return 0;
}

int schema_command(const std::string& kind, Console& console) {
  const std::string schema = schema_json(kind);
  if (schema.empty()) {
    console.complain("schema " + kind + ": there is no such kind of file; use part, recipe, cell, fixture, calibration, scans, batch or captures");
    return 2;
  }
  console.answer_text(schema + (schema.ends_with('\n') ? "" : "\n"), schema + (schema.ends_with('\n') ? "" : "\n"));
  return 0;
}

namespace {

std::string result_text(const Json& j) {
  std::string text = fmt::format("{}: {}\n", j.value("item", ""), j.value("status", ""));
  for (const Json& r : j.value("reasons", Json::array())) text += fmt::format("  {}: {} [{}]\n", r.value("stage", ""), r.value("message", ""), r.value("code", ""));
  std::vector<std::vector<std::string>> rows{{"edge", "feature", "length mm", "stations"}};
  for (const Json& e : j.value("edges", Json::array()))
    rows.push_back({e.value("id", ""), e.value("feature", ""), e["s"].empty() ? "" : fmt::format("{:.1f}", e["s"].back().get<double>()), fmt::format("{}", e["s"].size())});
  if (rows.size() > 1) text += text_table(rows);
  for (const Json& p : j.value("programs", Json::array()))
    for (const Json& f : p["files"]) text += fmt::format("{}: {}, {} points, {} s\n", p.value("language", ""), f.value("path", ""), p["points"].dump(), p["duration_s"].dump());
  if (j.contains("verification"))
    for (const auto& [name, value] : j["verification"].items())
      if (name != "checks") text += fmt::format("{}: {}\n", name, value.dump());
  return text;
}

std::string batch_text(const Json& j) {
  std::vector<std::vector<std::string>> rows{{"item", "status", "reason"}};
  for (const Json& item : j.value("items", Json::array())) {
    std::string why;
    if (!item["reasons"].empty()) why = item["reasons"][0].value("stage", "") + ": " + item["reasons"][0].value("message", "");
    rows.push_back({item.value("item", ""), item.value("status", ""), why});
  }
  return j.value("id", "") + "\n" + text_table(rows);
}

}  // namespace

int show_command(const std::string& name, Console& console) {
  std::filesystem::path file = name;
  if (std::filesystem::is_directory(file)) file /= std::filesystem::exists(file / "result.json") ? "result.json" : "batch.json";
  const auto text = read_file_whole(file);
  if (!text) return console.complain(file.string() + ": there is no such file"), 2;
  const Json json = Json::parse(*text, nullptr, false);
  if (!json.is_object()) return console.complain(file.string() + ": found no JSON of asbuilt; show takes result.json, batch.json or the folder of one"), 2;
  const std::string kind = json.value("asbuilt", "");
  if (kind != "result/1" && kind != "batch-result/1") return console.complain(file.string() + ": found kind '" + kind + "'; show takes result/1 and batch-result/1"), 2;
  console.answer(json, kind == "result/1" ? result_text(json) : batch_text(json));
  return 0;
}

int why_command(const std::string& item, const std::string& out, Console& console) {
  const auto why = why_item(out, item);
  if (!why) return console.complain("why " + item + ": no run of this item is recorded under " + out + "; name the folder with --out"), 2;
  Json json{{"asbuilt", "why/1"}, {"item", item}, {"files", why->files}, {"stages", Json::array()}};
  std::vector<std::vector<std::string>> rows{{"stage", "was", "s", "changed since the run before"}};
  for (const WhyLine& line : why->stages) {
    std::string changed;
    for (const std::string& c : line.changed) changed += (changed.empty() ? "" : ", ") + c;
    rows.push_back({line.stage, line.what, fmt::format("{:.2f}", line.time_s), changed.empty() ? "nothing" : changed});
    json["stages"].push_back({{"stage", line.stage}, {"what", line.what}, {"changed", line.changed}, {"time_s", line.time_s}, {"peak_memory_mib", line.peak_memory_mib}});
  }
  std::string text = text_table(rows);
  for (const std::string& f : why->files) text += f + "\n";
  console.answer(json, text);
  return 0;
}

}  // namespace asbuilt
