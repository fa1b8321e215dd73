// SPDX-License-Identifier: GPL-3.0-or-later
// Neutral program -> Yaskawa INFORM: one job (.JBI), or pages and a main job that calls them; UFRAME.CND where the machine
// gives a user frame number. Facts and their confidence are in dialect.md. Joint targets are pulses, path targets millimetres
// with 3 and degrees with 4 decimals in BASE or USER.
#include <algorithm>
#include <cmath>
#include <locale>
#include <sstream>

#include "planner/base/number.hpp"
#include "postprocessors/inform/inform.hpp"
#include "postprocessors/inform/posture.hpp"
#include "postprocessors/writing.hpp"

namespace asbuilt::inform {
namespace {

using namespace writing;

constexpr int kMm = 3, kDeg = 4;
constexpr std::size_t kCommentWidth = 32;

struct Machine {
  std::array<double, 6> pulses_per_degree{};
  double mm_s_per_unit = 1;  // of V=
  int user_frame = 0;        // 0: BASE
  FlipRule flip = FlipRule::r_axis;
  bool is_relative = false;  // inform.relative: paths in jobs whose positions stay Cartesian
  int coolant = 0;           // inform.coolant: the output
  std::array<std::string, 2> recording;  // inform.recording: jobs of the controller
  std::string tool_check;                // inform.tool_check: a job that takes the tool's number
  std::vector<double> level_mm;  // inform.position_levels: what PL=1, 2, .. round at most; empty: CR= is used
};

std::string padded(int number, int width) {
  std::string s = std::to_string(number);
  return std::string(std::max(0, width - static_cast<int>(s.size())), '0') + s;
}
std::string comma_list(const Printed& p) {
  std::string s;
  for (double v : p.xyz_mm) s += fixed_number(v, kMm) + ",";
  return s + fixed_number(p.abc_deg[2], kDeg) + "," + fixed_number(p.abc_deg[1], kDeg) + "," + fixed_number(p.abc_deg[0], kDeg);
}
std::string posture_line(const Posture& p) {
  std::string s = "///RCONF ";
  for (bool flag : {p.is_no_flip, p.is_lower_arm, p.is_rear, p.is_r_beyond, p.is_t_beyond, p.is_s_beyond}) s += flag ? "1," : "0,";
  for (int i = 6; i < 24; ++i) s += i < 23 ? "0," : "0";
  return s;
}
/// A comment of any length as lines of at most 32 characters; what follows a cut begins with "> ".
void add_comment(Lines& out, std::string_view text, std::string_view mark = "") {
  std::string all = std::string(mark) + std::string(text);
  all.erase(all.find_last_not_of(' ') + 1);
  bool is_first = true;
  do {
    const std::size_t width = kCommentWidth - (is_first ? 0 : 2);
    std::size_t n = std::min(width, all.size());
    while (n < all.size() && n > 1 && (all[n - 1] == ' ' || all[n] == ' ')) --n;  // a blank at an end would get lost
    out.add((is_first ? "'" : "'> ") + all.substr(0, n));
    all.erase(0, n);
    is_first = false;
  } while (!all.empty());
}

/// One job: positions and instructions grow side by side, each position is used once and in order.
struct Job {
  Lines positions{"\r\n"}, instructions{"\r\n"};
  int count = 0;
  std::string kind, tool_line, posture;  // what the last lines above the positions said
};

enum class Next { arc, spline, other };
/// What kind of motion follows instruction `at`.
Next next_motion(const Program& program, std::size_t at) {
  for (std::size_t i = at + 1; i < program.instructions.size(); ++i) {
    if (std::holds_alternative<MoveCircular>(program.instructions[i])) return Next::arc;
    if (std::holds_alternative<MoveSpline>(program.instructions[i])) return Next::spline;
    if (std::holds_alternative<MoveLinear>(program.instructions[i]) || std::holds_alternative<MoveJoint>(program.instructions[i])) break;
  }
  return Next::other;
}

struct Writer {
  const Program& program;
  const PostContext& context;
  const Machine& machine;
  Job job;
  std::size_t at = 0;  // the instruction being written
  const ToolSpec* tool = nullptr;
  Pose<frame::Base, frame::Work> T_base_work;  // as printed; identity for BASE
  JointVector q_rad{};                         // the last joint target: the posture of the path that follows
  std::optional<Pose<frame::Base, frame::Tool>> T_now;
  bool is_arc_last = false;     // the last motion was an arc: its end may start the next one
  bool is_start_given = false;  // the last motion was written as the first MOVC of an arc, or the first MOVS of a spline
  bool is_spline_last = false;
  bool needs_wait = false;           // the last motion carries NWAIT
  bool was_blended = false;          // the last motion is rounded: what comes now must not stop the robot
  std::vector<std::string> during_;  // what runs while the next motion does (NWAIT)

