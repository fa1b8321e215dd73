// SPDX-License-Identifier: GPL-3.0-or-later
// The lint rules K-01 to K-16 of KRL, on the text alone and without the reader's grammar; G-.. rules through the reader.
#include <cmath>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>

#include "postprocessors/krl/krl.hpp"
#include "postprocessors/linting.hpp"

namespace asbuilt::krl {
namespace {

using namespace linting;
using reading::Line;

std::string_view code_of(std::string_view line) { return line.substr(0, line.find(';')); }

const std::set<std::string> kKeywords = {"DEF", "END", "DEFDAT", "ENDDAT", "PTP", "LIN", "CIRC", "IF", "ENDIF", "FOR", "WHILE", "LOOP", "WAIT", "SWITCH",
                                         "CASE", "HALT", "TRIGGER", "INTERRUPT", "DECL", "INT", "REAL", "BOOL", "CHAR", "TRUE", "FALSE", "SPLINE"};

/// The name in a fold line: what stands before the inline form, without blanks around it.
std::string fold_name(std::string_view text) {
  text = text.substr(0, text.find(";%"));
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  return std::string(text);
}

struct Linter {
  Findings& f;
  const PostContext& context;
  std::set<std::string> names;  // of modules, over all files
  bool has_tool = false, has_base = false, has_ipo = false, has_moved = false;
  bool was_rounded = false;                   // the last motion is approximated
  std::optional<Line> stopper;                // an advance-run stopper after it
  int pending = 0;                            // triggers waiting for a motion
  std::optional<std::array<double, 3>> p_now;
  int with_external = 0, without_external = 0;
  std::map<int, std::set<std::string>> checked;  // components of TOOL_DATA[n] that the program waits for
  std::set<int> expected;                        // tools with their pose in the .dat

  /// Names of the controller's own sub-programs, as the machine file lists them.
  bool is_machines(const std::string& name) const {
    for (const char* key : {"krl.arc", "krl.weave", "krl.recording", "krl.tool_check"}) {
      const auto it = context.cell.controller.options.find(key);
      if (it == context.cell.controller.options.end()) continue;
      for (const std::string& word : reading::words(it->second))
        if (upper_of(word) == name) return true;
    }
    return false;
  }
  bool is_sub() const {
    const auto it = context.cell.controller.options.find("krl.delivery");
    return it != context.cell.controller.options.end() && it->second == "sub";
  }

  void name_rules(const Line& line, const std::string& name, const std::string& file) {
    if (name != stem_of(file)) f.add("K-01", line, "the name " + name + " is not the file's");
    if (name.size() > 24) f.add("K-01", line, "a name longer than 24 characters");
    if (kKeywords.count(name) || name.find('$') != std::string::npos) f.add("K-01", line, name + " is no free name");
  }

  void head_line(const Line& line, const std::vector<Token>& t, int& access, int& release) {
    static const std::set<std::string> rights = {"R", "RV", "RVP", "RVO", "RVO1", "RO", "RVP1", "RVO2"};
    const bool is_access = t.size() == 3 && t[1].is("ACCESS") && rights.count(t[2].text);
    const bool is_release = t.size() == 3 && t[1].is("REL") && t[2].kind == Token::Kind::number && t[2].value >= 1 && t[2].value == std::floor(t[2].value);
    access += is_access, release += is_release;
    if (!is_access && !is_release && !(t.size() > 1 && (t[1].is("COMMENT") || t[1].is("PARAM")))) f.add("K-02", line, "an unknown line with &");
  }

  void data(const ProgramFile& file) {
    int access = 0, release = 0;
    for (const Line& line : raw_lines(file)) {
      const auto t = tokens_of(code_of(line.text));
      if (t.empty()) continue;
      if (t[0].is("&")) head_line(line, t, access, release);
      if (t.size() > 1 && t[0].is("DEFDAT")) name_rules(line, t[1].text, file.name);
      expected_tool(line, t);
    }
    if (access != 1 || release != 1) f.add("K-02", file.name, "&ACCESS and &REL stand once each");
  }

