// SPDX-License-Identifier: GPL-3.0-or-later
// The command line: exit statuses, messages, one JSON document on standard output.
#include <gtest/gtest.h>

#include <fmt/format.h>

#include "planner/base/frames.hpp"
#include "planner/base/random.hpp"
#include "planner/simulate/simulate.hpp"
#include "tests/e2e/run_program.hpp"

namespace asbuilt {
namespace {

using test::run_program;

TEST(CommandLine, exit_statuses) {
  const test::Folder folder;
  const std::string out = folder.path / "out";
  const std::vector<std::pair<std::vector<std::string>, int>> table{
      {{"--help"}, 0},
      {{"--version"}, 0},
      {{"batch", "--help"}, 0},
      {{}, 2},
      {{"bacth"}, 2},
      {{"batch"}, 2},
      {{"batch", "none.yaml"}, 2},
      {{"batch", "none.yaml", "--out", out}, 2},
      {{"batch", "none.yaml", "--out", out, "--colour", "blue"}, 2},
      {{"batch", "none.yaml", "--out", out, "-j", "0"}, 2},
      {{"batch", "none.yaml", "--out", out, "-j", "two"}, 2},
      {{"batch", "none.yaml", "--out", out, "--executor", "cloud"}, 2},
      {{"batch", "none.yaml", "--out", out, "--post", "fanuc"}, 2},
      {{"locate", "none.yaml", "--item", "x"}, 2},
      {{"cad", "none.step"}, 2},
      {{"calibrate", "none.yaml", "--out", out}, 2},
      {{"simulate", "none.yaml", "--out", out}, 2},
      {{"verify", "none.src", "--cell", "none.yaml"}, 2},
      {{"compare", "none.json", "none.json"}, 2},
      {{"show", "none.json"}, 2},
      {{"why", "x", "--out", out}, 2},
      {{"schema", "recipe"}, 0},
      {{"schema", "poem"}, 2},
  };
  for (const auto& [words, status] : table) {
    std::string line;
    for (const std::string& w : words) line += w + " ";
    const test::Ran ran = run_program(words);
    EXPECT_EQ(ran.status, status) << line << "\n" << ran.err;
    if (status != 0) EXPECT_FALSE(ran.err.empty()) << line;
    if (status != 0) EXPECT_TRUE(ran.out.empty()) << line << ran.out;
  }
}

TEST(CommandLine, an_unknown_language_names_those_that_are_known) {
  const test::Ran ran = run_program({"batch", "none.yaml", "--out", "x", "--post", "krl,fanuc"});
  EXPECT_NE(ran.err.find("fanuc"), std::string::npos);
  EXPECT_NE(ran.err.find("inform"), std::string::npos);
}

TEST(CommandLine, an_expired_calibration_is_not_checked_but_refused) {
  const test::Folder folder;
  test::write_text(folder.path / "cell.yaml", test::read_text("tests/refuse/base/cell.yaml"));
  test::write_text(folder.path / "calibration.yaml", test::read_text("tests/refuse/base/calibration.yaml"));
  const auto captures = [&](const std::string& day) {
    test::write_text(folder.path / "captures.yaml", "asbuilt: captures/1\ncell: cell.yaml\nsensor: wide\ntaken: " + day +
                                                        "\ntarget: {kind: pose}\ncaptures:\n  - {name: monday, base_flange: {xyz: [900, 0, 800], zyx: [0, 90, 0]}, sensor_target: {xyz: [0, 0, 500], zyx: [0, 0, 0]}}\n");
    return run_program({"calibrate", folder.path / "captures.yaml", "--check", folder.path / "calibration.yaml"});
  };
  const test::Ran old = captures("2027-02-01");
  EXPECT_EQ(old.status, 3);
  EXPECT_NE(old.err.find("calibrate.expired"), std::string::npos) << old.err;
  EXPECT_NE(old.err.find("78 days"), std::string::npos) << old.err;
  const test::Ran young = captures("2026-11-20");  // of age; but it holds no views to compare with
  EXPECT_EQ(young.status, 3);
  EXPECT_NE(young.err.find("calibrate.no_reference"), std::string::npos) << young.err;
}

TEST(CommandLine, captures_to_a_calibration_and_a_check_of_it) {
  const test::Folder folder;
  test::write_text(folder.path / "cell.yaml", test::read_text("tests/refuse/base/cell.yaml"));
  const Pose<frame::Flange, frame::Sensor> X(quat_exp(Vec3(0.02, -0.01, 1.57)), Vec3(-150.4, 0.3, 149.8));
  const Pose<frame::Base, frame::Target> Y(quat_exp(Vec3(0.1, -0.07, 0.6)), Vec3(1200, 40, 300));
  Random random(5);
  const auto pose = [](const auto& T) {
    return fmt::format("{{xyz: [{:.5f}, {:.5f}, {:.5f}], quat: [{:.9f}, {:.9f}, {:.9f}, {:.9f}]}}", T.p_mm.x(), T.p_mm.y(), T.p_mm.z(), T.q.w(), T.q.x(), T.q.y(), T.q.z());
  };
  const auto captures = [&](int count, double moved_mm) {
    std::string yaml = "asbuilt: captures/1\ncell: cell.yaml\nsensor: wide\ntaken: 2026-11-18\nnoise: 0.02\nnoise_turn: 0.005\nrobot_sd: {position: 0.05, turn: 0.005}\nrepeat_sd: {position: 0.02, turn: 0.002}\ntarget: {kind: pose}\ncaptures:\n";
    Random robot(9);  // the same poses, the same errors of the arm there
    for (int k = 0; k < count; ++k) {
      const Pose<frame::Base, frame::Flange> F(quat_exp(Vec3(2.9 + 0.5 * std::sin(2.0 * k), 0.5 * std::cos(1.7 * k), 0.8 * std::sin(k))), Vec3(1150 + 40 * std::cos(k), 30 * std::sin(3.0 * k), 900));
      Vec6 arm, noise;
      for (int i = 0; i < 6; ++i) arm[i] = robot.normal(0, i < 3 ? 0.05 : 8e-5), noise[i] = random.normal(0, i < 3 ? 0.02 : 8e-5);
      Vec6 moved = Vec6::Zero();
      moved[0] = moved_mm;
      const Pose<frame::Sensor, frame::Target> seen = (F.disturbed(arm) * X.disturbed(moved)).inverse() * Y;
      yaml += "  - {name: view " + std::to_string(k) + ", base_flange: " + pose(F) + ", sensor_target: " + pose(seen.disturbed(noise)) + "}\n";
    }
    test::write_text(folder.path / "captures.yaml", yaml);
  };
  captures(16, 0);
  const std::string calibration = folder.path / "calibration.yaml";
  const test::Ran made = run_program({"calibrate", folder.path / "captures.yaml", "--out", calibration, "--json"});
  ASSERT_EQ(made.status, 0) << made.err;
  const Json report = Json::parse(made.out, nullptr, false);
  ASSERT_TRUE(report.is_object());
  EXPECT_NEAR(report["pose"]["xyz"][0].get<double>(), X.p_mm.x(), 0.3);
  EXPECT_LT(report["held_out"]["rms_mm"].get<double>(), 0.2);
  EXPECT_GT(report["held_out"]["rms_mm"].get<double>(), 0.01);
  captures(1, 0);
  EXPECT_EQ(run_program({"calibrate", folder.path / "captures.yaml", "--check", calibration}).status, 0);
  captures(1, 0.3);
  const test::Ran slipped = run_program({"calibrate", folder.path / "captures.yaml", "--check", calibration});
  EXPECT_EQ(slipped.status, 3) << slipped.out;
  EXPECT_NE(slipped.err.find("calibrate.sensor_moved"), std::string::npos) << slipped.err;
}

TEST(CommandLine, schemas_are_json) {
  for (const char* kind : {"part", "recipe", "cell", "fixture", "calibration", "scans", "batch"}) {
    const test::Ran ran = run_program({"schema", kind});
    EXPECT_EQ(ran.status, 0) << kind;
    EXPECT_TRUE(Json::parse(ran.out, nullptr, false).is_object()) << kind;
  }
}

TEST(CommandLine, an_item_that_is_not_there_is_refused_with_those_that_are) {
  const test::Folder folder;
  Scenario scenario;
  scenario.part = "bracket", scenario.trap = "unknown_key", scenario.item_id = "bracket-7";
  const auto made = simulate(scenario, folder.path / "virtual");
  ASSERT_TRUE(made);
  const std::string batch = made->artefact.string(), out = folder.path / "out";
  const test::Ran ran = run_program({"batch", batch, "--out", out, "--only", "bracket-8"});
  EXPECT_EQ(ran.status, 2);
  EXPECT_NE(ran.err.find("input.unknown_item"), std::string::npos) << ran.err;
  EXPECT_NE(ran.err.find("bracket-7"), std::string::npos) << ran.err;
  const test::Ran stage = run_program({"fit", batch, "--out", out, "--item", "bracket-8"});
  EXPECT_EQ(stage.status, 2);
  EXPECT_NE(stage.err.find("bracket-7"), std::string::npos) << stage.err;
  const test::Ran input = run_program({"fit", batch, "--out", out, "--item", "bracket-7", "--json"});
  EXPECT_EQ(input.status, 2);
  const Json said = Json::parse(input.out, nullptr, false);
  ASSERT_TRUE(said.is_object()) << input.out;
  EXPECT_EQ(said.at("status"), "refused");
  EXPECT_EQ(said.at("reasons")[0].at("code"), "input.unknown_key");

  // a folder that cannot be used, a cluster that is not there
  test::write_text(folder.path / "file", "not a folder");
  const test::Ran file = run_program({"batch", batch, "--out", folder.path / "file"});
  EXPECT_EQ(file.status, 2);
  EXPECT_NE(file.err.find("input.out_not_usable"), std::string::npos) << file.err;
}

TEST(CommandLine, stages_of_one_item_use_one_store) {
  const test::Folder folder;
  Scenario scenario;
  scenario.part = "ring", scenario.seed = 21, scenario.item_id = "good";
  const auto made = simulate(scenario, folder.path / "virtual");
  ASSERT_TRUE(made);
  const std::string batch = made->artefact.string(), out = folder.path / "out";
  for (const char* stage : {"fuse", "locate", "fit", "burr", "path", "motion"}) {
    const test::Ran ran = run_program({stage, batch, "--out", out, "--item", "good", "--json"});
    EXPECT_EQ(ran.status, 0) << stage << ran.err;
    const Json said = Json::parse(ran.out, nullptr, false);
    ASSERT_TRUE(said.is_object()) << stage;
    EXPECT_EQ(said.at("stage"), stage);
    EXPECT_FALSE(said.at("result").is_null()) << stage;
    if (std::string(stage) != "fuse") EXPECT_NE(ran.err.find("fuse: from store"), std::string::npos) << ran.err;
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path / "out" / "good"));

