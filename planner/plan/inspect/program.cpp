// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/program.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/plan/program/program.hpp"

namespace asbuilt {

namespace {

constexpr double kHomeSpeed_ratio = 0.2;

std::string ascii(const std::string& text) {
  std::string out;
  for (const char c : text) out += static_cast<unsigned char>(c) >= 0x20 && static_cast<unsigned char>(c) < 0x7F ? c : '?';
  return out;
}

/// The tool that rides along: the one the planner took.
const ToolSpec* tool_of(const Job& job) {
  for (const FeatureSpec& f : job.part.features)
    if (!f.edges.empty()) {
      const Recipe* r = job.recipe(f.recipe);
      if (r != nullptr && !r->tool.empty()) return job.tool(r->tool);
    }
  return job.cell.tools.empty() ? nullptr : &job.cell.tools.front();
}

}  // namespace

std::string inspection_program_name(const std::string& item_id) { return program_name(item_id.size() <= 19 ? item_id + "_scan" : item_id.substr(0, 13) + "_scan_" + item_id.substr(13)); }

Result<Done<Program>> plan_inspection_program(const InspectionProgramRecipe& recipe, const Job& job, const Location& location, const Inspection& inspection) {
  if (inspection.motion.segments.empty() || inspection.stops.size() != inspection.motion.segments.size())
    return refuse({.code = "inspect.no_motion", .where = "item " + job.item_id, .message = "there is no motion to write a program from", .stage = "inspect"});
  const ToolSpec* tool = tool_of(job);
  if (tool == nullptr)
    return refuse({.code = "inspect.tool", .where = "cell.tools", .message = "the program has to name a tool and the cell has none", .measured = 0, .limit = 1, .unit = "tools", .stage = "inspect"});
  Done<Program> done;
  Program& p = done.artefact;
  p.name = inspection_program_name(job.item_id);
  const auto line = [&](const std::string& text) { p.header.push_back(ascii(text)); };
  line("scan of item " + job.item_id + " of batch " + job.batch_id + ", " + std::to_string(inspection.views.size()) + " views");
  line("part " + job.part.id + ", planned for " + job.taken);
  line("calibration of " + job.calibration_created + ", valid " + std::to_string(job.calibration_valid_days) + " days");
  for (const InputFile& f : job.inputs) line("input " + f.sha256.substr(0, 12) + " " + f.path);
  double least = 1, sd = 0;
  for (const EdgeForecast& f : inspection.edges) least = std::min(least, f.coverage_ratio), sd = std::max(sd, f.sd_worst_mm);
  line("forecast: " + std::to_string(inspection.edges.size()) + " edges, least coverage " + fixed_number(100 * least, 1) + " %, greatest sd of a leg " + fixed_number(sd, 3) + " mm");
  line("not run on a controller");

  p.instructions.push_back(SetTool{tool->number, tool->T_flange_tool});
  p.instructions.push_back(SetFrame{printed_frame(location.T_base_part)});
  const auto move = [&](const JointVector& q, double ratio) {
    MoveJoint m;
    m.q_rad = q, m.speed_ratio = ratio;
    p.instructions.push_back(m);
  };
  move(job.cell.robot.home_rad, kHomeSpeed_ratio);
  for (std::size_t k = 0; k < inspection.motion.segments.size(); ++k) {
    const MotionSegment& s = inspection.motion.segments[k];
    const double ratio = std::max(0.01, std::floor(s.speed_ratio * 100 + 1e-9) / 100);
    for (std::size_t i = 1; i < s.q_rad.size(); ++i) move(s.q_rad[i], ratio);
    const int stop = inspection.stops[k];
    if (stop < 0) continue;
    const ScanView& v = inspection.views[static_cast<std::size_t>(stop)];
    if (recipe.settle_s > 0) p.instructions.push_back(Wait{recipe.settle_s});
    p.instructions.push_back(Comment{ascii(("take " + v.name).substr(0, 32))});
    p.instructions.push_back(Wait{recipe.exposure_s});
  }
  return done;
}

}  // namespace asbuilt
