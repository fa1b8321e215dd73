// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> KUKA KRL: NAME.src with the motions, NAME.dat with the tool the calibration expects. Facts and their
// confidence are in dialect.md. Points are printed in the work frame ($BASE literal), mm with 3 and degrees with 4 decimals.
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "postprocessors/krl/krl.hpp"
#include "postprocessors/writing.hpp"

namespace asbuilt::krl {
namespace {

using namespace writing;

constexpr int kMm = 3, kDeg = 4;

std::string frame_text(const Printed& p) {
  std::string s = "{X " + fixed_number(p.xyz_mm[0], kMm);
  s += ",Y " + fixed_number(p.xyz_mm[1], kMm);
  s += ",Z " + fixed_number(p.xyz_mm[2], kMm);
  s += ",A " + fixed_number(p.abc_deg[0], kDeg);
  s += ",B " + fixed_number(p.abc_deg[1], kDeg);
  s += ",C " + fixed_number(p.abc_deg[2], kDeg);
  return s + "}";
}
std::string axes_text(const JointVector& q_rad) {
  std::string s = "{";
  for (int i = 0; i < 6; ++i) s += (i ? ",A" : "A") + std::to_string(i + 1) + " " + fixed_number(deg_from_rad(q_rad[i]), kDeg);
  return s + "}";  // external axes are left out: they keep their place
}

void add_comment(Lines& out, std::string_view text) {
  for (const std::string& piece : pieces(text, 200)) {
    std::string line = "  ; " + piece;
    line.erase(line.find_last_not_of(' ') + 1);
    out.add(line);
  }
}

/// Statements of one run of instructions; the state is what the controller holds while they run.
struct Machine {
  bool is_krc2 = false;         // krl.version: KRC2 | KRC4
  bool is_spline = false;       // krl.motion: classic | spline
  bool is_tool_literal = false; // krl.tool: data | literal
};

struct Writer {
  const Program& program;
  const PostContext& context;
  const Machine& machine;
  Lines out{"\r\n"};
  const ToolSpec* tool = nullptr;
  std::string tool_line, frame_line;
  Pose<frame::Base, frame::Work> T_base_work;
  std::string speed, blend, percent, rpm;
  bool was_blended = false;  // the last motion is rounded into the next: nothing may stop the advance run

  void forget_settings() { speed.clear(), blend.clear(), percent.clear(); }

  /// An event between two rounded motions is fired by the next motion at its start; elsewhere it is a plain statement.
  void event(const std::string& statement) {
    out.add(was_blended ? "  TRIGGER WHEN DISTANCE=0 DELAY=0 DO " + statement : "  " + statement);
  }
  std::string output(int number, bool value) const {
    return "$OUT[" + std::to_string(number) + "]=" + (value ? "TRUE" : "FALSE");
  }
  void path_settings(double speed_mm_s, bool is_exact, double blend_mm) {
    const std::string v = "  $VEL.CP=" + fixed_number(speed_mm_s / 1000.0, 6);
    if (v != speed) out.add(speed = v);
    was_blended = !is_exact && rounded(blend_mm, kMm) > 0;
    if (!was_blended) return;
    const std::string d = "  $APO.CDIS=" + fixed_number(blend_mm, kMm);
    if (d != blend) out.add(blend = d);
  }
  const char* rounding() const { return !was_blended ? "" : machine.is_spline ? " C_SPL" : " C_DIS"; }
  std::string point(const Pose<frame::Base, frame::Tool>& T_base_tool) const {
    const auto T_work_tool = T_base_work.inverse() * T_base_tool;
    return frame_text(print_pose(T_work_tool.rotation(), T_work_tool.p_mm, kMm, kDeg));
  }

