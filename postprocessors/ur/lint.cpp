// SPDX-License-Identifier: GPL-3.0-or-later
// The lint rules U-01 to U-05 of UR script, on the text alone; G-.. rules through the reader.
#include "postprocessors/linting.hpp"
#include "postprocessors/ur/ur.hpp"

namespace asbuilt::ur {
namespace {

using namespace linting;
using reading::Line;

std::string_view code_of(std::string_view line) { return line.substr(0, line.find('#')); }

}  // namespace

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  Findings f(joined(kCommonErrors, {"U-01", "U-02", "U-03", "U-04", "U-05"}), kCommonWarnings);
  common_rules(f, text, context, read, code_of, false);
  for (const ProgramFile& file : text.files) {
    int defs = 0, ends = 0;
    bool has_moved = false, was_rounded = false;
    for (const Line& line : raw_lines(file)) {
      if (line.text.size() > 400) f.add("U-01", line, "a line longer than 400 characters");
      const auto t = tokens_of(code_of(line.text));
      if (t.empty()) continue;
      if (ends) f.add("U-01", line, "something stands after end");
      if (t[0].is("DEF")) {
        ++defs;
        if (t.size() < 2 || t[1].text != stem_of(file.name)) f.add("U-02", line, "the function is not called as its file");
      }
      if (t[0].is("END")) ++ends;
      const bool is_joint = t[0].is("MOVEJ"), is_motion = is_joint || t[0].is("MOVEL") || t[0].is("MOVEC");
      if (!is_motion && !t[0].is("DEF") && !t[0].is("END")) {
        if (was_rounded && (t[0].is("SLEEP"))) f.add("U-04", line, "a rounded corner cannot be followed by a wait");
        continue;
      }
      if (!is_motion) continue;
      if (!has_moved && !is_joint) f.add("U-03", line, "the first motion must be movej");
      has_moved = true;
      const auto a = number_after(t, "A"), v = number_after(t, "V"), r = number_after(t, "R");
      if (!a || !v || (!is_joint && !r)) f.add("U-05", line, "a motion without its acceleration, speed or rounding");
      if (a && (!(*a > 0) || *a > 40)) f.add("U-05", line, "an acceleration out of range");
      if (v && (!(*v > 0) || *v > (is_joint ? 7 : 3))) f.add("U-05", line, "a speed out of range");
      if (r && (*r < 0 || *r > 1)) f.add("U-05", line, "a rounding out of range");
      was_rounded = r && *r > 0;
    }
    if (defs != 1 || ends != 1) f.add("U-01", file.name, "one def and one end");
    if (was_rounded) f.add("U-04", file.name, "the last motion is rounded");
  }
  return f.checks();
}

}  // namespace asbuilt::ur
