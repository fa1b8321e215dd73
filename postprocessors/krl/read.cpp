// SPDX-License-Identifier: GPL-3.0-or-later
// KUKA KRL -> neutral program. A whitelist written from dialect.md: straight-line programs with sub-program calls, named or
// literal positions, PTP to axis values, LIN, CIRC and their spline singles, frames, speeds, rounding, outputs and triggers.
// A statement outside it is a refusal with file and line, never a guess.
#include <cmath>
#include <map>
#include <set>

#include "postprocessors/krl/krl.hpp"
#include "postprocessors/reading_arm.hpp"

namespace asbuilt::krl {
namespace {

using namespace reading;

using Components = std::map<std::string, double>;  // of an aggregate: X, A1, S, CP ...

struct Module {
  Line head;
  std::string name;
  std::vector<Line> body;
  std::vector<std::string> header;
};

bool is_comment_fold(std::string_view comment) { return comment.starts_with("FOLD") || comment.starts_with("ENDFOLD"); }

class Reader {
 public:
  Reader(const ProgramText& text, const PostContext& context) : text_(text), context_(context), build_(context) {}

  Program read() {
    for (const ProgramFile& f : text_.files) load(f);
    if (order_.empty()) fail({}, "read.missing", "no .src file with a DEF");
    const Module& main = modules_.at(order_.front());
    build_.program.name = std::string(original_name_);
    build_.program.header = main.header;
    run(main);
    if (is_in_spline_) fail(main.head, "read.missing", "ENDSPLINE is missing");
    if (!armed_at_.text.empty()) fail(armed_at_, "read.trigger", "no motion follows this TRIGGER, so it never fires");
    return std::move(build_.program);
  }

 private:
  const ProgramText& text_;
  const PostContext& context_;
  Builder build_;
  ArmReader arm_{context_};
  std::map<std::string, Module> modules_;
  std::vector<std::string> order_;
  std::string original_name_;
  std::map<std::string, Components> names_;         // declared positions, frames, frame data
  std::set<std::string> declared_;                  // names without a value
  std::map<int, Components> base_data_;
  std::set<std::string> running_;
  Components now_;                                  // the last Cartesian target: left-out components keep their value
  std::optional<double> speed_m_s_, apo_mm_;
  std::array<std::optional<double>, 6> percent_;
  std::string fdat_;
  bool is_in_spline_ = false;
  int spline_points_ = 0;
  std::set<std::string> checked_;                   // machine values that the program waits for
  Line armed_at_;                                   // a trigger that waits for its motion
  std::vector<std::pair<Line, std::string>> at_end_of_next_;

  // ---------------------------------------------------------------- files
  static std::string_view code(std::string_view text) { return text.substr(0, text.find(';')); }

  void load(const ProgramFile& f) {
    const auto ends = [&](std::string_view e) {
      std::string low = f.name;
      for (char& c : low) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
      return low.ends_with(e);
    };
    if (ends(".dat")) return load_data(f);
    if (ends(".cell.txt")) return;  // for the integrator, never loaded
    if (!ends(".src")) fail({&f.name, 0, {}}, "read.file", "a KRL program consists of .src and .dat files");
    Module* open = nullptr;
    bool has_code = false;
    for (const Line& line : lines_of(f)) {
      Scanner s(line, code(line.text));
      if (line.text.starts_with("&")) {
        if (open || has_code) fail(line, "read.unknown", "a line with & belongs at the top of the file");
        continue;
      }
      if (s.at_end()) {
        if (!open) continue;
        const std::size_t at = line.text.find(';');
        if (open->body.empty() && at != std::string_view::npos && !is_comment_fold(line.text.substr(at + 1))) {
          std::string_view h = line.text.substr(at + 1);
          h.remove_prefix(std::min(h.find_first_not_of(' '), h.size()));
          h.remove_suffix(h.size() - std::min(h.size(), h.find_last_not_of(' ') + 1));
          open->header.emplace_back(h);
        } else if (at != std::string_view::npos) {
          open->body.push_back(line);
        }
        continue;
      }
      has_code = true;
      Scanner d(line, code(line.text));
      d.accept("GLOBAL");
      if (d.accept("DEF")) {
        if (open) fail(line, "read.unknown", "a DEF inside another one; END is missing");
        const std::string_view before = d.rest();
        Module m;
        m.head = line;
        m.name = d.name();
        if (m.name.empty()) d.unknown();
        if (order_.empty()) original_name_ = std::string(before.substr(0, m.name.size()));
        d.expect("("), d.expect(")"), d.expect_end();
        if (modules_.count(m.name)) fail(line, "read.name", m.name + " is defined twice");
        order_.push_back(m.name);
        open = &modules_[m.name];
        *open = std::move(m);
        continue;
      }
      if (!open) s.unknown();
      if (s.accept("END")) {
        s.expect_end();
        open->body.push_back(line);
        open = nullptr;
        continue;
      }
      open->body.push_back(line);
    }
    if (open) fail(open->head, "read.missing", "END is missing");
  }

