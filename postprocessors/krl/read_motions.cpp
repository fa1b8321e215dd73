// SPDX-License-Identifier: GPL-3.0-or-later
// PTP, LIN, CIRC, their spline singles and blocks.
#include <cmath>

#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

void Reader::joint(Scanner& s) {
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

std::array<double, 6> Reader::posture(const Line& line, const Components& c) {
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

Components Reader::cartesian(Scanner& s) {
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

void Reader::path(Scanner& s, bool is_arc, bool is_spline) {
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

}  // namespace asbuilt::krl