  void source(const ProgramFile& file, bool is_main) {
    int defs = 0, depth = 0, body_lines = 0;
    std::vector<std::string> folds;
    int access = 0, release = 0;
    bool has_code = false, has_statement = false, has_init = false;
    std::vector<std::string> open_blocks;
    for (const Line& line : raw_lines(file)) {
      if (line.text.size() > 240) f.add("K-13", line, "a line longer than 240 characters");
      const std::string_view comment = line.text.find(';') == std::string_view::npos ? "" : line.text.substr(line.text.find(';') + 1);
      if (comment.starts_with("FOLD")) folds.push_back(fold_name(comment.substr(4)));
      if (comment.starts_with("ENDFOLD")) {
        const std::string name = fold_name(comment.substr(7));
        if (folds.empty()) f.add("K-02", line, "ENDFOLD without FOLD");
        else if (!name.empty() && name != "(" + folds.back() + ")") f.add("K-02", line, "ENDFOLD names another fold");
        if (!folds.empty()) folds.pop_back();
      }
      if (comment.find("%{PE}") != std::string_view::npos) f.add("K-16", line, "an inline form, whose technology package is not known here");
      const auto t = tokens_of(code_of(line.text));
      if (t.empty()) continue;
      if (t[0].is("&")) {
        if (has_code) f.add("K-02", line, "a line with & below the top");
        head_line(line, t, access, release);
        continue;
      }
      has_code = true;
      const std::size_t d = t[0].is("GLOBAL") ? 1 : 0;
      if (d < t.size() && (t[d].is("DEF") || t[d].is("DEFFCT"))) {
        if (++depth > 1) f.add("K-02", line, "DEF inside DEF");
        const std::string name = t[d].is("DEF") && d + 1 < t.size() ? t[d + 1].text : "";
        if (defs++ == 0) name_rules(line, name, file.name);
        if (!names.insert(name).second) f.add("K-01", line, name + " is defined twice");
        has_statement = false;
        continue;
      }
      if (t[0].is("END") || t[0].is("ENDFCT")) {
        if (--depth < 0) f.add("K-02", line, "END without DEF");
        if (!open_blocks.empty()) f.add("K-02", line, open_blocks.back() + " is not closed");
        open_blocks.clear();
        continue;
      }
      ++body_lines;
      blocks(line, t, open_blocks);
      if (t[0].is("DECL") || (d && t.size() > 1 && t[1].is("DECL"))) {
        if (has_statement) f.add("K-03", line, "a declaration after a statement");
        continue;
      }
      has_statement = true;
      if (find(t, "#INITMOV") != std::string::npos) {
        if (!is_main || has_init || is_sub()) f.add("K-04", line, "BAS (#INITMOV) belongs into the main module, once");
        has_init = true;
      }
      statement(line, t);
    }
    const std::string where = file.name;
    if (access != 1 || release != 1) f.add("K-02", where, "&ACCESS and &REL stand once each");
    if (depth != 0 || defs == 0) f.add("K-02", where, "DEF and END do not match");
    if (!folds.empty()) f.add("K-02", where, "FOLD and ENDFOLD do not match");
    if (is_main && !has_init && !is_sub()) f.add("K-04", where, "BAS (#INITMOV,0) is missing");
    if (body_lines > 3000) f.add("K-13", where, "a module of " + std::to_string(body_lines) + " lines");
  }

  void blocks(const Line& line, const std::vector<Token>& t, std::vector<std::string>& open) {
    static const std::map<std::string, std::string> ends = {{"ENDIF", "IF"}, {"ENDLOOP", "LOOP"}, {"ENDFOR", "FOR"}, {"ENDWHILE", "WHILE"},
                                                            {"ENDSWITCH", "SWITCH"}, {"ENDSPLINE", "SPLINE"}};
    if (t[0].is("ELSEIF")) f.add("K-02", line, "ELSEIF is no KRL");
    for (const auto& [end, begin] : ends) {
      if (t[0].is(begin)) open.push_back(begin);
      if (t[0].is(end)) {
        if (open.empty() || open.back() != begin)
          f.add("K-02", line, end + " without " + begin);
        else
          open.pop_back();
      }
    }
  }