  void load_data(const ProgramFile& f) {
    int state = 0;  // 0: before DEFDAT, 1: inside, 2: after ENDDAT
    for (const Line& line : lines_of(f)) {
      Scanner s(line, code(line.text));
      if (line.text.starts_with("&")) {
        if (state != 0) fail(line, "read.unknown", "a line with & belongs at the top of the file");
        continue;
      }
      if (s.at_end()) continue;
      if (state == 0) {
        s.expect("DEFDAT");
        if (s.name().empty()) s.unknown();
        s.accept("PUBLIC"), s.expect_end();
        state = 1;
      } else if (state == 1 && s.accept("ENDDAT")) {
        s.expect_end(), state = 2;
      } else if (state == 1) {
        if (s.accept("EXT")) continue;  // the head of a sub-program elsewhere
        if (!declaration(s)) s.unknown();
      } else {
        s.unknown();
      }
    }
    if (state != 2) fail({&f.name, 0, {}}, "read.missing", "DEFDAT or ENDDAT is missing");
  }

  /// DECL [GLOBAL] type name [= value] [, name ...]; false where the line is no declaration.
  bool declaration(Scanner& s) {
    static const std::set<std::string> with_value = {"E6POS", "POS", "FRAME", "E6AXIS", "AXIS", "FDAT"};
    static const std::set<std::string> ignored = {"LDAT", "PDAT", "LOAD", "INT", "REAL", "BOOL", "CHAR", "BASIS_SUGG_T"};
    Scanner t = s;
    t.accept("GLOBAL");
    const bool is_decl = t.accept("DECL");
    t.accept("GLOBAL");
    const std::string type = t.name();
    const bool is_simple = type == "INT" || type == "REAL" || type == "BOOL" || type == "CHAR";
    if (!is_decl && !is_simple && !with_value.count(type)) return false;
    s = t;
    if (ignored.count(type)) {
      if (s.name().empty()) s.unknown();
      return true;
    }
    if (!with_value.count(type)) fail(s.line(), "read.unknown", "a declaration of type " + type + " is not read");
    do {
      const std::string name = s.name();
      if (name.empty()) s.unknown();
      if (s.accept("=")) {
        if (names_.count(name)) fail(s.line(), "read.name", name + " is declared twice");
        names_[name] = aggregate(s);
      } else {
        declared_.insert(name);
      }
    } while (s.accept(","));
    s.expect_end();
    return true;
  }

  /// {X 1.0,Y 2.0,...}; a value may be a number, an enumeration, text or a list with index.
  Components aggregate(Scanner& s) {
    static const std::set<std::string> numeric = {"X",  "Y",  "Z",  "A",  "B",  "C",  "S",  "T",  "A1", "A2",      "A3",      "A4", "A5",
                                                  "A6", "E1", "E2", "E3", "E4", "E5", "E6", "CP", "ORI1", "ORI2", "TOOL_NO", "BASE_NO"};
    Components out;
    s.expect("{");
    for (bool first = true; !s.accept("}"); first = false) {
      if (!first) s.expect(",");
      std::string key = s.name();
      if (first && s.accept(":")) key = s.name();  // {E6POS: X ...
      if (numeric.count(key)) {
        if (!out.emplace(key, s.expect_number("a number")).second) fail(s.line(), "read.name", key + " is given twice");
      } else if (key == "IPO_FRAME") {
        s.expect("#BASE");
      } else if (key == "POINT2") {
        s.expect("["), s.expect("]"), s.expect("\"");
        while (!s.accept("\""))
          if (s.name().empty()) s.unknown();
      } else {
        s.unknown();
      }
    }
    return out;
  }

