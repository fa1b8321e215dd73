// SPDX-License-Identifier: GPL-3.0-or-later
// The generated batches beside the project load whole; skipped where they are absent.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "planner/inputs/inputs.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

std::string text_of(const Refusals& all) {
  std::string text;
  for (const Refusal& r : all) text += r.code + " | " + r.where + " | " + r.message + "\n";
  return text;
}

class SharedBatch : public testing::TestWithParam<const char*> {};

TEST_P(SharedBatch, loads) {
  const fs::path file = fs::path("../shared/data/batches") / GetParam() / "batch/batch.yaml";
  if (!fs::exists(file)) GTEST_SKIP() << "no " << file;
  const auto batch = load_batch(file, {});
  ASSERT_TRUE(batch) << text_of(batch.error());
  const std::string id = batch->artefact.items.at(0).id;
  const auto job = load_job(batch->artefact, id, {});
  ASSERT_TRUE(job) << text_of(job.error());
  const Job& j = job->artefact;
  EXPECT_EQ(j.cell.robot.links.size(), 7u);
  EXPECT_TRUE(j.cell.sensors.at(0).is_calibrated && j.cell.sensors.at(1).is_calibrated);
  EXPECT_EQ(j.taken, "2026-11-22");
  for (const Capture& c : j.captures) {
    EXPECT_GT(c.points_sensor.size(), 1000u);
    EXPECT_GT(c.T_base_flange.p_mm.norm(), 500);
  }
  EXPECT_EQ(job_inputs_hash(batch->artefact, id, {}), job_inputs_hash(batch->artefact, id, {}));
  EXPECT_TRUE(job->notes.empty());
  for (const FeatureSpec& f : j.part.features)
    for (const int e : f.edges) EXPECT_EQ(j.part.brep.edges[std::size_t(e)].kind, EdgeKind::sharp_convex);
}

TEST(Inputs, files_of_the_house_are_read) {
  std::size_t count = 0;
  for (const char* folder : {"parts", "fixtures"}) {
    if (!fs::exists(folder)) continue;
    for (const auto& e : fs::recursive_directory_iterator(folder)) {
      if (e.path().extension() != ".yaml") continue;
      std::ifstream in(e.path());
      std::string line;
      while (std::getline(in, line) && line.rfind("asbuilt:", 0) != 0) {
      }
      if (line.rfind("asbuilt:", 0) != 0) continue;
      const std::string kind = line.substr(9, line.find('/') - 9);
      const auto kinds = file_kinds();
      if (std::find(kinds.begin(), kinds.end(), kind) == kinds.end()) continue;  // a scenario is the simulator's
      const Refusals faults = check_file(kind, e.path());
      EXPECT_TRUE(faults.empty()) << e.path() << "\n" << text_of(faults);
      ++count;
    }
  }
  EXPECT_TRUE(count > 0 || !fs::exists("parts"));
}

INSTANTIATE_TEST_SUITE_P(Inputs, SharedBatch, testing::Values("ring", "bracket", "casting"));

}  // namespace
}  // namespace asbuilt
