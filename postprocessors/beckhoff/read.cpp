// SPDX-License-Identifier: GPL-3.0-or-later
// Beckhoff TwinCAT CNC -> neutral program. A whitelist written from dialect.md: blocks with G00 to G03 in axis values
// (transformation off, or #MCS) and in Cartesian (#TRAFO ON, #CS), feed, spindle, tool, dwell, contouring by corner distance,
// local and global sub-programs. A word or command outside it is a refusal with file and line, never a guess.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include "postprocessors/beckhoff/beckhoff.hpp"
#include "postprocessors/reading.hpp"

namespace asbuilt::beckhoff {
namespace {

using namespace reading;

constexpr const char kAxes[] = "XYZABC";
using Point = std::array<std::optional<double>, 6>;  // the words X Y Z A B C

struct Words {
  std::map<char, double> value;
  std::vector<int> g, m;
  bool has_axis() const {
    for (char c : std::string_view(kAxes))
      if (value.count(c)) return true;
    return false;
  }
};

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : text_(text), context_(context), build_(context) {
    for (const auto& [key, codes] : context.cell.controller.options) {
      int output = 0, on = 0, off = 0;
      if (std::sscanf(key.c_str(), "beckhoff.output.%d", &output) == 1 && std::sscanf(codes.c_str(), "%d %d", &on, &off) == 2)
        output_codes_[on] = {output, true}, output_codes_[off] = {output, false};
      for (const Equipment what : {Equipment::coolant, Equipment::arc, Equipment::weave, Equipment::recording, Equipment::tool_check}) {
        const std::string name = "beckhoff." + std::string(name_of(what));
        if (!key.starts_with(name) || (key.size() > name.size() && key[name.size()] != '.')) continue;
        const int data = key.size() > name.size() ? std::atoi(key.c_str() + name.size() + 1) : 0;
        const auto numbers = reading::words(codes);
        for (std::size_t i = 0; i < numbers.size() && i < 2; ++i) equipment_codes_[std::atoi(numbers[i].c_str())] = {what, data, i == 0};
      }
    }
  }

  Program read() {
    if (text_.files.empty()) fail({}, "read.missing", "no file");
    std::vector<Line> main = load(text_.files.front());
    run(main, 0);
    if (is_hsc_) fail(main.back(), "read.missing", "#HSC OFF is missing");
    if (!has_end_) fail(main.empty() ? Line{&text_.files.front().name, 0, {}} : main.back(), "read.missing", "M30 is missing");
    return std::move(build_.program);
  }

 private:
  const ProgramText& text_;
  const PostContext& context_;
  Builder build_;
  std::map<std::string, std::vector<Line>> subs_;
  std::map<int, std::pair<int, bool>> output_codes_;
  struct Switch {
    Equipment what;
    int data;
    bool is_on;
  };
  std::map<int, Switch> equipment_codes_;
  bool is_hsc_ = false;
  int hsc_points_ = 0, tool_number_ = 0;
  std::set<std::pair<int, int>> checked_;  // tool and index of its data that the program waits for
  std::map<int, Pose<frame::Base, frame::Work>> systems_;
  std::optional<Pose<frame::Base, frame::Work>> active_;
  bool is_trafo_ = false, is_mcs_ = false, is_contouring_ = false, is_centre_absolute_ = false;
  bool is_absolute_ = false, is_mm_ = false, is_per_minute_ = false, has_end_ = false, has_code_ = false;
  int motion_ = -1, plane_ = 17;
  std::optional<double> feed_, rpm_, contour_mm_;
  Point now_{}, joints_{};
  long long last_number_ = -1;