  // programs: verified, compared, and a changed one caught
  ASSERT_EQ(run_program({"batch", batch, "--out", out, "--post", "krl,inform,beckhoff", "--quiet"}).status, 0);
  const std::filesystem::path item = folder.path / "out" / "good", cell = made->artefact.parent_path() / "cell.yaml";
  std::vector<std::string> programs;
  std::filesystem::path src;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(item / "programs"))
    if (entry.is_regular_file()) {
      programs.push_back(entry.path());
      if (entry.path().extension() == ".src") src = entry.path();
    }
  std::vector<std::string> words{"verify"};
  words.insert(words.end(), programs.begin(), programs.end());
  words.insert(words.end(), {"--cell", cell, "--result", item / "result.json", "--json"});
  const test::Ran verified = run_program(words);
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  EXPECT_EQ(Json::parse(verified.out, nullptr, false).at("programs").size(), 3u);
  for (const Json& p : Json::parse(verified.out, nullptr, false).at("programs")) EXPECT_EQ(p.at("provenance"), "agrees");

  // another calibration file than the one the program was made from, and a program that does not say what it was made from
  const std::filesystem::path dat = src.parent_path() / (src.stem().string() + ".dat"), calibration = made->artefact.parent_path() / "calibration.yaml";
  test::write_text(calibration.parent_path() / "other.yaml", test::read_text(calibration) + "# typed in again\n");
  const test::Ran other = run_program({"verify", src, dat, "--cell", cell, "--calibration", calibration.parent_path() / "other.yaml", "--json"});
  EXPECT_EQ(other.status, 3) << other.out << other.err;
  EXPECT_EQ(Json::parse(other.out, nullptr, false).at("programs").at(0).at("provenance"), "differs");
  EXPECT_NE(other.out.find("provenance.calibration"), std::string::npos);
  std::string bare = test::read_text(src);
  for (std::size_t at = bare.find("  ; "); at != std::string::npos; at = bare.find("  ; ")) bare.erase(at, bare.find('\n', at) + 1 - at);
  test::write_text(folder.path / "bare" / src.filename(), bare);
  std::filesystem::copy_file(dat, folder.path / "bare" / dat.filename());
  const test::Ran unsaid = run_program({"verify", folder.path / "bare" / src.filename(), folder.path / "bare" / dat.filename(), "--cell", cell, "--json"});
  EXPECT_EQ(unsaid.status, 0) << unsaid.out << unsaid.err;
  EXPECT_EQ(Json::parse(unsaid.out, nullptr, false).at("programs").at(0).at("provenance"), "none");

