// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/posted.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "planner/plan/program/arcs.hpp"
#include "planner/verify/verify.hpp"
#include "postprocessors/rounding.hpp"

namespace asbuilt {

namespace {

/// The program as a dialect can say it: outputs on the path become points where it has none, and where the cell asks for it
/// (`arcs: 0.005` mm, `path: splines` in the controller's block) straight moves become arcs or splines.
Program shaped(const Program& program, const Post& post, const PostContext& context, Refusals& faults) {
  const std::string block(name_of(post.language));
  const auto& options = context.cell.controller.options;
  Program out = post.has_path_events ? program : cut_at_outputs(program);
  if (const auto it = options.find(block + ".arcs"); it != options.end()) {
    ArcRecipe recipe;
    char* end = nullptr;
    recipe.tolerance_mm = std::strtod(it->second.c_str(), &end);
    if (*end || !(recipe.tolerance_mm >= 0.001) || recipe.tolerance_mm > 0.02)
      faults.push_back({.code = "post.option", .where = "cell.yaml: controller." + it->first, .message = "\"" + it->second + "\" is no tolerance from 0.001 to 0.02 mm", .measured = recipe.tolerance_mm, .limit = 0.02, .unit = "mm", .stage = "post"});
    else
      out = with_arcs(recipe, out, [&](const Vec3& a, const Vec3& via, const Vec3& b, const Pose<frame::Base, frame::Work>& T_base_work) {
        if (post.arcs == Post::Arcs::anywhere) return true;
        const Eigen::Quaterniond turn = post.arcs == Post::Arcs::in_planes_of_base ? Eigen::Quaterniond::Identity() : T_base_work.q;
        const Vec3 u = turn.conjugate() * (via - a), v = turn.conjugate() * (b - a);
        int axis = 0;
        u.cross(v).cwiseAbs().maxCoeff(&axis);
        return std::max(std::abs(u[axis]), std::abs(v[axis])) < 0.001;  // two printed digits may add to it
      });
  }
  if (const auto it = options.find(block + ".path"); it != options.end()) {
    if (it->second == "splines") out = with_splines(out);
    else if (it->second != "lines")
      faults.push_back({.code = "post.option", .where = "cell.yaml: controller." + it->first, .message = "\"" + it->second + "\" is neither lines nor splines", .stage = "post"});
  }
  return out;
}

}  // namespace

Result<Done<Posted>> write_and_read_back(const Post& post, const Program& planned, const PostContext& context) {
  Posted posted;
  Refusals faults;
  const Program program = shaped(planned, post, context, faults);
  if (!faults.empty()) return refuse_all(std::move(faults));
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
  double joint_step_rad = 0;  // the coarsest joint's last printed digit
  for (const double step : post.joint_step_rad(context)) joint_step_rad = std::max(joint_step_rad, step);
  const Verdict same = compare_programs(program, posted.read_back, post.position_step_mm, post.angle_step_rad, post.speed_step_mm_s, joint_step_rad,
                                        keeps_rounding(post, context) ? post.blend_step_mm : 0);
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
