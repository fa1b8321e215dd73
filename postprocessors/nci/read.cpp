// SPDX-License-Identifier: GPL-3.0-or-later
// Beckhoff TwinCAT NC I -> neutral program. A whitelist written from dialect.md: blocks of words between blanks, G00 to G04, planes, feed,
// spindle, tool, Q axes, the M functions of the machine file. What is outside it is a refusal with file and line, never a guess.
#include <cmath>
#include <cstdlib>
#include <map>

#include "postprocessors/nci/nci.hpp"
#include "postprocessors/reading.hpp"

namespace asbuilt::nci {
namespace {

using namespace reading;

using Point = std::array<std::optional<double>, 6>;  // X Y Z Q1 Q2 Q3

struct Code {  // what an M function of the machine file stands for
  enum class Kind { output, equipment, kinematics } kind = Kind::output;
  int number = 0;
  Equipment what = Equipment::coolant;
  bool is_on = false;
};

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : text_(text), context_(context), build_(context) {
    for (const auto& [key, value] : context.cell.controller.options) {
      if (!key.starts_with("nci.")) continue;
      const std::string name = key.substr(4);
      const auto numbers = words(value);
      const auto keep = [&](Code code) {
        for (std::size_t i = 0; i < numbers.size() && i < 2; ++i) code.is_on = i == 0, codes_[std::atoi(numbers[i].c_str())] = code;
      };
      if (name == "kinematics") keep({Code::Kind::kinematics});
      if (name.starts_with("output.")) keep({Code::Kind::output, std::atoi(name.c_str() + 7)});
      for (const Equipment e : {Equipment::coolant, Equipment::arc, Equipment::weave, Equipment::recording, Equipment::tool_check}) {
        const std::string own(name_of(e));
        if (name == own || name.starts_with(own + ".")) keep({Code::Kind::equipment, name == own ? 0 : std::atoi(name.c_str() + own.size() + 1), e});
      }
      if (name == "orientation") mode_ = value;
    }
  }

  Program read() {
    if (text_.files.empty()) fail({}, "read.missing", "no file");
    const ProgramFile& f = text_.files.front();
    if (text_.files.size() > 1) fail({&text_.files[1].name, 0, {}}, "read.file", "an NC I program is one file");
    build_.program.name = f.name.substr(0, f.name.rfind('.'));
    const auto lines = lines_of(f);
    for (const Line& line : lines) block(line);
    if (!has_end_) fail(lines.empty() ? Line{&f.name, 0, {}} : lines.back(), "read.missing", "M30 is missing");
    return std::move(build_.program);
  }

 private:
  const ProgramText& text_;
  const PostContext& context_;
  Builder build_;
  std::map<int, Code> codes_;
  std::string mode_;
  bool has_end_ = false, has_code_ = false, is_absolute_ = false, is_mm_ = false;
  std::optional<bool> is_kinematics_;
  int motion_ = -1, plane_ = 17;
  std::optional<double> feed_, rpm_;
  Point now_{}, joints_{};
  long long last_number_ = -1;

  void block(const Line& line) {
    std::string code, remark;
    bool is_open = false, has_remark = false;
    for (const char c : line.text) {
      if (c == '(' && is_open) fail(line, "read.unknown", "a comment inside a comment");
      if (c == ')' && !is_open) fail(line, "read.unknown", "a ) without its (");
      if (c == '(' || c == ')') is_open = c == '(', has_remark = true;
      else (is_open ? remark : code) += c;
    }
    if (is_open) fail(line, "read.unknown", "a comment is not closed");
    Scanner s(line, code);
    if (s.at_end()) {
      if (!has_remark) return;
      if (has_code_) build_.comment(remark);
      else build_.program.header.push_back(remark.find_first_not_of(' ') == std::string::npos ? "" : remark);
      return;
    }
    if (has_end_) fail(line, "read.unknown", "something stands after the end of the program");
    if (s.accept("%")) {
      if (has_code_) fail(line, "read.unknown", "% belongs at the top");
      return;
    }
    has_code_ = true;
    std::map<std::string, double> value;
    std::vector<int> g, m;
    bool is_first = true;
    for (const std::string& text : words(code)) {
      word(line, text, is_first, value, g, m);
      is_first = false;
    }
    run(line, value, g, m);
  }

