// SPDX-License-Identifier: GPL-3.0-or-later
// verify: program files of any origin, read and replayed in a cell; with --result also: are these the files that were checked,
// and does the tip go where result.json says the edges are.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "planner/app/commands.hpp"
#include "planner/app/programs.hpp"
#include "planner/base/hash.hpp"
#include "planner/pipeline/store.hpp"
#include "planner/verify/verify.hpp"

namespace asbuilt {

namespace {

/// Checks of a program's files and path against the result they came with.
Result<std::vector<Check>> checks_against(const Json& result, const ReadProgram& read, const CellSpec& cell) {
  double reach_mm = 0;  // a tip that works an edge is no farther from it than its cutter is wide
  for (const ToolSpec& tool : cell.tools) reach_mm = std::max(reach_mm, tool.cutter.diameter_mm);
  std::vector<Check> checks;
  try {
    for (const ProgramFile& f : read.text.files) {
      Check c{"sha256", 1, 0, "files", f.name, false};
      for (const Json& p : result.at("programs"))
        for (const Json& file : p.at("files"))
          if (std::filesystem::path(file.at("path").get<std::string>()).filename() == f.name && file.at("sha256") == sha256_hex(f.bytes)) c.is_passed = true, c.measured = 0;
      checks.push_back(std::move(c));
    }
    if (!result.contains("locate")) return checks;
    const Json& b = result.at("locate").at("base_part");
    const auto at = [](const Json& a, std::size_t k) { return a.at(k).get<double>(); };
    const Pose<frame::Base, frame::Part> T_base_part{Eigen::Quaterniond(at(b.at("quat"), 0), at(b.at("quat"), 1), at(b.at("quat"), 2), at(b.at("quat"), 3)).normalized(),
                                                     Vec3(at(b.at("xyz"), 0), at(b.at("xyz"), 1), at(b.at("xyz"), 2))};
    std::vector<Vec3> tips;
    for (const Instruction& i : read.program.instructions)
      if (const auto* l = std::get_if<MoveLinear>(&i)) tips.push_back(l->T_base_tool.p_mm);
    for (const Json& e : result.at("edges")) {
      double farthest_mm = 0;
      for (const Json& p : e.at("adapted")) {
        const Vec3 q = T_base_part.point({at(p, 0), at(p, 1), at(p, 2)});
        double nearest_mm = 1e9;
        for (std::size_t i = 0; i + 1 < tips.size(); ++i) {
          const Vec3 d = tips[i + 1] - tips[i];
          const double t = std::clamp((q - tips[i]).dot(d) / std::max(1e-12, d.squaredNorm()), 0.0, 1.0);
          nearest_mm = std::min(nearest_mm, (q - tips[i] - t * d).norm());
        }
        farthest_mm = std::max(farthest_mm, nearest_mm);
      }
      checks.push_back({"edge_visited", farthest_mm, reach_mm, "mm", "edge " + e.at("id").get<std::string>(), farthest_mm <= reach_mm});
    }
  } catch (const Json::exception& fault) {
    return refuse({.code = "input.bad_result", .where = "--result", .message = std::string("found no result/1 of asbuilt: ") + fault.what(), .stage = "input"});
  }
  return checks;
}

/// The header of a program names its inputs by the first digits of their hashes: the cell and the calibration it is checked with must be among
/// them. None where it names no inputs: then nothing says what it was made from.
std::optional<std::vector<Check>> provenance(const Program& program, const std::filesystem::path& cell, const std::filesystem::path& calibration) {
  std::vector<std::string> digests;
  for (const std::string& line : program.header)
    if (line.rfind("input ", 0) == 0) digests.push_back(line.substr(6, line.find(' ', 6) - 6));
  if (digests.empty()) return std::nullopt;
  std::vector<Check> checks;
  for (const auto& [name, file] : {std::pair{"provenance.cell", cell}, std::pair{"provenance.calibration", calibration}}) {
    if (file.empty()) continue;
    const std::string sha = sha256_hex(read_file_whole(file).value_or(""));
    const bool is_named = std::any_of(digests.begin(), digests.end(), [&](const std::string& d) { return d.size() >= 12 && sha.rfind(d, 0) == 0; });
    checks.push_back({name, is_named ? 0.0 : 1.0, 0, "files", is_named ? "" : file.filename().string() + " is not the one the program was made from", is_named});
  }
  return checks;
}

/// The calibration that is used: the one asked for, or the one beside the cell.
std::filesystem::path calibration_file(const std::string& cell, const std::string& calibration) {
  if (!calibration.empty()) return calibration;
  const std::filesystem::path beside = std::filesystem::path(cell).parent_path() / "calibration.yaml";
  return std::filesystem::exists(beside) ? beside : std::filesystem::path();
}

}  // namespace

Result<CellSpec> calibrated_cell(const std::string& cell, const std::string& calibration, Console& console) {
  const std::filesystem::path file = calibration_file(cell, calibration);
  auto loaded = load_cell(cell, {true, today_iso()}, file);
  if (!loaded) return refuse_all(loaded.error());
  console.say(file.empty() ? "no calibration: the tools' nominal poses are used" : "calibration: " + file.string());
  return std::move(loaded->artefact);
}

int verify_command(const VerifyArguments& a, Console& console) {
  const auto cell = calibrated_cell(a.cell, a.calibration, console);
  if (!cell) return console.complain(cell.error()), 2;
  const PostContext context{*cell, today_iso()};
  const auto programs = read_programs(a.programs, context);
  if (!programs) {
    console.complain(programs.error());
    const bool is_input = std::any_of(programs.error().begin(), programs.error().end(), [](const Refusal& r) { return r.stage == "input"; });
    return is_input ? 2 : 3;
  }
  Json result;
  if (!a.result.empty()) {
    const auto text = read_file_whole(a.result);
    if (!text) return console.complain("--result " + a.result + ": there is no such file"), 2;
    result = Json::parse(*text, nullptr, false);
  }
  Json json{{"asbuilt", "verify/1"}, {"programs", Json::array()}};
  std::string text;
  bool is_ok = true;
  for (const ReadProgram& read : *programs) {
    Verdict verdict = verify_program(*cell, read.program);
    const auto lint = find_post(read.text.language)->lint(read.text, context);
    verdict.checks.insert(verdict.checks.end(), lint.begin(), lint.end());
    const auto made_from = provenance(read.program, a.cell, calibration_file(a.cell, a.calibration));
    if (made_from) verdict.checks.insert(verdict.checks.end(), made_from->begin(), made_from->end());
    if (!a.result.empty()) {
      const auto more = checks_against(result, read, *cell);
      if (!more) return console.complain(more.error()), 2;
      verdict.checks.insert(verdict.checks.end(), more->begin(), more->end());
    }
    is_ok &= verdict.is_ok();
    std::vector<std::vector<std::string>> rows{{"check", "measured", "limit", "", "pass", "where"}};
    for (const Check& c : verdict.checks)
      if (!c.is_passed || c.name.rfind("lint.", 0) != 0)
        rows.push_back({c.name, fmt::format("{:.5g}", c.measured), fmt::format("{:.5g}", c.limit), c.unit, c.is_passed ? "yes" : "NO", c.where});
    text += fmt::format("{} ({}): {}\n", read.text.files.front().name, name_of(read.text.language), verdict.is_ok() ? "every check passed" : "NOT every check passed") + text_table(rows);
    if (!made_from) text += "no provenance: the program's header does not say which cell and calibration it was made from\n";
    Json row{{"file", read.text.files.front().name}, {"language", std::string(name_of(read.text.language))}, {"ok", verdict.is_ok()}};
    row["provenance"] = !made_from ? "none" : std::all_of(made_from->begin(), made_from->end(), [](const Check& c) { return c.is_passed; }) ? "agrees" : "differs";
    row["verdict"] = to_json(verdict);
    json["programs"].push_back(std::move(row));
  }
  json["ok"] = is_ok;
  console.answer(json, text);
  return is_ok ? 0 : 3;
}

}  // namespace asbuilt
