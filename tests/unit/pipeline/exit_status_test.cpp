// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "planner/pipeline/pipeline.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

TEST(ExitStatus, the_highest_of_1_2_4_3_wins) {
  EXPECT_EQ(worst_exit_status({}), 0);
  EXPECT_EQ(worst_exit_status({0, 0}), 0);
  EXPECT_EQ(worst_exit_status({0, 3}), 3);
  EXPECT_EQ(worst_exit_status({3, 4}), 4);
  EXPECT_EQ(worst_exit_status({4, 3, 2}), 2);
  EXPECT_EQ(worst_exit_status({2, 1, 4}), 1);
}

TEST(ExitStatus, of_one_item) {
  BatchLine line;
  line.status = ItemStatus::emitted;
  EXPECT_EQ(exit_status_of(line), 0);
  line.status = ItemStatus::failed;
  line.reasons = {{.code = "failed.signal", .stage = "input"}};
  EXPECT_EQ(exit_status_of(line), 4);
  line.status = ItemStatus::refused;
  line.reasons = {{.code = "fit.edge_not_seen", .stage = "fit"}};
  EXPECT_EQ(exit_status_of(line), 3);
  line.reasons = {{.code = "input.cloud_truncated", .stage = "input"}};
  EXPECT_EQ(exit_status_of(line), 2);
  line.reasons = {{.code = "input.calibration_expired", .stage = "input"}};
  EXPECT_EQ(exit_status_of(line), 3);
}

TEST(RunBatch, a_batch_file_that_is_not_there_is_refused) {
  const test::TemporaryFolder folder;
  BatchOptions options;
  options.item.out = folder.path / "out";
  options.worker = test::worker_command();
  const auto ran = run_batch(folder.path / "none.yaml", options);
  ASSERT_FALSE(ran);
  EXPECT_EQ(ran.error().at(0).stage, "input");
  EXPECT_FALSE(std::filesystem::exists(folder.path / "out" / "batch.json"));
}

}  // namespace
}  // namespace asbuilt