  std::string next_position(bool is_joint, const std::string& values) {
    const std::string t = "///TOOL " + std::to_string(tool->number);
    const std::string user = machine.user_frame ? "///USER " + std::to_string(machine.user_frame) : "";
    const std::string kind = is_joint ? "PULSE" : machine.user_frame ? "USER" : "BASE";
    if (!is_joint && !user.empty() && job.kind != kind) job.positions.add(user);
    if (job.tool_line != t) job.positions.add(job.tool_line = t);
    if (job.kind != kind) {
      job.kind = kind;
      job.positions.add("///POSTYPE " + kind);
      job.positions.add(is_joint ? "///PULSE" : "///RECTAN");
      job.posture.clear();
    }
    if (!is_joint) {
      const std::string p = posture_line(posture_of(context.cell.robot, q_rad, machine.flip));
      if (p != job.posture) job.positions.add(job.posture = p);
    }
    const std::string name = "C" + padded(job.count++, 5);
    job.positions.add(name + "=" + values);
    return name;
  }
  std::string cartesian(const Pose<frame::Base, frame::Tool>& T_base_tool) {
    const auto T_work_tool = T_base_work.inverse() * T_base_tool;
    return next_position(false, comma_list(print_pose(T_work_tool.rotation(), T_work_tool.p_mm, kMm, kDeg)));
  }
  std::string path_words(double speed_mm_s, bool is_exact, double blend_mm) const {
    std::string s = " V=" + fixed_number(speed_mm_s / machine.mm_s_per_unit, 1);
    if (!is_exact && machine.level_mm.empty() && rounded(blend_mm, 1) > 0) return s + " CR=" + fixed_number(blend_mm, 1);
    int level = 0;  // the largest zone within the distance planned
    for (std::size_t i = 0; !is_exact && i < machine.level_mm.size(); ++i)
      if (machine.level_mm[i] <= blend_mm + 1e-9) level = static_cast<int>(i) + 1;
    return s + " PL=" + std::to_string(level);
  }

  /// An event: beside an exact stop a plain line; between rounded motions it runs as the next motion begins.
  void event(const std::string& line) {
    wait_for_end();
    if (was_blended) during_.push_back(line);
    else job.instructions.add(line);
  }
  /// Behind a motion with NWAIT everything else runs during it, unless it is told to wait for its end.
  void wait_for_end() {
    if (needs_wait && !was_blended) job.instructions.add("CWAIT");
    needs_wait = false;
  }
  /// A motion, with the events that run as it begins; behind an exact one CWAIT holds what follows until it has ended.
  void motion(const std::string& words, bool is_exact) {
    job.instructions.add(words + (during_.empty() ? "" : " NWAIT"));
    for (const std::string& e : during_) job.instructions.add(e);
    needs_wait = !during_.empty();
    during_.clear();
    was_blended = !is_exact;
  }
  /// Before an arc, which takes nothing between its points, the events go out plainly.
  void flush() {
    for (const std::string& e : during_) job.instructions.add(e);
    during_.clear();
  }