  void word(const Line& line, const std::string& text, bool is_first, std::map<std::string, double>& value, std::vector<int>& g, std::vector<int>& m) {
    Scanner s(line, text);
    char c = text[0];
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    std::string key(1, c);
    Scanner rest(line, std::string_view(text).substr(1));
    if (c == 'Q') {
      if (text.size() < 3 || text[1] < '1' || text[1] > '3' || text[2] != '=') s.unknown();
      key += text[1];
      rest = Scanner(line, std::string_view(text).substr(3));
    } else if (std::string_view("NGMXYZIJKFSTD").find(c) == std::string_view::npos) {
      s.unknown();
    }
    const auto v = rest.number();
    if (!v || !rest.at_end()) s.unknown();
    if (c == 'N') {
      if (!is_first || *v != std::floor(*v) || *v <= static_cast<double>(last_number_) || *v > 2e9)
        fail(line, "read.range", "block numbers stand first and rise", *v, static_cast<double>(last_number_));
      last_number_ = static_cast<long long>(*v);
    } else if (c == 'G' || c == 'M') {
      if (*v != std::floor(*v) || *v < 0 || *v > 999) s.unknown();
      auto& codes = c == 'G' ? g : m;
      for (int known : codes)
        if (known == static_cast<int>(*v)) fail(line, "read.unknown", key + std::to_string(known) + " is given twice");
      codes.push_back(static_cast<int>(*v));
    } else if (!value.emplace(key, *v).second) {
      fail(line, "read.unknown", "the word " + key + " is given twice");
    }
  }

  void run(const Line& line, std::map<std::string, double>& value, const std::vector<int>& g, const std::vector<int>& m) {
    int motions = 0;
    bool is_dwell = false;
    for (int x : g) {
      switch (x) {
        case 0: case 1: case 2: case 3: motion_ = x, ++motions; break;
        case 4: is_dwell = true; break;
        case 17: case 18: case 19: plane_ = x; break;
        case 71: is_mm_ = true; break;
        case 90: is_absolute_ = true; break;
        default: fail(line, "read.unknown", "G" + std::to_string(x) + " is not read", x);
      }
    }
    if (motions > 1) fail(line, "read.unknown", "two kinds of motion in one block");
    if (is_dwell) {
      if (value.size() != 1 || !value.count("X") || g.size() != 1 || !m.empty()) fail(line, "read.unknown", "a dwell is G04 X and seconds, alone");
      return build_.wait(line, value["X"]);
    }
    if (value.count("T") || value.count("D")) {
      const double t = value.count("D") ? value["D"] : value["T"];
      if (value.count("T") && value["T"] != t) fail(line, "read.tool", "T and D name different tools", value["T"], t);
      if (t != std::floor(t) || t < 1 || t > 9999) fail(line, "read.range", "tools are whole numbers from 1", t, 9999);
      build_.set_tool(line, static_cast<int>(t));
    }
    if (value.count("F")) {
      feed_ = value["F"];
      if (!(*feed_ > 0)) fail(line, "read.range", "F must be greater than 0", *feed_, 0, "mm/min");
    }
    if (value.count("S")) rpm_ = value["S"];
    if (m.size() > 1) fail(line, "read.unknown", "one M function a block is read", static_cast<double>(m.size()), 1);
    static const char* const kAxes[] = {"X", "Y", "Z", "Q1", "Q2", "Q3"};
    bool has_axis = false, has_centre = false;
    for (const char* a : kAxes) has_axis |= value.count(a) > 0;
    for (const char* a : {"I", "J", "K"}) has_centre |= value.count(a) > 0;
    if (!m.empty() && has_axis) fail(line, "read.unknown", "an M function beside a motion: before or after it is a setting of the PLC", m[0]);
    if (!m.empty()) function(line, m[0], value);
    if (!has_axis) {
      if (motions || has_centre) fail(line, "read.unknown", "a kind of motion without a target");
      return;
    }
    if (motion_ < 0) fail(line, "read.undefined", "a motion before G00, G01, G02 or G03");
    if (!is_absolute_ || !is_mm_) fail(line, "read.undefined", "a motion before G90 and G71 are set");
    if (motion_ == 0) fail(line, "read.rapid", "the speed of G00 is the machine's and is not read; use G01 with F");
    if (!feed_) fail(line, "read.undefined", "a motion before F");
    if (!is_kinematics_) fail(line, "read.undefined", "a motion before the M functions of controller.nci.kinematics say what the axis words are");
    if (motion_ == 1 && has_centre) fail(line, "read.unknown", "I, J, K belong to an arc");
    Point& at = *is_kinematics_ ? now_ : joints_;
    const Point before = at;
    for (std::size_t i = 0; i < 6; ++i) {
      if (value.count(kAxes[i])) at[i] = value[kAxes[i]];
      if (!at[i]) fail(line, "read.missing", std::string("the word ") + kAxes[i] + " has no value since the kinematics were switched");
    }
    if (!*is_kinematics_) return joint(line);
    build_.set_frame(line, Pose<frame::Base, frame::Work>());
    if (motion_ == 1) return build_.linear(line, pose(line, now_), *feed_ / 60, 0);
    arc(line, value, before);
  }

