// SPDX-License-Identifier: GPL-3.0-or-later
// Every fault the virtual cell can build in: refused by the right stage, with the right exit status, and without a program.
#include <gtest/gtest.h>

#include <set>

#include "planner/simulate/simulate.hpp"
#include "tests/e2e/run_program.hpp"

namespace asbuilt {
namespace {

struct Trap {
  const char* name;
  std::set<std::string> stages;  // that may refuse it
  std::string code;              // exact, where only one can be right
  int exit_status;
};
std::ostream& operator<<(std::ostream& out, const Trap& trap) { return out << trap.name; }

class Traps : public ::testing::TestWithParam<Trap> {};

TEST_P(Traps, is_refused_by_the_right_stage) {
  const Trap& trap = GetParam();
  const test::Folder folder;
  Scenario scenario;
  scenario.part = "ring", scenario.seed = 21, scenario.trap = trap.name, scenario.item_id = "trapped";
  const auto made = simulate(scenario, folder.path / "virtual");
  ASSERT_TRUE(made);
  const auto out = folder.path / "out";
  const test::Ran ran = test::run_program({"batch", made->artefact.string(), "--out", out.string(), "--post", "krl,inform,beckhoff", "--quiet"});
  EXPECT_EQ(ran.status, trap.exit_status) << ran.out << ran.err;
  const Json r = test::result_of(out, "trapped");
  ASSERT_EQ(r.value("status", ""), "refused") << r["reasons"].dump();
  const Json& why = r["reasons"][0];
  EXPECT_TRUE(trap.stages.contains(why.value("stage", ""))) << why.dump();
  if (!trap.code.empty()) EXPECT_EQ(why.value("code", ""), trap.code) << why.dump();
  EXPECT_GT(why.value("message", "").size(), 20u);
  EXPECT_TRUE(why.contains("value") && why.contains("limit"));
  EXPECT_FALSE(std::filesystem::exists(out / "trapped" / "programs"));
  EXPECT_TRUE(r["programs"].empty());
}

INSTANTIATE_TEST_SUITE_P(VirtualCell, Traps,
                         ::testing::Values(Trap{"truncated_ply", {"input"}, "input.cloud_truncated", 2}, Trap{"nan_cloud", {"input"}, "input.cloud_empty", 2},
                                           Trap{"step_cut", {"input"}, "step.truncated", 2}, Trap{"unknown_key", {"input"}, "input.unknown_key", 2},
                                           Trap{"missing_unit", {"input"}, "input.units_missing", 2}, Trap{"expired", {"input"}, "input.calibration_expired", 3},
                                           Trap{"lugs_missing", {"locate", "fit"}, "", 3}, Trap{"flat_views", {"locate", "fit"}, "", 3},
                                           Trap{"edge_unscanned", {"fit", "burr"}, "", 3}, Trap{"hand_eye", {"locate", "fit"}, "", 3},
                                           Trap{"unreachable", {"path", "motion"}, "", 3}, Trap{"clamp", {"fit", "burr", "motion", "verify"}, "", 3}),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(VirtualCell, single_points_without_a_coordinate_are_dropped_and_counted) {
  const test::Folder folder;
  Scenario scenario;
  scenario.part = "ring", scenario.seed = 21, scenario.trap = "nan_points", scenario.item_id = "good";
  const auto made = simulate(scenario, folder.path / "virtual");
  ASSERT_TRUE(made);
  const test::Ran ran = test::run_program({"batch", made->artefact.string(), "--out", (folder.path / "out").string(), "--quiet"});
  EXPECT_EQ(ran.status, 0) << ran.out << ran.err;
}

}  // namespace
}  // namespace asbuilt
