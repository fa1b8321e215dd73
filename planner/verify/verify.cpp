// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/verify.hpp"

namespace asbuilt {
Verdict verify_program(const CellSpec&, const Program&) { return {}; }
Verdict verify_item(const Job&, const Location&, const Features&, const Burrs&, const ToolPath&, const Program&) { return {}; }
Verdict compare_programs(const Program&, const Program&, double, double, double) { return {}; }
}  // namespace asbuilt
