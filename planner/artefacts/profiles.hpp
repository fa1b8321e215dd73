// SPDX-License-Identifier: GPL-3.0-or-later
// What a laser profilometer on the flange delivers while the robot moves it, and the plate with conical holes it is calibrated on.
// A profile is a row of (u, v) in pixels, or of (x, z) in mm where the device converts by itself.
// Frame `target` of the plate: origin at the rim centre of the first large hole, x to the second, z out of the plate.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

/// A plate with conical holes in a square raster; three of them are larger. Cells are counted from 0, as seen from the front with x to
/// the right and y up. large: the origin, one further along the direction of x, one on the side of y.
struct HolePlate {
  std::string name;
  int columns_count = 0, rows_count = 0;
  double pitch_mm = 0;
  double diameter_mm = 0, large_diameter_mm = 0;  // of the rim
  double cone_rad = 0;                            // full angle of the cone
  std::array<std::array<int, 2>, 3> large{};      // column, row
  double sd_mm = 0.002;                           // of one hole's place
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("columns", s.columns_count), a("rows", s.rows_count), a("pitch", s.pitch_mm), a("diameter", s.diameter_mm);
    a("large_diameter", s.large_diameter_mm), a("cone", s.cone_rad), a("large", s.large), a("sd", s.sd_mm);
  }
};

/// One pass over the plate. Point k of profile i is uv[begin[i] + k], k < begin[i + 1] - begin[i].
struct ProfileScan {
  std::string name;
  bool is_held_out = false;
  std::vector<double> t_s;                                     // of each profile, from the first one on
  std::vector<Pose<frame::Base, frame::Flange>> T_base_flange;  // of each profile, as commanded or logged
  std::vector<std::uint32_t> begin;                            // one more than there are profiles
  std::vector<Eigen::Vector2f> uv;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("held_out", s.is_held_out), a("t", s.t_s), a("T_base_flange", s.T_base_flange), a("begin", s.begin), a("uv", s.uv);
  }
};

/// Rim centre of a hole in the frame of the plate.
inline Vec3 hole_center(const HolePlate& plate, int column, int row) {
  const auto& o = plate.large[0];
  const double dx = plate.large[1][0] - o[0], dy = plate.large[1][1] - o[1], n = std::hypot(dx, dy);
  const double x = column - o[0], y = row - o[1];
  return Vec3((x * dx + y * dy) / n, (y * dx - x * dy) / n, 0) * plate.pitch_mm;
}

inline bool is_large_hole(const HolePlate& plate, int column, int row) {
  for (const auto& l : plate.large)
    if (l[0] == column && l[1] == row) return true;
  return false;
}

}  // namespace asbuilt
