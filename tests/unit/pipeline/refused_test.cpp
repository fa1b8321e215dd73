// SPDX-License-Identifier: GPL-3.0-or-later
// Faults that only the pipeline can meet: an image that changes under a running batch, a fault of the program inside an inspection.
#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>

#include "planner/base/hash.hpp"
#include "planner/pipeline/frames.hpp"
#include "planner/pipeline/inspect_item.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

TEST(Refused, an_image_that_was_changed_while_the_batch_ran) {
  const std::filesystem::path root = "tests/refuse/stream_notes/slot-1";
  std::string name;
  for (const auto& e : std::filesystem::directory_iterator(root / "depth"))
    if (e.path().extension() == ".png") name = "depth/" + e.path().filename().string();
  ASSERT_FALSE(name.empty());
  test::TemporaryFolder folder;
  std::filesystem::create_directories(std::filesystem::path(folder.path) / "depth");
  std::filesystem::copy_file(root / name, std::filesystem::path(folder.path) / name);
  std::ifstream in(root / name, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  StreamFrame frame;
  frame.file = name, frame.sha256 = sha256_hex(bytes);
  const FrameSource frames = frames_under(folder.path);
  ASSERT_TRUE(frames(frame));
  std::ofstream(std::filesystem::path(folder.path) / name, std::ios::binary | std::ios::app) << "x";
  const auto changed = frames(frame);
  ASSERT_FALSE(changed);
  EXPECT_EQ(changed.error().front().code, "fuse.frame_changed");
  EXPECT_EQ(changed.error().front().where, name);
  std::filesystem::remove(std::filesystem::path(folder.path) / name);
  EXPECT_EQ(frames(frame).error().front().code, "input.file_missing");
}

TEST(Refused, a_fault_of_the_program_in_an_inspection_is_that_items_failure) {
  Batch batch;
  batch.id = "b", batch.file = "tests/refuse/base/batch.yaml";
  const auto loaded = load_batch("tests/refuse/base/batch.yaml", {false, "2026-11-20"});
  ASSERT_TRUE(loaded);
  test::TemporaryFolder folder;
  InspectOptions options;
  options.item.out = folder.path, options.item.inputs = {false, "2026-11-20"};
  const InspectRecord r = inspect_item(loaded->artefact, loaded->artefact.items.front().id, options, [](const StageEvent&) { throw std::runtime_error("no paper"); });
  EXPECT_EQ(r.status, ItemStatus::failed);
  ASSERT_FALSE(r.reasons.empty());
  EXPECT_EQ(r.reasons.back().code, "inspect.failed");
  EXPECT_NE(r.reasons.back().message.find("no paper"), std::string::npos);
  EXPECT_TRUE(r.programs.empty());
}

}  // namespace
}  // namespace asbuilt