  // ---------------------------------------------------------------- files
  std::vector<Line> load(const ProgramFile& f) {
    std::vector<Line> main, *into = &main;
    bool has_main = false;
    build_.program.name = f.name.substr(0, f.name.rfind('.'));
    for (const Line& line : lines_of(f)) {
      Scanner s(line);
      if (s.peek() != '%') {
        into->push_back(line);
        continue;
      }
      s.expect("%");
      Scanner sub = s;
      if (sub.accept("L")) {
        const std::string name = sub.name();
        if (name.empty() || has_main) s.unknown();
        if (subs_.count(name)) fail(line, "read.name", "sub-program " + name + " is defined twice");
        into = &subs_[name];
        continue;
      }
      if (has_main || !main.empty()) fail(line, "read.unknown", "% begins a program, and one has begun already");
      has_main = true;
      into = &main;
      const std::string_view name = s.rest();
      if (name.empty() || name.find_first_of("([\"]#$;, ") != std::string_view::npos) s.unknown();
      build_.program.name = std::string(name);
    }
    return main;
  }

  /// The block without its comments; what they say goes to the program.
  std::string strip(const Line& line) {
    std::string code, remark;
    int depth = 0;
    for (std::size_t i = 0; i < line.text.size(); ++i) {
      const char c = line.text[i];
      if (depth == 0 && c == ';') {
        remark += line.text.substr(i + 1);
        break;
      }
      if (c == '(') {
        ++depth;
      } else if (c == ')') {
        if (--depth < 0) fail(line, "read.unknown", "a ) without its (");
      } else {
        (depth ? remark : code) += c;
      }
    }
    if (depth) fail(line, "read.unknown", "a comment is not closed");
    const bool is_remark_only = code.find_first_not_of(" \t") == std::string::npos;
    if (is_remark_only && line.text.find_first_of(";(") != std::string_view::npos) {
      if (has_code_) {
        build_.comment(remark);
      } else {
        const std::size_t a = std::min(remark.find_first_not_of(' '), remark.size());
        remark.erase(0, a);
        remark.erase(remark.find_last_not_of(' ') + 1);
        build_.program.header.push_back(remark);
      }
    }
    return code;
  }

  void run(const std::vector<Line>& lines, int depth) {
    if (depth > 10) fail(lines.empty() ? Line{} : lines.front(), "read.call", "sub-programs are nested deeper than 10");
    bool has_return = depth == 0;
    for (const Line& line : lines) {
      if (depth && has_return && line.text.find_first_not_of(" \t") == std::string_view::npos) continue;
      const std::string code = strip(line);
      Scanner s(line, code);
      if (s.at_end()) continue;
      if (has_end_) fail(line, "read.unknown", "something stands after the end of the program");
      has_code_ = true;
      if (code.size() > 4000) fail(line, "read.range", "a block has at most 4000 characters", static_cast<double>(code.size()), 4000);
      if (s.peek() == 'N' || s.peek() == 'n') {
        Scanner n = s;
        n.name();  // N10 is one token of letters and digits
        const std::string_view token = s.rest().substr(0, s.rest().size() - n.rest().size());
        long long number = 0;
        if (std::sscanf(std::string(token).c_str() + 1, "%lld", &number) != 1 || number <= last_number_ || number > 2000000000)
          fail(line, "read.range", "block numbers must rise", static_cast<double>(number), static_cast<double>(last_number_));
        for (char c : token.substr(1))
          if (c != ' ' && (c < '0' || c > '9')) s.unknown();
        if (depth == 0) last_number_ = number;
        s = n;
        if (s.at_end()) continue;
      }
      if (s.peek() == '#') {
        command(s);
        s.expect_end();
        continue;
      }
      Scanner call = s;
      if (call.accept("LL")) {
        const std::string name = call.name();
        call.expect_end();
        const auto it = subs_.find(name);
        if (it == subs_.end()) fail(line, "read.call", "sub-program " + name + " is not defined in this file");
        run(it->second, depth + 1);
        continue;
      }
      if (call.accept("L")) {
        const std::string_view name = call.rest();
        const ProgramFile* found = nullptr;
        for (const ProgramFile& f : text_.files)
          if (f.name == name) found = &f;
        if (!found || found == &text_.files.front()) fail(line, "read.call", std::string(name) + " is called but not among these files");
        run(lines_of(*found), depth + 1);
        continue;
      }
      if (block(s, depth)) return;
    }
    if (!has_return) fail(lines.empty() ? Line{} : lines.back(), "read.missing", "M17 or M29 is missing at the end of a sub-program");
  }

