// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/posted.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "planner/verify/verify.hpp"

namespace asbuilt {

Result<Done<Posted>> write_and_read_back(const Post& post, const Program& program, const PostContext& context) {
  Posted posted;
  auto text = post.write(program, context);
  if (!text) return refuse_all(text.error());
  posted.text = std::move(*text);
  posted.checks = post.lint(posted.text, context);
  auto read_back = post.read(posted.text, context);
  if (!read_back) {
    Refusals why = read_back.error();
    for (Refusal& r : why) r.stage = "verify";
    return refuse_all(std::move(why));
  }
  posted.read_back = std::move(*read_back);
  double angle_step_rad = post.angle_step_rad;  // the last printed digit of an orientation or of a joint, whichever is coarser
  for (const double step : post.joint_step_rad(context)) angle_step_rad = std::max(angle_step_rad, step);
  const Verdict same = compare_programs(program, posted.read_back, post.position_step_mm, angle_step_rad, post.speed_step_mm_s);
  must(!same.checks.empty(), "the comparison of planned and read-back program made no check");
  posted.checks.insert(posted.checks.end(), same.checks.begin(), same.checks.end());
  return Done<Posted>{std::move(posted), {}};
}

Refusals refusals_of(const Verdict& verdict, const std::string& what) {
  Refusals reasons;
  for (const Check& c : verdict.checks)
    if (!c.is_passed)
      reasons.push_back({.code = "verify." + c.name,
                         .where = c.where,
                         .message = fmt::format("{}: check {} failed: {:.6g} {} where {:.6g} {} is allowed; nothing was emitted", what, c.name,
                                                c.measured, c.unit, c.limit, c.unit),
                         .measured = c.measured,
                         .limit = c.limit,
                         .unit = c.unit,
                         .stage = "verify"});
  if (verdict.checks.empty())
    reasons.push_back({.code = "verify.no_checks", .where = what, .message = what + ": not one check was made; nothing was emitted", .stage = "verify"});
  return reasons;
}

}  // namespace asbuilt
