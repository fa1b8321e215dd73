// SPDX-License-Identifier: GPL-3.0-or-later
// Yaskawa INFORM -> neutral program: the instructions of the jobs that read_jobs.cpp read. A whitelist written from dialect.md: MOVJ
// from pulses, MOVL and MOVC from Cartesian positions in BASE, ROBOT or USER (with UFRAME.CND), DOUT, AOUT, TIMER, CALL, comments.
// An instruction outside it is a refusal with file and line, never a guess.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include "postprocessors/inform/inform.hpp"
#include "postprocessors/inform/posture.hpp"
#include "postprocessors/inform/read_jobs.hpp"
#include "postprocessors/reading_arm.hpp"

namespace asbuilt::inform {
namespace {

using namespace reading;

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : context_(context), build_(context), jobs_(load_jobs(text, context)) {}

  Program read() {
    Job& first = jobs_.jobs.at(jobs_.first);
    build_.program.name = first.name;
    run(first, true);
    end_of_runs(first.head);
    return std::move(build_.program);
  }

 private:
  const PostContext& context_;
  Builder build_;
  Jobs jobs_;
  std::set<std::string> running_;
  std::optional<Position> last_;      // the last path target
  ArmReader arm_{context_};
  int spline_points_ = 0;             // MOVS seen in the present run
  int during_ = -1;                   // index of the motion whose start the next events belong to (NWAIT); -1: none
  int weave_ = 0;
  int arc_points_ = 0;                // MOVC seen in the present run
  Position arc_via_;
  double arc_speed_ = 0, arc_start_speed_ = 0;
  bool has_body_ = false;             // something other than a header line has been read

  void run(Job& job, bool is_main) {
    if (!running_.insert(job.name).second) fail(job.head, "read.call", job.name + " calls itself");
    if (running_.size() > 10) fail(job.head, "read.call", "calls are nested deeper than 10");
    if (!is_main) has_body_ = true;
    int used = 0;
    if (!job.positions.empty()) build_.set_tool(job.positions.begin()->second.line, job.positions.begin()->second.tool);
    for (const Line& line : job.instructions) {
      if (line.text.starts_with("'")) {
        remark(line.text.substr(1));
        continue;
      }
      Scanner s(line);
      if (s.at_end()) s.unknown();
      has_body_ = true;
      if (s.accept("END")) {
        s.expect_end();
        break;
      }
      if (s.accept("MOVJ")) joint(s, take(s, job, used));
      else if (s.accept("MOVL")) line_or_arc(s, take(s, job, used), false);
      else if (s.accept("MOVC")) line_or_arc(s, take(s, job, used), true);
      else if (s.accept("MOVS")) spline(s, take(s, job, used));
      else if (s.accept("DOUT")) event([&] { digital(s); });
      else if (s.accept("AOUT")) event([&] { analog(s); });
      else if (s.accept("ARCON")) event([&] { build_.switch_on(s.line(), Equipment::arc, number(s, "ASF#", 255)); });
      else if (s.accept("ARCOF")) event([&] { build_.switch_off(s.line(), Equipment::arc, number(s, "AEF#", 255)); });
      else if (s.accept("WVON")) event([&] { weave_ = number(s, "WEV#", 255), build_.switch_on(s.line(), Equipment::weave, weave_); });
      else if (s.accept("WVOF")) event([&] { build_.switch_off(s.line(), Equipment::weave, weave_); });
      else if (s.accept("CWAIT")) during_ = -1;
      else if (s.accept("TIMER")) timer(s);
      else if (s.accept("CALL")) call(s);
      else s.unknown();
      s.expect_end();
    }
    if (used != static_cast<int>(job.positions.size()))
      fail(job.head, "read.count", "every position must be used once, in order", used, static_cast<double>(job.positions.size()));
    running_.erase(job.name);
  }

  /// Comment lines: a header line begins with "* ", what follows a cut with "> ".
  void remark(std::string_view text) {
    during_ = -1;
    if (text.starts_with("> ")) {
      text.remove_prefix(2);
      if (!has_body_ && !build_.program.header.empty()) {
        build_.program.header.back() += text;
        return;
      }
      if (!build_.program.instructions.empty())
        if (auto* c = std::get_if<Comment>(&build_.program.instructions.back())) {
          c->text += text;
          return;
        }
    }
    if (!has_body_ && text.starts_with("*")) {
      text.remove_prefix(text.starts_with("* ") ? 2 : 1);
      build_.program.header.emplace_back(text);
      return;
    }
    has_body_ = true;
    build_.comment(text);
  }

