// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> KUKA KRL: NAME.src with the motions, NAME.dat with the tool the calibration expects. Facts and their
// confidence are in dialect.md. Points are printed in the work frame ($BASE literal), mm with 3 and degrees with 4 decimals.
#include <algorithm>
#include <cmath>
#include <map>

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
  bool is_sub = false;          // krl.delivery: main | sub
  int coolant = 0;              // krl.coolant: the output
  std::string serial_number, kernel;  // krl.serial_number, krl.kernel: of the controller that the program is for
  std::map<Equipment, std::array<std::string, 2>> names;  // krl.arc, krl.weave, krl.recording, krl.tool_check: sub-programs of the controller
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
  bool is_in_spline = false;
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
  void operator()(const OutputOnPath& o) {
    const std::string place = fixed_number(o.path_mm, kMm) + (o.path_mm > 0 ? " ONSTART" : "");
    out.add("  TRIGGER WHEN PATH=" + place + " DELAY=0 DO " + output(o.output, o.value));
  }
  void equipment(Equipment what, int data, bool on) {
    if (what == Equipment::coolant) return event(output(machine.coolant, on));
    const std::string& name = machine.names.at(what)[on ? 0 : 1];
    const std::string call = name + (data ? "(" + std::to_string(data) + ")" : "( )");
    out.add(was_blended ? "  TRIGGER WHEN DISTANCE=0 DELAY=0 DO " + call + " PRIO=-1" : "  " + call);
  }
  void operator()(const SwitchOn& s) { equipment(s.what, s.data, true); }
  void operator()(const SwitchOff& s) { equipment(s.what, s.data, false); }
  /// A block of points, its speed with each: nothing else may stand inside.
  void operator()(const MoveSpline& m) {
    if (!is_in_spline) out.add("  SPLINE");
    is_in_spline = true;
    out.add("  SPL " + point(m.T_base_tool) + " WITH $VEL.CP=" + fixed_number(m.speed_mm_s / 1000.0, 6));
    was_blended = false;
  }
  void end_spline() {
    if (is_in_spline) out.add("  ENDSPLINE");
    is_in_spline = false;
  }
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

/// The program waits, with the condition on the pendant, on any other controller than the one it was made for.
void write_controller_check(Lines& out, const Machine& machine) {
  if (machine.serial_number.empty() && machine.kernel.empty()) return;
  const std::string name = "WAITS WHILE THIS IS NOT THE CONTROLLER IT IS FOR";
  out.add("  ;FOLD " + name);
  if (!machine.serial_number.empty()) out.add("  WAIT FOR $KR_SERIALNO==" + machine.serial_number);
  if (!machine.kernel.empty()) out.add("  WAIT FOR StrFind(1,$RCV_INFO[],\"" + machine.kernel + "\",#NOT_CASE_SENS)");
  out.add("  ;ENDFOLD (" + name + ")");
}

void write_head(Lines& out, const std::string& name) {
  out.add("&ACCESS RVP");
  out.add("&REL 1");
  out.add("DEF " + name + "( )");
}