  // ---------------------------------------------------------------- values
  Components value(Scanner& s, std::string_view what) {
    if (s.peek() == '{') return aggregate(s);
    const Scanner before = s;
    const std::string name = s.name();
    const auto it = names_.find(name);
    if (it != names_.end()) return it->second;
    if (name == "XHOME") {
      Components home;
      for (int i = 0; i < 6; ++i) home["A" + std::to_string(i + 1)] = deg_from_rad(context_.cell.robot.home_rad[i]);
      return home;
    }
    if (declared_.count(name)) fail(s.line(), "read.undefined", name + " is declared but has no value");
    Scanner at = before;
    fail(s.line(), "read.undefined", std::string(what) + " \"" + std::string(at.rest()).substr(0, 40) + "\" is not defined in these files");
  }
  static double get(const Components& c, const char* key) {
    const auto it = c.find(key);
    return it == c.end() ? 0 : it->second;
  }
  template <class To>
  static Pose<To, frame::Tool> pose_of(const Components& c) {
    return {rotation_zyx(get(c, "A"), get(c, "B"), get(c, "C")), Vec3(get(c, "X"), get(c, "Y"), get(c, "Z"))};
  }
  void need_frame(const Line& line, const Components& c) {
    for (const char* k : {"X", "Y", "Z", "A", "B", "C"})
      if (!c.count(k)) fail(line, "read.missing", std::string("the frame lacks its component ") + k);
    if (c.size() != 6) fail(line, "read.unknown", "a frame has the components X, Y, Z, A, B, C and no more");
  }
  Components base_data(const Line& line, int n) {
    if (base_data_.count(n)) return base_data_[n];
    if (n == 0) return {{"X", 0}, {"Y", 0}, {"Z", 0}, {"A", 0}, {"B", 0}, {"C", 0}};
    fail(line, "read.undefined", "BASE_DATA[" + std::to_string(n) + "] is on the controller and not in these files", n);
  }
  void set_base(const Line& line, const Components& c) {
    need_frame(line, c);
    const auto T = pose_of<frame::Base>(c);
    build_.set_frame(line, {T.q, T.p_mm});
    now_.clear();
  }
  void set_base(Scanner& s) {
    if (s.accept("$NULLFRAME") || s.accept("$WORLD")) return set_base(s.line(), base_data(s.line(), 0));
    if (s.accept("BASE_DATA")) return set_base(s.line(), base_data(s.line(), index(s, 0, 32)));
    set_base(s.line(), value(s, "the frame"));
  }
  static int index(Scanner& s, int lo, int hi) {
    s.expect("[");
    const int n = s.expect_integer("the index", lo, hi);
    s.expect("]");
    return n;
  }
  void set_tool(Scanner& s) {
    if (s.accept("TOOL_DATA")) return build_.set_tool(s.line(), index(s, 1, 16));
    const Components c = value(s, "the tool");
    need_frame(s.line(), c);
    const auto T = pose_of<frame::Flange>(c);
    build_.set_tool_pose(s.line(), T);
  }

  // ---------------------------------------------------------------- statements
  void run(const Module& m) {
    if (!running_.insert(m.name).second) fail(m.head, "read.call", m.name + " calls itself");
    if (running_.size() > 10) fail(m.head, "read.call", "calls are nested deeper than 10");
    for (const Line& line : m.body) {
      const std::size_t semicolon = line.text.find(';');
      Scanner s(line, code(line.text));
      if (s.at_end()) {
        const std::string_view c = line.text.substr(semicolon + 1);
        if (!is_comment_fold(c)) build_.comment(c);
        continue;
      }
      if (s.accept("END")) break;
      statement(s);
      s.expect_end();
    }
    running_.erase(m.name);
  }