  void function(const Line& line, int m, const std::map<std::string, double>& value) {
    if (m == 3) {
      if (!rpm_) fail(line, "read.undefined", "M3 before S");
      return build_.spindle_on(line, *rpm_);
    }
    if (m == 5) {
      if (value.count("S")) fail(line, "read.unknown", "M5 takes no S");
      return build_.spindle_off();
    }
    if (m == 2 || m == 30) {
      has_end_ = true;
      return;
    }
    const auto it = codes_.find(m);
    if (it == codes_.end()) fail(line, "read.unknown", "M" + std::to_string(m) + " is not known; name it in cell.yaml (controller.nci)", m);
    const Code& c = it->second;
    if (c.kind == Code::Kind::output) return build_.digital_output(line, c.number, c.is_on);
    if (c.kind == Code::Kind::equipment) return c.is_on ? build_.switch_on(line, c.what, c.number) : build_.switch_off(line, c.what, c.number);
    is_kinematics_ = c.is_on;
    now_ = joints_ = {};
    feed_.reset();  // degrees here, millimetres there: never carried over
  }

  void joint(const Line& line) {
    if (motion_ > 1) fail(line, "read.unknown", "an arc in axis values");
    double slowest_deg_s = 1e300;
    for (const JointSpec& j : context_.cell.robot.joints) slowest_deg_s = std::min(slowest_deg_s, j.speed_rad_s * 57.29577951308232);
    const double ratio = *feed_ / 60 / slowest_deg_s;
    if (ratio > 1.0001) fail(line, "read.range", "F in degrees per minute is beyond the slowest joint", *feed_, slowest_deg_s * 60, "deg/min");
    std::array<double, 6> q{};
    for (std::size_t i = 0; i < 6; ++i) q[i] = *joints_[i];
    build_.joint(line, q, std::min(1.0, ratio));
  }

  Pose<frame::Work, frame::Tool> pose(const Line& line, const Point& p) const {
    const double a = *p[3], b = *p[4], c = *p[5], deg = 0.017453292519943295;
    const Vec3 at(*p[0], *p[1], *p[2]);
    if (mode_ == "cba") return {rotation_zyx(a, b, c), at};
    if (mode_ == "ypr") return {rotation_zyx(c, -b, a), at};
    if (mode_ != "euler") fail(line, "read.undefined", "Q1, Q2, Q3 cannot be read without controller.nci.orientation in cell.yaml");
    const double sa = std::sin(a * deg), ca = std::cos(a * deg), sb = std::sin(b * deg), cb = std::cos(b * deg), sc = std::sin(c * deg), cc = std::cos(c * deg);
    Mat3 R;  // Rz(Q3) Ry(Q2) Rz(Q1)
    R << cc * cb * ca - sc * sa, -cc * cb * sa - sc * ca, cc * sb,  //
        sc * cb * ca + cc * sa, -sc * cb * sa + cc * ca, sc * sb,   //
        -sb * ca, sb * sa, cb;
    return {rotation_of(R), at};
  }

  void arc(const Line& line, std::map<std::string, double>& value, const Point& before) {
    if (!before[0]) fail(line, "read.arc", "an arc needs a start; move to it first");
    static const char* const kCentre[] = {"I", "J", "K"};
    const std::size_t axis = plane_ == 17 ? 2 : plane_ == 18 ? 1 : 0, u = (axis + 1) % 3, v = (axis + 2) % 3;
    if (value.count(kCentre[axis])) fail(line, "read.arc", "a centre outside the arc's plane");
    if (std::abs(*before[axis] - *now_[axis]) > 0.0045) fail(line, "read.arc", "a helix is not read", std::abs(*before[axis] - *now_[axis]), 0.0045, "mm");
    if (!value.count(kCentre[u]) && !value.count(kCentre[v])) fail(line, "read.arc", "an arc needs its centre");
    const Vec2 p0(*before[u], *before[v]), p1(*now_[u], *now_[v]), c = p0 + Vec2(value[kCentre[u]], value[kCentre[v]]);
    const double r0 = (p0 - c).norm(), r1 = (p1 - c).norm();
    if (std::abs(r0 - r1) > 0.00102 || r0 < 1e-3) fail(line, "read.arc", "the radii at start and end differ, or are 0", std::abs(r0 - r1), 0.001, "mm");
    const double t0 = std::atan2(p0.y() - c.y(), p0.x() - c.x());
    double turn = std::atan2(p1.y() - c.y(), p1.x() - c.x()) - t0;
    turn -= 2 * kPi * std::floor(turn / (2 * kPi));  // to the left
    if (motion_ == 2) turn -= 2 * kPi;
    if (std::abs(turn) > kPi * (1 + 1e-9) || std::abs(turn) < 1e-9) fail(line, "read.arc", "an arc beyond half a turn is not read", deg_from_rad(std::abs(turn)), 180, "deg");
    Point middle = now_;
    middle[u] = c.x() + 0.5 * (r0 + r1) * std::cos(t0 + 0.5 * turn), middle[v] = c.y() + 0.5 * (r0 + r1) * std::sin(t0 + 0.5 * turn);
    middle[axis] = 0.5 * (*before[axis] + *now_[axis]);
    const auto from = pose(line, before), to = pose(line, now_);
    build_.circular(line, {from.q.slerp(0.5, to.q), Vec3(*middle[0], *middle[1], *middle[2])}, to, *feed_ / 60, 0);
  }
};

}  // namespace

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return reading::guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::nci