void write_start(Lines& out, const Machine& machine) {
  if (machine.is_krc2) out.add("  EXT BAS (BAS_COMMAND :IN,REAL :IN )");
  if (machine.is_krc2)  // what the integrator's sub-programs take
    for (const auto& [what, names] : machine.names)
      for (const std::string& name : names)
        if (!name.empty()) out.add("  EXT " + name + (what == Equipment::recording ? "( )" : "(INT :IN )"));
  if (machine.is_sub) {
    out.add("  ;FOLD SETTINGS");
    out.add("  $IPO_MODE=#BASE");
    out.add("  $ORI_TYPE=#VAR");
    out.add("  $CIRC_TYPE=#BASE");
    out.add("  ;ENDFOLD (SETTINGS)");
    return;
  }
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

bool is_krl_name(std::string_view s) {
  const auto letter = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_'; };
  return !s.empty() && s.size() <= 24 && letter(s[0]) && std::all_of(s.begin(), s.end(), [&](char c) { return letter(c) || (c >= '0' && c <= '9'); });
}

/// The machine's own names for what the program switches; a missing one is a refusal.
void equip(Machine& machine, const Program& program, const PostContext& context, Refusals& faults) {
  for (const auto& [what, data] : equipment_of(program)) {
    const std::string key = "krl." + std::string(name_of(what));
    if (machine.names.count(what) || machine.coolant) {
      if (what != Equipment::coolant && machine.names.count(what)) continue;
      if (what == Equipment::coolant && machine.coolant) continue;
    }
    const auto text = option(context, key);
    if (!text) {
      faults.push_back(fault("post.missing_value", "cell.yaml: controller." + key,
                             what == Equipment::coolant      ? "give the digital output that switches the coolant"
                             : what == Equipment::tool_check ? "give the name of the controller's sub-program that checks a tool, called with its number"
                                                             : "give the names of the controller's two sub-programs, on and off, as in \"ARC_START ARC_END\""));
      continue;
    }
    const auto words = words_of(*text);
    if (what == Equipment::coolant) {
      const auto n = whole_number(*text);
      if (!n || *n < 1 || *n > 4096) faults.push_back(fault("post.option", "cell.yaml: controller." + key, "\"" + *text + "\" is no output from 1 to 4096"));
      machine.coolant = n.value_or(0);
      continue;
    }
    const std::size_t wanted = what == Equipment::tool_check ? 1 : 2;
    if (words.size() != wanted || !std::all_of(words.begin(), words.end(), is_krl_name))
      faults.push_back(fault("post.option", "cell.yaml: controller." + key, "\"" + *text + "\" are not " + std::to_string(wanted) + " names of sub-programs", static_cast<double>(words.size()), static_cast<double>(wanted)));
    machine.names[what] = {words.empty() ? "" : words[0], words.size() > 1 ? words[1] : ""};
  }
}

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  Refusals faults = check(program, context, {.name_length = 24, .speed_min_mm_s = 0.01, .speed_max_mm_s = 2000, .wait_max_s = 3600, .has_path_events = true});
  check_options(context, "krl", {"version", "motion", "tool", "max_lines", "delivery", "cell", "coolant", "arc", "weave", "recording", "tool_check", "path", "arcs", "receipt", "serial_number", "kernel"}, faults);
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
  choose("krl.delivery", "main", "sub", machine.is_sub);
  machine.serial_number = option(context, "krl.serial_number").value_or("");
  machine.kernel = option(context, "krl.kernel").value_or("");
  if (!machine.serial_number.empty() && (machine.serial_number.size() > 9 || machine.serial_number.find_first_not_of("0123456789") != std::string::npos || machine.serial_number[0] == '0'))
    faults.push_back(fault("post.option", "cell.yaml: controller.krl.serial_number", "\"" + machine.serial_number + "\" is no number of a controller ($KR_SERIALNO)"));
  const auto is_plain = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' || c == ' ' || c == '-' || c == '_'; };
  if (!machine.kernel.empty() && (machine.kernel.size() > 40 || !std::all_of(machine.kernel.begin(), machine.kernel.end(), is_plain)))
    faults.push_back(fault("post.option", "cell.yaml: controller.krl.kernel", "\"" + machine.kernel + "\" is no part of the controller's own version text ($RCV_INFO)"));
  equip(machine, program, context, faults);
  if (machine.is_krc2)
    for (std::size_t i = 0; i < program.instructions.size(); ++i) {
      const std::string where = program.name + ": instruction " + std::to_string(i + 1);
      if (std::holds_alternative<MoveSpline>(program.instructions[i])) faults.push_back(fault("post.spline", where, "KRC2 has no splines; write straight moves"));
      if (const auto* o = std::get_if<OutputOnPath>(&program.instructions[i]); o && o->path_mm > 0)
        faults.push_back(fault("post.trigger", where, "KRC2 counts a place on the path from the end of a motion; give it as a distance before the end", o->path_mm, 0, "mm"));
    }
  const auto cell_case = option_int(context, "krl.cell", 0, 1, 255);
  if (!cell_case) faults.insert(faults.end(), cell_case.error().begin(), cell_case.error().end());
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
  write_controller_check(w.out, machine);
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
    for (std::size_t i = runs[k].first; i < runs[k].second; ++i) {
      if (!std::holds_alternative<MoveSpline>(program.instructions[i])) w.end_spline();
      std::visit(w, program.instructions[i]);
    }
    w.end_spline();
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
  if (*cell_case) {  // what the integrator adds to CELL.SRC, which is never overwritten
    Lines snippet{"\r\n"};
    snippet.add("; one case of the SWITCH in CELL.SRC");
    snippet.add("  CASE " + std::to_string(*cell_case));
    snippet.add("    P00 (#EXT_PGNO,#PGNO_ACKN,DMY[],0)");
    snippet.add("    " + program.name + "( )");
    text.files.push_back({program.name + ".cell.txt", std::move(snippet.bytes)});
  }
  return text;
}

}  // namespace asbuilt::krl
