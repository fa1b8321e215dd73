// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/history.hpp"

#include <gtest/gtest.h>

#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

BatchLine line_with(const std::string& part_hash) {
  BatchLine line;
  line.item_id = "ring-0001";
  line.result_json = R"({"inputs": [{"path": "part.yaml", "sha256": ")" + part_hash + R"("}, {"path": "cell.yaml", "sha256": "c"}]})";
  return line;
}

StageEvent stage(const char* name, StageEvent::What what, std::map<std::string, std::string> parts) {
  StageEvent e;
  e.item = "ring-0001", e.stage = name, e.what = what, e.parts = std::move(parts);
  return e;
}

TEST(History, says_which_input_changed_since_the_run_before) {
  const test::TemporaryFolder folder;
  EXPECT_FALSE(why_item(folder.path, "ring-0001"));
  {
    History history(folder.path / "store" / "history.sqlite");
    history.add(line_with("a"), {stage("fuse", StageEvent::What::done, {{"code", "1"}, {"input: job", "x"}}), stage("fit", StageEvent::What::done, {{"code", "1"}, {"input: cloud", "p"}})});
  }
  auto why = why_item(folder.path, "ring-0001");
  ASSERT_TRUE(why);
  EXPECT_EQ(why->stages.at(0).changed, std::vector<std::string>{"first run"});
  {
    History history(folder.path / "store" / "history.sqlite");
    history.add(line_with("b"), {stage("fuse", StageEvent::What::from_store, {{"code", "1"}, {"input: job", "x"}}), stage("fit", StageEvent::What::done, {{"code", "1"}, {"input: cloud", "q"}})});
  }
  why = why_item(folder.path, "ring-0001");
  ASSERT_TRUE(why);
  EXPECT_TRUE(why->stages.at(0).changed.empty());
  EXPECT_EQ(why->stages.at(0).what, "from store");
  EXPECT_EQ(why->stages.at(1).changed, std::vector<std::string>{"input: cloud"});
  EXPECT_EQ(why->files, std::vector<std::string>{"part.yaml: changed"});
  EXPECT_FALSE(why_item(folder.path, "another"));
}

TEST(History, names_the_keys_of_the_latest_runs_of_each_item) {
  const test::TemporaryFolder folder;
  History history(folder.path / "history.sqlite");
  for (const char* key : {"k1", "k2", "k3"}) {
    StageEvent e = stage("fuse", StageEvent::What::done, {});
    e.key = key;
    history.add(line_with("a"), {e});
  }
  BatchLine other = line_with("a");
  other.item_id = "ring-0002";
  StageEvent e = stage("fuse", StageEvent::What::done, {});
  e.key = "k4";
  history.add(other, {e});
  EXPECT_EQ(history.latest_keys(2), (std::set<std::string>{"k2", "k3", "k4"}));
  EXPECT_EQ(history.latest_keys(1), (std::set<std::string>{"k3", "k4"}));
}

}  // namespace
}  // namespace asbuilt