  static bool has(const std::vector<Token>& t, std::string_view text) { return find(t, text) != std::string::npos; }
  void range(const Line& line, std::string_view rule, const char* what, std::optional<double> v, double lo, double hi, bool is_open_below = false) {
    if (v && (*v < lo || *v > hi || (is_open_below && *v <= lo))) f.add(rule, line, std::string(what) + " out of range");
  }

  /// The spindle's speed is set beside its switching on and taken back beside its switching off: no motion with the one and without the other.
  double analog = 0;
  bool is_spindle_on = false;
  void spindle(const std::vector<Token>& t) {
    for (const char* name : {"$OUT", "$ANOUT"}) {
      const std::size_t at = find(t, name);
      if (at == std::string::npos || at + 5 >= t.size() || t[at + 2].kind != Token::Kind::number) continue;
      for (const ToolSpec& tool : context.cell.tools) {
        if (name[1] == 'O' && tool.spindle.output == t[at + 2].value) is_spindle_on = t[at + 5].is("TRUE");
        if (name[1] == 'A' && tool.spindle.analog == t[at + 2].value) analog = t[at + 5].value;
      }
    }
  }

  void statement(const Line& line, const std::vector<Token>& t) {
    spindle(t);
    const bool is_assignment = t.size() > 1 && find(t, "=") != std::string::npos;
    if (t[0].is("$TOOL")) {
      has_tool = true;
      if (has(t, "TOOL_DATA")) range(line, "K-06", "the tool number", number_after(t, "TOOL_DATA"), 1, 16);
      if (has(t, "$NULLFRAME")) f.add("K-06", line, "the tool is the flange");
    }
    if (t[0].is("$BASE")) {
      has_base = true;
      if (has(t, "BASE_DATA")) range(line, "K-06", "the base number", number_after(t, "BASE_DATA"), 1, 32);
    }
    if (t[0].is("BAS") && has(t, "#TOOL")) has_tool = true, range(line, "K-06", "the tool number", number_after(t, "#TOOL"), 1, 16);
    if (t[0].is("BAS") && has(t, "#BASE")) has_base = true;
    if (t[0].is("BAS") && has(t, "#FRAMES")) has_tool = has_base = has_ipo = true;
    if (t[0].is("$IPO_MODE")) has_ipo = true;
    if (t[0].is("$VEL") && is_assignment) {
      range(line, "K-07", "$VEL.CP", number_after(t, "CP"), 0, 3, true);
      range(line, "K-07", "$VEL.ORI1", number_after(t, "ORI1"), 0, 400, true);
      range(line, "K-07", "$VEL.ORI2", number_after(t, "ORI2"), 0, 400, true);
    }
    if (t[0].is("BAS") && has(t, "#VEL_CP")) range(line, "K-07", "the path speed", number_after(t, "#VEL_CP"), 0, 3, true);
    if (t[0].is("BAS") && has(t, "#VEL_PTP")) range(line, "K-07", "the joint speed", number_after(t, "#VEL_PTP"), 1, 100);
    if (t[0].is("$VEL_AXIS") || t[0].is("$ACC_AXIS") || t[0].is("$VEL_EXTAX")) {
      range(line, "K-07", "the axis index", number_after(t, t[0].text), 1, 6);
      const std::size_t eq = find(t, "=");
      if (eq != std::string::npos && eq + 1 < t.size() && t[eq + 1].kind == Token::Kind::number)
        range(line, "K-07", "the percentage", t[eq + 1].value, 1, 100);
    }
    if (t[0].is("$ADVANCE")) range(line, "K-07", "$ADVANCE", number_after(t, "$ADVANCE"), 0, 5);
    if (t[0].is("$APO")) {
      range(line, "K-08", "$APO.CDIS", number_after(t, "CDIS"), 0, 1000);
      range(line, "K-08", "$APO.CPTP", number_after(t, "CPTP"), 1, 100);
      range(line, "K-08", "$APO.CVEL", number_after(t, "CVEL"), 1, 100);
    }
    if (t[0].is("WAIT") && has(t, "TOOL_DATA")) tool_check(line, t);
    if (t[0].is("TRIGGER")) trigger(line, t);
    if (t[0].is("INTERRUPT") || (t[0].is("GLOBAL") && has(t, "INTERRUPT"))) interrupt(line, t);
    if (t[0].is("WAIT") || t[0].is("HALT") || t[0].is("$OUT") || t[0].is("$ANOUT") || t[0].is("PULSE") || has(t, "$IN"))
      if (was_rounded && !stopper) stopper = line;
    static const std::set<std::string> joint = {"PTP", "SPTP"}, path = {"LIN", "CIRC", "SLIN", "SCIRC", "SPL"};
    if (joint.count(t[0].text) || path.count(t[0].text)) motion(line, t, joint.count(t[0].text) > 0);
    if (context.cell.controller.options.count("krl.version") && context.cell.controller.options.at("krl.version") == "KRC2") {
      for (const char* word : {"SPTP", "SLIN", "SCIRC", "SPL", "SPLINE", "PTP_SPLINE", "C_SPL", "ONSTART"})
        if (has(t, word)) f.add("K-15", line, std::string(word) + " is unknown to KRC2");
    }
  }

