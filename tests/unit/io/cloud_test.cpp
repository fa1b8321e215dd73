// SPDX-License-Identifier: GPL-3.0-or-later
// Every layout of a cloud gives the same points; what is cut off, broken or not a number is found and named.
#include "planner/io/cloud_file.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "planner/io/file.hpp"
#include "planner/io/mesh_file.hpp"
#include "tests/unit/io/cloud_text.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

std::string text_of(const Refusals& all) {
  std::string text;
  for (const Refusal& r : all) text += r.code + " | " + r.where + " | " + r.message + "\n";
  return text;
}

TEST(Cloud, every_layout_gives_the_same_points) {
  const auto points = test::some_points(100);
  for (const auto& [name, bytes] : test::all_layouts(points)) {
    const auto cloud = read_cloud(bytes, name);
    ASSERT_TRUE(cloud) << name << "\n" << text_of(cloud.error());
    EXPECT_EQ(cloud->points, points) << name;
    EXPECT_EQ(cloud->dropped_count, 0u) << name;
  }
}

TEST(Cloud, line_ends_of_windows_are_read) {
  std::string bytes = test::ply(test::some_points(5), {.format = "ascii"});
  for (std::size_t i = bytes.find('\n'); i != std::string::npos; i = bytes.find('\n', i + 2)) bytes.insert(i, "\r");
  const auto cloud = read_cloud(bytes, "a.ply");
  ASSERT_TRUE(cloud) << text_of(cloud.error());
  EXPECT_EQ(cloud->points, test::some_points(5));
}

TEST(Cloud, points_that_are_no_numbers_are_dropped_and_counted) {
  auto points = test::some_points(20);
  points[3].y() = std::numeric_limits<float>::quiet_NaN();
  points[7].x() = std::numeric_limits<float>::infinity();
  points[19].z() = -std::numeric_limits<float>::infinity();
  for (const auto& [name, bytes] : test::all_layouts(points)) {
    const auto cloud = read_cloud(bytes, name);
    ASSERT_TRUE(cloud) << name << "\n" << text_of(cloud.error());
    EXPECT_EQ(cloud->points.size(), 17u) << name;
    EXPECT_EQ(cloud->dropped_count, 3u) << name;
    EXPECT_EQ(cloud->points[3], points[4]) << name;
  }
}

TEST(Cloud, windows_spellings_of_nan_are_no_measurement) {
  const auto cloud = read_cloud("1 2 3\n1.#QNAN 2 3\n-1.#IND 0 0\nnan 0 0\n1e400 0 0\n4 5 6\n", "a.xyz");
  ASSERT_TRUE(cloud);
  EXPECT_EQ(cloud->points.size(), 2u);
  EXPECT_EQ(cloud->dropped_count, 4u);
}

TEST(Cloud, every_cut_of_a_binary_file_is_refused) {
  const auto points = test::some_points(9);
  for (const auto& [name, bytes] : test::all_layouts(points)) {
    if (name.find("binary") == std::string::npos) continue;
    for (std::size_t n = 0; n < bytes.size(); ++n) {
      const auto cloud = read_cloud(std::string_view(bytes).substr(0, n), "cut");
      ASSERT_FALSE(cloud) << name << " cut at " << n << " of " << bytes.size();
      EXPECT_EQ(cloud.error()[0].stage, "input");
      EXPECT_EQ(cloud.error()[0].where.substr(0, 3), "cut");
    }
  }
}

TEST(Cloud, a_text_that_ends_early_is_refused_with_its_line) {
  const std::string bytes = test::ply(test::some_points(10), {.format = "ascii"});
  const auto cloud = read_cloud(bytes.substr(0, bytes.size() - 60), "a.ply");
  ASSERT_FALSE(cloud);
  EXPECT_EQ(cloud.error()[0].code, "input.cloud_truncated");
  EXPECT_EQ(cloud.error()[0].where.substr(0, 6), "a.ply:");
  EXPECT_EQ(cloud.error()[0].limit, 10);
}

