// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> UR script: one function in one .script file. Facts and their confidence are in dialect.md. Metres, radians, seconds;
// poses in base with a rotation vector; every motion names its acceleration, speed and rounding.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "planner/base/number.hpp"
#include "postprocessors/ur/ur.hpp"
#include "postprocessors/writing.hpp"

namespace asbuilt::ur {
namespace {

using namespace writing;

constexpr int kMetre = 6, kRad = 7;

struct Machine {
  double path_m_s2 = 0, joint_rad_s2 = 0, slowest_rad_s = 0;
};

template <class A, class B>
std::string pose_text(const Pose<A, B>& T) {
  const Vec3 w = quat_log(T.q);
  std::string s = "p[";
  for (int i = 0; i < 3; ++i) s += fixed_number(T.p_mm[i] / 1000, kMetre) + ", ";
  for (int i = 0; i < 3; ++i) s += fixed_number(w[i], kRad) + (i < 2 ? ", " : "]");
  return s;
}

struct Writer {
  const PostContext& context;
  const Machine& machine;
  const std::string& name;
  Lines out{"\n"};
  const ToolSpec* tool = nullptr;
  Refusals faults;
  std::size_t at = 0;

  void add(const std::string& text) { out.add("  " + text); }
  void add_comment(std::string_view text) {
    for (const std::string& piece : pieces(text, 200)) {
      std::string line = "# " + piece;
      line.erase(line.find_last_not_of(' ') + 1);
      add(line);
    }
  }
  void bad(const char* code, const char* message) { faults.push_back(fault(code, name + ": instruction " + std::to_string(at + 1), message)); }
  std::string path_words(double speed_mm_s, bool is_exact, double blend_mm) const {
    return ", a=" + fixed_number(machine.path_m_s2, 3) + ", v=" + fixed_number(speed_mm_s / 1000, kMetre) + ", r=" + fixed_number(is_exact ? 0 : blend_mm / 1000, kMetre);
  }
  void output(int number, bool value) {  // 1 to 7 standard, 8 to 15 the configurable ones
    add((number > 7 ? "set_configurable_digital_out(" + std::to_string(number - 8) : "set_standard_digital_out(" + std::to_string(number)) + ", " + (value ? "True" : "False") + ")");
  }
  void speed(double ratio) { add("set_standard_analog_out(" + std::to_string(tool->spindle.analog) + ", " + fixed_number(ratio, 5) + ")"); }

  void operator()(const SetTool& s) {
    const ToolSpec* t = find_tool(context, s.number);
    if (t != tool) add("set_tcp(" + pose_text(t->T_flange_tool) + ")");
    tool = t;
  }
  void operator()(const SetFrame&) {}  // points are in base
  void operator()(const MoveJoint& m) {
    std::string q;
    for (std::size_t i = 0; i < 6; ++i) q += (i ? ", " : "") + fixed_number(m.q_rad[i], kRad);
    add("movej([" + q + "], a=" + fixed_number(machine.joint_rad_s2, 3) + ", v=" + fixed_number(m.speed_ratio * machine.slowest_rad_s, 6) + ")");
  }
  void operator()(const MoveLinear& m) { add("movel(" + pose_text(m.T_base_tool) + path_words(m.speed_mm_s, m.is_exact, m.blend_mm) + ")"); }
  void operator()(const MoveCircular& m) {
    add("movec(" + pose_text(m.T_base_via) + ", " + pose_text(m.T_base_tool) + path_words(m.speed_mm_s, m.is_exact, m.blend_mm) + ", mode=0)");
  }
  void operator()(const MoveSpline&) { bad("post.spline", "UR script has no splines through points; write straight moves"); }
  void operator()(const SpindleOn& s) { speed(s.rpm / tool->spindle.max_rpm), output(tool->spindle.output, true); }
  void operator()(const SpindleOff&) { output(tool->spindle.output, false), speed(0); }
  void operator()(const SetOutput& s) {
    if (s.output > 15) bad("post.output", "outputs are numbered up to 15");
    output(s.output, s.value);
  }
  void operator()(const OutputOnPath&) {}  // refused before
  void operator()(const SwitchOn&) { bad("post.equipment", "this post switches the spindle and outputs only; use SetOutput"); }
  void operator()(const SwitchOff&) {}
  void operator()(const Wait& w) { add("sleep(" + fixed_number(w.time_s, 3) + ")"); }
  void operator()(const Comment& c) { add_comment(c.text); }
};

double acceleration(const PostContext& context, const char* key, const char* ask, double greatest, Refusals& faults) {
  const auto text = option(context, key);
  const std::string where = std::string("cell.yaml: controller.") + key;
  if (!text) return faults.push_back(fault("post.missing_value", where, ask)), 0;
  char* end = nullptr;
  const double v = std::strtod(text->c_str(), &end);
  if (end == text->c_str() || *end || !(v >= 0.01) || v > greatest)
    faults.push_back(fault("post.option", where, "\"" + *text + "\" is no acceleration from 0.01 to " + shortest_number(greatest), v, greatest));
  return v;
}

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  Refusals faults = check(program, context, {.name_length = 60, .speed_min_mm_s = 0.01, .speed_max_mm_s = 3000, .wait_min_s = 0.001, .wait_max_s = 3600});
  check_options(context, "ur", {"acceleration", "joint_acceleration", "path", "arcs", "receipt"}, faults);
  Machine machine;
  machine.path_m_s2 = acceleration(context, "ur.acceleration", "every straight motion names its acceleration; give it in m/s2", 15, faults);
  machine.joint_rad_s2 = acceleration(context, "ur.joint_acceleration", "every joint motion names its acceleration; give it in rad/s2", 40, faults);
  machine.slowest_rad_s = 1e300;
  for (const JointSpec& j : context.cell.robot.joints) machine.slowest_rad_s = std::min(machine.slowest_rad_s, j.speed_rad_s);
  if (!(machine.slowest_rad_s > 0))
    faults.push_back(fault("post.missing_value", "cell.yaml: robot.joints[].speed", "joint moves need the joints' greatest speeds"));
  bool has_spindle = false;
  for (const Instruction& i : program.instructions) has_spindle |= std::holds_alternative<SpindleOn>(i) || std::holds_alternative<SpindleOff>(i);
  for (const Instruction& i : program.instructions)
    if (const auto* s = std::get_if<SetTool>(&i))
      if (const ToolSpec* t = find_tool(context, s->number); t && has_spindle && (t->spindle.output < 1 || t->spindle.output > 7 || t->spindle.analog < 1))
        faults.push_back(fault("post.missing_value", "cell.yaml: tools[" + t->id + "].spindle", "the spindle is switched by a standard output 1 to 7 and an analogue output; give both numbers"));
  if (!faults.empty()) return refuse_all(std::move(faults));

  Writer w{context, machine, program.name};
  w.out.add("def " + program.name + "():");
  for (const std::string& h : program.header) w.add_comment(h);
  for (w.at = 0; w.at < program.instructions.size(); ++w.at) std::visit(w, program.instructions[w.at]);
  w.out.add("end");
  if (!w.faults.empty()) return refuse_all(std::move(w.faults));
  return ProgramText{Language::ur, {{program.name + ".script", std::move(w.out.bytes)}}};
}

}  // namespace asbuilt::ur