  void statement(Scanner& s) {
    if (s.accept("GLOBAL")) {
      for (const char* t : {"INTERRUPT", "DECL", "3", "WHEN", "$STOPMESS", "=", "=", "TRUE", "DO", "IR_STOPM", "(", ")"}) s.expect(t);
      return;
    }
    if (s.accept("INTERRUPT")) return s.expect("ON"), s.expect("3");
    if (s.accept("BAS")) return basic(s);
    if (s.accept("EXT")) {
      while (!s.at_end())
        if (s.name().empty() && !s.accept("(") && !s.accept(")") && !s.accept(":") && !s.accept(",")) s.unknown();
      return;
    }
    if (s.accept("SPLINE")) {
      if (is_in_spline_) s.unknown();
      is_in_spline_ = true, spline_points_ = 0;
      return;
    }
    if (s.accept("ENDSPLINE")) {
      if (!is_in_spline_) s.unknown();
      if (spline_points_ < 2) fail(s.line(), "read.spline", "a spline block needs at least two points", spline_points_, 2, "points");
      is_in_spline_ = false;
      return;
    }
    if (s.accept("SPL")) {
      if (!is_in_spline_) fail(s.line(), "read.spline", "SPL outside a spline block");
      return path(s, false, true);
    }
    if (is_in_spline_) fail(s.line(), "read.spline", "inside a spline block only SPL is read");
    if (s.accept("WAIT")) return wait(s);
    if (s.accept("TRIGGER")) return trigger(s);
    if (s.accept("CONTINUE")) return;
    for (const char* k : {"PTP", "SPTP"})
      if (s.accept(k)) return joint(s);
    for (const char* k : {"LIN", "SLIN"})
      if (s.accept(k)) return path(s, false, k[0] == 'S');
    for (const char* k : {"CIRC", "SCIRC"})
      if (s.accept(k)) return path(s, true, k[0] == 'S');
    Scanner d = s;
    if (declaration(d)) {
      s = d;
      return;
    }
    if (setting(s)) return;
    Scanner c = s;
    const std::string name = c.name();
    if (!name.empty() && c.accept("(")) {
      Scanner e = s;
      if (equipment(e)) {
        s = e;
        return;
      }
      c.expect(")");
      const auto it = modules_.find(name);
      if (it == modules_.end()) fail(s.line(), "read.call", name + " is called but not among these files");
      s = c;
      return run(it->second);
    }
    if (!name.empty() && (names_.count(name) || declared_.count(name)) && c.accept("=")) {
      names_[name] = aggregate(c);
      s = c;
      return;
    }
    s.unknown();
  }

  /// A call of one of the machine's own sub-programs that switch something: ARC_START(3), LOG_START( ).
  bool equipment(Scanner& s) {
    const Line line = s.line();
    const std::string called = s.name();
    for (const Equipment what : {Equipment::arc, Equipment::weave, Equipment::recording, Equipment::tool_check}) {
      const auto it = context_.cell.controller.options.find("krl." + std::string(name_of(what)));
      if (it == context_.cell.controller.options.end()) continue;
      const auto names = words(it->second);
      for (std::size_t k = 0; k < names.size() && k < 2; ++k) {
        std::string name = names[k];
        for (char& c : name) c = static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
        if (name != called) continue;
        s.expect("(");
        const int data = what == Equipment::recording ? 0 : s.expect_integer("the number of the data", 1, 255);
        s.expect(")");
        if (k == 0) build_.switch_on(line, what, data);
        else build_.switch_off(line, what, data);
        return true;
      }
    }
    return false;
  }
  std::optional<int> coolant() const {
    const auto it = context_.cell.controller.options.find("krl.coolant");
    if (it == context_.cell.controller.options.end()) return std::nullopt;
    return std::atoi(it->second.c_str());
  }

