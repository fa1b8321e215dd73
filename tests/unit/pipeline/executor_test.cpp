// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/executor.hpp"

#include <gtest/gtest.h>

#include <chrono>

#include "planner/pipeline/store.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

struct Ran {
  std::vector<ItemEnd> ends;
  std::vector<StageEvent> events;
  double time_s = 0;
};

Ran run(const std::filesystem::path& out, const std::vector<std::string>& items, int jobs_count, double timeout_s = 0) {
  Ran ran;
  ran.ends.resize(items.size());
  BatchOptions options;
  options.item.out = out;
  options.jobs_count = jobs_count;
  options.timeout_s = timeout_s;
  options.worker = test::worker_command();
  options.watch = [&](const StageEvent& e) { ran.events.push_back(e); };
  std::vector<ItemTask> tasks;
  for (const std::string& item : items) tasks.push_back({"batch.yaml", item});
  const auto start = std::chrono::steady_clock::now();
  run_items_here(tasks, options, [&](std::size_t index, const ItemEnd& end) { ran.ends[index] = end; });
  ran.time_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return ran;
}

TEST(Executor, a_crash_is_one_items_failure_with_stage_and_signal) {
  const test::TemporaryFolder folder;
  const Ran ran = run(folder.path, {"good-1", "crash", "good-2", "abort"}, 2);
  EXPECT_TRUE(ran.ends[0].code.empty());
  EXPECT_TRUE(ran.ends[2].code.empty());
  EXPECT_TRUE(std::filesystem::exists(folder.path / "good-2" / "result.json"));
  EXPECT_EQ(ran.ends[1].code, "failed.signal");
  EXPECT_EQ(ran.ends[1].blame, "fit");
  EXPECT_NE(ran.ends[1].message.find("signal 11"), std::string::npos) << ran.ends[1].message;
  EXPECT_NE(ran.ends[1].message.find("stage fit"), std::string::npos);
  EXPECT_EQ(ran.ends[1].timing_s.at("input"), 0.25);
  EXPECT_NE(ran.ends[3].message.find("signal 6"), std::string::npos);
}

TEST(Executor, a_time_limit_ends_one_item) {
  const test::TemporaryFolder folder;
  const Ran ran = run(folder.path, {"slow", "good"}, 2, 1);
  EXPECT_EQ(ran.ends[0].code, "failed.timeout");
  EXPECT_EQ(ran.ends[0].blame, "fit");
  EXPECT_TRUE(ran.ends[1].code.empty());
  EXPECT_LT(ran.time_s, 10);
}

TEST(Executor, no_result_is_a_failure_whatever_the_process_says) {
  const test::TemporaryFolder folder;
  const Ran ran = run(folder.path, {"silent", "broken"}, 1);
  EXPECT_EQ(ran.ends[0].code, "failed.exit");
  EXPECT_EQ(ran.ends[1].code, "failed.exit");
  EXPECT_NE(ran.ends[1].message.find("77"), std::string::npos);
}

TEST(Executor, tells_every_stage_of_every_item) {
  const test::TemporaryFolder folder;
  const Ran ran = run(folder.path, {"good-1", "good-2"}, 1);
  ASSERT_EQ(ran.events.size(), 6u);
  EXPECT_EQ(ran.events[0].item, "good-1");
  EXPECT_EQ(ran.events[1].what, StageEvent::What::done);
  EXPECT_EQ(ran.events[5].stage, "fit");
  EXPECT_EQ(ran.events[5].item, "good-2");
}

TEST(Executor, slurm_without_sbatch_is_refused_by_name) {
  const test::TemporaryFolder folder;
  const char* path = std::getenv("PATH");
  const std::string kept = path ? path : "";
  ::setenv("PATH", folder.path.c_str(), 1);
  BatchOptions options;
  options.item.out = folder.path;
  options.worker = test::worker_command();
  const auto ran = run_items_on_slurm({{"batch.yaml", "good"}}, options, [](std::size_t, const ItemEnd&) {});
  ::setenv("PATH", kept.c_str(), 1);
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().at(0).code, "input.no_slurm");
}

TEST(Executor, slurm_submits_a_script_an_item_and_waits) {
  const test::TemporaryFolder folder;
  // a cluster of one machine: sbatch that runs the script at once
  write_file_whole(folder.path / "bin" / "sbatch", "#!/bin/sh\nfor last; do :; done\nexec sh \"$last\"\n");
  std::filesystem::permissions(folder.path / "bin" / "sbatch", std::filesystem::perms::owner_all);
  const std::string kept = std::getenv("PATH");
  ::setenv("PATH", ((folder.path / "bin").string() + ":" + kept).c_str(), 1);
  BatchOptions options;
  options.item.out = folder.path / "it's out";
  options.worker = test::worker_command();
  std::vector<ItemEnd> ends(2);
  const auto ran = run_items_on_slurm({{"batch.yaml", "good"}, {"batch.yaml", "crash"}}, options, [&](std::size_t k, const ItemEnd& end) { ends[k] = end; });
  ::setenv("PATH", kept.c_str(), 1);
  ASSERT_TRUE(ran);
  EXPECT_TRUE(ends[0].code.empty()) << ends[0].message;
  EXPECT_TRUE(std::filesystem::exists(options.item.out / "good" / "result.json"));
  EXPECT_EQ(ends[1].code, "failed.exit");
}

}  // namespace
}  // namespace asbuilt