  // ---------------------------------------------------------------- commands
  static std::vector<double> bracket(Scanner& s) {
    std::vector<double> v;
    s.expect("[");
    do v.push_back(s.expect_number("a number"));
    while (s.accept(","));
    s.expect("]");
    return v;
  }
  static Pose<frame::Base, frame::Work> system(const Line& line, const std::vector<double>& v) {
    if (v.size() != 6) fail(line, "read.missing", "a coordinate system has six numbers", static_cast<double>(v.size()), 6);
    return {rotation_zyx(v[5], v[4], v[3]), Vec3(v[0], v[1], v[2])};
  }
  void forget_place() { now_ = {}; }

  void command(Scanner& s) {
    const Line line = s.line();
    if (is_hsc_ && !Scanner(s).accept("#HSC")) fail(line, "read.hsc", "inside #HSC only path blocks are read");
    if (s.accept("#TRAFO")) {
      const bool on = s.accept("ON");
      if (!on) s.expect("OFF");
      if (on && is_mcs_) fail(line, "read.order", "#TRAFO ON inside #MCS");
      is_trafo_ = on;
      joints_ = {};
      forget_place();
    } else if (s.accept("#MCS")) {
      const bool on = s.accept("ON");
      if (!on) s.expect("OFF");
      if (is_mcs_ == on) fail(line, "read.order", "#MCS is in that state already");
      is_mcs_ = on;
      joints_ = {};
      forget_place();
    } else if (s.accept("#KIN")) {
      s.expect("ID");
      const auto v = bracket(s);
      if (is_trafo_) fail(line, "read.order", "#KIN ID while the transformation is on");
      const auto wanted = context_.cell.controller.kinematic_id;
      if (v.size() != 1 || !wanted || v[0] != *wanted)
        fail(line, "read.kinematic", "the kinematic id is not the cell's", v[0], wanted.value_or(0));
    } else if (s.accept("#CS")) {
      if (s.accept("OFF")) {
        s.accept("ALL");
        active_.reset();
        forget_place();
        return;
      }
      const bool on = s.accept("ON");
      if (!on) s.expect("DEF");
      auto v = bracket(s);
      int id = 1;
      std::optional<std::vector<double>> values;
      if (v.size() == 1) {
        id = static_cast<int>(v[0]);
        if (id != v[0] || id < 1 || id > 5) fail(line, "read.range", "coordinate systems are numbered from 1 to 5", v[0], 5);
        if (s.peek() == '[') values = bracket(s);
      } else {
        values = v;
      }
      if (values) systems_[id] = system(line, *values);
      if (!on && !values) fail(line, "read.missing", "#CS DEF without its numbers");
      if (!on) {
        if (!is_trafo_) build_.set_frame(line, systems_[id]);
        return;
      }
      if (!systems_.count(id)) fail(line, "read.undefined", "#CS ON of a system that is not defined", id);
      active_ = systems_[id];
      forget_place();
    } else if (s.accept("#CONTOUR")) {
      s.expect("MODE"), s.expect("["), s.expect("DIST"), s.expect("PRE_DIST"), s.expect("=");
      const double pre = s.expect_number("the distance");
      s.expect("POST_DIST"), s.expect("=");
      const double post = s.expect_number("the distance");
      s.expect("]");
      if (pre != post || !(pre > 0)) fail(line, "read.range", "the corner distances must be equal and above 0", pre, post, "mm");
      contour_mm_ = pre;
    } else if (s.accept("#HSC")) {
      if (s.accept("ON")) {
        if (is_hsc_ || !is_trafo_ || is_mcs_) fail(line, "read.order", "#HSC ON belongs between path blocks, once");
        s.expect("["), s.expect("BSPLINE"), s.expect("PATH_DEV"), s.expect("=");
        const double dev = s.expect_number("the deviation");
        s.expect("]");
        const auto it = context_.cell.controller.options.find("beckhoff.hsc_path_dev");
        if (it == context_.cell.controller.options.end() || std::abs(std::atof(it->second.c_str()) - dev) > 5.1e-4)
          fail(line, "read.hsc", "PATH_DEV is not the cell's (controller.beckhoff.hsc_path_dev)", dev);
        is_hsc_ = true, hsc_points_ = 0;
      } else {
        s.expect("OFF");
        if (!is_hsc_) fail(line, "read.order", "#HSC OFF without ON");
        if (hsc_points_ < 2) fail(line, "read.spline", "a spline needs at least two points", hsc_points_, 2, "points");
        is_hsc_ = false;
      }
    } else if (s.accept("#WAIT")) {
      tool_check(s);
    } else if (s.accept("#FLUSH")) {
      s.accept("WAIT");
    } else {
      s.unknown();
    }
  }

