// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include "planner/base/archive.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "planner/pipeline/store.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt {
namespace {

ItemRecord emitted() {
  ItemRecord r;
  r.item_id = "ring-0001";
  r.status = ItemStatus::emitted;
  Verdict good;
  good.checks = {{"path_error", 0.001, 0.01, "mm", "", true}};
  r.motion_verdict = good;
  r.programs = {{{Language::krl, {{"ring.src", "DEF ring()\r\nEND\r\n"}, {"ring.dat", "DEFDAT ring\r\nENDDAT\r\n"}}}, good}, {{Language::beckhoff, {{"ring.nc", "%ring\n"}}}, good}};
  return r;
}

TEST(Release, programs_lie_where_the_result_says_with_the_hash_it_says) {
  const test::TemporaryFolder folder;
  write_item(folder.path, emitted());
  const Json result = Json::parse(*read_file_whole(folder.path / "ring-0001" / "result.json"));
  std::size_t files = 0;
  for (const Json& p : result.at("programs"))
    for (const Json& f : p.at("files")) {
      const auto bytes = read_file_whole(folder.path / "ring-0001" / f.at("path").get<std::string>());
      ASSERT_TRUE(bytes) << f.dump();
      EXPECT_EQ(sha256_hex(*bytes), f.at("sha256").get<std::string>());
      ++files;
    }
  EXPECT_EQ(files, 3u);
  EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / ".programs"));
}

TEST(Release, a_refused_or_failed_item_leaves_no_program_of_an_earlier_run) {
  for (const ItemStatus status : {ItemStatus::refused, ItemStatus::failed}) {
    const test::TemporaryFolder folder;
    write_item(folder.path, emitted());
    ItemRecord later = emitted();
    later.status = status;
    later.reasons = {{.code = "verify.clearance", .message = "too near", .stage = "verify"}};
    write_item(folder.path, later);
    EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / "programs"));
    EXPECT_TRUE(Json::parse(*read_file_whole(folder.path / "ring-0001" / "result.json")).at("programs").empty());
  }
}

TEST(Release, a_program_with_a_failed_check_or_none_is_never_released) {
  for (const bool has_checks : {true, false}) {
    const test::TemporaryFolder folder;
    ItemRecord r = emitted();
    if (has_checks) r.programs[1].verdict.checks[0].is_passed = false;
    else r.programs[1].verdict.checks.clear();
    EXPECT_THROW(write_item(folder.path, r), Bug);
    EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / "programs"));
    EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / "result.json"));
  }
}

TEST(Release, withdrawing_keeps_what_is_not_ours) {
  const test::TemporaryFolder folder;
  write_item(folder.path, emitted());
  write_file_whole(folder.path / "ring-0001" / "notes of the shift.txt", "mine");
  withdraw_item(folder.path, "ring-0001");
  EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / "programs"));
  EXPECT_FALSE(std::filesystem::exists(folder.path / "ring-0001" / "result.json"));
  EXPECT_TRUE(std::filesystem::exists(folder.path / "ring-0001" / "notes of the shift.txt"));
}

}  // namespace
}  // namespace asbuilt