  void operator()(const SetTool& s) { tool = find_tool(context, s.number); }
  void operator()(const SetFrame& s) {
    if (machine.user_frame) T_base_work = frame_of(print_pose(s.T_base_work.rotation(), s.T_base_work.p_mm, kMm, kDeg));
  }
  void operator()(const MoveJoint& m) {
    is_arc_last = is_start_given = false;
    T_now.reset();
    std::string values;
    for (int i = 0; i < 6; ++i) {
      const long long pulses = std::llround(deg_from_rad(m.q_rad[i]) * machine.pulses_per_degree[i]);
      values += (i ? "," : "") + std::to_string(pulses);
      q_rad[i] = rad_from_deg(static_cast<double>(pulses) / machine.pulses_per_degree[i]);  // the posture is that of what is printed
    }
    is_spline_last = false;
    motion("MOVJ " + next_position(true, values) + " VJ=" + fixed_number(m.speed_ratio * 100, 2) + " PL=0", true);
  }
  void operator()(const MoveLinear& m) {
    const bool stays = T_now && (T_now->p_mm - m.T_base_tool.p_mm).norm() < 0.002 && quat_log(T_now->q.conjugate() * m.T_base_tool.q).norm() < 1e-5;
    const Next next = next_motion(program, at);
    is_start_given = !is_arc_last && !stays && next == Next::arc && during_.empty();
    const bool is_spline_start = !is_spline_last && !stays && during_.empty() && next == Next::spline && at + 1 < program.instructions.size() &&
                                 std::holds_alternative<MoveSpline>(program.instructions[at + 1]);
    is_arc_last = false;
    motion((is_start_given ? "MOVC " : is_spline_start ? "MOVS " : "MOVL ") + cartesian(m.T_base_tool) + path_words(m.speed_mm_s, m.is_exact, m.blend_mm),
           m.is_exact || !(m.blend_mm > 0));
    is_start_given |= is_spline_start;
    is_spline_last = false;
    T_now = m.T_base_tool;
  }
  void operator()(const MoveCircular& m) {
    flush();
    is_spline_last = false;
    // A run of MOVC: the start (to which the tool goes straight), a point on the way, the end, which may start the next arc.
    if (!is_arc_last && !is_start_given) job.instructions.add("MOVC " + cartesian(*T_now) + path_words(m.speed_mm_s, true, 0));
    job.instructions.add("MOVC " + cartesian(m.T_base_via) + path_words(m.speed_mm_s, true, 0));
    job.instructions.add("MOVC " + cartesian(m.T_base_tool) + path_words(m.speed_mm_s, m.is_exact, m.blend_mm) +
                         (next_motion(program, at) == Next::arc ? " FPT" : ""));
    T_now = m.T_base_tool;
    is_arc_last = true;
    is_start_given = false;
    was_blended = !m.is_exact && m.blend_mm > 0;
  }
  /// A run of MOVS: the start, unless the straight motion before was written as it, then the points.
  void operator()(const MoveSpline& m) {
    if (!is_spline_last && !is_start_given) job.instructions.add("MOVS " + cartesian(*T_now) + path_words(m.speed_mm_s, true, 0));
    job.instructions.add("MOVS " + cartesian(m.T_base_tool) + path_words(m.speed_mm_s, true, 0));
    T_now = m.T_base_tool;
    is_spline_last = true;
    is_arc_last = is_start_given = false;
    was_blended = false;
  }
  void operator()(const OutputOnPath&) {}  // refused before
  void equipment(Equipment what, int data, bool on) {
    const std::string n = "#(" + std::to_string(data) + ")";
    switch (what) {
      case Equipment::coolant: return event("DOUT OT#(" + std::to_string(machine.coolant) + ") " + (on ? "ON" : "OFF"));
      case Equipment::arc: return event(on ? "ARCON ASF" + n : "ARCOF AEF" + n);
      case Equipment::weave: return event(on ? "WVON WEV" + n : "WVOF");
      case Equipment::recording: return event("CALL JOB:" + machine.recording[on ? 0 : 1]);
      default: return event("CALL JOB:" + machine.tool_check + " ARGF" + std::to_string(data));
    }
  }
  void operator()(const SwitchOn& s) { equipment(s.what, s.data, true); }
  void operator()(const SwitchOff& s) { equipment(s.what, s.data, false); }
  void operator()(const SpindleOn& s) {
    event("AOUT AO#(" + std::to_string(tool->spindle.analog) + ") " + fixed_number(s.rpm / tool->spindle.max_rpm * 10.0, 3));
    event("DOUT OT#(" + std::to_string(tool->spindle.output) + ") ON");
  }
  void operator()(const SpindleOff&) {
    event("DOUT OT#(" + std::to_string(tool->spindle.output) + ") OFF");
    event("AOUT AO#(" + std::to_string(tool->spindle.analog) + ") 0.000");
  }
  void operator()(const SetOutput& s) {
    event("DOUT OT#(" + std::to_string(s.output) + ") " + (s.value ? "ON" : "OFF"));
  }
  void operator()(const Wait& w) { wait_for_end(), job.instructions.add("TIMER T=" + fixed_number(w.time_s, 2)); }
  void operator()(const Comment& c) { add_comment(job.instructions, c.text); }
};

/// `frame` not empty: a relative job, its positions stay in this frame.
std::string job_text(const std::string& name, const Job& job, const std::string& date, const std::string& frame = "") {
  Lines out("\r\n");
  out.add("/JOB");
  out.add("//NAME " + name);
  out.add("//POS");
  out.add("///NPOS " + std::to_string(job.count) + ",0,0,0,0,0");
  out.bytes += job.positions.bytes;
  out.add("//INST");
  out.add("///DATE " + date);
  out.add(frame.empty() ? "///ATTR SC,RW" : "///ATTR SC,RW,RJ");
  if (!frame.empty()) out.add("///FRAME " + frame);
  out.add("///GROUP1 RB1");
  out.add("NOP");
  out.bytes += job.instructions.bytes;
  out.add("END");
  return std::move(out.bytes);
}

/// ISO date -> "2026/11/22 00:00".
std::optional<std::string> date_text(const std::string& iso) {
  if (iso.size() < 10 || iso[4] != '-' || iso[7] != '-') return std::nullopt;
  for (int i : {0, 1, 2, 3, 5, 6, 8, 9})
    if (iso[i] < '0' || iso[i] > '9') return std::nullopt;
  return iso.substr(0, 4) + "/" + iso.substr(5, 2) + "/" + iso.substr(8, 2) + " 00:00";
}

std::string user_frame_file(int number, const Pose<frame::Base, frame::Work>& T) {
  const std::string values = comma_list(print_pose(T.rotation(), T.p_mm, kMm, kDeg));
  Lines out("\r\n");
  out.add("//UFRAME " + std::to_string(number));
  out.add("///NAME");
  out.add("///TOOL 0");
  out.add("///GROUP 1,0,0");
  out.add("///BUSER " + values);
  return std::move(out.bytes);
}

/// A job names its tool at its positions only: between a change of tool and the next motion nothing says whose spindle is meant.
void check_spindle_tools(const Program& program, Refusals& faults) {
  int tool = -1, tool_at_motion = -1;
  std::optional<int> first_tool;  // that of the first motion
  for (const Instruction& i : program.instructions) {
    if (const auto* s = std::get_if<SetTool>(&i)) tool = s->number;
    if (std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i)) {
      first_tool = tool;
      break;
    }
  }
  tool = -1, tool_at_motion = first_tool.value_or(-1);
  for (std::size_t k = 0; k < program.instructions.size(); ++k) {
    const Instruction& i = program.instructions[k];
    if (const auto* s = std::get_if<SetTool>(&i)) tool = s->number;
    if (std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i)) tool_at_motion = tool;
    if ((std::holds_alternative<SpindleOn>(i) || std::holds_alternative<SpindleOff>(i)) && tool != tool_at_motion)
      faults.push_back(fault("post.order", program.name + ": instruction " + std::to_string(k + 1),
                             "INFORM names the tool at its positions: the spindle of a new tool is switched before the first motion with it; move first", tool));
  }
}

