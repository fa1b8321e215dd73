// SPDX-License-Identifier: GPL-3.0-or-later
// Statements that move nothing and switch nothing: calls, BAS, settings.
#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

void Reader::run(const Module& m) {
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

void Reader::statement(Scanner& s) {
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

void Reader::basic(Scanner& s) {
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

bool Reader::setting(Scanner& s) {
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
  if (assign("$LOAD")) {  // the load of another tool lets the arm sag and its limits be wrong
    s.expect("LOAD_DATA");
    const int n = index(s, 1, 16);
    if (!build_.tool() || build_.tool()->number != n) fail(line, "read.load", "the load is that of tool " + std::to_string(n) + ", the tool in use another", n, build_.tool() ? build_.tool()->number : 0);
    return true;
  }
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

void Reader::positive(Scanner& s) {
  const double v = s.expect_number("a number");
  if (!(v > 0)) fail(s.line(), "read.range", "the value must be greater than 0", v, 0);
}

}  // namespace asbuilt::krl