  /// #WAIT FOR ABS[V.G.WZ[n].KIN_PARAM[i]-v] < 100: it must hold for the cell's tool, or the program would wait for ever.
  void tool_check(Scanner& s) {
    const Line line = s.line();
    s.expect("FOR"), s.expect("ABS"), s.expect("["), s.expect("V"), s.expect("."), s.expect("G"), s.expect("."), s.expect("WZ"), s.expect("[");
    const int number = s.expect_integer("the tool", 1, 9999);
    s.expect("]"), s.expect("."), s.expect("KIN_PARAM"), s.expect("[");
    const int index = s.expect_integer("the index", 0, 69);
    s.expect("]");
    const double sign = s.accept("+") ? -1 : 1;
    if (sign > 0) s.expect("-");
    const double wanted = sign * s.expect_integer("the value", 0, 100000000);
    s.expect("]"), s.expect("<");
    s.expect_integer("the limit", 100, 100);
    const auto option = context_.cell.controller.options.find("beckhoff.tool_data");
    if (option == context_.cell.controller.options.end()) fail(line, "read.undefined", "what KIN_PARAM[" + std::to_string(index) + "] is is the machine's; give controller.beckhoff.tool_data in cell.yaml", index);
    const auto indices = reading::words(option->second);
    std::size_t k = 0;
    while (k < indices.size() && std::atoi(indices[k].c_str()) != index) ++k;
    if (k >= indices.size() || k > 5) fail(line, "read.check", "KIN_PARAM[" + std::to_string(index) + "] is none of controller.beckhoff.tool_data", index);
    const ToolSpec* tool = nullptr;
    for (const ToolSpec& t : context_.cell.tools)
      if (t.number == number) tool = &t;
    if (!tool) fail(line, "read.tool", "tool " + std::to_string(number) + " is not in the cell", number);
    const Mat3 R = tool->T_flange_tool.rotation();
    const double deg = 57.29577951308232, cos_b = std::hypot(R(0, 0), R(1, 0));
    const bool is_pole = cos_b < 1e-9;
    const double a = is_pole ? std::atan2(-R(0, 1), R(1, 1)) : std::atan2(R(1, 0), R(0, 0)), b = std::atan2(-R(2, 0), cos_b), c = is_pole ? 0 : std::atan2(R(2, 1), R(2, 2));
    const std::array<double, 6> has{tool->T_flange_tool.p_mm.x(), tool->T_flange_tool.p_mm.y(), tool->T_flange_tool.p_mm.z(), a * deg, b * deg, c * deg};
    const double off = std::abs(has[k] * 1e4 - wanted);  // the machine's own units: 0.1 micrometres, 0.0001 degrees
    if (off > 5.1 && std::abs(off - 3.6e6) > 5.1) fail(line, "read.check", "the program would wait here for ever: the cell's tool differs from the one expected", off / 1e4, 0.0005);
    checked_.insert({number, index});
  }