  /// WAIT FOR ABS(TOOL_DATA[n].X-EXPECTED_TOOL_n.X)<0.010: the same component on both sides, a limit that is one.
  void tool_check(const Line& line, const std::vector<Token>& t) {
    const std::size_t minus = find(t, "-"), less = find(t, "<");
    const auto n = number_after(t, "TOOL_DATA");
    if (!n || minus == std::string::npos || less == std::string::npos || less + 2 != t.size() || minus < 2 || less < minus + 5)
      return f.add("K-06", line, "no check of a tool");
    const std::string left = t[minus - 1].text, right = t[less - 2].text;
    if (left != right || t[minus + 1].text != "EXPECTED_TOOL_" + std::to_string(static_cast<int>(*n))) f.add("K-06", line, "the two sides of the check do not belong together");
    if (!(t[less + 1].value > 0) || t[less + 1].value > 0.01 + 1e-9) f.add("K-06", line, "the check lets more than 0.01 pass");
    checked[static_cast<int>(*n)].insert(left);
  }
  /// DECL FRAME EXPECTED_TOOL_n={..} in the .dat: the cell's tool to the last digit.
  void expected_tool(const Line& line, const std::vector<Token>& t) {
    if (t.size() < 3 || !t[2].text.starts_with("EXPECTED_TOOL_")) return;
    const int n = std::atoi(t[2].text.c_str() + 14);
    expected.insert(n);
    for (const ToolSpec& tool : context.cell.tools) {
      if (tool.number != n) continue;
      for (int i = 0; i < 3; ++i) {
        const auto v = component(t, std::string_view("XYZ").substr(static_cast<std::size_t>(i), 1));
        if (!v || std::abs(*v - tool.T_flange_tool.p_mm[i]) > 0.00051) f.add("K-06", line, "the expected tool is not the cell's");
      }
      const auto a = component(t, "A"), b = component(t, "B"), c = component(t, "C");
      if (!a || !b || !c ||
          quat_log(tool.T_flange_tool.q.conjugate() * quat_from_zyx(rad_from_deg(*a), rad_from_deg(*b), rad_from_deg(*c))).norm() > rad_from_deg(8.7e-5))
        f.add("K-06", line, "the expected tool is not the cell's");
    }
  }
  void tools_are_checked(const std::string& where) {
    for (int n : expected)
      if (checked[n].size() != 6) f.add("K-06", where, "tool " + std::to_string(n) + " is not checked in all six components");
  }