  void basic(Scanner& s) {
    s.expect("(");
    if (s.accept("#INITMOV")) {
      s.expect(","), s.expect("0");
      speed_m_s_.reset(), apo_mm_.reset(), percent_ = {};
    } else if (s.accept("#VEL_PTP") || s.accept("#PTP_PARAMS")) {
      s.expect(",");
      percent_.fill(s.expect_integer("the percentage", 1, 100));
    } else if (s.accept("#VEL_CP") || s.accept("#CP_PARAMS")) {
      s.expect(",");
      speed_m_s_ = s.expect_number("the speed");
    } else if (s.accept("#TOOL")) {
      s.expect(",");
      build_.set_tool(s.line(), s.expect_integer("the tool number", 1, 16));
    } else if (s.accept("#BASE")) {
      s.expect(",");
      set_base(s.line(), base_data(s.line(), s.expect_integer("the base number", 0, 32)));
    } else if (s.accept("#ACC_PTP") || s.accept("#ACC_CP")) {
      s.expect(",");
      s.expect_number("the acceleration");
    } else if (s.accept("#PTP_DAT") || s.accept("#CP_DAT")) {
    } else if (s.accept("#FRAMES")) {
      if (!names_.count(fdat_)) fail(s.line(), "read.undefined", "BAS(#FRAMES) without a known FDAT_ACT");
      const Components& f = names_[fdat_];
      build_.set_tool(s.line(), static_cast<int>(get(f, "TOOL_NO")));
      set_base(s.line(), base_data(s.line(), static_cast<int>(get(f, "BASE_NO"))));
    } else {
      s.unknown();
    }
    s.expect(")");
  }

  double reference(Scanner& s) {
    if (const auto v = s.number()) return *v;
    Components c;
    if (s.accept("TOOL_DATA")) {
      const int n = index(s, 1, 16);
      const ToolSpec* tool = nullptr;
      for (const ToolSpec& t : context_.cell.tools)
        if (t.number == n) tool = &t;
      if (!tool) fail(s.line(), "read.tool", "tool " + std::to_string(n) + " is not in the cell", n);
      const Mat3 R = tool->T_flange_tool.rotation();
      const double deg = 57.29577951308232, cos_b = std::sqrt(R(0, 0) * R(0, 0) + R(1, 0) * R(1, 0));
      const bool is_pole = cos_b < 1e-9;
      c = {{"X", tool->T_flange_tool.p_mm.x()}, {"Y", tool->T_flange_tool.p_mm.y()}, {"Z", tool->T_flange_tool.p_mm.z()},
           {"A", deg * (is_pole ? std::atan2(-R(0, 1), R(1, 1)) : std::atan2(R(1, 0), R(0, 0)))}, {"B", deg * std::atan2(-R(2, 0), cos_b)},
           {"C", is_pole ? 0.0 : deg * std::atan2(R(2, 1), R(2, 2))}};
    } else {
      c = value(s, "the value");
    }
    s.expect(".");
    const std::string key = s.name();
    const auto it = c.find(key);
    if (it == c.end()) fail(s.line(), "read.undefined", "the value has no component " + key);
    return it->second;
  }

  /// A check of which controller this is: it must be the cell's.
  void machine_check(const Line& line, const std::string& key, const std::string& text) {
    const auto it = context_.cell.controller.options.find(key);
    if (it == context_.cell.controller.options.end() || it->second != text)
      fail(line, "read.check", "the program waits for a controller with \"" + text + "\", and the cell's (controller." + key + ") " + (it == context_.cell.controller.options.end() ? "is not given" : "is \"" + it->second + "\""));
    checked_.insert(key);
  }
  void wait(Scanner& s) {
    if (s.accept("SEC")) return build_.wait(s.line(), s.expect_number("the time"));
    s.expect("FOR");
    if (s.accept("$KR_SERIALNO")) {
      s.expect("="), s.expect("=");
      return machine_check(s.line(), "krl.serial_number", std::to_string(s.expect_integer("the number", 1, 999999999)));
    }
    if (s.accept("StrFind")) {
      for (const char* t : {"(", "1", ",", "$RCV_INFO", "[", "]", ",", "\""}) s.expect(t);
      const std::string_view rest = s.rest();
      const std::string text(rest.substr(0, std::min(rest.find('"'), rest.size())));
      s = Scanner(s.line(), rest.substr(text.size()));
      for (const char* t : {"\"", ",", "#NOT_CASE_SENS", ")"}) s.expect(t);
      return machine_check(s.line(), "krl.kernel", text);
    }
    do {  // a check of the machine's data: it must hold for the cell, or the program would wait for ever
      s.expect("ABS"), s.expect("(");
      const double a = reference(s);
      s.expect("-");
      const double b = reference(s);
      s.expect(")"), s.expect("<");
      const double limit = s.expect_number("the limit");
      const double d = std::abs(a - b);
      if (!(std::min(d, std::abs(d - 360)) < limit + 1e-9))
        fail(s.line(), "read.check", "the program would wait here for ever: the cell's value differs from the one expected", d, limit);
    } while (s.accept("AND"));
  }