  // ---------------------------------------------------------------- blocks
  Words words(Scanner& s) {
    Words w;
    while (!s.at_end()) {
      const char c = s.peek() >= 'a' && s.peek() <= 'z' ? static_cast<char>(s.peek() - 'a' + 'A') : s.peek();
      if (c < 'A' || c > 'Z') s.unknown();
      Scanner before = s;
      const std::string_view rest = s.rest();
      if (c == 'S' && rest.size() > 1 && rest[1] == '[') {  // S[REV 1000 M03]
        s = Scanner(s.line(), rest.substr(1));
        s.expect("["), s.expect("REV"), s.accept("=");
        set_once(s, w, 'S', s.expect_number("the speed"));
        Scanner m(s.line(), s.rest());
        w.m.push_back(m_code(m));
        m.expect("]");
        s = m;
        continue;
      }
      s = Scanner(s.line(), rest.substr(1));
      s.accept("=");
      const auto v = s.number();
      if (!v) before.unknown();
      if (c == 'G' || c == 'M') {
        if (*v != std::floor(*v) || *v < 0 || *v > 999) before.unknown();
        std::vector<int>& codes = c == 'G' ? w.g : w.m;
        for (int known : codes)
          if (known == static_cast<int>(*v)) fail(s.line(), "read.unknown", std::string(1, c) + std::to_string(known) + " is given twice");
        codes.push_back(static_cast<int>(*v));
      } else {
        set_once(before, w, c, *v);
      }
    }
    return w;
  }
  static int m_code(Scanner& m) {
    for (const char* t : {"M03", "M3"})
      if (m.accept(t)) return 3;
    for (const char* t : {"M05", "M5"})
      if (m.accept(t)) return 5;
    m.unknown();
  }
  static void set_once(Scanner& s, Words& w, char c, double v) {
    if (!w.value.emplace(c, v).second) fail(s.line(), "read.unknown", std::string("the word ") + c + " is given twice");
  }

