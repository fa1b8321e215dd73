// SPDX-License-Identifier: GPL-3.0-or-later
// A second opinion on the emitted text: parsers written by other people, where they are at hand (../shared/judge), must accept
// every program without an issue and see the same motions, speeds and spindle.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "planner/base/archive.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;
namespace fs = std::filesystem;

Json matrix_of(const Pose<frame::Base, frame::Tool>& T) {
  const Eigen::Matrix4d m = T.matrix().matrix();
  Json rows = Json::array();
  for (int i = 0; i < 4; ++i) rows.push_back({m(i, 0), m(i, 1), m(i, 2), m(i, 3)});
  return rows;
}

TEST(PostSecondOpinion, foreign_readers_see_the_same_motions) {
  if (!fs::exists("../shared/judge/vc/programs.py")) GTEST_SKIP() << "no second set of readers beside the project";
  const fs::path work = fs::path(testing::TempDir()) / "post_second_opinion";
  fs::remove_all(work);
  const PostContext context = post_context();
  Json cell;
  cell["controller"]["inform"] = {{"pulses_per_degree", *context.cell.controller.pulses_per_degree}, {"speed_unit", "mm/s"}};
  cell["controller"]["beckhoff"]["orientation"] = "cba";
  for (const ToolSpec& t : {context.cell.tools[0]}) {
    const auto& T = t.T_flange_tool;
    cell["tools"].push_back({{"id", t.id}, {"number", t.number}, {"spindle", {{"max_rpm", t.spindle.max_rpm}, {"output", t.spindle.output}, {"analog", t.spindle.analog}}},
                             {"flange_tool", {{"xyz", {T.p_mm.x(), T.p_mm.y(), T.p_mm.z()}}, {"quat", {T.q.w(), T.q.x(), T.q.y(), T.q.z()}}}}});
  }
  for (int seed = 1; seed <= 30; ++seed) {
    const Program p = random_program(seed, {.has_two_tools = false});
    Json expected = Json::array();
    double rpm = 0;
    for (const Instruction& i : p.instructions) {
      if (const auto* s = std::get_if<SpindleOn>(&i)) rpm = s->rpm;
      if (std::holds_alternative<SpindleOff>(i)) rpm = 0;
      if (const auto* m = std::get_if<MoveJoint>(&i)) {
        Json q = Json::array();
        for (double v : m->q_rad) q.push_back(deg_from_rad(v));
        expected.push_back({{"kind", "joint"}, {"joints", q}});
      }
      if (const auto* m = std::get_if<MoveLinear>(&i))
        expected.push_back({{"kind", "line"}, {"pose", matrix_of(m->T_base_tool)}, {"speed", m->speed_mm_s}, {"spin", rpm}});
      if (const auto* m = std::get_if<MoveCircular>(&i))
        expected.push_back({{"kind", "arc"}, {"pose", matrix_of(m->T_base_tool)}, {"speed", m->speed_mm_s}, {"spin", rpm}});
    }
    const fs::path folder = work / std::to_string(seed);
    for (const Post& post : posts()) {
      const auto text = post.write(p, context);
      ASSERT_TRUE(text) << text_of(text.error());
      fs::create_directories(folder / name_of(post.language));
      for (const ProgramFile& f : text->files) std::ofstream(folder / name_of(post.language) / f.name, std::ios::binary) << f.bytes;
    }
    std::ofstream(folder / "cell.json") << cell.dump();
    std::ofstream(folder / "expected.json") << expected.dump();
  }
  const std::string command = "/usr/bin/python3 tests/contract/second_readers.py ../shared/judge " + work.string();
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
}

}  // namespace
}  // namespace asbuilt