  Position& take(Scanner& s, Job& job, int& used) {
    const std::string name = s.name();
    const auto it = job.positions.find(name);
    if (it == job.positions.end()) fail(s.line(), "read.undefined", "position " + name + " is not in this job");
    char expected[16];
    std::snprintf(expected, sizeof expected, "C%05d", used);
    if (name != expected) fail(s.line(), "read.count", "positions are used once and in order; expected " + std::string(expected), used);
    ++used;
    return it->second;
  }

  void joint(Scanner& s, const Position& p) {
    const std::array<double, 6> q_deg = p.is_joint ? p.q_deg : posture(s.line(), p);
    s.expect("VJ"), s.expect("=");
    const double percent = s.expect_number("the speed");
    if (percent < 0.01 || percent > 100) fail(s.line(), "read.range", "VJ is not between 0.01 and 100", percent, 100, "%");
    exact(s);
    build_.set_tool(s.line(), p.tool);
    build_.joint(s.line(), q_deg, percent / 100);
    no_wait(s);
    end_of_runs(s.line());
    last_.reset();
  }
  /// MOVJ to a Cartesian position: the joint values with the flags of RCONF, as far as the controller regards them (S2C430 = 1).
  std::array<double, 6> posture(const Line& line, const Position& p) {
    const ToolSpec* tool = find_tool(line, p.tool);
    const auto flip = machine("flip") == "b_axis" ? FlipRule::b_axis : FlipRule::r_axis;
    must(p.flags.size() >= 6, "a Cartesian position without the flags that its line was read with");
    const auto T = (p.user < 0 ? Pose<frame::Base, frame::Work>() : jobs_.user_frames.at(p.user)) * p.T_work_tool;
    return arm_.one(line, T, *tool, [&](const std::array<double, 6>& q_deg) {
      JointVector q{};
      for (std::size_t i = 0; i < 6; ++i) q[i] = rad_from_deg(q_deg[i]);
      const Posture x = posture_of(context_.cell.robot, q, flip);
      const std::array<bool, 6> flags{x.is_no_flip, x.is_lower_arm, x.is_rear, x.is_r_beyond, x.is_t_beyond, x.is_s_beyond};
      for (std::size_t i = 0; i < 6; ++i)
        if (flags[i] != p.flags[i]) return false;
      return true;
    });
  }
  const ToolSpec* find_tool(const Line& line, int number) const {
    for (const ToolSpec& t : context_.cell.tools)
      if (t.number == number) return &t;
    fail(line, "read.tool", "tool " + std::to_string(number) + " is not in the cell, so the path cannot be placed; add it to cell.yaml", number);
  }
  /// A path motion to pulses goes where the arm has the tool with them.
  Position on_path(const Line& line, Position p) {
    if (!p.is_joint) return p;
    p.T_work_tool = Pose<frame::Work, frame::Tool>(Pose<frame::Work, frame::Base>() * arm_.tool_at(p.q_deg, *find_tool(line, p.tool)));
    p.user = -1, p.is_joint = false;
    return p;
  }
  /// NWAIT: the events on the next lines run as this motion begins, so they stand before it in the program.
  void no_wait(Scanner& s) { during_ = s.accept("NWAIT") ? static_cast<int>(build_.program.instructions.size()) - 1 : -1; }
  template <class F>
  void event(F&& f) {
    auto& list = build_.program.instructions;
    const auto before = static_cast<std::ptrdiff_t>(list.size());
    f();
    if (during_ < 0) return;
    std::rotate(list.begin() + during_, list.begin() + before, list.end());
    during_ += static_cast<int>(list.size()) - static_cast<int>(before);
  }
  /// A run of MOVC or MOVS ends here.
  void end_of_runs(const Line& line) {
    if (arc_points_ == 1 || (arc_points_ > 0 && arc_points_ % 2 == 0)) fail(line, "read.arc", "a run of MOVC needs start, middle and end");
    if (spline_points_ > 0 && spline_points_ < 3) fail(line, "read.spline", "a run of MOVS needs three points and more", spline_points_, 3, "points");
    arc_points_ = spline_points_ = 0;
  }
  void spline(Scanner& s, const Position& as_written) {
    const Line line = s.line();
    const Position p = on_path(line, as_written);
    if (arc_points_ == 1 || (arc_points_ > 0 && arc_points_ % 2 == 0)) fail(line, "read.arc", "a run of MOVC needs start, middle and end");
    arc_points_ = 0;
    s.expect("V"), s.expect("=");
    const double speed = path_speed(s);
    const double blend = corner(s);
    frame_of(line, p);
    if (++spline_points_ == 1) {
      const bool is_there = last_ && last_->user == p.user && last_->T_work_tool.p_mm == p.T_work_tool.p_mm &&
                            last_->T_work_tool.q.coeffs() == p.T_work_tool.q.coeffs();
      if (!is_there) build_.linear(line, p.T_work_tool, speed, blend), no_wait(s);
      else if (blend > 0) fail(line, "read.spline", "the points of a spline are passed exactly", blend, 0, "mm");
      arc_start_speed_ = is_there ? speed : 0;
    } else {
      if (arc_start_speed_ > 0 && speed != arc_start_speed_) fail(line, "read.spline", "the start of a spline has another speed than its first point", arc_start_speed_, speed, "mm/s");
      arc_start_speed_ = 0;
      if (blend > 0) fail(line, "read.spline", "the points of a spline are passed exactly", blend, 0, "mm");
      during_ = -1;
      build_.spline(line, p.T_work_tool, speed);
    }
    last_ = p;
  }
  double path_speed(Scanner& s) {
    const auto unit = context_.cell.controller.speed_unit;
    if (!unit) fail(s.line(), "read.undefined", "V= cannot be read without controller.inform.speed_unit in cell.yaml");
    return s.expect_number("the speed") * (*unit == SpeedUnit::mm_s ? 1.0 : 10.0 / 60.0);
  }
  double corner(Scanner& s) {
    double blend = 0;
    if (s.accept("CR")) {
      s.expect("=");
      blend = s.expect_number("the corner radius");
      if (blend < 0.1 || blend > 6553.5) fail(s.line(), "read.range", "CR is not between 0.1 and 6553.5 mm", blend, 6553.5, "mm");
    } else {
      s.expect("PL"), s.expect("=");
      blend = zone(s.line(), s.expect_integer("PL", 0, 8));
    }
    return blend;
  }
  void exact(Scanner& s) {
    s.expect("PL"), s.expect("=");
    s.expect_integer("a joint motion that is rounded (PL above 0) cannot be held; PL", 0, 0);
  }