  /// True where the block ends the program part that is running.
  bool block(Scanner& s, int depth) {
    const Line line = s.line();
    Words w = words(s);
    bool is_dwell = false, is_exact = false, is_corner = false;
    int motions = 0;
    for (int g : w.g) {
      switch (g) {
        case 0: case 1: case 2: case 3: motion_ = g, ++motions; break;
        case 4: is_dwell = true; break;
        case 17: case 18: case 19: plane_ = g; break;
        case 40: case 53: break;
        case 60: is_exact = true; break;
        case 61: is_corner = true; break;
        case 71: is_mm_ = true; break;
        case 90: is_absolute_ = true; break;
        case 94: is_per_minute_ = true; break;
        case 161: is_centre_absolute_ = true; break;
        case 162: is_centre_absolute_ = false; break;
        case 260: is_contouring_ = false; break;
        case 261: is_contouring_ = true; break;
        default: fail(line, "read.unknown", "G" + std::to_string(g) + " is not read", g);
      }
    }
    if (motions > 1) fail(line, "read.unknown", "two kinds of motion in one block");
    for (const auto& [c, v] : w.value)
      if (std::string_view("XYZABCIJKRFSTD").find(c) == std::string_view::npos) fail(line, "read.unknown", std::string("the word ") + c + " is not read", v);
    if (is_dwell) {
      if (w.value.size() != 1 || !w.value.count('X') || w.g.size() != 1 || !w.m.empty()) fail(line, "read.unknown", "a dwell is G04 X and seconds, alone");
      build_.wait(line, w.value['X']);
      return false;
    }
    if (w.value.count('T') || w.value.count('D')) {
      const double t = w.value.count('D') ? w.value['D'] : w.value['T'];
      if (w.value.count('T') && w.value['T'] != t) fail(line, "read.tool", "T and D name different tools", w.value['T'], t);
      if (t != std::floor(t) || t < 1 || t > 9999) fail(line, "read.range", "tools are whole numbers from 1", t, 9999);
      build_.set_tool(line, static_cast<int>(t));
      tool_number_ = static_cast<int>(t);
    }
    if (w.value.count('F')) {
      feed_ = w.value['F'];
      if (!(*feed_ > 0)) fail(line, "read.range", "F must be greater than 0", *feed_, 0, "mm/min");
    }
    if (w.value.count('S')) rpm_ = w.value['S'];
    bool ends = false;
    for (int m : w.m) {
      if (m == 3) {
        if (!rpm_) fail(line, "read.undefined", "M3 before S");
        build_.spindle_on(line, *rpm_);
      } else if (m == 5) {
        if (w.value.count('S')) fail(line, "read.unknown", "M5 takes no S");
      } else if (m == 30 || m == 2) {
        if (depth) fail(line, "read.unknown", "the program ends inside a sub-program");
        has_end_ = true;
      } else if (m == 17 || m == 29) {
        const auto it = context_.cell.controller.options.find("beckhoff.delivery");
        const bool is_sub = it != context_.cell.controller.options.end() && it->second == "sub";
        if (!depth && !is_sub) fail(line, "read.unknown", "M17 and M29 end sub-programs");
        if (depth) ends = true;
        else has_end_ = true;
      } else if (const auto it = equipment_codes_.find(m); it != equipment_codes_.end()) {
        if (it->second.is_on) build_.switch_on(line, it->second.what, it->second.data);
        else build_.switch_off(line, it->second.what, it->second.data);
      } else if (output_codes_.count(m)) {
        build_.digital_output(line, output_codes_[m].first, output_codes_[m].second);
      } else {
        fail(line, "read.unknown", "M" + std::to_string(m) + " is not known; name it as an output in cell.yaml (controller.beckhoff.output.N)", m);
      }
    }
    if (w.has_axis()) {
      if (has_end_) fail(line, "read.unknown", "a motion in the last block");
      if (motion_ < 0) fail(line, "read.undefined", "a motion before G00, G01, G02 or G03");
      if (const auto option = context_.cell.controller.options.find("beckhoff.tool_data"); option != context_.cell.controller.options.end())
        for (const std::string& index : reading::words(option->second))
          if (!checked_.count({tool_number_, std::atoi(index.c_str())}))
            fail(line, "read.check", "the tool's data are not checked before its first motion (KIN_PARAM[" + index + "])", tool_number_);
      if (!is_absolute_ || !is_mm_ || !is_per_minute_) fail(line, "read.undefined", "a motion before G90, G71 and G94 are set");
      if (is_trafo_ && !is_mcs_)
        path(line, w, !is_exact && (is_contouring_ || is_corner));
      else
        joint(line, w);
    } else {
      if (motions) fail(line, "read.unknown", "a kind of motion without a target");
      for (char c : {'I', 'J', 'K', 'R'})
        if (w.value.count(c)) fail(line, "read.unknown", "I, J, K, R belong to an arc");
    }
    for (int m : w.m)
      if (m == 5) build_.spindle_off();  // after the motion of its block
    return ends;
  }

