// SPDX-License-Identifier: GPL-3.0-or-later
// Stages 8 and 10: each check with the measured value, the limit and the place. A program is released only if all pass.
#pragma once

#include <string>
#include <vector>

namespace asbuilt {

struct Check {
  std::string name;     // "path_error", "clearance.tool", "lint.K-05"
  double measured = 0, limit = 0;
  std::string unit, where;
  bool is_passed = false;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("measured", s.measured), a("limit", s.limit), a("unit", s.unit), a("where", s.where), a("pass", s.is_passed);
  }
};

struct Verdict {
  std::vector<Check> checks;
  double path_error_max_mm = 0, clearance_min_mm = 1e9, joint_margin_min_rad = 1e9, singularity_min_ratio = 1e9, speed_ratio_max = 0;
  double duration_s = 0;
  std::size_t points_count = 0;
  bool is_ok() const {
    for (const Check& c : checks)
      if (!c.is_passed) return false;
    return !checks.empty();
  }
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("checks", s.checks), a("path_error_max", s.path_error_max_mm), a("clearance_min", s.clearance_min_mm);
    a("joint_margin_min", s.joint_margin_min_rad), a("singularity_min", s.singularity_min_ratio), a("speed_ratio_max", s.speed_ratio_max);
    a("duration", s.duration_s), a("points", s.points_count);
  }
};

}  // namespace asbuilt