  bool output(Scanner& s, const Line& line) {
    if (s.accept("$OUT")) {
      const int n = index(s, 1, 4096);
      s.expect("=");
      const bool on = s.accept("TRUE");
      if (!on) s.expect("FALSE");
      if (n == coolant()) {
        if (on) build_.switch_on(line, Equipment::coolant, 0);
        else build_.switch_off(line, Equipment::coolant, 0);
        return true;
      }
      build_.digital_output(line, n, on);
      return true;
    }
    if (s.accept("$ANOUT")) {
      const int n = index(s, 1, 32);
      s.expect("=");
      build_.analog_ratio(line, n, s.expect_number("the value"));
      return true;
    }
    return false;
  }

  /// What a trigger does: an output, or one of the machine's sub-programs.
  void action(Scanner& s, const Line& line) {
    if (!output(s, line) && !equipment(s)) s.unknown();
    if (s.accept("PRIO")) s.expect("="), s.expect_integer("PRIO", -1, 128);
  }

  void trigger(Scanner& s) {
    const Line line = s.line();
    s.expect("WHEN");
    int at = 0;  // 0: at the start of the next motion, 1: at its end
    std::optional<double> path_mm;
    if (s.accept("PATH")) {
      s.expect("=");
      path_mm = s.expect_number("the length");
      at = s.accept("ONSTART") ? 0 : 1;
      if (*path_mm != 0 && (*path_mm > 0) == (at == 1))
        fail(line, "read.trigger", "a place beyond the motion it belongs to cannot be held", *path_mm, 0, "mm");
    } else {
      s.expect("DISTANCE"), s.expect("=");
      at = s.expect_integer("DISTANCE", 0, 1);
    }
    s.expect("DELAY"), s.expect("=");
    s.expect_integer("a DELAY other than 0 cannot be held in the program; DELAY", 0, 0);
    s.expect("DO");
    armed_at_ = line;
    if (path_mm && *path_mm != 0) {
      s.expect("$OUT");
      const int n = index(s, 1, 4096);
      s.expect("=");
      const bool on = s.accept("TRUE");
      if (!on) s.expect("FALSE");
      if (s.accept("PRIO")) s.expect("="), s.expect_integer("PRIO", -1, 128);
      if (n == coolant()) fail(line, "read.trigger", "the coolant is switched at a place on the path; that cannot be held");
      build_.output_on_path(line, n, on, *path_mm);
    } else if (at == 0) {
      action(s, line);
    } else {
      at_end_of_next_.push_back({line, std::string(s.rest())});
      while (!s.at_end())  // read when the motion has been
        if (s.name().empty() && !s.number() && !s.accept("[") && !s.accept("]") && !s.accept("=") && !s.accept("(") && !s.accept(")")) s.unknown();
    }
  }
  void moved() {
    armed_at_ = {};
    const auto events = std::move(at_end_of_next_);
    at_end_of_next_.clear();
    for (const auto& [line, statement] : events) {
      Scanner s(line, statement);
      action(s, line);
      s.expect_end();
    }
  }