  /// What PL=n rounds at most, mm: a parameter of the controller, so it is the cell's to say.
  double zone(const Line& line, int level) const {
    if (level == 0) return 0;
    const auto it = context_.cell.controller.options.find("inform.position_levels");
    if (it == context_.cell.controller.options.end())
      fail(line, "read.undefined", "the zone of PL=" + std::to_string(level) + " is a parameter; give controller.inform.position_levels in cell.yaml", level);
    Scanner s(line, it->second);
    double mm = 0;
    for (int i = 0; i < level; ++i) mm = s.expect_number("a zone of controller.inform.position_levels");
    return mm;
  }

  void frame_of(const Line& line, const Position& p) {
    build_.set_tool(line, p.tool);
    build_.set_frame(line, p.user < 0 ? Pose<frame::Base, frame::Work>() : jobs_.user_frames.at(p.user));
  }

  void line_or_arc(Scanner& s, const Position& as_written, bool is_arc) {
    const Line line = s.line();
    const Position p = on_path(line, as_written);
    s.expect("V"), s.expect("=");
    const double speed = path_speed(s);
    const double blend = corner(s);
    if (spline_points_ > 0 && spline_points_ < 3) fail(line, "read.spline", "a run of MOVS needs three points and more", spline_points_, 3, "points");
    spline_points_ = 0;
    const bool is_arc_end = s.accept("FPT");
    if (is_arc_end && (!is_arc || arc_points_ % 2 == 1)) fail(line, "read.unknown", "FPT belongs to the end of an arc");
    if (!is_arc) {
      if (arc_points_ == 1 || (arc_points_ > 0 && arc_points_ % 2 == 0)) fail(line, "read.arc", "a run of MOVC needs start, middle and end");
      arc_points_ = 0;
      frame_of(line, p);
      build_.linear(line, p.T_work_tool, speed, blend);
      no_wait(s);
      last_ = p;
      return;
    }
    during_ = -1;
    if (++arc_points_ == 1) {  // the start of an arc: the tool goes there straight, unless it is there already
      frame_of(line, p);
      const bool is_there = last_ && last_->user == p.user && last_->T_work_tool.p_mm == p.T_work_tool.p_mm &&
                            last_->T_work_tool.q.coeffs() == p.T_work_tool.q.coeffs();
      if (!is_there) build_.linear(line, p.T_work_tool, speed, blend);
      arc_start_speed_ = is_there ? speed : 0;
      last_ = p;
    } else if (arc_points_ % 2 == 0) {
      if (arc_start_speed_ > 0 && speed != arc_start_speed_) fail(line, "read.arc", "the points of one arc have different speeds", speed, arc_start_speed_, "mm/s");
      if (blend > 0) fail(line, "read.arc", "the middle of an arc cannot be rounded", blend, 0, "mm");
      arc_start_speed_ = 0;
      arc_via_ = p;
      arc_speed_ = speed;
    } else {
      if (speed != arc_speed_) fail(line, "read.arc", "the points of one arc have different speeds", speed, arc_speed_, "mm/s");
      if (arc_via_.user != p.user || last_->user != p.user || arc_via_.tool != p.tool)
        fail(line, "read.arc", "the points of an arc are in different frames or of different tools");
      frame_of(line, p);
      build_.circular(line, arc_via_.T_work_tool, p.T_work_tool, speed, blend);
      last_ = p;
    }
  }

