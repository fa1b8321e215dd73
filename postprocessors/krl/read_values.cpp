// SPDX-License-Identifier: GPL-3.0-or-later
// Positions, frames and tools, written out or by name.
#include <cmath>

#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

Components Reader::value(Scanner& s, std::string_view what) {
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

double Reader::get(const Components& c, const char* key) {
  const auto it = c.find(key);
  return it == c.end() ? 0 : it->second;
}

void Reader::need_frame(const Line& line, const Components& c) {
  for (const char* k : {"X", "Y", "Z", "A", "B", "C"})
    if (!c.count(k)) fail(line, "read.missing", std::string("the frame lacks its component ") + k);
  if (c.size() != 6) fail(line, "read.unknown", "a frame has the components X, Y, Z, A, B, C and no more");
}

Components Reader::base_data(const Line& line, int n) {
  if (base_data_.count(n)) return base_data_[n];
  if (n == 0) return {{"X", 0}, {"Y", 0}, {"Z", 0}, {"A", 0}, {"B", 0}, {"C", 0}};
  fail(line, "read.undefined", "BASE_DATA[" + std::to_string(n) + "] is on the controller and not in these files", n);
}

void Reader::set_base(const Line& line, const Components& c) {
  need_frame(line, c);
  const auto T = pose_of<frame::Base>(c);
  build_.set_frame(line, {T.q, T.p_mm});
  now_.clear();
}

void Reader::set_base(Scanner& s) {
  if (s.accept("$NULLFRAME") || s.accept("$WORLD")) return set_base(s.line(), base_data(s.line(), 0));
  if (s.accept("BASE_DATA")) return set_base(s.line(), base_data(s.line(), index(s, 0, 32)));
  set_base(s.line(), value(s, "the frame"));
}

int Reader::index(Scanner& s, int lo, int hi) {
  s.expect("[");
  const int n = s.expect_integer("the index", lo, hi);
  s.expect("]");
  return n;
}

void Reader::set_tool(Scanner& s) {
  if (s.accept("TOOL_DATA")) return build_.set_tool(s.line(), index(s, 1, 16));
  const Components c = value(s, "the tool");
  need_frame(s.line(), c);
  const auto T = pose_of<frame::Flange>(c);
  build_.set_tool_pose(s.line(), T);
}

}  // namespace asbuilt::krl