  void operator()(const SetTool& s) {
    tool = find_tool(context, s.number);
    const std::string line =
        machine.is_tool_literal ? "  $TOOL=" + frame_text(print_pose(s.T_flange_tool.rotation(), s.T_flange_tool.p_mm, kMm, kDeg))
                                : "  $TOOL=TOOL_DATA[" + std::to_string(s.number) + "]";
    if (line != tool_line) out.add(tool_line = line);
  }
  void operator()(const SetFrame& s) {
    const Printed p = print_pose(s.T_base_work.rotation(), s.T_base_work.p_mm, kMm, kDeg);
    T_base_work = frame_of(p);
    const std::string line = "  $BASE=" + frame_text(p);
    if (line != frame_line) out.add(frame_line = line);
  }
  void operator()(const MoveJoint& m) {
    const std::string p = "  BAS (#VEL_PTP," + std::to_string(std::max(1, static_cast<int>(std::lround(m.speed_ratio * 100)))) + ")";
    if (p != percent) out.add(percent = p);
    out.add("  PTP " + axes_text(m.q_rad));
    was_blended = false;
  }
  void operator()(const MoveLinear& m) {
    path_settings(m.speed_mm_s, m.is_exact, m.blend_mm);
    out.add((machine.is_spline ? "  SLIN " : "  LIN ") + point(m.T_base_tool) + rounding());
  }
  void operator()(const MoveCircular& m) {
    path_settings(m.speed_mm_s, m.is_exact, m.blend_mm);
    out.add((machine.is_spline ? "  SCIRC " : "  CIRC ") + point(m.T_base_via) + "," + point(m.T_base_tool) + rounding());
  }
  void operator()(const SpindleOn& s) {
    event("$ANOUT[" + std::to_string(tool->spindle.analog) + "]=" + fixed_number(s.rpm / tool->spindle.max_rpm, 5));
    event(output(tool->spindle.output, true));
  }
  void operator()(const SpindleOff&) {
    event(output(tool->spindle.output, false));
    event("$ANOUT[" + std::to_string(tool->spindle.analog) + "]=0.00000");
  }
  void operator()(const SetOutput& s) { event(output(s.output, s.value)); }
  void operator()(const Wait& w) { out.add("  WAIT SEC " + fixed_number(w.time_s, 3)); }
  void operator()(const Comment& c) { add_comment(out, c.text); }
};

std::string tool_variable(int number) { return "EXPECTED_TOOL_" + std::to_string(number); }

/// The check on the machine: the program waits, with the condition on the pendant, until TOOL_DATA is what the plan was made with.
void write_tool_check(Lines& out, const ToolSpec& tool) {
  const std::string n = std::to_string(tool.number), data = "TOOL_DATA[" + n + "]", expected = tool_variable(tool.number);
  const std::string name = "WAITS WHILE TOOL_DATA[" + n + "] IS NOT THE CALIBRATED TOOL";
  out.add("  ;FOLD " + name);
  for (const char* part : {"X", "Y", "Z", "A", "B", "C"}) {
    const bool is_angle = part[0] <= 'C';
    out.add(std::string("  WAIT FOR ABS(") + data + "." + part + "-" + expected + "." + part + ")<" + (is_angle ? "0.0100" : "0.010"));
  }
  out.add("  ;ENDFOLD (" + name + ")");
}

void write_head(Lines& out, const std::string& name) {
  out.add("&ACCESS RVP");
  out.add("&REL 1");
  out.add("DEF " + name + "( )");
}

void write_start(Lines& out, const Machine& machine) {
  if (machine.is_krc2) out.add("  EXT BAS (BAS_COMMAND :IN,REAL :IN )");
  out.add("  ;FOLD INI");
  out.add("  GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )");
  out.add("  INTERRUPT ON 3");
  out.add("  BAS (#INITMOV,0)");
  out.add("  ;ENDFOLD (INI)");
  out.add("  ;FOLD SETTINGS");
  out.add("  $IPO_MODE=#BASE");
  out.add("  $ORI_TYPE=#VAR");
  out.add("  $CIRC_TYPE=#BASE");
  out.add("  $ADVANCE=3");
  out.add("  ;ENDFOLD (SETTINGS)");
}

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  Refusals faults = check(program, context, {.name_length = 24, .speed_min_mm_s = 0.01, .speed_max_mm_s = 2000, .wait_max_s = 3600});
  check_options(context, "krl", {"version", "motion", "tool", "max_lines"}, faults);
  Machine machine;
  const auto choose = [&](const char* key, const char* usual, const char* other, bool& is_other) {
    const std::string value = option(context, key).value_or(usual);
    is_other = value == other;
    if (!is_other && value != usual)
      faults.push_back(fault("post.option", std::string("cell.yaml: controller.") + key, "\"" + value + "\" is neither " + usual + " nor " + other));
  };
  choose("krl.version", "KRC4", "KRC2", machine.is_krc2);
  choose("krl.motion", "classic", "spline", machine.is_spline);
  choose("krl.tool", "data", "literal", machine.is_tool_literal);
  if (machine.is_krc2 && machine.is_spline)
    faults.push_back(fault("post.option", "cell.yaml: controller.krl.motion", "KRC2 has no spline motions; choose classic"));
  const auto max_lines = option_int(context, "krl.max_lines", 3000, 50, 100000);
  if (!max_lines) faults.insert(faults.end(), max_lines.error().begin(), max_lines.error().end());

