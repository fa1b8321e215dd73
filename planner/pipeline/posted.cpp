// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/posted.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "planner/base/number.hpp"
#include "planner/plan/program/arcs.hpp"

namespace asbuilt {

namespace {

/// What the text depends on besides the cell's geometry; the program's header states it, and the rules hold it against the cell.
std::string controller_line(const Post& post, const PostContext& context) {
  const ControllerSpec& c = context.cell.controller;
  const auto option = [&](const char* key, const std::string& otherwise = "") {
    const auto it = c.options.find(key);
    return it == c.options.end() ? otherwise : it->second;
  };
  std::string line;
  const auto part = [&](const std::string& head, const std::string& value) {
    if (!value.empty()) line += (line.empty() ? "" : ", ") + head + value;
  };
  if (post.language == Language::krl) {
    part("", option("krl.version", "KRC4"));
    part("serial_number ", option("krl.serial_number")), part("kernel ", option("krl.kernel"));
  } else if (post.language == Language::inform) {
    part("V in ", c.speed_unit ? std::string(name_of(*c.speed_unit)) : "");
    std::string pulses;
    for (std::size_t i = 0; c.pulses_per_degree && i < 6; ++i) pulses += (i ? " " : "") + fixed_number((*c.pulses_per_degree)[i], 5);
    part("pulses per degree ", pulses);
  } else if (post.language == Language::beckhoff) {
    part("A B C by ", c.orientation ? std::string(name_of(*c.orientation)) : "");
    part("kinematic ", c.kinematic_id ? std::to_string(*c.kinematic_id) : "");
  } else if (post.language == Language::nci) {
    part("Q1 Q2 Q3 by ", option("nci.orientation")), part("kinematics by M ", option("nci.kinematics"));
  } else {
    part("", "Polyscope");
  }
  return "controller " + std::string(name_of(post.language)) + ": " + line;
}

/// The header's last word: for which controller, and whether one has run a program of this post. A receipt is "DIGEST DATE who and what": the
/// SHA-256 of the program that ran (12 hex digits at least) and the day.
void sign_header(Program& out, const Post& post, const PostContext& context, Refusals& faults) {
  const auto line = std::find(out.header.begin(), out.header.end(), "not run on a controller");
  const std::string key = std::string(name_of(post.language)) + ".receipt";
  const auto it = context.cell.controller.options.find(key);
  if (it != context.cell.controller.options.end()) {
    const std::string& r = it->second;
    const std::size_t digest = std::min(r.find(' '), r.size());
    const auto refuse_it = [&](const std::string& why) {
      faults.push_back({.code = "post.receipt", .where = "cell.yaml: controller." + key, .message = "\"" + r + "\" " + why + "; give it as \"SHA256 2026-11-22 NAME, CONTROLLER\" or leave it out", .stage = "post"});
    };
    const std::string date = digest < r.size() ? r.substr(digest + 1, 10) : "";
    bool is_date = date.size() == 10 && date[4] == '-' && date[7] == '-';
    for (std::size_t i : {0u, 1u, 2u, 3u, 5u, 6u, 8u, 9u}) is_date = is_date && date[i] >= '0' && date[i] <= '9';
    if (digest < 12 || r.find_first_not_of("0123456789abcdef") < digest) refuse_it("does not begin with the digest of the program that ran");
    else if (!is_date) refuse_it("does not tell the day of the run");
    else if (date > context.date.substr(0, 10)) refuse_it("tells of a run after " + context.date);
    else if (r.size() < digest + 13) refuse_it("does not tell who ran it, and where");
    else if (line != out.header.end()) *line = "run on a controller: " + r;
  }
  if (line != out.header.end()) out.header.insert(line, controller_line(post, context));
}

}  // namespace

// `arcs: 0.005` (mm) and `path: splines` in the controller's block.
Result<Program> shaped_for(const Post& post, const Program& program, const PostContext& context) {
  Refusals faults;
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
  sign_header(out, post, context, faults);
  if (!faults.empty()) return refuse_all(std::move(faults));
  return out;
}

Result<Done<Posted>> write_and_read_back(const Post& post, const Program& planned, const PostContext& context) {
  Posted posted;
  auto shaped = shaped_for(post, planned, context);
  if (!shaped) return refuse_all(shaped.error());
  const Program& program = *shaped;
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
  const Verdict same = compare_programs(program, posted.read_back, printed_steps(post, context));
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
