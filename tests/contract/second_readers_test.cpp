// SPDX-License-Identifier: GPL-3.0-or-later
// A second opinion on the emitted text: parsers written by other people, where they are at hand (../shared/judge), must accept
// every program without an issue and see the same motions, speeds and spindle.
#include <gtest/gtest.h>

#include <cstdlib>
#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/support/foreign_case.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;
namespace fs = std::filesystem;

TEST(PostSecondOpinion, foreign_readers_see_the_same_motions) {
  if (!fs::exists("../shared/judge/vc/programs.py")) GTEST_SKIP() << "no second set of readers beside the project";
  const fs::path work = fs::path(testing::TempDir()) / "post_second_opinion";
  fs::remove_all(work);
  PostContext context = post_context();
  for (int seed = 1; seed <= 30; ++seed) {
    // every third program in another orientation mode, every second in the other speed unit, every fifth in a user frame or in modules
    auto& options = context.cell.controller.options;
    context.cell.controller.orientation = std::array{BeckhoffOrientation::cba, BeckhoffOrientation::ypr, BeckhoffOrientation::euler}[seed % 3];
    context.cell.controller.speed_unit = seed % 2 ? SpeedUnit::mm_s : SpeedUnit::cm_min;
    options.erase("inform.user_frame"), options.erase("krl.max_lines"), options.erase("inform.max_lines");
    if (seed % 5 == 0) options["inform.user_frame"] = "7";
    if (seed % 5 == 1) options["krl.max_lines"] = options["inform.max_lines"] = "50";
    const Program p = random_program(seed, {.has_two_tools = false, .has_new_frames = seed % 5 != 0, .has_equipment = false, .has_splines = false});
    std::vector<ProgramText> texts;
    for (const Post& post : posts()) {
      if (post.language != Language::krl && post.language != Language::inform && post.language != Language::beckhoff) continue;  // those the foreign readers know
      auto text = post.write(p, context);
      ASSERT_TRUE(text) << text_of(text.error());
      texts.push_back(*std::move(text));
    }
    write_foreign_case(work / std::to_string(seed), context, {context.cell.tools[0]}, p, texts);
  }
  const std::string command = "/usr/bin/python3 tests/contract/second_readers.py ../shared/judge " + work.string();
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
}

