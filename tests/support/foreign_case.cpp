// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/support/foreign_case.hpp"

#include <fstream>

#include "planner/base/archive.hpp"

namespace asbuilt::support {
namespace {

Json matrix_of(const Pose<frame::Base, frame::Tool>& T) {
  const Eigen::Matrix4d m = T.matrix().matrix();
  Json rows = Json::array();
  for (int i = 0; i < 4; ++i) rows.push_back({m(i, 0), m(i, 1), m(i, 2), m(i, 3)});
  return rows;
}

Json cell_of(const ControllerSpec& c, const std::vector<ToolSpec>& tools) {
  Json cell;
  if (c.pulses_per_degree) cell["controller"]["inform"]["pulses_per_degree"] = *c.pulses_per_degree;
  if (c.speed_unit) cell["controller"]["inform"]["speed_unit"] = std::string(name_of(*c.speed_unit));
  if (c.orientation) cell["controller"]["beckhoff"]["orientation"] = std::string(name_of(*c.orientation));
  for (const ToolSpec& t : tools) {
    const auto& T = t.T_flange_tool;
    cell["tools"].push_back({{"id", t.id},
                             {"number", t.number},
                             {"spindle", {{"max_rpm", t.spindle.max_rpm}, {"output", t.spindle.output}, {"analog", t.spindle.analog}}},
                             {"flange_tool", {{"xyz", {T.p_mm.x(), T.p_mm.y(), T.p_mm.z()}}, {"quat", {T.q.w(), T.q.x(), T.q.y(), T.q.z()}}}}});
  }
  return cell;
}

Json motions_of(const Program& plan) {
  Json motions = Json::array();
  double rpm = 0;
  for (const Instruction& i : plan.instructions) {
    if (const auto* s = std::get_if<SpindleOn>(&i)) rpm = s->rpm;
    if (std::holds_alternative<SpindleOff>(i)) rpm = 0;
    if (const auto* m = std::get_if<MoveJoint>(&i)) {
      Json q = Json::array();
      for (double v : m->q_rad) q.push_back(deg_from_rad(v));
      motions.push_back({{"kind", "joint"}, {"joints", q}});
    }
    if (const auto* m = std::get_if<MoveLinear>(&i))
      motions.push_back({{"kind", "line"}, {"pose", matrix_of(m->T_base_tool)}, {"speed", m->speed_mm_s}, {"spin", rpm}});
    if (const auto* m = std::get_if<MoveCircular>(&i))
      motions.push_back({{"kind", "arc"}, {"pose", matrix_of(m->T_base_tool)}, {"speed", m->speed_mm_s}, {"spin", rpm}});
  }
  return motions;
}

}  // namespace

void write_foreign_case(const std::filesystem::path& folder, const PostContext& context, const std::vector<ToolSpec>& tools, const Program& plan,
                        const std::vector<ProgramText>& texts) {
  std::filesystem::create_directories(folder);
  for (const ProgramText& text : texts) {
    const auto in = folder / std::string(name_of(text.language));
    std::filesystem::create_directories(in);
    for (const ProgramFile& f : text.files) std::ofstream(in / f.name, std::ios::binary) << f.bytes;
  }
  std::ofstream(folder / "cell.json") << cell_of(context.cell.controller, tools).dump();
  std::ofstream(folder / "expected.json") << motions_of(plan).dump();
}

}  // namespace asbuilt::support