  void joint(const Line& line, Words& w) {
    for (int i = 0; i < 6; ++i)
      if (w.value.count(kAxes[i])) joints_[i] = w.value[kAxes[i]];
    std::array<double, 6> q{};
    for (int i = 0; i < 6; ++i) {
      if (!joints_[i]) fail(line, "read.missing", std::string("axis ") + kAxes[i] + " has no value since the transformation was switched");
      q[i] = *joints_[i];
    }
    if (motion_ > 1) fail(line, "read.unknown", "an arc in axis values");
    for (char c : {'I', 'J', 'K', 'R'})
      if (w.value.count(c)) fail(line, "read.unknown", "I, J, K, R belong to an arc");
    double ratio = 1;
    if (motion_ == 1) {
      if (!feed_) fail(line, "read.undefined", "G01 before F");
      double slowest_deg_s = 1e300;
      for (const JointSpec& j : context_.cell.robot.joints) slowest_deg_s = std::min(slowest_deg_s, j.speed_rad_s * 57.29577951308232);
      ratio = *feed_ / 60.0 / slowest_deg_s;
      if (ratio > 1.0001) fail(line, "read.range", "F in degrees per minute is beyond the slowest joint", *feed_, slowest_deg_s * 60, "deg/min");
    }
    build_.joint(line, q, std::min(1.0, ratio));
    feed_.reset();  // degrees per minute here, millimetres per minute there: never carried over
  }

  Eigen::Quaterniond orientation(const Line& line, const Point& p) const {
    const double a = *p[3], b = *p[4], c = *p[5];
    const auto mode = context_.cell.controller.orientation;
    if (!mode) fail(line, "read.undefined", "A, B, C cannot be read without controller.beckhoff.orientation in cell.yaml");
    if (*mode == BeckhoffOrientation::cba) return rotation_zyx(a, b, c);
    if (*mode == BeckhoffOrientation::ypr) return rotation_zyx(c, -b, a);
    const double deg = 0.017453292519943295;
    const double sa = std::sin(a * deg), ca = std::cos(a * deg), sb = std::sin(b * deg), cb = std::cos(b * deg), sc = std::sin(c * deg),
                 cc = std::cos(c * deg);
    Mat3 R;  // Rz(C) Ry(B) Rz(A)
    R << cc * cb * ca - sc * sa, -cc * cb * sa - sc * ca, cc * sb,  //
        sc * cb * ca + cc * sa, -sc * cb * sa + cc * ca, sc * sb,   //
        -sb * ca, sb * sa, cb;
    return rotation_of(R);
  }
  Pose<frame::Work, frame::Tool> pose(const Line& line, const Point& p) const { return {orientation(line, p), Vec3(*p[0], *p[1], *p[2])}; }

  void path(const Line& line, Words& w, bool is_rounded) {
    const Point before = now_;
    for (int i = 0; i < 6; ++i)
      if (w.value.count(kAxes[i])) now_[i] = w.value[kAxes[i]];
    for (int i = 0; i < 6; ++i)
      if (!now_[i]) fail(line, "read.missing", std::string("the word ") + kAxes[i] + " has no value since the frame was switched");
    build_.set_frame(line, active_.value_or(Pose<frame::Base, frame::Work>()));
    double blend = 0;
    if (is_rounded) {
      if (!contour_mm_) fail(line, "read.undefined", "contouring before #CONTOUR MODE gives its distance");
      blend = *contour_mm_;
    }
    double speed = 0;
    if (motion_ == 0) {
      const auto it = context_.cell.controller.options.find("beckhoff.rapid_mm_s");
      if (it == context_.cell.controller.options.end())
        fail(line, "read.rapid", "the speed of G00 in Cartesian is the machine's; give controller.beckhoff.rapid_mm_s in cell.yaml");
      Scanner r(line, it->second);
      speed = r.expect_number("controller.beckhoff.rapid_mm_s");
    } else {
      if (!feed_) fail(line, "read.undefined", "a path motion before F");
      speed = *feed_ / 60.0;
    }
    if (is_hsc_) {
      if (motion_ != 1 || !w.m.empty() || w.value.count('S') || blend > 0) fail(line, "read.hsc", "inside #HSC only G01 with its words and F is read");
      ++hsc_points_;
      return build_.spline(line, pose(line, now_), speed);
    }
    if (motion_ > 1) return arc(line, w, before, speed, blend);
    for (char c : {'I', 'J', 'K', 'R'})
      if (w.value.count(c)) fail(line, "read.unknown", "I, J, K, R belong to an arc");
    build_.linear(line, pose(line, now_), speed, blend);
  }