  bool setting(Scanner& s) {
    const Line line = s.line();
    if (output(s, line)) return true;
    const auto assign = [&](std::string_view name) {
      if (!s.accept(name)) return false;
      s.expect("=");
      return true;
    };
    if (assign("$TOOL")) return set_tool(s), true;
    if (assign("$BASE")) return set_base(s), true;
    if (assign("$IPO_MODE")) return s.expect("#BASE"), true;
    if (assign("$CIRC_TYPE")) return s.expect("#BASE"), true;
    if (assign("$ORI_TYPE")) {
      if (!s.accept("#VAR") && !s.accept("#JOINT")) s.unknown();
      return true;
    }
    if (assign("$BWDSTART")) {
      if (!s.accept("FALSE")) s.expect("TRUE");
      return true;
    }
    if (assign("$ADVANCE")) return s.expect_integer("$ADVANCE", 0, 5), true;
    if (assign("$VEL.CP")) return speed_m_s_ = s.expect_number("the speed"), true;
    if (assign("$VEL.ORI1") || assign("$VEL.ORI2") || assign("$ACC.ORI1") || assign("$ACC.ORI2") || assign("$ACC.CP"))
      return positive(s), true;
    if (assign("$VEL")) {
      const Components c = aggregate(s);
      if (c.count("CP")) speed_m_s_ = get(c, "CP");
      return true;
    }
    if (assign("$APO.CDIS")) return apo_mm_ = s.expect_number("the distance"), true;
    if (assign("$APO.CPTP") || assign("$APO.CVEL") || assign("$APO.CORI")) return positive(s), true;
    if (s.accept("$VEL_AXIS")) {
      const int i = index(s, 1, 6);
      s.expect("=");
      percent_[i - 1] = s.expect_integer("the percentage", 1, 100);
      return true;
    }
    if (s.accept("$ACC_AXIS")) return index(s, 1, 6), s.expect("="), s.expect_integer("the percentage", 1, 100), true;
    if (assign("$LOAD")) return s.expect("LOAD_DATA"), index(s, 1, 16), true;
    if (assign("FDAT_ACT")) {
      fdat_ = s.peek() == '{' ? "FDAT_ACT" : s.name();
      if (fdat_ == "FDAT_ACT") names_[fdat_] = aggregate(s);
      return true;
    }
    if (assign("PDAT_ACT") || assign("LDAT_ACT")) return !s.name().empty() || (s.unknown(), true);
    if (s.accept("BASE_DATA")) {
      const int n = index(s, 1, 32);
      s.expect("=");
      return base_data_[n] = value(s, "the frame"), need_frame(line, base_data_[n]), true;
    }
    return false;
  }
  void positive(Scanner& s) {
    const double v = s.expect_number("a number");
    if (!(v > 0)) fail(s.line(), "read.range", "the value must be greater than 0", v, 0);
  }

