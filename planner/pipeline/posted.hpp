// SPDX-License-Identifier: GPL-3.0-or-later
// One program in one dialect: written, read back, compared with the plan. Internal to the room.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "planner/artefacts/program.hpp"
#include "planner/artefacts/program_text.hpp"
#include "planner/artefacts/verdict.hpp"
#include "planner/base/result.hpp"
#include "planner/verify/verify.hpp"
#include "postprocessors/post.hpp"
#include "postprocessors/rounding.hpp"

namespace asbuilt {

/// A program as it was written, and as it was read back from what was written.
struct Posted {
  ProgramText text;
  Program read_back;
  std::vector<Check> checks;  // lint, and planned against read back
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("text", s.text), a("read_back", s.read_back), a("checks", s.checks);
  }
};

/// The last digits that the dialect prints for this machine.
inline PrintedSteps printed_steps(const Post& post, const PostContext& context) {
  double max_rpm = 0;
  for (const ToolSpec& t : context.cell.tools) max_rpm = std::max(max_rpm, t.spindle.max_rpm);
  const bool is_euler = (post.language == Language::beckhoff && context.cell.controller.orientation == BeckhoffOrientation::euler) ||
                        (post.language == Language::nci && context.cell.controller.options.count("nci.orientation") && context.cell.controller.options.at("nci.orientation") == "euler");
  return {post.position_step_mm, post.angle_step_rad, post.speed_step_mm_s, post.joint_step_rad(context), post.joint_speed_step_ratio,
          std::max(1.0, post.spindle_step_ratio * max_rpm), post.time_step_s,
          post.language == Language::ur ? PrintedSteps::Angles::vector : is_euler ? PrintedSteps::Angles::turns_zyz : PrintedSteps::Angles::turns_zyx, post.arcs == Post::Arcs::anywhere, keeps_rounding(post, context) ? post.blend_step_mm : 0};
}
/// The program as the dialect can say it: outputs on the path become points where it has none, and where the cell asks for it straight moves
/// become arcs or splines. What is written and what is read back is compared with this. Refuses post.option.
Result<Program> shaped_for(const Post& post, const Program& program, const PostContext& context);
/// Refuses what the dialect cannot say, and what its reader does not take back.
Result<Done<Posted>> write_and_read_back(const Post& post, const Program& program, const PostContext& context);
/// A failed check as a refusal; none of a verdict without checks is let through either.
Refusals refusals_of(const Verdict& verdict, const std::string& what);

}  // namespace asbuilt