  void trigger(const Line& line, const std::vector<Token>& t) {
    if (const auto path = number_after(t, "PATH"); path && *path != 0 && (*path > 0) != has(t, "ONSTART"))
      f.add("K-11", line, "a place on the path lies behind the start (ONSTART, above 0) or before the end (below 0)");
    if (++pending > 8) f.add("K-11", line, "more than 8 triggers wait for one motion");
    if (const auto d = number_after(t, "DISTANCE"); d && *d != 0 && *d != 1) f.add("K-11", line, "DISTANCE is 0 or 1");
    if (const auto p = number_after(t, "PRIO")) priority(line, *p, true);
    if (!has(t, "DELAY")) f.add("K-11", line, "DELAY is missing");
  }
  void priority(const Line& line, double p, bool is_trigger) {
    const bool is_legal = p == 1 || p == 2 || (p >= 4 && p <= 39) || (p >= 81 && p <= 128) || (is_trigger && p == -1);
    if (!is_legal) f.add("K-11", line, "the priority is not free");
  }
  void interrupt(const Line& line, const std::vector<Token>& t) {
    const std::size_t d = find(t, "DECL");
    if (d == std::string::npos || d + 1 >= t.size() || t[d + 1].kind != Token::Kind::number) return;
    if (t[d + 1].value == 3 && has(t, "IR_STOPM")) return;  // the one it is reserved for
    priority(line, t[d + 1].value, false);
  }

  static std::optional<double> component(const std::vector<Token>& t, std::string_view key, std::size_t from = 0, std::size_t to = std::string::npos) {
    for (std::size_t i = from; i + 1 < t.size() && i < to; ++i)
      if (t[i].is(key) && t[i + 1].kind == Token::Kind::number) return t[i + 1].value;
    return std::nullopt;
  }
  static std::optional<std::array<double, 3>> point(const std::vector<Token>& t, std::size_t from, std::size_t to) {
    const auto x = component(t, "X", from, to), y = component(t, "Y", from, to), z = component(t, "Z", from, to);
    if (!x || !y || !z) return std::nullopt;
    return std::array<double, 3>{*x, *y, *z};
  }

  void motion(const Line& line, const std::vector<Token>& t, bool is_joint) {
    const bool is_rounded = has(t, "C_DIS") || has(t, "C_VEL") || has(t, "C_ORI") || has(t, "C_PTP") || has(t, "C_SPL");
    if (!has_moved) {
      if (!is_joint || is_rounded || has(t, "$AXIS_ACT") || has(t, "$POS_ACT") || has(t, "X"))
        f.add("K-05", line, "the first motion must be a PTP to axis values with exact stop");
      if (!has_tool || !has_base || !has_ipo) f.add("K-06", line, "motion before $TOOL, $BASE and $IPO_MODE are set");
    }
    has_moved = true;
    if (analog != 0 && !is_spindle_on) f.add("G-10", line, "the spindle's speed is set and the spindle is not switched on");
    pending = 0;
    if (stopper && was_rounded && is_rounded) f.add("K-10", *stopper, "stops the advance run between two rounded motions; use TRIGGER");
    stopper.reset();
    was_rounded = is_rounded;
    const bool is_spline = t[0].text[0] == 'S';
    if (is_joint ? (has(t, "C_VEL") || has(t, "C_ORI") || (has(t, "C_DIS") && !has(t, "C_PTP"))) : has(t, "C_PTP"))
      f.add("K-08", line, "the approximation does not fit the motion");
    if (is_spline != has(t, "C_SPL") && is_rounded) f.add("K-08", line, "the approximation does not fit the motion");
    const auto s = component(t, "S"), turn = component(t, "T");
    if (!is_joint && (s || turn)) f.add("K-09", line, "S and T have no meaning on a path motion");
    if (is_joint && has(t, "X")) {
      if (!s || !turn) f.add("K-09", line, "a Cartesian PTP without S and T");
      if (s && turn) {
        const int si = static_cast<int>(*s), ti = static_cast<int>(*turn);
        if ((si & ~16) > 7 || si < 0 || ti < 0 || ti > 63) f.add("K-09", line, "S or T out of range");
        if (((si >> 2) & 1) != ((ti >> 4) & 1)) f.add("K-09", line, "S and T contradict each other about axis 5");
      }
    }
    (component(t, "E1") ? with_external : without_external) += 1;
    if (with_external && without_external) {
      f.add("K-14", line, "some targets name external axes and some do not");
      with_external = without_external = 0;
    }
    if (t[0].is("CIRC") || t[0].is("SCIRC")) arc(line, t);
    if (is_joint) p_now.reset();
    const std::size_t last = [&] {
      std::size_t at = 0;
      for (std::size_t i = 0; i < t.size(); ++i)
        if (t[i].is("{")) at = i;
      return at;
    }();
    if (!is_joint)
      if (const auto p = point(t, last, t.size())) {
        if (p_now && *p_now == *p) f.add("K-13", line, "the same position twice");
        p_now = p;
      }
  }