  std::vector<const ToolSpec*> tools;
  bool has_spindle = false;
  for (const Instruction& i : program.instructions) {
    if (const auto* s = std::get_if<SetTool>(&i)) {
      const ToolSpec* t = find_tool(context, s->number);
      if (t && std::find(tools.begin(), tools.end(), t) == tools.end()) tools.push_back(t);
    }
    has_spindle |= std::holds_alternative<SpindleOn>(i) || std::holds_alternative<SpindleOff>(i);
  }
  for (const ToolSpec* t : tools) {
    if (t->number < 1 || t->number > 16)
      faults.push_back(fault("post.tool", "cell.yaml: tools[" + t->id + "].number", "KRL tools are numbered from 1 to 16", t->number, 16));
    if (has_spindle && (t->spindle.output < 1 || t->spindle.analog < 1))
      faults.push_back(fault("post.missing_value",
                             "cell.yaml: tools[" + t->id + "].spindle." + (t->spindle.output < 1 ? "output" : "analog"),
                             "KRL switches the spindle by $OUT[output] and sets its speed by $ANOUT[analog]; give both numbers"));
  }
  const auto runs = split(program, 2, max_lines.value_or(3000));
  if (!faults.empty()) return refuse_all(std::move(faults));

  ProgramText text{Language::krl, {}};
  Writer w{program, context, machine};
  write_head(w.out, program.name);
  for (const std::string& h : program.header) add_comment(w.out, h);
  write_start(w.out, machine);
  if (machine.is_tool_literal) tools.clear();  // no data of the controller to check
  for (const ToolSpec* t : tools) write_tool_check(w.out, *t);
  w.out.add("  ;FOLD PROGRAM");

  std::vector<ProgramFile> parts;
  for (std::size_t k = 0; k < runs.size(); ++k) {
    Lines main{"\r\n"};
    const std::string name = module_name(program.name, k + 1, 24);
    if (runs.size() > 1) {
      std::swap(main, w.out);
      w.out = Lines("\r\n");
      write_head(w.out, name);
      if (!w.tool_line.empty()) w.out.add(w.tool_line);
      if (!w.frame_line.empty()) w.out.add(w.frame_line);
    }
    w.forget_settings();
    for (std::size_t i = runs[k].first; i < runs[k].second; ++i) std::visit(w, program.instructions[i]);
    if (runs.size() > 1) {
      w.out.add("END");
      parts.push_back({name + ".src", std::move(w.out.bytes)});
      w.out = std::move(main);
      w.out.add("  " + name + "( )");
    }
  }
  w.out.add("  ;ENDFOLD (PROGRAM)");
  w.out.add("END");
  text.files.push_back({program.name + ".src", std::move(w.out.bytes)});

  Lines dat{"\r\n"};
  dat.add("&ACCESS RVP");
  dat.add("&REL 1");
  dat.add("DEFDAT " + program.name);
  for (const ToolSpec* t : tools) {
    const Printed p = print_pose(t->T_flange_tool.rotation(), t->T_flange_tool.p_mm, kMm, kDeg);
    dat.add("  DECL FRAME " + tool_variable(t->number) + "=" + frame_text(p));
  }
  dat.add("ENDDAT");
  text.files.push_back({program.name + ".dat", std::move(dat.bytes)});
  for (ProgramFile& f : parts) text.files.push_back(std::move(f));
  return text;
}

}  // namespace asbuilt::krl