  void arc(const Line& line, Words& w, const Point& before, double speed, double blend) {
    if (!before[0]) fail(line, "read.arc", "an arc needs a start; move to it first");
    const int axis = plane_ == 17 ? 2 : plane_ == 18 ? 1 : 0, u = (axis + 1) % 3, v = (axis + 2) % 3;
    const Vec2 p0(*before[u], *before[v]), p1(*now_[u], *now_[v]);
    static constexpr char kCentre[] = "IJK";
    if (w.value.count(kCentre[axis])) fail(line, "read.arc", std::string("the word ") + kCentre[axis] + " is outside the arc's plane");
    if (std::abs(*before[axis] - *now_[axis]) > 0.0045)
      fail(line, "read.arc", "a helix is not read", std::abs(*before[axis] - *now_[axis]), 0.0045, "mm");
    Vec2 centre;
    const bool is_left = motion_ == 3;
    if (w.value.count('R')) {
      const double r = w.value['R'], half = (p1 - p0).norm() / 2;
      if (std::abs(r) < half - 1e-6 || half < 1e-6) fail(line, "read.arc", "the radius is smaller than half the chord", r, half, "mm");
      const double h = std::sqrt(std::max(0.0, r * r - half * half)) * ((r > 0) == is_left ? 1 : -1);
      const Vec2 d = (p1 - p0) / (2 * half);
      centre = (p0 + p1) / 2 + h * Vec2(-d.y(), d.x());
    } else {
      if (!w.value.count(kCentre[u]) && !w.value.count(kCentre[v])) fail(line, "read.arc", "an arc needs its centre or its radius");
      const auto word = [&](int i) { return w.value.count(kCentre[i]) ? w.value[kCentre[i]] : 0.0; };
      centre = Vec2(word(u), word(v)) + (is_centre_absolute_ ? Vec2::Zero() : p0);
    }
    const double r0 = (p0 - centre).norm(), r1 = (p1 - centre).norm();
    if (std::abs(r0 - r1) > 0.001 + 2e-5) fail(line, "read.arc", "the radii at start and end differ", std::abs(r0 - r1), 0.001, "mm");
    if (r0 < 1e-3) fail(line, "read.arc", "an arc without a radius", r0, 1e-3, "mm");
    const double t0 = std::atan2(p0.y() - centre.y(), p0.x() - centre.x());
    double turn = std::atan2(p1.y() - centre.y(), p1.x() - centre.x()) - t0;
    const double full = 2 * kPi;
    turn -= full * std::floor(turn / full);  // 0 .. 360 degrees to the left
    if (turn < 1e-9) turn = full;
    if (!is_left) turn = turn > full - 1e-9 ? -full : turn - full;
    const int pieces = std::max(1, static_cast<int>(std::ceil(std::abs(turn) / (0.98 * kPi))));
    const auto start = pose(line, before), end = pose(line, now_);
    const auto at = [&](double f) {  // pose a part of the way
      const double r = r0 + f * (r1 - r0), t = t0 + f * turn;
      Vec3 p;
      p[u] = centre.x() + r * std::cos(t), p[v] = centre.y() + r * std::sin(t);
      p[axis] = *before[axis] + f * (*now_[axis] - *before[axis]);
      return Pose<frame::Work, frame::Tool>(start.q.slerp(f, end.q), p);
    };
    for (int k = 0; k < pieces; ++k) {
      const bool is_last = k + 1 == pieces;
      build_.circular(line, at((k + 0.5) / pieces), is_last ? end : at((k + 1.0) / pieces), speed, is_last ? blend : 0);
    }
  }
};

}  // namespace

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return reading::guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::beckhoff
