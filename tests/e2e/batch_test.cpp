// SPDX-License-Identifier: GPL-3.0-or-later
// A batch with good and bad items, made by the virtual cell: every bad one refused by the right stage, the good one the same
// bytes whatever else is in the batch, however many run at once, and whether it comes from the store or not.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "planner/simulate/simulate.hpp"
#include "tests/e2e/run_program.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;
using test::read_text;
using test::result_of;
using test::run_program;
using test::write_text;

/// One virtual ring, and beside its item others made from it by spoiling one file each.
struct SpoiledBatch {
  test::Folder folder;
  fs::path batch;

  SpoiledBatch() {
    Scenario scenario;
    scenario.part = "ring", scenario.seed = 21, scenario.item_id = "good";
    const auto made = simulate(scenario, folder.path / "virtual");
    if (!made) throw std::runtime_error("the virtual cell made no batch");
    batch = made->artefact;
    const fs::path root = batch.parent_path();
    items = "- {id: good, part: part.yaml, fixture: fixture.yaml, scans: good/scans.yaml}\n";

    const fs::path cut = copy_scans("cut-cloud");
    const fs::path cloud = first_cloud(cut);
    fs::resize_file(cloud, fs::file_size(cloud) / 2);
    add("cut-cloud", "part.yaml", "cut-cloud/scans.yaml");

    write_text(root / "part-key.yaml", read_text(root / "part.yaml") + "colour: blue\n");
    add("unknown-key", "part-key.yaml", "good/scans.yaml");

    std::string part = read_text(root / "part.yaml");
    const std::string step = scenario.part + ".step";
    write_text(root / "cut.step", read_text(root / step).substr(0, read_text(root / step).size() / 2));
    part.replace(part.find(step), step.size(), "cut.step");
    write_text(root / "part-cut.yaml", part);
    add("cut-step", "part-cut.yaml", "good/scans.yaml");

    add("no-scans", "part.yaml", "nowhere/scans.yaml");

    std::string text = read_text(batch);
    text = text.substr(0, text.find("items:")) + "items:\n" + items;
    write_text(batch, text);
  }

 private:
  std::string items;
  void add(const std::string& id, const std::string& part, const std::string& scans) {
    items += "- {id: " + id + ", part: " + part + ", fixture: fixture.yaml, scans: " + scans + "}\n";
  }
  fs::path copy_scans(const std::string& id) {
    const fs::path to = batch.parent_path() / id;
    fs::copy(batch.parent_path() / "good", to, fs::copy_options::recursive);
    std::string scans = read_text(to / "scans.yaml");
    scans.replace(scans.find("item: good"), 10, "item: " + id);
    write_text(to / "scans.yaml", scans);
    return to;
  }
  static fs::path first_cloud(const fs::path& folder) {
    std::vector<fs::path> clouds;
    for (const auto& entry : fs::directory_iterator(folder))
      if (entry.path().extension() == ".ply") clouds.push_back(entry.path());
    std::sort(clouds.begin(), clouds.end());
    return clouds.at(0);
  }
};

void expect_refused(const fs::path& out, const std::string& item, const std::string& stage) {
  const Json r = result_of(out, item);
  EXPECT_EQ(r.value("status", ""), "refused") << item;
  ASSERT_FALSE(r["reasons"].empty()) << item;
  EXPECT_EQ(r["reasons"][0].value("stage", ""), stage) << item << r["reasons"].dump();
  EXPECT_FALSE(r["reasons"][0].value("message", "").empty()) << item;
  EXPECT_FALSE(r["reasons"][0].value("code", "").empty()) << item;
  EXPECT_FALSE(fs::exists(out / item / "programs")) << item;
  EXPECT_TRUE(fs::exists(out / item / "report.html")) << item;
}