  // ---------------------------------------------------------------- motions
  void joint(Scanner& s) {
    for (const char* key : {"krl.serial_number", "krl.kernel"})
      if (context_.cell.controller.options.count(key) && !checked_.count(key))
        fail(s.line(), "read.check", std::string("a motion before the controller is checked (controller.") + key + ")");
    const Components c = value(s, "the position");
    std::array<double, 6> q{};
    const bool is_cartesian = c.count("X") > 0;
    if (is_cartesian) q = posture(s.line(), c);
    for (int i = 0; i < 6 && !is_cartesian; ++i) {
      const std::string k = "A" + std::to_string(i + 1);
      if (!c.count(k)) fail(s.line(), "read.missing", "the target lacks " + k);
      q[i] = c.at(k);
    }
    for (const auto& [k, v] : c)
      if (is_cartesian ? k[0] == 'E' && v != 0 : k[0] == 'E' ? v != 0 : k[0] != 'A' || k.size() != 2)
        fail(s.line(), "read.unknown", "component " + k + " has no meaning here (external axes must be 0)", v);
    for (int i = 0; i < 6; ++i)
      if (!percent_[i] || *percent_[i] != *percent_[0])
        fail(s.line(), "read.undefined", "the joint speed is not set, or not the same for all six axes");
    for (const char* k : {"C_PTP", "C_DIS", "C_SPL"})
      if (s.accept(k)) fail(s.line(), "read.unknown", "a rounded PTP cannot be held in the program");
    build_.joint(s.line(), q, *percent_[0] / 100.0);
    now_.clear();
    moved();
  }
  /// PTP to a frame: the joint values by status and turn. T holds the signs of all axes; of S the wrist in front or behind (bit 0) and the
  /// sign of A5 (bit 2) are used, which documents agree about; the elbow (bit 1) is left to T and to the limits, or the target is refused.
  std::array<double, 6> posture(const Line& line, const Components& c) {
    if (!build_.tool() || !build_.has_frame()) fail(line, "read.order", "a PTP to a frame before tool and base are chosen");
    for (const char* k : {"X", "Y", "Z", "A", "B", "C"})
      if (!c.count(k)) fail(line, "read.missing", std::string("the target lacks ") + k);
    if (!c.count("S") || !c.count("T"))
      fail(line, "read.ptp_cartesian", "a PTP to a frame without S and T keeps a posture that the text does not say; give both, or axis values");
    const int status = static_cast<int>(get(c, "S")), turn = static_cast<int>(get(c, "T"));
    if (get(c, "S") != status || get(c, "T") != turn || status < 0 || (status & ~16) > 7 || turn < 0 || turn > 63) fail(line, "read.range", "S is 0 to 7 and T 0 to 63", get(c, "S"), 7);
    return arm_.one(line, build_.T_base_work() * pose_of<frame::Work>(c), *build_.tool(), [&](const std::array<double, 6>& q) {
      for (std::size_t i = 0; i < 6; ++i)
        if ((q[i] < -1e-4) != ((turn >> i & 1) != 0) && std::abs(q[i]) > 1e-4) return false;
      return (q[4] < 0) == ((status & 4) != 0);
    });
  }
  Components cartesian(Scanner& s) {
    Components c = value(s, "the position");
    for (const auto& [k, v] : c)
      if (k.size() == 1 ? std::string_view("XYZABCST").find(k[0]) == std::string_view::npos : k[0] != 'E' || v != 0)
        fail(s.line(), "read.unknown", "component " + k + " has no meaning in a path motion", v);
    c.erase("S"), c.erase("T");
    Components full = now_;
    for (const auto& [k, v] : c)
      if (k.size() == 1) full[k] = v;
    if (full.size() != 6) fail(s.line(), "read.missing", "the first path target after a joint motion must name X, Y, Z, A, B and C");
    return full;
  }
  void path(Scanner& s, bool is_arc, bool is_spline) {
    Components via;
    if (is_arc) via = cartesian(s), s.expect(",");
    const Components end = cartesian(s);
    std::optional<double> v = speed_m_s_;
    double blend = 0;
    if (is_arc && s.accept(",")) s.expect("CA"), fail(s.line(), "read.unknown", "CIRC with an angle CA is not read");
    if (is_in_spline_) ++spline_points_;
    if (is_spline && s.accept("WITH")) s.expect("$VEL.CP"), s.expect("="), v = s.expect_number("the speed");
    if (!is_in_spline_ && s.accept(is_spline ? "C_SPL" : "C_DIS")) {
      if (!apo_mm_) fail(s.line(), "read.undefined", "a rounded motion before $APO.CDIS is set");
      if (!(*apo_mm_ >= 0)) fail(s.line(), "read.range", "$APO.CDIS is negative", *apo_mm_, 0, "mm");
      blend = *apo_mm_;
    }
    if (!v) fail(s.line(), "read.undefined", "a path motion before $VEL.CP is set");
    const auto T = pose_of<frame::Work>(end);
    if (is_in_spline_)
      build_.spline(s.line(), T, *v * 1000.0);
    else if (is_arc)
      build_.circular(s.line(), pose_of<frame::Work>(via), T, *v * 1000.0, blend);
    else
      build_.linear(s.line(), T, *v * 1000.0, blend);
    now_ = end;
    moved();
  }
};

}  // namespace

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return reading::guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::krl