  // modules of one program are read as one
  std::string small = test::read_text(cell);
  small.replace(small.find("language: krl"), 13, "language: krl\n  krl: {max_lines: 50}");
  test::write_text(cell, small);
  ASSERT_EQ(run_program({"batch", batch, "--out", folder.path / "small", "--post", "krl", "--quiet"}).status, 0);
  std::vector<std::string> modules{"verify"};
  for (const auto& entry : std::filesystem::directory_iterator(folder.path / "small" / "good" / "programs" / "krl")) modules.push_back(entry.path());
  EXPECT_GT(modules.size(), 4u);
  modules.insert(modules.end(), {"--cell", cell, "--json"});
  const test::Ran split = run_program(modules);
  EXPECT_EQ(split.status, 0) << split.out << split.err;
  EXPECT_EQ(Json::parse(split.out, nullptr, false).at("programs").size(), 1u);
  small.replace(small.find("\n  krl: {max_lines: 50}"), 23, "");
  test::write_text(cell, small);

  const test::Ran drawing = run_program({"compare", item, "--json"});
  EXPECT_EQ(drawing.status, 0);
  EXPECT_EQ(Json::parse(drawing.out).at("kind"), "nominal-adapted");
  const test::Ran same = run_program({"compare", item, item / "result.json", "--json"});
  for (const Json& e : Json::parse(same.out).at("edges")) EXPECT_EQ(e.at("max"), 0.0);
  EXPECT_EQ(run_program({"compare", src, src}).status, 2);  // what a program means depends on the cell

