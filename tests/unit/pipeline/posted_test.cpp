// SPDX-License-Identifier: GPL-3.0-or-later
// From the plan to one dialect and back: arcs where the cell asks for them, what the header says of the controller and of runs on it.
#include <gtest/gtest.h>

#include "planner/pipeline/posted.hpp"
#include "planner/verify/replay.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using support::post_context;
using support::text_of;

const Eigen::Quaterniond kTurn = quat_from_zyx(0.4, 0, 0);
const Vec3 kCentre(1200, 50, 700);
constexpr double kRadius_mm = 50;

/// Straight moves round a horizontal circle, rounded into each other; the tool down, the frame turned about z.
Program round_program(const PostContext& context, const Eigen::Quaterniond& q = kTurn * quat_from_zyx(0.2, 0.1, 2.9)) {
  Program p;
  p.name = "ROUND";
  p.header = {"item round", "not run on a controller"};
  const auto at = [&](int i) {
    const double t = 5.5 * i / 280;
    return Pose<frame::Base, frame::Tool>(q, kCentre + kTurn * Vec3(kRadius_mm * std::cos(t), kRadius_mm * std::sin(t), 0));
  };
  p.instructions = {SetTool{1, context.cell.tools[0].T_flange_tool}, SetFrame{Pose<frame::Base, frame::Work>(kTurn, kCentre)}, MoveJoint{context.cell.robot.home_rad, 0.3}, MoveLinear{at(0), 20, true, 0}};
  for (int i = 1; i <= 280; ++i) p.instructions.emplace_back(MoveLinear{at(i), 20, i == 280, i == 280 ? 0 : 0.1});
  p.instructions.emplace_back(MoveJoint{context.cell.robot.home_rad, 0.3});
  return p;
}

TEST(Posted, arcs_that_are_emitted_replay_on_the_planned_circle) {
  for (const Post& post : posts()) {
    if (!post.has_rounding) continue;
    PostContext context = post_context();
    context.cell.controller.options[std::string(name_of(post.language)) + ".arcs"] = "0.005";
    const auto posted = write_and_read_back(post, round_program(context), context);
    ASSERT_TRUE(posted) << text_of(posted.error());
    for (const Check& c : posted->artefact.checks) EXPECT_TRUE(c.is_passed) << name_of(post.language) << " " << c.name << " " << c.where;
    const Program& back = posted->artefact.read_back;
    int arcs = 0, lines = 0;
    for (const Instruction& i : back.instructions) arcs += std::holds_alternative<MoveCircular>(i), lines += std::holds_alternative<MoveLinear>(i);
    EXPECT_EQ(arcs, 3) << name_of(post.language);
    EXPECT_EQ(lines, 1);
    const verifying::Arm arm(context.cell.robot);
    const verifying::Replay r = verifying::replay(context.cell, arm, back, {});
    EXPECT_TRUE(r.unreached.empty());
    int on_the_circle = 0;
    for (const verifying::Sample& s : r.samples) {
      if (s.is_joint || !std::holds_alternative<MoveCircular>(back.instructions[static_cast<std::size_t>(s.instruction)])) continue;
      const Vec3 d = kTurn.conjugate() * (s.T_base_tool.p_mm - kCentre);
      EXPECT_NEAR(d.head<2>().norm(), kRadius_mm, 0.005 + 0.0009);
      EXPECT_NEAR(d.z(), 0, 0.0009);
      EXPECT_NEAR(s.speed_mm_s, 20, 0.051);
      ++on_the_circle;
    }
    EXPECT_GT(on_the_circle, 100);
  }
}

TEST(Posted, orientation_turns_at_most_five_degrees_a_block) {
  const PostContext context = post_context();
  const Post& post = *find_post(Language::krl);
  for (const double step_deg : {4.9, 5.1}) {
    const Pose<frame::Base, frame::Flange> T_base_flange(verifying::Arm(context.cell.robot).flange(context.cell.robot.home_rad));
    Program p = round_program(context, (T_base_flange * context.cell.tools[0].T_flange_tool).q);  // as the tool stands at home
    auto& T = std::get<MoveLinear>(p.instructions[p.instructions.size() - 2]).T_base_tool;
    T.q = T.q * quat_exp(Vec3(0, 0, rad_from_deg(step_deg)));
    const auto posted = write_and_read_back(post, p, context);
    ASSERT_TRUE(posted) << text_of(posted.error());
    bool has_check = false;
    for (const Check& c : verify_program(context.cell, posted->artefact.read_back).checks)
      if (c.name == "orientation.step") {
        has_check = true;
        EXPECT_EQ(c.is_passed, step_deg < 5) << c.measured;
      }
    EXPECT_TRUE(has_check);
  }
}

TEST(Posted, the_header_says_for_which_controller_and_whether_one_has_run_it) {
  for (const Post& post : posts()) {
    PostContext context = post_context();
    const std::string language(name_of(post.language)), key = language + ".receipt";
    Program plan = round_program(context);
    if (!post.has_rounding) plan.instructions.resize(4), plan.instructions.emplace_back(MoveJoint{context.cell.robot.home_rad, 0.3});
    auto posted = write_and_read_back(post, plan, context);
    ASSERT_TRUE(posted) << text_of(posted.error());
    const auto header = [&] { return posted->artefact.read_back.header; };
    ASSERT_EQ(header().size(), 3u);
    EXPECT_EQ(header()[1].find("controller " + language + ": "), 0u) << header()[1];
    EXPECT_EQ(header()[2], "not run on a controller");
    for (const Check& c : posted->artefact.checks) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
    context.cell.controller.options[key] = "0123456789abcdef 2026-11-20 A. Smith, cell 3";
    posted = write_and_read_back(post, plan, context);
    ASSERT_TRUE(posted) << text_of(posted.error());
    EXPECT_EQ(header()[2], "run on a controller: 0123456789abcdef 2026-11-20 A. Smith, cell 3");
    for (const Check& c : posted->artefact.checks) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
    for (const char* bad : {"yes", "0123456789 2026-11-20 A. Smith", "0123456789ab on Friday A. Smith", "0123456789ab 2026-11-23 A. Smith", "0123456789ab 2026-11-20"}) {
      context.cell.controller.options[key] = bad;
      const auto no = write_and_read_back(post, plan, context);
      ASSERT_FALSE(no) << bad;
      EXPECT_EQ(no.error().front().code, "post.receipt");
      EXPECT_EQ(no.error().front().where, "cell.yaml: controller." + key);
    }
  }
}

TEST(Posted, what_is_no_tolerance_and_no_kind_of_path_is_refused) {
  for (const auto& [key, value] : {std::pair{"krl.arcs", "wide"}, {"krl.arcs", "0.5"}, {"krl.arcs", "0.0001"}, {"inform.path", "curves"}}) {
    PostContext context = post_context();
    context.cell.controller.options[key] = value;
    const auto no = write_and_read_back(*find_post(key[0] == 'k' ? Language::krl : Language::inform), round_program(context), context);
    ASSERT_FALSE(no) << key << " " << value;
    EXPECT_EQ(no.error().front().code, "post.option");
  }
}

}  // namespace
}  // namespace asbuilt
