// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/reading.hpp"

#include <charconv>
#include <cmath>

namespace asbuilt::reading {

namespace {
char up(char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c; }
bool is_letter(char c) { return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z'); }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
bool is_name(char c) { return is_letter(c) || is_digit(c) || c == '_' || c == '$'; }
}  // namespace

std::string place(const Line& line) { return (line.file ? *line.file : std::string("-")) + ":" + std::to_string(line.number); }

void fail(const Line& line, std::string code, std::string message, double measured, double limit, std::string unit) {
  throw Fault{{.code = std::move(code), .where = place(line), .message = std::move(message), .measured = measured, .limit = limit,
               .unit = std::move(unit), .stage = "verify"}};
}

std::vector<Line> lines_of(const ProgramFile& file) {
  std::vector<Line> out;
  std::string_view rest = file.bytes;
  int number = 0;
  while (!rest.empty()) {
    const std::size_t n = rest.find('\n');
    Line line{&file.name, ++number, rest.substr(0, n)};
    if (!line.text.empty() && line.text.back() == '\r') line.text.remove_suffix(1);
    for (char c : line.text)
      if ((c < 0x20 || c > 0x7e) && c != '\t')
        fail(line, "read.not_ascii", "a character outside printable ASCII (code " + std::to_string(static_cast<unsigned char>(c)) + ")",
             static_cast<unsigned char>(c), 126);
    out.push_back(line);
    if (n == std::string_view::npos) break;
    rest.remove_prefix(n + 1);
  }
  return out;
}

void Scanner::blanks() {
  while (at_ < text_.size() && (text_[at_] == ' ' || text_[at_] == '\t')) ++at_;
}
bool Scanner::at_end() {
  blanks();
  return at_ >= text_.size();
}
char Scanner::peek() { return at_end() ? '\0' : text_[at_]; }
bool Scanner::accept(std::string_view text) {
  blanks();
  if (text_.size() - at_ < text.size()) return false;
  for (std::size_t i = 0; i < text.size(); ++i)
    if (up(text_[at_ + i]) != up(text[i])) return false;
  const std::size_t next = at_ + text.size();
  if (is_name(text.back()) && next < text_.size() && is_name(text_[next])) return false;
  at_ = next;
  return true;
}
void Scanner::expect(std::string_view text) {
  if (!accept(text)) fail(line_, "read.unknown", "expected \"" + std::string(text) + "\", found \"" + std::string(rest()).substr(0, 40) + "\"");
}
std::optional<double> Scanner::number() {
  blanks();
  std::size_t i = at_;
  if (i < text_.size() && (text_[i] == '+' || text_[i] == '-')) ++i;
  std::size_t digits = 0;
  while (i < text_.size() && is_digit(text_[i])) ++i, ++digits;
  if (i < text_.size() && text_[i] == '.') {
    ++i;
    while (i < text_.size() && is_digit(text_[i])) ++i, ++digits;
  }
  if (digits == 0) return std::nullopt;
  if (i < text_.size() && up(text_[i]) == 'E') {
    std::size_t e = i + 1;
    if (e < text_.size() && (text_[e] == '+' || text_[e] == '-')) ++e;
    if (e < text_.size() && is_digit(text_[e])) {
      while (e < text_.size() && is_digit(text_[e])) ++e;
      i = e;
    }
  }
  const char* first = text_.data() + at_;
  if (*first == '+') ++first;
  double value = 0;
  const auto r = std::from_chars(first, text_.data() + i, value);
  if (r.ec != std::errc() || r.ptr != text_.data() + i || !std::isfinite(value))
    fail(line_, "read.number", "\"" + std::string(text_.substr(at_, i - at_)) + "\" is no number that can be held");
  at_ = i;
  return value;
}
double Scanner::expect_number(std::string_view what) {
  const auto v = number();
  if (!v) fail(line_, "read.unknown", "expected " + std::string(what) + ", found \"" + std::string(rest()).substr(0, 40) + "\"");
  if (at_ < text_.size() && (is_name(text_[at_]) && !is_letter(text_[at_]))) unknown();
  return *v;
}
int Scanner::expect_integer(std::string_view what, int lo, int hi) {
  blanks();
  const std::size_t first = at_;
  const double v = expect_number(what);
  const std::string_view token = text_.substr(first, at_ - first);
  if (token.find_first_of(".eE") != std::string_view::npos) fail(line_, "read.range", std::string(what) + " is a whole number, written without a point", v, hi);
  if (v == 0 && token.front() == '-') fail(line_, "read.range", std::string(what) + " is 0, written without a sign", v, hi);
  if (v != std::floor(v) || v < lo || v > hi)
    fail(line_, "read.range", std::string(what) + " is no whole number from " + std::to_string(lo) + " to " + std::to_string(hi), v, hi);
  return static_cast<int>(v);
}
std::string Scanner::name() {
  blanks();
  std::string out;
  if (at_ < text_.size() && is_name(text_[at_]) && !is_digit(text_[at_]))
    while (at_ < text_.size() && is_name(text_[at_])) out += up(text_[at_++]);
  return out;
}
std::string_view Scanner::rest() {
  blanks();
  return text_.substr(std::min(at_, text_.size()));
}
void Scanner::expect_end() {
  if (!at_end()) unknown();
}
void Scanner::unknown() { fail(line_, "read.unknown", "cannot read \"" + std::string(rest()).substr(0, 60) + "\""); }

Eigen::Quaterniond rotation_of(const Mat3& R) { return Eigen::Quaterniond(R).normalized(); }

Eigen::Quaterniond rotation_zyx(double a_deg, double b_deg, double c_deg) {
  const double deg = 0.017453292519943295;
  const double sa = std::sin(a_deg * deg), ca = std::cos(a_deg * deg);
  const double sb = std::sin(b_deg * deg), cb = std::cos(b_deg * deg);
  const double sc = std::sin(c_deg * deg), cc = std::cos(c_deg * deg);
  Mat3 R;
  R << ca * cb, ca * sb * sc - sa * cc, ca * sb * cc + sa * sc,  //
      sa * cb, sa * sb * sc + ca * cc, sa * sb * cc - ca * sc,   //
      -sb, cb * sc, cb * cc;
  return rotation_of(R);
}

void Builder::set_tool(const Line& line, int number) {
  const ToolSpec* found = nullptr;
  for (const ToolSpec& t : context_.cell.tools)
    if (t.number == number) found = &t;
  if (!found)
    fail(line, "read.tool", "tool " + std::to_string(number) + " is not in the cell, so the path cannot be placed; add it to cell.yaml", number);
  if (found == tool_) return;
  if (is_spinning_ && tool_ && found != tool_) fail(line, "read.tool", "the tool changes while the spindle turns");
  tool_ = found;
  program.instructions.emplace_back(SetTool{number, found->T_flange_tool});
}
void Builder::set_tool_pose(const Line& line, const Pose<frame::Flange, frame::Tool>& T) {
  for (const ToolSpec& t : context_.cell.tools)
    if ((t.T_flange_tool.p_mm - T.p_mm).cwiseAbs().maxCoeff() <= 0.0011 &&
        2 * (t.T_flange_tool.q.conjugate() * T.q).vec().norm() < rad_from_deg(0.0005))
      return set_tool(line, t.number);
  fail(line, "read.tool", "the tool written out here is none of the cell's tools");
}
void Builder::set_frame(const Line&, const Pose<frame::Base, frame::Work>& T) {
  if (has_frame_ && T.p_mm == T_base_work_.p_mm && T.q.coeffs() == T_base_work_.q.coeffs()) return;
  has_frame_ = true;
  T_base_work_ = T;
  program.instructions.emplace_back(SetFrame{T});
}
void Builder::ready(const Line& line, bool is_path) const {
  if (!tool_) fail(line, "read.order", "a motion comes before a tool is chosen");
  if (is_path && !has_frame_) fail(line, "read.order", "a path motion comes before a frame is chosen");
  if (is_path && !has_moved_) fail(line, "read.order", "the first motion must be a joint motion");
}
void Builder::speed(const Line& line, double v) const {
  if (!(v > 0) || v > 10000) fail(line, "read.range", "the path speed is not between 0 and 10000 mm/s", v, 10000, "mm/s");
}
void Builder::joint(const Line& line, const std::array<double, 6>& q_deg, double speed_ratio) {
  ready(line, false);
  if (!(speed_ratio > 0) || speed_ratio > 1 + 1e-9) fail(line, "read.range", "the joint speed is not between 0 and 100 %", speed_ratio * 100, 100, "%");
  MoveJoint m;
  for (int i = 0; i < 6; ++i) {
    if (!(std::abs(q_deg[i]) <= 3600)) fail(line, "read.range", "joint " + std::to_string(i + 1) + " is beyond ten turns", q_deg[i], 3600, "deg");
    m.q_rad[i] = rad_from_deg(q_deg[i]);
  }
  m.speed_ratio = speed_ratio;
  has_moved_ = true;
  program.instructions.emplace_back(m);
}
void Builder::linear(const Line& line, const Pose<frame::Work, frame::Tool>& T, double v, double blend_mm) {
  ready(line, true);
  speed(line, v);
  program.instructions.emplace_back(MoveLinear{T_base_work_ * T, v, !(blend_mm > 0), blend_mm});
}
void Builder::circular(const Line& line, const Pose<frame::Work, frame::Tool>& via, const Pose<frame::Work, frame::Tool>& end, double v,
                       double blend_mm) {
  ready(line, true);
  speed(line, v);
  program.instructions.emplace_back(MoveCircular{T_base_work_ * via, T_base_work_ * end, v, !(blend_mm > 0), blend_mm});
}
void Builder::spline(const Line& line, const Pose<frame::Work, frame::Tool>& T, double v) {
  ready(line, true);
  speed(line, v);
  program.instructions.emplace_back(MoveSpline{T_base_work_ * T, v});
}
void Builder::output_on_path(const Line& line, int number, bool value, double path_mm) {
  if (tool_ && tool_->spindle.output == number) fail(line, "read.trigger", "the spindle is switched at a place on the path; that cannot be held", path_mm, 0, "mm");
  program.instructions.emplace_back(OutputOnPath{number, value, path_mm});
}
void Builder::switch_on(const Line& line, Equipment what, int data) {
  if (data < 0 || data > 255) fail(line, "read.range", "the number of " + std::string(name_of(what)) + " data is not between 0 and 255", data, 255);
  program.instructions.emplace_back(SwitchOn{what, data});
}
void Builder::switch_off(const Line& line, Equipment what, int data) {
  if (data < 0 || data > 255) fail(line, "read.range", "the number of " + std::string(name_of(what)) + " data is not between 0 and 255", data, 255);
  program.instructions.emplace_back(SwitchOff{what, data});
}
void Builder::digital_output(const Line& line, int number, bool value) {
  if (tool_ && tool_->spindle.output == number) {
    if (!value) return spindle_off();
    if (!is_spinning_) spindle_on(line, rpm_);
    return;
  }
  program.instructions.emplace_back(SetOutput{number, value});
}
void Builder::analog_ratio(const Line& line, int number, double ratio) {
  if (!tool_) fail(line, "read.order", "an analogue output is set before a tool is chosen, so its meaning is unknown");
  if (tool_->spindle.analog != number)
    fail(line, "read.unknown", "analogue output " + std::to_string(number) + " is not the spindle's; the program cannot hold it", number);
  if (!(ratio >= 0) || ratio > 1 + 1e-9) fail(line, "read.range", "the spindle speed is not between 0 and its largest", ratio, 1, "ratio");
  const double rpm = ratio * tool_->spindle.max_rpm;
  if (rpm == rpm_) return;
  rpm_ = rpm;
  if (is_spinning_) program.instructions.emplace_back(SpindleOn{rpm});
}
void Builder::spindle_on(const Line& line, double rpm) {
  if (!tool_) fail(line, "read.order", "the spindle is switched before a tool is chosen");
  if (!(rpm > 0) || rpm > tool_->spindle.max_rpm * (1 + 1e-4) + 1)
    fail(line, "read.range", "the spindle is switched on with a speed outside its range", rpm, tool_->spindle.max_rpm, "rpm");
  if (is_spinning_ && rpm == rpm_) return;
  rpm_ = rpm;
  is_spinning_ = true;
  program.instructions.emplace_back(SpindleOn{rpm});
}
void Builder::spindle_off() {
  is_spinning_ = false;
  program.instructions.emplace_back(SpindleOff{});
}
void Builder::wait(const Line& line, double time_s) {
  if (!(time_s >= 0) || time_s > 1e6) fail(line, "read.range", "the waiting time is out of range", time_s, 1e6, "s");
  program.instructions.emplace_back(Wait{time_s});
}
void Builder::comment(std::string_view text) {
  const std::size_t a = text.find_first_not_of(" \t");
  if (a == std::string_view::npos) {
    program.instructions.emplace_back(Comment{});
    return;
  }
  program.instructions.emplace_back(Comment{std::string(text.substr(a, text.find_last_not_of(" \t") + 1 - a))});
}

std::vector<std::string> words(std::string_view text) {
  std::vector<std::string> out;
  std::string word;
  for (char c : text) {
    if (c != ' ' && c != '\t') {
      word += c;
    } else if (!word.empty()) {
      out.push_back(std::move(word));
      word.clear();
    }
  }
  if (!word.empty()) out.push_back(std::move(word));
  return out;
}

}  // namespace asbuilt::reading