TEST(Batch, bad_items_are_refused_and_the_good_one_is_the_same_bytes_always) {
  const SpoiledBatch spoiled;
  const fs::path one = spoiled.folder.path / "one", two = spoiled.folder.path / "two", alone = spoiled.folder.path / "alone";
  const std::string batch = spoiled.batch;
  const test::Ran ran = run_program({"batch", batch, "--out", one, "-j", "1", "--post", "krl,inform,beckhoff", "--json", "--log", spoiled.folder.path / "log"});
  for (const char* item : {"cut-cloud", "unknown-key", "cut-step", "no-scans"}) expect_refused(one, item, "input");
  EXPECT_EQ(ran.status, 2) << ran.err;
  const Json said = Json::parse(ran.out, nullptr, false);
  ASSERT_TRUE(said.is_object()) << ran.out;
  EXPECT_EQ(said.at("items").size(), 5u);
  EXPECT_TRUE(fs::exists(one / "index.html"));
  EXPECT_NE(read_text(spoiled.folder.path / "log").find("\"stage\":\"locate\""), std::string::npos);
  const Json good = result_of(one, "good");
  EXPECT_EQ(good.value("status", ""), "emitted") << good["reasons"].dump();

  // however many at once
  EXPECT_EQ(run_program({"batch", batch, "--out", two, "-j", "2", "--post", "krl,inform,beckhoff", "--quiet"}).status, 2);
  EXPECT_EQ(test::what_came_out(one), test::what_came_out(two));
  // from the store
  EXPECT_EQ(run_program({"batch", batch, "--out", one, "-j", "2", "--post", "krl,inform,beckhoff", "--quiet"}).status, 2);
  EXPECT_EQ(test::what_came_out(one), test::what_came_out(two));
  const Json why = Json::parse(run_program({"why", "good", "--out", one, "--json"}).out, nullptr, false);
  for (const Json& stage : why.at("stages")) EXPECT_NE(stage.at("what"), "done") << stage.dump();
  // alone: what else is in the batch does not matter
  EXPECT_EQ(run_program({"batch", batch, "--out", alone, "--only", "good", "--post", "krl,inform,beckhoff", "--quiet"}).status, good.value("status", "") == "emitted" ? 0 : 3);
  const auto whole = test::what_came_out(two);
  for (const auto& [path, bytes] : test::what_came_out(alone)) EXPECT_EQ(whole.at(path), bytes) << path;
}

TEST(Batch, a_changed_recipe_plans_again_and_measures_nothing_again) {
  test::Folder folder;
  Scenario scenario;
  scenario.part = "ring", scenario.seed = 21, scenario.item_id = "good";
  const auto made = simulate(scenario, folder.path / "virtual");
  ASSERT_TRUE(made);
  const fs::path out = folder.path / "out", recipe = made->artefact.parent_path() / "deburr-0.4.yaml";
  ASSERT_EQ(run_program({"batch", made->artefact, "--out", out, "--quiet"}).status, 0);
  const auto before = test::what_came_out(out);
  std::string text = read_text(recipe);
  const std::size_t at = text.find("approach:");
  ASSERT_NE(at, std::string::npos);
  text.replace(at, text.find('\n', at) - at, "approach: 17");
  write_text(recipe, text);
  ASSERT_EQ(run_program({"batch", made->artefact, "--out", out, "--quiet"}).status, 0);
  EXPECT_NE(before, test::what_came_out(out));
  const Json why = Json::parse(run_program({"why", "good", "--out", out, "--json"}).out, nullptr, false);
  EXPECT_EQ(why.at("files").dump(), "[\"deburr-0.4.yaml: changed\"]");
  for (const Json& stage : why.at("stages")) {
    const std::string name = stage.at("stage");
    const bool is_measuring = name == "fuse" || name == "locate" || name == "fit" || name == "burr";
    if (is_measuring) EXPECT_EQ(stage.at("what"), "from store") << name;
    if (name == "path" || name == "motion" || name == "post") EXPECT_EQ(stage.at("what"), "done") << name;
  }
}

TEST(Batch, one_refused_language_means_no_program_at_all) {
  const SpoiledBatch spoiled;
  const fs::path cell = spoiled.batch.parent_path() / "cell.yaml";
  std::string text = read_text(cell);
  const std::size_t at = text.find("pulses_per_degree");
  ASSERT_NE(at, std::string::npos);
  const fs::path out = spoiled.folder.path / "out";
  // a machine value the dialect must not guess
  const std::size_t from = text.rfind('\n', at) + 1, end = text.find('\n', at);
  const std::string line = text.substr(from, end - from);
  const std::size_t begin_inform = line.find("inform: {");
  if (begin_inform == std::string::npos) GTEST_SKIP() << "the virtual cell writes its controller block in another way: " << line;
  const std::size_t end_inform = line.find('}', begin_inform);
  text.replace(from + begin_inform, end_inform + 1 - begin_inform, "inform: {speed_unit: mm/s}");
  write_text(cell, text);
  run_program({"batch", spoiled.batch, "--out", out, "--only", "good", "--post", "krl,inform", "--quiet"});
  const Json r = result_of(out, "good");
  EXPECT_EQ(r.value("status", ""), "refused");
  EXPECT_FALSE(fs::exists(out / "good" / "programs"));
}

}  // namespace
}  // namespace asbuilt
