// SPDX-License-Identifier: GPL-3.0-or-later
// The lint rules B-01 to B-14 of Beckhoff CNC, on the text alone and without the reader's grammar; G-.. rules through the reader.
#include <cmath>
#include <optional>
#include <set>

#include "postprocessors/beckhoff/beckhoff.hpp"
#include "postprocessors/linting.hpp"

namespace asbuilt::beckhoff {
namespace {

using namespace linting;
using reading::Line;

std::string_view code_of(std::string_view line) {
  line = line.substr(0, line.find_first_of(";("));
  return line.starts_with("%") ? std::string_view() : line;
}

struct Word {
  char letter = 0;
  double value = 0;
};
/// Letter and number pairs; false where something else stands in the block.
bool words_of(std::string_view code, std::vector<Word>& out) {
  for (std::size_t i = 0; i < code.size();) {
    char c = code[i];
    if (c == ' ' || c == '\t') {
      ++i;
      continue;
    }
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    if (c < 'A' || c > 'Z') return false;
    std::size_t j = i + 1;
    while (j < code.size() && (code[j] == ' ' || code[j] == '=')) ++j;
    const std::size_t begin = j;
    while (j < code.size() && ((code[j] >= '0' && code[j] <= '9') || code[j] == '.' || code[j] == '-' || code[j] == '+')) ++j;
    if (j == begin) return false;
    out.push_back({c, std::atof(std::string(code.substr(begin, j - begin)).c_str())});
    i = j;
  }
  return true;
}

struct Linter {
  Findings& f;
  const PostContext& context;
  const std::string& file;
  std::set<std::string> subs, called;
  int mains = 0;
  bool is_sub() const {
    const auto it = context.cell.controller.options.find("beckhoff.delivery");
    return it != context.cell.controller.options.end() && it->second == "sub";
  }
  bool is_in_sub = false, has_code = false, has_motion = false, has_m30 = false;
  bool is_trafo = false, is_cs = false, is_mcs = false, is_hsc = false, is_ptp = false, has_kinematic = false, is_trafo_said = false, is_cs_said = false, is_spinning = false, has_speed = false;
  std::set<int> head;
  double last_number = -1, step = 0;
  bool has_unnumbered = false;
  int motion = -1, plane = 17;
  bool has_feed = false, is_centre_absolute = false;
  std::map<char, double> now;

