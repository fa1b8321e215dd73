// SPDX-License-Identifier: GPL-3.0-or-later
// What the readers of all dialects need: lines, tokens, faults with file and line, and the neutral program under construction.
// Never included by a writer: a reader must not repeat a writer's mistake.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "postprocessors/post.hpp"

namespace asbuilt::reading {

/// Leaves a reader on the first thing it cannot read; caught in the reader's public function and never outside.
struct Fault {
  Refusal refusal;
};

struct Line {
  const std::string* file = nullptr;
  int number = 0;
  std::string_view text;  // without its line end
};
std::string place(const Line& line);

[[noreturn]] void fail(const Line& line, std::string code, std::string message, double measured = 0, double limit = 0, std::string unit = "");

/// Lines of a file; CR LF, LF and a last line without an end are taken alike. A byte outside printable ASCII and tab is a fault.
std::vector<Line> lines_of(const ProgramFile& file);

/// Reads tokens from one line, case of letters ignored.
class Scanner {
 public:
  Scanner(const Line& line, std::string_view text) : line_(line), text_(text) {}
  explicit Scanner(const Line& line) : Scanner(line, line.text) {}

  void blanks();
  bool at_end();
  char peek();                         // next character after blanks, 0 at the end
  bool accept(std::string_view text);  // exact characters (letters in any case) after blanks; a word must end where the text ends
  void expect(std::string_view text);
  std::optional<double> number();      // decimal; an exponent is taken only with a sign or digit behind it
  double expect_number(std::string_view what);
  int expect_integer(std::string_view what, int lo, int hi);
  std::string name();                  // letter, _ or $ first; in upper case; empty where there is none
  std::string_view rest();
  void expect_end();
  [[noreturn]] void unknown();
  const Line& line() const { return line_; }

 private:
  Line line_;
  std::string_view text_;
  std::size_t at_ = 0;
};

/// Rz(a) * Ry(b) * Rx(c), element by element; degrees.
Eigen::Quaterniond rotation_zyx(double a_deg, double b_deg, double c_deg);
Eigen::Quaterniond rotation_of(const Mat3& R);

/// The neutral program under construction, in one normal form: a tool or frame is listed only when it changes, a spindle
/// speed belongs to the moment the spindle is switched on.
class Builder {
 public:
  Builder(const PostContext& context) : context_(context) {}

  Program program;
  void set_tool(const Line& line, int number);
  void set_tool_pose(const Line& line, const Pose<frame::Flange, frame::Tool>& T);  // a literal: the cell's tool it equals
  void set_frame(const Line& line, const Pose<frame::Base, frame::Work>& T);
  void joint(const Line& line, const std::array<double, 6>& q_deg, double speed_ratio);
  void linear(const Line& line, const Pose<frame::Work, frame::Tool>& T, double speed_mm_s, double blend_mm);
  void circular(const Line& line, const Pose<frame::Work, frame::Tool>& via, const Pose<frame::Work, frame::Tool>& end, double speed_mm_s,
                double blend_mm);
  void spline(const Line& line, const Pose<frame::Work, frame::Tool>& T, double speed_mm_s);
  void digital_output(const Line& line, int number, bool value);
  void output_on_path(const Line& line, int number, bool value, double path_mm);
  void switch_on(const Line& line, Equipment what, int data);
  void switch_off(const Line& line, Equipment what, int data);
  void analog_ratio(const Line& line, int number, double ratio);  // of max_rpm
  void spindle_on(const Line& line, double rpm);
  void spindle_off();
  void wait(const Line& line, double time_s);
  void comment(std::string_view text);
  const ToolSpec* tool() const { return tool_; }
  bool has_frame() const { return has_frame_; }
  const Pose<frame::Base, frame::Work>& T_base_work() const { return T_base_work_; }

 private:
  void ready(const Line& line, bool is_path) const;
  void speed(const Line& line, double speed_mm_s) const;
  const PostContext& context_;
  const ToolSpec* tool_ = nullptr;
  bool has_frame_ = false, has_moved_ = false, is_spinning_ = false;
  double rpm_ = 0;
  Pose<frame::Base, frame::Work> T_base_work_;
};

/// Words of a machine value, between blanks.
std::vector<std::string> words(std::string_view text);

/// Runs a reader and turns its fault into a refusal.
template <class F>
Result<Program> guarded(F&& body) {
  try {
    return body();
  } catch (Fault& f) {
    return refuse(std::move(f.refusal));
  }
}

}  // namespace asbuilt::reading
