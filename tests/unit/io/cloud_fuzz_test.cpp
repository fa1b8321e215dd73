// SPDX-License-Identifier: GPL-3.0-or-later
// Bytes changed, cut, doubled and inserted at random: the readers answer with points or a refusal, never with a crash, and never
// hold more points than the bytes could carry.
#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "planner/io/cloud_file.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/io/urdf.hpp"
#include "tests/unit/io/cloud_text.hpp"

namespace asbuilt {
namespace {

TEST(CloudFuzz, no_bytes_break_the_readers) {
  const auto layouts = test::all_layouts(test::some_points(12));
  std::mt19937_64 engine(20261122);
  std::size_t read = 0, refused = 0;
  for (int round = 0; round < 600; ++round)
    for (const auto& [name, bytes] : layouts) {
      const std::string changed = test::mutated(bytes, engine);
      const auto cloud = read_cloud(changed, "f");
      if (!cloud) {
        ++refused;
        EXPECT_FALSE(cloud.error().empty());
        EXPECT_FALSE(cloud.error()[0].code.empty() || cloud.error()[0].message.empty());
        continue;
      }
      ++read;
      EXPECT_LE(cloud->points.size() + cloud->dropped_count, changed.size());
      for (const auto& p : cloud->points) ASSERT_TRUE(p.allFinite()) << name;
    }
  EXPECT_GT(read, 1000u);
  EXPECT_GT(refused, 1000u);
}

TEST(CloudFuzz, no_bytes_break_the_urdf_reader) {
  std::string urdf =
      "<robot name=\"r\"><link name=\"b\"><collision><origin xyz=\"0 0 1\" rpy=\"0 0 0\"/><geometry><box size=\"1 1 "
      "1\"/></geometry></collision></link>";
  for (int j = 1; j <= 6; ++j) {
    const std::string n = std::to_string(j), parent = j == 1 ? "b" : "l" + std::to_string(j - 1);
    urdf += "<link name=\"l" + n + "\"/><joint name=\"j" + n + "\" type=\"revolute\"><parent link=\"" + parent + "\"/><child link=\"l" + n +
            "\"/><origin xyz=\"0 0 0.1\"/><axis xyz=\"0 1 0\"/><limit lower=\"-1\" upper=\"1\" velocity=\"2\" effort=\"0\"/></joint>";
  }
  urdf += "</robot>";
  ASSERT_TRUE(read_urdf(urdf, "r.urdf", "b", "l6"));
  std::mt19937_64 engine(7);
  for (int round = 0; round < 20000; ++round) {
    const auto robot = read_urdf(test::mutated(urdf, engine), "r.urdf", "b", "l6");
    EXPECT_TRUE(robot || !robot.error()[0].code.empty());
  }
}

}  // namespace
}  // namespace asbuilt