struct Broken {
  const char *code, *where, *bytes;
};
class BrokenCloud : public testing::TestWithParam<Broken> {};
TEST_P(BrokenCloud, is_refused) {
  const auto cloud = read_cloud(GetParam().bytes, "f");
  ASSERT_FALSE(cloud);
  EXPECT_EQ(cloud.error()[0].code, GetParam().code) << text_of(cloud.error());
  EXPECT_EQ(cloud.error()[0].where, GetParam().where) << text_of(cloud.error());
}
INSTANTIATE_TEST_SUITE_P(
    Cloud, BrokenCloud,
    testing::Values(
        Broken{"input.cloud_header", "f:2", "ply\nformat binary 1.0\nend_header\n"},  //
        Broken{"input.cloud_header", "f:3", "ply\nformat ascii 1.0\nelement vertex -1\nend_header\n"},
        Broken{"input.cloud_header", "f:3", "ply\nformat ascii 1.0\nelement vertex 99999999999999999999\nend_header\n"},
        Broken{"input.cloud_header", "f:3", "ply\nformat ascii 1.0\nproperty float x\nend_header\n"},
        Broken{"input.cloud_header", "f:4", "ply\nformat ascii 1.0\nelement vertex 1\nproperty real x\nend_header\n"},
        Broken{"input.cloud_header", "f:2", "ply\nend_header\n"},
        Broken{"input.cloud_no_xyz", "f", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n"},
        Broken{"input.cloud_no_xyz", "f", "ply\nformat ascii 1.0\nelement face 1\nproperty float x\nend_header\n1\n"},
        Broken{"input.cloud_truncated", "f: byte 127",
               "ply\nformat binary_little_endian 1.0\nelement vertex 1099511627776\nproperty float x\nproperty float y\nproperty float "
               "z\nend_header\n"},
        Broken{"input.cloud_value", "f:8: y",
               "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2,5 3\n"},
        Broken{"input.cloud_value", "f:8",
               "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2\n1 2 3\n"},
        Broken{"input.cloud_value", "f:8",
               "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3 4\n"},
        Broken{"input.cloud_header", "f:3", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4\n"},
        Broken{"input.cloud_header", "f:4", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F Q\n"},
        Broken{"input.cloud_header", "f:5", "VERSION 0.7\nFIELDS x y z\nSIZE 3 4 4\nPOINTS 1\nDATA ascii\n1 2 3\n"},
        Broken{"input.cloud_no_xyz", "f:3", "VERSION 0.7\nPOINTS 1\nDATA ascii\n1 2 3\n"}, Broken{"input.cloud_format", "f", ""},
        Broken{"input.cloud_format", "f:1", "1 2\n"}, Broken{"input.cloud_format", "f: byte 1", "a\1 binary thing of some length\n"},
        Broken{"input.cloud_value", "f:2", "1 2 3\n1 zwei 3\n"}, Broken{"input.cloud_truncated", "f:2", "1 2 3\n1 2"}));

TEST(Cloud, a_compressed_bomb_is_refused_without_its_memory) {
  std::string bytes = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 100000000\nDATA binary_compressed\n";
  test::put(bytes, std::uint32_t(3)), test::put(bytes, std::uint32_t(1200000000));
  bytes += "\1aa";
  const auto cloud = read_cloud(bytes, "bomb.pcd");
  ASSERT_FALSE(cloud);
  EXPECT_EQ(cloud.error()[0].code, "input.cloud_value");
}

TEST(Cloud, compressed_data_that_do_not_expand_are_refused) {
  std::string bytes = "VERSION 0.7\nFIELDS x y z\nPOINTS 1\nDATA binary_compressed\n";
  test::put(bytes, std::uint32_t(5)), test::put(bytes, std::uint32_t(12));
  for (const char* packed : {"\x0b"
                             "abcd",
                             "\x01"
                             "ab"
                             "\x20\x09",
                             "\x01"
                             "ab"
                             "\x20\x01",
                             "\xe0\xff\x01"
                             "ab"}) {
    const auto cloud = read_cloud(bytes + packed, "c.pcd");
    ASSERT_FALSE(cloud);
    EXPECT_EQ(cloud.error()[0].code, "input.cloud_value");
    EXPECT_EQ(cloud.error()[0].where, "c.pcd: byte 57");
  }
}

TEST(Cloud, what_is_written_is_read) {
  const auto points = test::some_points(50);
  for (const bool has_more : {false, true}) {
    const std::vector<Eigen::Vector3f> normals(has_more ? 50 : 0, Eigen::Vector3f::UnitZ());
    const std::vector<float> sigma(has_more ? 50 : 0, 0.01f);
    const auto cloud = read_cloud(write_cloud_ply(points, normals, sigma), "w.ply");
    ASSERT_TRUE(cloud);
    EXPECT_EQ(cloud->points, points);
  }
}

TEST(File, is_written_whole_or_refused) {
  const fs::path folder = fs::path(testing::TempDir()) / "asbuilt_io_file";
  fs::remove_all(folder);
  const auto written = write_file(folder / "deep/a.txt", "hello");
  ASSERT_TRUE(written);
  EXPECT_EQ(written->bytes_count, 5u);
  EXPECT_EQ(*read_file(folder / "deep/a.txt", "a"), "hello");
  EXPECT_FALSE(fs::exists(folder / "deep/a.txt.part"));
  const auto blocked = write_file(folder / "deep/a.txt/b.txt", "x");
  ASSERT_FALSE(blocked);
  EXPECT_EQ(blocked.error()[0].code, "input.file_unwritable");
  fs::remove_all(folder);
}

struct RealCloud {
  const char* file;
  std::size_t points, dropped;
};
class RealClouds : public testing::TestWithParam<RealCloud> {};
TEST_P(RealClouds, are_read) {
  const fs::path file = fs::path("../shared/data/scans") / GetParam().file;
  if (!fs::exists(file)) GTEST_SKIP() << "no " << file;
  const auto bytes = read_file(file, file.string());
  ASSERT_TRUE(bytes);
  const auto cloud = read_cloud(*bytes, file.string());
  ASSERT_TRUE(cloud) << text_of(cloud.error());
  EXPECT_EQ(cloud->points.size(), GetParam().points);
  EXPECT_EQ(cloud->dropped_count, GetParam().dropped);
}
INSTANTIATE_TEST_SUITE_P(Cloud, RealClouds,
                         testing::Values(RealCloud{"bunny_raw/bun000.ply", 40256, 0}, RealCloud{"bunny_raw/top3.ply", 36023, 0},
                                         RealCloud{"bunny_raw/bun_zipper_res2.ply", 8171, 0}, RealCloud{"sick_tof_part/data.ply", 24397, 0},
                                         RealCloud{"sick_tof_part/V2D63xModel.ply", 77861, 0}, RealCloud{"uwa_chef_rs1/chef.pcd", 5092, 0},
                                         RealCloud{"uwa_chef_rs1/rs1.pcd", 289541, 0}));

}  // namespace
}  // namespace asbuilt
