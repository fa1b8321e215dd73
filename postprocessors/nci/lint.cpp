// SPDX-License-Identifier: GPL-3.0-or-later
// The lint rules of NC I (B-13 and those of B-02 to B-14 that it shares), on the text alone; G-.. rules through the reader.
#include <cmath>
#include <cstdlib>
#include <map>
#include <set>

#include "postprocessors/linting.hpp"
#include "postprocessors/nci/nci.hpp"

namespace asbuilt::nci {
namespace {

using namespace linting;
using reading::Line;

std::string_view code_of(std::string_view line) { return line.substr(0, line.find('(')); }

struct Linter {
  Findings& f;
  const PostContext& context;
  std::set<int> head;
  bool has_motion = false, has_m30 = false, has_feed = false, is_spinning = false, has_speed = false, is_cartesian = false;
  double last_number = -1, step = 0;
  std::map<std::string, double> now;

  std::vector<int> codes(const std::string& key) const {
    std::vector<int> out;
    const auto it = context.cell.controller.options.find("nci." + key);
    if (it != context.cell.controller.options.end())
      for (const std::string& w : reading::words(it->second)) out.push_back(std::atoi(w.c_str()));
    return out;
  }

  void line(const Line& line) {
    int depth = 0;
    for (char c : line.text) {
      depth += c == '(' ? 1 : c == ')' ? -1 : 0;
      if (depth > 1 || depth < 0) f.add("B-13", line, "comments do not nest in NC I");
    }
    if (depth != 0) f.add("B-02", line, "brackets of a comment do not match");
    const std::string_view code = code_of(line.text);
    if (code.empty()) return;
    if (line.text.size() > 200) f.add("B-09", line, "a block longer than 200 characters");
    for (const char* foreign : {"#", "$", "%L", "V."})
      if (code.find(foreign) != std::string_view::npos) f.add("B-13", line, std::string(foreign) + " is no part of NC I");
    if (code.find("  ") != std::string_view::npos || code.back() == ' ' || code.front() == ' ') f.add("B-13", line, "words stand with one blank between them");
    if (has_m30) f.add("B-10", line, "something stands after M30");
    std::map<std::string, double> v;
    std::vector<int> g, m;
    const auto all = reading::words(code);
    if (all.empty()) return;
    if (all[0][0] != 'N') f.add("B-09", line, "a block without a number: a line may be lost");
    for (const std::string& w : all) {
      const std::size_t at = w[0] == 'Q' ? w.find('=') : 0;
      char* end = nullptr;
      const double value = at == std::string::npos ? 0 : std::strtod(w.c_str() + at + 1, &end);
      if (at == std::string::npos || end == w.c_str() + at + 1 || *end) {
        f.add("B-13", line, "\"" + w + "\" is no word");
        continue;
      }
      const std::string key = w.substr(0, std::max<std::size_t>(1, at));
      if (key == "N") number(line, value);
      else if (key == "G") g.push_back(static_cast<int>(value));
      else if (key == "M") m.push_back(static_cast<int>(value));
      else v[key] = value;
    }
    words(line, v, g, m);
  }
  void number(const Line& line, double value) {
    if (value <= last_number) f.add("B-09", line, "block numbers do not rise");
    if (last_number >= 0 && step == 0) step = value - last_number;
    if (last_number >= 0 && value - last_number != step) f.add("B-09", line, "a gap in the block numbers: a line may be lost");
    last_number = value;
  }
  void words(const Line& line, std::map<std::string, double>& v, const std::vector<int>& g, const std::vector<int>& m) {
    bool is_motion = false, is_arc = false, has_plane = false;
    for (int x : g) {
      if (!has_motion) head.insert(x);
      is_motion |= x >= 0 && x <= 3, is_arc |= x == 2 || x == 3, has_plane |= x >= 17 && x <= 19;
      if (x == 91 || x == 70) f.add("B-14", line, "G" + std::to_string(x));
      if (x == 4) return;
    }
    for (const auto& [key, value] : v)
      if (key[0] == 'Q' && key != "Q1" && key != "Q2" && key != "Q3") f.add("B-13", line, key + " is no axis of the arm");
    if (v.count("F")) {
      has_feed = true;
      if (!(v["F"] > 0)) f.add("B-05", line, "F is not positive");
    }
    if (v.count("S")) has_speed = true;
    if (v.count("T") != v.count("D")) f.add("B-12", line, "T and D stand together");
    const auto kinematics = codes("kinematics");
    for (int x : m) {
      if (x == 3 && !has_speed) f.add("B-12", line, "M3 before S");
      if (x == 5 && v.count("S")) f.add("B-12", line, "S with M5");
      if (x == 3 || x == 5) is_spinning = x == 3;
      if (kinematics.size() == 2 && (x == kinematics[0] || x == kinematics[1])) {
        if (has_motion && is_cartesian == (x == kinematics[0])) f.add("B-04", line, "the kinematics are switched twice");
        is_cartesian = x == kinematics[0];
        has_feed = false, now.clear();
      }
      if (x == 30 || x == 2) {
        has_m30 = true;
        if (is_cartesian) f.add("B-04", line, "the program ends with the kinematics on");
        if (is_spinning) f.add("B-12", line, "the program ends with the spindle on");
      }
    }
    bool has_axis = false;
    for (const char* a : {"X", "Y", "Z", "Q1", "Q2", "Q3"}) has_axis |= v.count(a) > 0;
    if (!has_axis) return;
    if (!has_motion)
      for (int x : {90, 71, 17})
        if (!head.count(x)) f.add("B-14", line, "G" + std::to_string(x) + " is not in the head");
    has_motion = true;
    if (!is_motion || (is_arc && !has_plane)) f.add("B-05", line, "a motion block must name its G word, an arc its plane");
    if (!has_feed) f.add("B-05", line, "a motion before F");
    const auto before = now;
    for (const char* a : {"X", "Y", "Z", "Q1", "Q2", "Q3"}) {
      if (!v.count(a)) f.add(is_cartesian ? "B-06" : "B-04", line, std::string("the word ") + a + " is left out");
      now[a] = v[a];
    }
    if (!is_cartesian) return;
    for (const char* a : {"Q1", "Q2", "Q3"}) {
      if (std::abs(now[a]) > 180) f.add("B-06", line, std::string(a) + " is beyond 180 degrees");
      if (before.count(a) && std::abs(now[a] - before.at(a)) > 90) f.add("B-06", line, std::string("a jump in ") + a);
    }
    if (is_arc) arc(line, v, before, has_plane, g);
  }
  void arc(const Line& line, std::map<std::string, double>& v, const std::map<std::string, double>& before, bool, const std::vector<int>& g) {
    int plane = 17;
    for (int x : g)
      if (x >= 17 && x <= 19) plane = x;
    const std::string a = plane == 17 ? "X" : plane == 18 ? "Z" : "Y", b = plane == 17 ? "Y" : plane == 18 ? "X" : "Z";
    const std::string i = plane == 17 ? "I" : plane == 18 ? "K" : "J", j = plane == 17 ? "J" : plane == 18 ? "I" : "K";
    if (!before.count(a)) return f.add("B-08", line, "an arc without a start");
    if (!v.count(i) && !v.count(j)) return f.add("B-08", line, "an arc without a centre");
    const double r0 = std::hypot(v[i], v[j]), r1 = std::hypot(now[a] - before.at(a) - v[i], now[b] - before.at(b) - v[j]);
    if (std::abs(r0 - r1) > 0.001 || r0 < 1e-3) f.add("B-08", line, "the radii at start and end differ, or are 0");
  }
};

}  // namespace

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  Findings f(joined(kCommonErrors, {"B-02", "B-04", "B-05", "B-06", "B-08", "B-09", "B-10", "B-12", "B-13", "B-14"}), kCommonWarnings);
  common_rules(f, text, context, read, code_of, true);
  if (!text.files.empty()) {
    Linter l{f, context, {}};
    for (const Line& line : raw_lines(text.files.front())) l.line(line);
    if (!l.has_m30) f.add("B-10", text.files.front().name, "M30 is missing");
  }
  return f.checks();
}

}  // namespace asbuilt::nci