  void arc(const Line& line, const std::vector<Token>& t) {
    const std::size_t close = find(t, "}");
    if (close == std::string::npos) return;  // named positions
    const auto via = point(t, 0, close), end = point(t, close, t.size());
    if (!via || !end || !p_now) return;
    const Vec3 a = Vec3((*via)[0], (*via)[1], (*via)[2]) - Vec3((*p_now)[0], (*p_now)[1], (*p_now)[2]);
    const Vec3 b = Vec3((*end)[0], (*end)[1], (*end)[2]) - Vec3((*via)[0], (*via)[1], (*via)[2]);
    if (a.norm() < 0.01 || b.norm() < 0.01 || a.cross(b).norm() < 1e-3 * a.norm() * b.norm()) f.add("K-12", line, "the three points define no arc");
  }
};

}  // namespace

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  Findings f(joined(kCommonErrors, {"G-09", "K-01", "K-02", "K-03", "K-04", "K-05", "K-06", "K-07", "K-08", "K-09", "K-10", "K-11", "K-12", "K-14", "K-15", "K-16"}),
             joined(kCommonWarnings, {"G-08", "K-13"}));
  common_rules(f, text, context, read, code_of, true);
  Linter l{f, context, {}};
  // Modules in the order they run: the main file's calls come after its settings, so its statements are read first.
  bool is_first = true;
  std::set<std::string> sources, called;
  for (const ProgramFile& file : text.files) {
    const std::string name = upper_of(file.name);
    if (name.ends_with(".SRC")) {
      sources.insert(stem_of(file.name));
      l.source(file, is_first);
      is_first = false;
    } else if (name.ends_with(".DAT")) {
      l.data(file);
    }
  }
  if (l.analog != 0) f.add("G-05", text.files.front().name, "the spindle's speed is set at the end");
  if (!text.files.empty()) l.tools_are_checked(text.files.front().name);
  for (const ProgramFile& file : text.files) {
    if (!upper_of(file.name).ends_with(".SRC")) continue;
    for (const Line& line : raw_lines(file)) {
      const auto t = tokens_of(code_of(line.text));
      const bool is_call = t.size() >= 3 && t.size() <= 4 && t[0].kind == Token::Kind::name && t[1].is("(") && t.back().is(")") && !t[0].is("BAS");
      if (!is_call || l.is_machines(t[0].text)) continue;
      called.insert(t[0].text);
      if (!l.names.count(t[0].text)) f.add("G-09", line, t[0].text + " is called and not delivered");
    }
  }
  if (!text.files.empty())
    for (const std::string& s : sources)
      if (s != stem_of(text.files.front().name) && !called.count(s)) f.add("G-08", s + ".src", "is never called");
  return f.checks();
}

}  // namespace asbuilt::krl
