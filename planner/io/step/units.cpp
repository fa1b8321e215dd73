// SPDX-License-Identifier: GPL-3.0-or-later
// Length and angle factors of a representation context.
#include <algorithm>
#include <cmath>

#include "planner/io/step/model.hpp"

namespace asbuilt::step {

using namespace p21;

namespace {

double prefix_factor(std::string_view prefix) {
  struct Row {
    std::string_view name;
    double factor;
  };
  constexpr Row rows[] = {{"EXA", 1e18},  {"PETA", 1e15},  {"TERA", 1e12},   {"GIGA", 1e9},   {"MEGA", 1e6},   {"KILO", 1e3},
                          {"HECTO", 1e2}, {"DECA", 1e1},   {"DECI", 1e-1},   {"CENTI", 1e-2}, {"MILLI", 1e-3}, {"MICRO", 1e-6},
                          {"NANO", 1e-9}, {"PICO", 1e-12}, {"FEMTO", 1e-15}, {"ATTO", 1e-18}};
  for (const Row& r : rows)
    if (r.name == prefix) return r.factor;
  return 1;
}

/// Factor of a unit to metre or radian; 0 when it is neither readable nor known by name.
double unit_factor(const Binder& b, const Instance& i, int depth, std::string& name) {
  if (depth > 8) return 0;
  if (b.has(i, K_CONVERSION_BASED_UNIT)) {
    const Args c = b.args(i, K_CONVERSION_BASED_UNIT);
    const std::uint32_t o = c.size() > 2 ? c.size() - 2 : 0;
    name = b.text(c.at(o));
    for (char& ch : name) ch = static_cast<char>(ch >= 'A' && ch <= 'Z' ? ch + 32 : ch);
    try {
      const Instance& m = b.instance(b.reference(i, c.at(o + 1)));
      Args ma = b.args(m, K_MEASURE_WITH_UNIT);
      if (ma.size() < 2) ma = b.args(m);
      const double value = b.real(m, ma.at(ma.size() - 2));
      std::string base;
      const double inner = unit_factor(b, b.instance(b.reference(m, ma.at(ma.size() - 1))), depth + 1, base);
      if (value > 0 && inner > 0) return value * inner;
    } catch (const StepFault&) {
    }
    if (name == "inch" || name == "'inch'" || name == "in") return 0.0254;
    if (name == "foot" || name == "ft") return 0.3048;
    if (name == "millimetre" || name == "mm" || name == "millimeter") return 0.001;
    if (name.find("degree") == 0) return kPi / 180;
    return 0;
  }
  if (b.has(i, K_SI_UNIT)) {
    const Args s = b.args(i, K_SI_UNIT);
    const Value *p = nullptr, *n = nullptr;
    if (s.size() >= 2) p = s.at(s.size() - 2), n = s.at(s.size() - 1);
    const std::string_view unit = b.enumeration(n), prefix = b.enumeration(p);
    if (unit == "METRE") {
      name = prefix.empty()      ? "m"
             : prefix == "MILLI" ? "mm"
             : prefix == "CENTI" ? "cm"
             : prefix == "MICRO" ? "um"
                                 : std::string(prefix) + "METRE";
      return prefix_factor(prefix);
    }
    if (unit == "RADIAN") {
      name = "rad";
      return prefix_factor(prefix);
    }
  }
  return 0;
}

}  // namespace

Units read_units(const Binder& b, std::int64_t context) {
  Units u;
  u.name = "";
  const Instance* c = b.file().find(context);
  if (!c) {
    u.name = "mm (none given)";
    return u;
  }
  const Args assigned = b.args(*c, K_GLOBAL_UNIT_ASSIGNED_CONTEXT);
  try {
    for (std::uint32_t k = 0; k < assigned.size(); ++k) {
      if (assigned.at(k)->kind != Kind::list) continue;
      for (std::int64_t id : b.references(*c, assigned.at(k))) {
        const Instance* i = b.file().find(id);
        if (!i) continue;
        std::string name;
        const bool is_length = b.has(*i, K_LENGTH_UNIT), is_angle = b.has(*i, K_PLANE_ANGLE_UNIT);
        if (!is_length && !is_angle) continue;
        const double f = unit_factor(b, *i, 0, name);
        if (!(f > 0) || !std::isfinite(f)) continue;
        if (is_length) u.length_mm = 1000 * f, u.name = name;
        if (is_angle) u.angle_rad = f;
      }
    }
    const Args uncertain = b.args(*c, K_GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT);
    if (uncertain.size())
      for (std::int64_t id : b.references(*c, uncertain.at(0))) {
        const Instance* i = b.file().find(id);
        if (!i) continue;
        Args m = b.args(*i, K_UNCERTAINTY_MEASURE_WITH_UNIT);
        if (m.size() < 2) m = b.args(*i, K_MEASURE_WITH_UNIT);
        if (m.size()) u.uncertainty_mm = std::clamp(b.real(*i, m.at(0)) * u.length_mm, 0.0, 1.0);
      }
  } catch (const StepFault&) {
  }
  if (u.name.empty()) u.name = "mm (none given)";
  return u;
}

}  // namespace asbuilt::step