  void line(const Line& line) {
    if (line.text.size() > 200) f.add("B-09", line, "a block longer than 200 characters");
    static const std::string_view allowed = " !@#$%&*-+_=~()[],;:\"<>/\\?'.";
    int depth = 0;
    bool is_remark = false;
    for (char c : line.text) {
      if (!((c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || allowed.find(c) != std::string_view::npos))
        f.add("B-02", line, "a character outside the controller's set");
      if (!is_remark && c == ';') is_remark = true;
      if (!is_remark && c == '(') ++depth;
      if (!is_remark && c == ')') --depth;
      if (depth < 0) break;
    }
    if (depth != 0) f.add("B-02", line, "brackets of a comment do not match");
    if (line.text.starts_with("%")) return program_start(line);
    std::string_view code = code_of(line.text);
    while (!code.empty() && code.front() == ' ') code.remove_prefix(1);
    while (!code.empty() && code.back() == ' ') code.remove_suffix(1);
    if (code.empty()) return;
    if (code.find('%') != std::string_view::npos) f.add("B-02", line, "% inside a block");
    if (has_m30) f.add("B-10", line, "something stands after M30");
    if (!is_in_sub && mains == 0) has_code = true;
    if (code.front() == 'N' || code.front() == 'n') {
      std::size_t j = 1;
      while (j < code.size() && code[j] >= '0' && code[j] <= '9') ++j;
      const double number = std::atof(std::string(code.substr(1, j - 1)).c_str());
      if (!is_in_sub) numbered(line, number);
      code.remove_prefix(j);
      while (!code.empty() && code.front() == ' ') code.remove_prefix(1);
      if (code.empty()) return;
    } else if (!is_in_sub) {
      has_unnumbered = true;
      if (last_number >= 0) f.add("B-09", line, "a block without a number among numbered ones: a line may be lost");
    }
    if (code.front() == '#') return command(line, code);
    if (code.find('#') != std::string_view::npos) f.add("B-03", line, "a # command must stand alone in its block");
    if (code.find('$') != std::string_view::npos || code.find("V.") != std::string_view::npos) f.add("B-11", line, "variables and control flow are not used here");
    const auto t = tokens_of(code);
    if (t.size() > 1 && t[0].text.size() > 1 && t[0].text[0] == 'P' && t[1].is("=")) return f.add("B-11", line, "a parameter");
    if (t.size() == 2 && (t[0].is("LL") || t[0].is("L"))) {
      if (t[0].is("LL")) called.insert(t[1].text);
      return;
    }
    block(line, code);
  }

  /// Numbers rise by one step from the first to the last block, so that a lost or foreign line shows.
  void numbered(const Line& line, double number) {
    if (number <= last_number) f.add("B-09", line, "block numbers do not rise");
    if (last_number >= 0 && step == 0) step = number - last_number;
    if (last_number < 0 ? has_unnumbered : number - last_number != step) f.add("B-09", line, "a gap in the block numbers: a line may be lost");
    last_number = number;
  }

  void program_start(const Line& line) {
    const auto t = tokens_of(line.text.substr(1));
    if (t.size() == 2 && t[0].is("L")) {
      is_in_sub = true;
      if (!subs.insert(t[1].text).second) f.add("B-10", line, "two sub-programs of one name");
      if (mains) f.add("B-10", line, "a sub-program after the main program");
      return;
    }
    is_in_sub = false;
    if (has_code) f.add("B-02", line, "% after the first block");
    if (++mains > 1) f.add("B-01", line, "a second main program");
  }

  void on_off(const Line& line, const std::vector<Token>& t, bool& state, const char* name) {
    const bool on = find(t, "ON") != std::string::npos, off = find(t, "OFF") != std::string::npos;
    if (on == off) return;
    if (off && !state && has_motion) f.add("B-03", line, std::string(name) + " OFF twice");
    if (on && state && std::string_view(name) != "#CS") f.add("B-03", line, std::string(name) + " ON twice");
    state = on;
  }
  void command(const Line& line, std::string_view code) {
    const auto t = tokens_of(code);
    const std::string& name = t[0].text;
    if (is_hsc && (name == "#TRAFO" || name == "#CS" || name == "#FLUSH" || name == "#CHANNEL")) f.add("B-03", line, name + " inside #HSC");
    static const std::set<std::string> own = {"ON", "OFF", "ALL", "DEF", "ADD", "ID", "MODE", "WAIT", "INIT", "ANGLE", "VECTOR", "BEGIN", "END"};
    int depth = 0;
    for (std::size_t i = 1; i < t.size() && name != "#WAIT"; ++i) {  // a condition, to the end of the block
      depth += t[i].is("[") ? 1 : t[i].is("]") ? -1 : 0;
      if (depth == 0 && !t[i].is("]") && !own.count(t[i].text)) {
        f.add("B-03", line, "a # command must stand alone in its block");
        break;
      }
    }
    if (name == "#TRAFO") {
      if (find(t, "OFF") != std::string::npos && is_cs) f.add("B-03", line, "#TRAFO OFF inside #CS");
      on_off(line, t, is_trafo, "#TRAFO");
      is_trafo_said = true;
      if (is_trafo && !has_kinematic && context.cell.controller.kinematic_id) f.add("B-04", line, "#TRAFO ON without #KIN ID: the channel's own choice may be another");
      has_feed = false;
      now.clear();
    } else if (name == "#CS") {
      if (find(t, "ON") != std::string::npos && !is_trafo) f.add("B-03", line, "#CS ON before #TRAFO ON");
      on_off(line, t, is_cs, "#CS");
      is_cs_said |= find(t, "OFF") != std::string::npos;
      if (find(t, "DEF") == std::string::npos) now.clear();
    } else if (name == "#MCS") {
      on_off(line, t, is_mcs, "#MCS");
      has_feed = false;
      now.clear();
    } else if (name == "#HSC") {
      on_off(line, t, is_hsc, "#HSC");
      const auto dev = number_after(t, "PATH_DEV");
      const auto it = context.cell.controller.options.find("beckhoff.hsc_path_dev");
      if (is_hsc && (!dev || it == context.cell.controller.options.end() || *dev > std::atof(it->second.c_str()) + 5.1e-4))
        f.add("B-03", line, "#HSC with a deviation that is not the machine file's");
    } else if (name == "#PTP") {
      on_off(line, t, is_ptp, "#PTP");
    } else if (name == "#KIN") {
      has_kinematic = true;
      if (is_trafo) f.add("B-03", line, "#KIN ID while the transformation is on");
    }
  }

  void block(const Line& line, std::string_view code) {
    std::string plain(code);
    if (const std::size_t s = plain.find("S["); s != std::string::npos) {  // S[REV 1000 M03]
      has_speed = true;
      plain.erase(s, plain.find(']') == std::string::npos ? plain.size() : plain.find(']') - s + 1);
    }
    for (const char* flag : {" IS", " IT"})
      if (const std::size_t s = plain.find(flag); s != std::string::npos) {
        if (!is_ptp) f.add("B-07", line, "IS and IT need #PTP ON");
        plain.erase(s, plain.find(' ', s + 1) == std::string::npos ? plain.size() : plain.find(' ', s + 1) - s);
      }
    std::vector<Word> words;
    if (!words_of(plain, words)) {
      f.add("B-01", line, "cannot be taken apart into words");
      return;
    }
    std::map<char, double> v;
    std::vector<int> m;
    bool is_dwell = false, has_g = false, has_plane = false;
    for (const Word& w : words) {
      if (w.letter == 'G') {
        const int g = static_cast<int>(w.value);
        if (g >= 0 && g <= 3) motion = g, has_g = true;
        has_plane |= g >= 17 && g <= 19;
        if (g == 4) is_dwell = true;
        if (g >= 17 && g <= 19) plane = g;
        if (g == 161 || g == 162) is_centre_absolute = g == 161;
        if (g == 91 || g == 70 || g == 93 || g == 95) f.add(g == 91 ? "B-14" : "B-05", line, "G" + std::to_string(g));
        if (is_hsc && (g == 61 || g == 261 || g == 95 || g == 96 || g == 33 || g == 100)) f.add("B-03", line, "G" + std::to_string(g) + " inside #HSC");
        if (!has_motion) head.insert(g);
      } else if (w.letter == 'M') {
        m.push_back(static_cast<int>(w.value));
      } else if (w.letter == 'P') {
        f.add("B-11", line, "a parameter");
      } else {
        v[w.letter] = w.value;
      }
    }
    if (is_dwell) return;
    if (v.count('F')) {
      has_feed = true;
      if (!(v['F'] > 0)) f.add("B-05", line, "F is not positive");
    }
    if (v.count('S')) has_speed = true;
    if (v.count('T') != v.count('D')) f.add("B-12", line, "T and D stand together");
    for (int code_m : m) {
      if (code_m == 3 || code_m == 4) {
        if (!has_speed) f.add("B-12", line, "M3 before S");
        is_spinning = true;
      }
      if (code_m == 5) {
        if (v.count('S')) f.add("B-12", line, "S with M5");
        is_spinning = false;
      }
      const bool is_return = code_m == 17 || code_m == 29;
      if (is_return && !is_in_sub && !is_sub()) f.add("B-10", line, "M17 outside a sub-program");
      if (is_hsc) f.add("B-03", line, "an M function inside #HSC");
      if (((code_m == 30 || code_m == 2) && !is_in_sub) || (is_return && !is_in_sub && is_sub())) {
        has_m30 = true;
        if (is_trafo || is_cs || is_mcs || is_hsc) f.add("B-04", line, "the program ends with #TRAFO, #CS, #MCS or #HSC on");
        if (is_spinning) f.add("B-12", line, "the program ends with the spindle on");
      }
    }
    bool has_axis = false;
    for (char c : std::string_view("XYZABC")) has_axis |= v.count(c) > 0;
    if (has_axis && (!has_g || (motion > 1 && !has_plane))) f.add("B-05", line, "a motion block must name its G word, an arc its plane");
    if (has_axis) move(line, v);
  }

  void move(const Line& line, std::map<char, double>& v) {
    if (!has_motion)
      for (int g : {90, 71, 94, 17, 40, 53, 162})
        if (!head.count(g)) f.add("B-14", line, "G" + std::to_string(g) + " is not in the head");
    has_motion = true;
    if (motion < 0) f.add("B-05", line, "a motion before G00, G01, G02, G03");
    if (motion > 0 && !has_feed) f.add("B-05", line, "a motion before F");
    const bool is_cartesian = is_trafo && !is_mcs;
    if (!is_cartesian && !is_trafo_said && !is_mcs) f.add("B-04", line, "a joint move before #TRAFO OFF: what the program before left on is not known");
    if (is_cartesian && !is_cs_said) f.add("B-04", line, "a path block before #CS OFF: what the program before left on is not known");
    if (!is_cartesian && motion > 1) f.add("B-04", line, "an arc in axis values");
    std::map<char, double> before = now;
    for (char c : std::string_view("XYZABC"))
      if (v.count(c)) now[c] = v[c];
    for (char c : std::string_view("XYZABC"))
      if (!v.count(c)) f.add(is_cartesian ? "B-06" : "B-04", line, std::string("the word ") + c + " is left out");
    if (!is_cartesian) return;
    for (char c : std::string_view("ABC"))
      if (before.count(c) && now.count(c) && std::abs(now[c] - before[c]) > 180) f.add("B-06", line, std::string("a jump in ") + c);
    if (before.empty() && context.cell.controller.orientation) {  // the controller's own angles may have the other sign near 180
      const bool is_euler = *context.cell.controller.orientation == BeckhoffOrientation::euler;
      if (std::abs(now['A']) > 170 || std::abs(now['C']) > 170 || (is_euler ? std::abs(now['B'] - 90) : std::abs(now['B'])) > 85)
        f.add("B-06", line, "the first block after #CS ON is near the wrap of its angles: the tool might turn once about");
    }
    if (motion > 1) arc(line, v, before);
  }

  void arc(const Line& line, std::map<char, double>& v, std::map<char, double>& before) {
    if (is_hsc) f.add("B-08", line, "an arc inside #HSC");
    if (v.count('R')) return;
    const std::string_view axes = plane == 17 ? "XY" : plane == 18 ? "ZX" : "YZ", centre = plane == 17 ? "IJ" : plane == 18 ? "KI" : "JK";
    if (!before.count(axes[0]) || !before.count(axes[1])) return f.add("B-08", line, "an arc without a start");
    if (!v.count(centre[0]) && !v.count(centre[1])) return f.add("B-08", line, "an arc without a centre");
    const double x0 = before[axes[0]], y0 = before[axes[1]];
    const auto word = [&](char c) { return v.count(c) ? v[c] : 0.0; };
    const double cx = word(centre[0]) + (is_centre_absolute ? 0 : x0), cy = word(centre[1]) + (is_centre_absolute ? 0 : y0);
    const double r0 = std::hypot(x0 - cx, y0 - cy), r1 = std::hypot(now[axes[0]] - cx, now[axes[1]] - cy);
    if (std::abs(r0 - r1) > 0.001 || r0 < 1e-3) f.add("B-08", line, "the radii at start and end differ, or are 0");
  }
};

}  // namespace

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  Findings f(joined(kCommonErrors, {"B-01", "B-02", "B-03", "B-04", "B-05", "B-06", "B-07", "B-08", "B-09", "B-10", "B-11", "B-12", "B-14"}), kCommonWarnings);
  common_rules(f, text, context, read, code_of, true);
  bool is_first = true;
  for (const ProgramFile& file : text.files) {
    if (file.name.find_first_of("(\"]#$;,\t\r\n") != std::string::npos) f.add("B-02", file.name, "a character a file name must not hold");
    if (!is_first) continue;  // global sub-programs are the reader's to follow
    is_first = false;
    Linter l{f, context, file.name, {}, {}};
    for (const Line& line : raw_lines(file)) l.line(line);
    if (!l.has_m30) f.add("B-10", file.name, "M30 is missing");
    for (const std::string& name : l.called)
      if (!l.subs.count(name)) f.add("B-10", file.name, "sub-program " + name + " is not defined");
  }
  return f.checks();
}

}  // namespace asbuilt::beckhoff