  std::string machine(const char* key) const {
    const auto it = context_.cell.controller.options.find(std::string("inform.") + key);
    return it == context_.cell.controller.options.end() ? "" : it->second;
  }
  static int number(Scanner& s, std::string_view kind, int hi) {
    s.expect(kind), s.expect("("); 
    const int n = s.expect_integer("the number", 1, hi);
    s.expect(")");
    return n;
  }
  void digital(Scanner& s) {
    const int n = number(s, "OT#", 4096);
    const bool on = s.accept("ON");
    if (!on) s.expect("OFF");
    if (const std::string coolant = machine("coolant"); !coolant.empty() && std::atoi(coolant.c_str()) == n) {
      if (on) build_.switch_on(s.line(), Equipment::coolant, 0);
      else build_.switch_off(s.line(), Equipment::coolant, 0);
      return;
    }
    build_.digital_output(s.line(), n, on);
  }
  void analog(Scanner& s) {
    const int n = number(s, "AO#", 40);
    build_.analog_ratio(s.line(), n, s.expect_number("the voltage") / 10.0);
  }
  void timer(Scanner& s) {
    s.expect("T"), s.expect("=");
    const double t = s.expect_number("the time");
    if (t < 0.01 || t > 655.35) fail(s.line(), "read.range", "TIMER takes 0.01 to 655.35 s", t, 655.35, "s");
    during_ = -1;
    build_.wait(s.line(), t);
  }
  void call(Scanner& s) {
    s.expect("JOB"), s.expect(":");
    const std::string name = job_name(s);
    const auto recording = words(machine("recording"));
    if (const auto it = std::find(recording.begin(), recording.end(), name); it != recording.end())
      return event([&] {
        if (it == recording.begin()) build_.switch_on(s.line(), Equipment::recording, 0);
        else build_.switch_off(s.line(), Equipment::recording, 0);
      });
    if (name == machine("tool_check")) {
      std::string argument = s.name();  // ARGF3
      if (!argument.starts_with("ARGF") || argument.size() > 7 || argument.find_first_not_of("0123456789", 4) != std::string::npos || argument.size() == 4)
        fail(s.line(), "read.unknown", "the tool check takes the tool's number, ARGFn");
      return build_.switch_on(s.line(), Equipment::tool_check, std::atoi(argument.c_str() + 4));
    }
    during_ = -1;
    const auto it = jobs_.jobs.find(name);
    if (it == jobs_.jobs.end()) fail(s.line(), "read.call", name + " is called but not among these files");
    end_of_runs(s.line());
    run(it->second, false);
    end_of_runs(s.line());
  }
};

}  // namespace

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return reading::guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::inform
