// SPDX-License-Identifier: GPL-3.0-or-later
// What the program switches and waits for: outputs, the machine's own sub-programs, checks of the machine, triggers.
#include <cmath>
#include <cstdlib>

#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

bool Reader::equipment(Scanner& s) {
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

std::optional<int> Reader::coolant() const {
  const auto it = context_.cell.controller.options.find("krl.coolant");
  if (it == context_.cell.controller.options.end()) return std::nullopt;
  return std::atoi(it->second.c_str());
}

double Reader::reference(Scanner& s) {
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

void Reader::machine_check(const Line& line, const std::string& key, const std::string& text) {
  const auto it = context_.cell.controller.options.find(key);
  if (it == context_.cell.controller.options.end() || it->second != text)
    fail(line, "read.check", "the program waits for a controller with \"" + text + "\", and the cell's (controller." + key + ") " + (it == context_.cell.controller.options.end() ? "is not given" : "is \"" + it->second + "\""));
  checked_.insert(key);
}

void Reader::wait(Scanner& s) {
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

bool Reader::output(Scanner& s, const Line& line) {
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

void Reader::action(Scanner& s, const Line& line) {
  if (!output(s, line) && !equipment(s)) s.unknown();
  if (s.accept("PRIO")) s.expect("="), s.expect_integer("PRIO", -1, 128);
}

void Reader::trigger(Scanner& s) {
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

void Reader::moved() {
  armed_at_ = {};
  const auto events = std::move(at_end_of_next_);
  at_end_of_next_.clear();
  for (const auto& [line, statement] : events) {
    Scanner s(line, statement);
    action(s, line);
    s.expect_end();
  }
}

}  // namespace asbuilt::krl