bool is_job_name(std::string_view s) {
  return !s.empty() && s.size() <= 32 && std::all_of(s.begin(), s.end(), [](char c) { return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-'; });
}

/// The controller's own outputs, data files and jobs for what the program switches; a missing one is a refusal.
void equip(Machine& machine, const Program& program, const PostContext& context, Refusals& faults) {
  for (const auto& [what, data] : equipment_of(program)) {
    const std::string key = "inform." + std::string(name_of(what)), where = "cell.yaml: controller." + key;
    const auto text = option(context, key);
    const bool is_list = what == Equipment::arc || what == Equipment::weave;
    if (!text) {
      faults.push_back(fault("post.missing_value", where,
                             what == Equipment::coolant     ? "give the digital output that switches the coolant"
                             : is_list                      ? "give the numbers of the condition files on the controller, as in \"1 2 5\""
                             : what == Equipment::recording ? "give the controller's two jobs that start and stop the recording, as in \"LOGON LOGOFF\""
                                                            : "give the controller's job that checks a tool and takes its number"));
      continue;
    }
    const auto words = words_of(*text);
    if (is_list) {
      bool has_it = false;
      for (const std::string& w : words) has_it |= whole_number(w) == data;
      if (!has_it) faults.push_back(fault("post.option", where, "the program uses data " + std::to_string(data) + ", which the list \"" + *text + "\" does not hold", data));
    } else if (what == Equipment::coolant) {
      const auto n = whole_number(*text);
      if (!n || *n < 1 || *n > 4096) faults.push_back(fault("post.option", where, "\"" + *text + "\" is no output from 1 to 4096"));
      machine.coolant = n.value_or(0);
    } else {
      const std::size_t wanted = what == Equipment::recording ? 2 : 1;
      if (words.size() != wanted || !std::all_of(words.begin(), words.end(), is_job_name)) {
        faults.push_back(fault("post.option", where, "\"" + *text + "\" is not " + std::to_string(wanted) + " job name(s)", static_cast<double>(words.size()), static_cast<double>(wanted)));
        continue;
      }
      if (what == Equipment::recording) machine.recording = {words[0], words[1]};
      else machine.tool_check = words[0];
    }
  }
  bool is_arc = false, was_rounded = false, has_event = false, was_spline = false;
  for (std::size_t i = 0; i < program.instructions.size(); ++i) {
    const Instruction& at = program.instructions[i];
    const auto* line = std::get_if<MoveLinear>(&at);
    const auto* circle = std::get_if<MoveCircular>(&at);
    const bool is_spline = std::holds_alternative<MoveSpline>(at);
    const std::string here = program.name + ": instruction " + std::to_string(i + 1);
    if (circle && was_rounded && has_event)
      faults.push_back(fault("post.trigger", here, "INFORM fires nothing between a rounded corner and an arc; make the move before the arc exact"));
    if (is_spline && was_spline && has_event)
      faults.push_back(fault("post.spline", here, "INFORM would run on through what is switched between two splines; put a straight move between them"));
    if (line || circle || is_spline || std::holds_alternative<MoveJoint>(at)) {
      was_rounded = (line && !line->is_exact && line->blend_mm > 0) || (circle && !circle->is_exact && circle->blend_mm > 0);
      was_spline = is_spline, has_event = false;
    } else {
      has_event |= !std::holds_alternative<Comment>(at);
    }
    if (const auto* s = std::get_if<SwitchOn>(&program.instructions[i])) is_arc |= s->what == Equipment::arc;
    if (const auto* s = std::get_if<SwitchOff>(&program.instructions[i])) is_arc &= s->what != Equipment::arc;
    if (is_arc && std::holds_alternative<MoveSpline>(program.instructions[i]))
      faults.push_back(fault("post.spline", program.name + ": instruction " + std::to_string(i + 1), "with the arc on INFORM takes MOVL and MOVC only; write the spline as straight moves"));
  }
}

/// Runs of instructions for relative jobs: from the first path motion behind a joint move up to the next joint move.
std::vector<std::pair<std::size_t, std::size_t>> path_runs(const Program& program) {
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  std::size_t begin = program.instructions.size();
  for (std::size_t i = 0; i <= program.instructions.size(); ++i) {
    const bool is_end = i == program.instructions.size() || std::holds_alternative<MoveJoint>(program.instructions[i]);
    if (is_end && begin < i) runs.push_back({begin, i}), begin = program.instructions.size();
    if (!is_end && begin == program.instructions.size() &&
        (std::holds_alternative<MoveLinear>(program.instructions[i]) || std::holds_alternative<MoveCircular>(program.instructions[i])))
      begin = i;
  }
  return runs;
}

}  // namespace

Result<ProgramText> write(const Program& program, const PostContext& context) {
  const ControllerSpec& c = context.cell.controller;
  Machine machine;
  Refusals faults;
  bool has_path = false, has_spindle = false;
  int frames_count = 0;
  Pose<frame::Base, frame::Work> T_base_work;
  for (const Instruction& i : program.instructions) {
    has_path |= std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i);
    has_spindle |= std::holds_alternative<SpindleOn>(i) || std::holds_alternative<SpindleOff>(i);
    if (const auto* s = std::get_if<SetFrame>(&i)) {
      if (frames_count == 0 || s->T_base_work.p_mm != T_base_work.p_mm || s->T_base_work.q.coeffs() != T_base_work.q.coeffs()) ++frames_count;
      T_base_work = s->T_base_work;
    }
  }
  if (!c.pulses_per_degree)
    faults.push_back(fault("post.missing_value", "cell.yaml: controller.inform.pulses_per_degree",
                           "INFORM joint targets are encoder pulses; give the six pulses per degree of this robot (ALL.PRM)"));
  else
    machine.pulses_per_degree = *c.pulses_per_degree;
  for (int i = 0; c.pulses_per_degree && i < 6; ++i)
    if (!std::isfinite(machine.pulses_per_degree[i]) || std::abs(machine.pulses_per_degree[i]) < 1)
      faults.push_back(fault("post.missing_value", "cell.yaml: controller.inform.pulses_per_degree[" + std::to_string(i) + "]",
                             "a joint with less than one pulse per degree cannot be placed; give the value of ALL.PRM",
                             machine.pulses_per_degree[i], 1, "pulses/deg"));
  if (has_path && !c.speed_unit)
    faults.push_back(fault("post.missing_value", "cell.yaml: controller.inform.speed_unit",
                           "V= is mm/s or cm/min by a setting of the controller, a factor of 6; give the one it has"));
  if (c.speed_unit && *c.speed_unit == SpeedUnit::cm_min) machine.mm_s_per_unit = 10.0 / 60.0;
  check_options(context, "inform", {"user_frame", "name_length", "max_lines", "flip", "position_levels", "relative", "coolant", "arc", "weave", "recording", "tool_check", "path", "arcs", "receipt"}, faults);
  const auto user = option_int(context, "inform.user_frame", 0, 1, 63);
  const auto name_length = option_int(context, "inform.name_length", 32, 8, 32);
  const auto max_lines = option_int(context, "inform.max_lines", 9000, 50, 99000);
  for (const auto* o : {&user, &name_length, &max_lines})
    if (!*o) faults.insert(faults.end(), o->error().begin(), o->error().end());
  machine.user_frame = user.value_or(0);
  if (machine.user_frame && frames_count > 1)
    faults.push_back(fault("post.frames", program.name,
                           "one job has one user frame here, the program changes its frame; leave out controller.inform.user_frame",
                           frames_count, 1, "frames"));
  if (const auto rule = option(context, "inform.flip")) {
    if (*rule == "b_axis") machine.flip = FlipRule::b_axis;
    else if (*rule != "r_axis")
      faults.push_back(fault("post.option", "cell.yaml: controller.inform.flip", "\"" + *rule + "\" is neither r_axis nor b_axis"));
  }
  if (const auto levels = option(context, "inform.position_levels")) {
    std::istringstream in(*levels);
    in.imbue(std::locale::classic());
    for (double v; in >> v;) machine.level_mm.push_back(v);
    const bool is_rising = std::is_sorted(machine.level_mm.begin(), machine.level_mm.end());
    if (machine.level_mm.empty() || machine.level_mm.size() > 8 || !is_rising || machine.level_mm.front() <= 0 || !in.eof())
      faults.push_back(fault("post.option", "cell.yaml: controller.inform.position_levels",
                             "\"" + *levels + "\" are not 1 to 8 rising lengths in mm, for PL=1, 2, ..", static_cast<double>(machine.level_mm.size()), 8));
  }
  if (const auto relative = option(context, "inform.relative")) {
    machine.is_relative = *relative == "yes";
    if (*relative != "yes" && *relative != "no")
      faults.push_back(fault("post.option", "cell.yaml: controller.inform.relative", "\"" + *relative + "\" is neither yes (the option is there) nor no"));
  }
  equip(machine, program, context, faults);
  const auto date = date_text(context.date);
  if (!date) faults.push_back(fault("post.date", "scans.yaml: taken", "\"" + context.date + "\" is no date like 2026-11-22"));
  const double v_min = 0.1 * machine.mm_s_per_unit;
  Refusals more = check(program, context,
                        {.name_length = name_length.value_or(32), .speed_min_mm_s = v_min, .speed_max_mm_s = 1500, .wait_min_s = 0.01, .wait_max_s = 655.35});
  faults.insert(faults.end(), more.begin(), more.end());
  check_spindle_tools(program, faults);
  for (const Instruction& i : program.instructions)
    if (const auto* s = std::get_if<SetTool>(&i)) {
      const ToolSpec* t = find_tool(context, s->number);
      if (t && has_spindle && (t->spindle.output < 1 || t->spindle.analog < 1))
        faults.push_back(fault("post.missing_value",
                               "cell.yaml: tools[" + t->id + "].spindle." + (t->spindle.output < 1 ? "output" : "analog"),
                               "INFORM switches the spindle by OT#(output) and sets its speed by AO#(analog); give both numbers"));
      if (t && (t->number < 0 || t->number > 63))
        faults.push_back(fault("post.tool", "cell.yaml: tools[" + t->id + "].number", "INFORM tools are numbered from 0 to 63", t->number, 63));
    }
  const auto runs = machine.is_relative ? path_runs(program) : split(program, 2, max_lines.value_or(9000));
  const std::string base = upper(program.name);
  if ((runs.size() > 1 || machine.is_relative) && module_name(base, runs.size(), name_length.value_or(32)).empty())
    faults.push_back(fault("post.name", program.name,
                           "cut into " + std::to_string(runs.size()) + " pages the name grows too long; shorten the item's name",
                           static_cast<double>(base.size()), name_length.value_or(32), "characters"));
  if (!faults.empty()) return refuse_all(std::move(faults));

  ProgramText text{Language::inform, {}};
  Job main;
  for (const std::string& h : program.header) add_comment(main.instructions, h, "* ");
  Writer w{program, context, machine, {}};
  std::vector<ProgramFile> pages;
  if (machine.is_relative) {  // joint moves and what stands between in the main job, each stretch of path in a relative job of its own
    const std::string frame = machine.user_frame ? "USER " + std::to_string(machine.user_frame) : "BASE";
    w.job = std::move(main);
    std::size_t k = 0;
    for (w.at = 0; w.at < program.instructions.size(); ++w.at) {
      if (k < runs.size() && w.at == runs[k].first) {
        Job joints = std::move(w.job);
        w.job = Job{};
        for (; w.at < runs[k].second; ++w.at) std::visit(w, program.instructions[w.at]);
        w.flush();
        const std::string name = module_name(base, ++k, name_length.value_or(32));
        pages.push_back({name + ".JBI", job_text(name, w.job, *date, frame)});
        w.job = std::move(joints);
        w.job.instructions.add("CALL JOB:" + name);
        if (w.at == program.instructions.size()) break;
      }
      std::visit(w, program.instructions[w.at]);
    }
    main = std::move(w.job);
  }
  for (std::size_t k = 0; !machine.is_relative && k < runs.size(); ++k) {
    if (runs.size() == 1) w.job = std::move(main);
    for (w.at = runs[k].first; w.at < runs[k].second; ++w.at) std::visit(w, program.instructions[w.at]);
    if (w.job.count > 100000)
      return refuse(fault("post.too_long", program.name, "a job holds at most 100000 positions and this one has no place to cut it",
                          w.job.count, 100000, "positions"));
    if (runs.size() == 1) {
      main = std::move(w.job);
    } else {
      const std::string name = module_name(base, k + 1, name_length.value_or(32));
      pages.push_back({name + ".JBI", job_text(name, w.job, *date)});
      main.instructions.add("CALL JOB:" + name);
    }
    w.job = Job{};
  }
  text.files.push_back({base + ".JBI", job_text(base, main, *date)});
  for (ProgramFile& p : pages) text.files.push_back(std::move(p));
  if (machine.user_frame) text.files.push_back({"UFRAME.CND", user_frame_file(machine.user_frame, T_base_work)});
  return text;
}

}  // namespace asbuilt::inform