/// The ISO part of Beckhoff programs in the interpreter of a machine control, where it is installed (rs274 of linuxcnc-uspace; RS274
/// names it elsewhere, as in `apt-get download linuxcnc-uspace; dpkg -x linuxcnc-uspace*.deb DIR; export RS274=DIR/usr/bin/rs274`): the canonical motions it makes are the planned ones, in the work frame. Commands with # and the G words it
/// does not know are taken out first; its exit status says nothing, its text does.
TEST(PostSecondOpinion, an_iso_interpreter_makes_the_same_motions) {
  const char* asked = std::getenv("RS274");
  const fs::path tool = asked ? asked : "/usr/bin/rs274";
  if (!fs::exists(tool)) GTEST_SKIP() << "no rs274 (package linuxcnc-uspace); RS274 may name it";
  const fs::path work = fs::path(testing::TempDir()) / "post_iso";
  fs::create_directories(work);
  std::ofstream(work / "tool.tbl") << "T1 P1 Z0\n";
  std::ofstream(work / "var") << "";
  const PostContext context = post_context();
  int motions = 0;
  for (int seed = 1; seed <= 40; ++seed) {
    const Program p = random_program(seed, {.has_two_tools = false, .has_equipment = false, .has_splines = false});
    const auto text = find_post(Language::beckhoff)->write(p, context);
    ASSERT_TRUE(text);
    std::istringstream in(text->files[0].bytes);
    std::ofstream out(work / "a.ngc");
    for (std::string line; std::getline(in, line);) {
      line.pop_back();
      if (line[0] == '%' || line[0] == ';') continue;
      line.erase(0, line.find(' ') + 1);
      if (line[0] == '#' || line[0] == 'T') continue;
      const auto change = [&](const std::string& a, const std::string& b) {
        if (const std::size_t at = line.find(a); at != std::string::npos) line.replace(at, a.size(), b);
      };
      change("G71", "G21"), change("G261 ", ""), change("G260 ", ""), change("G04 X", "G04 P");
      if (line[0] == 'M' && line != "M30" && line != "M05") continue;
      if (line == "G260") continue;
      out << line << "\n";
    }
    out.close();
    const std::string command = "cd " + work.string() + " && LD_LIBRARY_PATH=" + (tool.parent_path().parent_path() / "lib").string() + " " + tool.string() +
                                " -g -n 0 -t tool.tbl -v var a.ngc > canon.txt 2> errors.txt";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
    std::ifstream canon(work / "canon.txt");
    std::vector<std::pair<std::string, std::vector<double>>> calls;
    double feed = 0, spin = 0;
    bool is_turning = false;
    for (std::string line; std::getline(canon, line);) {
      const std::size_t at = line.find("N..... ");
      if (at == std::string::npos) continue;
      const std::string call = line.substr(at + 7, line.find('(', at) - at - 7);
      std::vector<double> v;
      std::string rest = line.substr(line.find('(', at) + 1);
      for (char& c : rest)
        if (c == ',' || c == ')') c = ' ';
      std::istringstream numbers(rest);
      for (double x; numbers >> x;) v.push_back(x);
      if (call == "SET_FEED_RATE" && !v.empty()) feed = v[0];
      if (call == "SET_SPINDLE_SPEED" && !v.empty()) spin = v.back();
      if (call == "START_SPINDLE_CLOCKWISE") is_turning = true;
      if (call == "STOP_SPINDLE_TURNING") is_turning = false;
      if (call == "STRAIGHT_FEED" || call == "ARC_FEED") v.push_back(feed), v.push_back(is_turning ? spin : 0), calls.push_back({call, v});
    }
    Pose<frame::Base, frame::Work> T_base_work;
    std::vector<Pose<frame::Base, frame::Work>> frames;  // as they stand in the text, one a motion
    std::istringstream again(text->files[0].bytes);
    for (std::string line; std::getline(again, line);) {
      const std::string head = "#CS DEF [1][";
      if (const std::size_t at = line.find(head); at != std::string::npos) {
        std::istringstream numbers(line.substr(at + head.size()));
        std::array<double, 6> v{};
        char comma = 0;
        for (double& x : v) numbers >> x >> comma;
        T_base_work = {quat_from_zyx(rad_from_deg(v[5]), rad_from_deg(v[4]), rad_from_deg(v[3])), Vec3(v[0], v[1], v[2])};
      }
      if (line.find(" X") != std::string::npos && line.find("G04") == std::string::npos) frames.push_back(T_base_work);
    }
    std::size_t k = 0;
    Vec3 before = Vec3::Zero();
    double rpm = 0;
    for (const Instruction& i : p.instructions) {
      if (const auto* s = std::get_if<SpindleOn>(&i)) rpm = s->rpm;
      if (std::holds_alternative<SpindleOff>(i)) rpm = 0;
      const auto* line = std::get_if<MoveLinear>(&i);
      const auto* arc = std::get_if<MoveCircular>(&i);
      if (!line && !arc && !std::holds_alternative<MoveJoint>(i)) continue;
      ASSERT_LT(k, calls.size()) << "seed " << seed;
      T_base_work = frames.at(k);
      const auto& [call, v] = calls[k++];
      ++motions;
      if (const auto* joint = std::get_if<MoveJoint>(&i)) {
        ASSERT_EQ(call, "STRAIGHT_FEED") << "seed " << seed;
        for (std::size_t n = 0; n < 6; ++n) ASSERT_NEAR(v[n], deg_from_rad(joint->q_rad[n]), 0.000061) << "seed " << seed;
        continue;
      }
      ASSERT_EQ(call, line ? "STRAIGHT_FEED" : "ARC_FEED") << "seed " << seed;
      ASSERT_NEAR(v[v.size() - 2], (line ? line->speed_mm_s : arc->speed_mm_s) * 60, 0.0051);
      ASSERT_NEAR(v.back(), rpm, 0.5);
      const Vec3 end = (T_base_work.inverse() * (line ? line->T_base_tool : arc->T_base_tool)).p_mm;
      if (line) {
        ASSERT_LT((Vec3(v[0], v[1], v[2]) - end).cwiseAbs().maxCoeff(), 0.00061) << "seed " << seed;
        const Eigen::Quaterniond q = quat_from_zyx(rad_from_deg(v[3]), rad_from_deg(v[4]), rad_from_deg(v[5]));  // the test cell's A B C by cba
        ASSERT_LT(quat_log((T_base_work.q * q).conjugate() * line->T_base_tool.q).norm(), 2e-6) << "seed " << seed;
        before = end;
        continue;
      }
      const Vec3 via = (T_base_work.inverse() * arc->T_base_via).p_mm, normal = (via - before).cross(end - via);
      int axis = 0;
      normal.cwiseAbs().maxCoeff(&axis);
      const int u = (axis + 1) % 3, w = (axis + 2) % 3;
      ASSERT_NEAR(v[0], end[u], 0.00061);
      ASSERT_NEAR(v[1], end[w], 0.00061);
      ASSERT_EQ(v[4] > 0, normal[axis] > 0) << "direction, seed " << seed;
      for (const Vec3& q : {before, via, end})
        ASSERT_NEAR(std::hypot(q[u] - v[2], q[w] - v[3]), std::hypot(end[u] - v[2], end[w] - v[3]), 0.03) << "seed " << seed;
      before = end;
    }
    ASSERT_EQ(k, calls.size()) << "seed " << seed;
  }
  std::printf("%d motions compared\n", motions);
}

}  // namespace
}  // namespace asbuilt