  const std::filesystem::path changed = folder.path / "changed" / src.filename();
  std::string text = test::read_text(src);
  const std::size_t at = text.rfind("LIN");
  ASSERT_NE(at, std::string::npos);
  const std::size_t x = text.find("X ", at) + 2;
  text.replace(x, text.find_first_of(",.", x) - x, "0");
  test::write_text(changed, text);
  for (const char* end : {".dat"})
    if (auto beside = src; std::filesystem::exists(beside.replace_extension(end))) std::filesystem::copy_file(beside, changed.parent_path() / beside.filename());
  EXPECT_NE(run_program({"verify", changed, changed.string().substr(0, changed.string().size() - 3) + "dat", "--cell", cell, "--calibration",
                         made->artefact.parent_path() / "calibration.yaml", "--result", item / "result.json"}).status, 0);
}

TEST(CommandLine, demo_good_parts_come_out_and_traps_are_refused) {
  const test::Folder folder;
  const test::Ran ran = run_program({"demo", "--out", folder.path / "demo", "--json", "--quiet"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
  const Json said = Json::parse(ran.out, nullptr, false);
  ASSERT_TRUE(said.is_object());
  for (const Json& item : said.at("items")) {
    EXPECT_TRUE(item.at("as_designed").get<bool>()) << item.dump();
    if (item.at("status") != "emitted") continue;
    const Json& truth = item.at("truth");
    EXPECT_LT(truth.at("edge_p95_mm").get<double>(), 0.12) << item.dump();
    EXPECT_LT(truth.at("edge_p95_mm").get<double>(), truth.at("edge_nominal_p95_mm").get<double>()) << item.dump();
    EXPECT_GT(truth.at("chamfer_within_ratio").get<double>(), 0.95) << item.dump();
    EXPECT_LT(truth.at("burr_rms_mm").get<double>(), 0.2) << item.dump();  // fins along every view are told too low
  }
}

}  // namespace
}  // namespace asbuilt
