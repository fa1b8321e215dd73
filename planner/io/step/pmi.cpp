// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/pmi.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>

#include "planner/base/number.hpp"

namespace asbuilt::step {

using namespace p21;

namespace {

constexpr std::size_t kLinesLimit = 20000;

struct Tolerance {
  std::uint32_t key;
  const char* name;
};
constexpr Tolerance kTolerances[] = {{K_ANGULARITY_TOLERANCE, "angularity"},
                                     {K_CIRCULAR_RUNOUT_TOLERANCE, "circular runout"},
                                     {K_COAXIALITY_TOLERANCE, "coaxiality"},
                                     {K_CONCENTRICITY_TOLERANCE, "concentricity"},
                                     {K_CYLINDRICITY_TOLERANCE, "cylindricity"},
                                     {K_FLATNESS_TOLERANCE, "flatness"},
                                     {K_LINE_PROFILE_TOLERANCE, "line profile"},
                                     {K_PARALLELISM_TOLERANCE, "parallelism"},
                                     {K_PERPENDICULARITY_TOLERANCE, "perpendicularity"},
                                     {K_POSITION_TOLERANCE, "position"},
                                     {K_ROUNDNESS_TOLERANCE, "roundness"},
                                     {K_STRAIGHTNESS_TOLERANCE, "straightness"},
                                     {K_SURFACE_PROFILE_TOLERANCE, "surface profile"},
                                     {K_SYMMETRY_TOLERANCE, "symmetry"},
                                     {K_TOTAL_RUNOUT_TOLERANCE, "total runout"}};

class PmiReader {
 public:
  explicit PmiReader(const Binder& b) : b_(b), f_(b.file()) {}

  std::vector<std::string> run() {
    link();
    std::vector<std::string> out;
    for (const Instance& i : f_.instances) {
      if (i.record_count == 0 || out.size() >= kLinesLimit) continue;
      try {
        const std::string line = one(i);
        if (!line.empty()) out.push_back(line + faces(i));
      } catch (const StepFault&) {  // what is broken here hurts no geometry
      }
    }
    return out;
  }

 private:
  /// Which faces a shape aspect is about, tolerances of dimensions, values of dimensions.
  void link() {
    for (const Instance& i : f_.instances) {
      if (i.record_count == 0) continue;
      const std::uint32_t k = b_.key(i);
      try {
        if (k == K_GEOMETRIC_ITEM_SPECIFIC_USAGE) {
          const Args a = b_.args(i);
          const Value* v = a.at(4);
          std::vector<std::int64_t> items;
          if (v && v->kind == Kind::list)
            items = b_.references(i, v);
          else
            items.push_back(b_.reference(i, v));
          auto& list = faces_[b_.reference(i, a.at(2))];
          for (std::int64_t item : items) {
            const Instance* f = f_.find(item);
            if (f && (b_.key(*f) == K_ADVANCED_FACE || b_.key(*f) == K_FACE_SURFACE)) list.push_back(item);
          }
        } else if (k == K_SHAPE_ASPECT_RELATIONSHIP) {  // a group of aspects and its members
          const Args a = b_.args(i);
          members_[b_.reference(i, a.at(2))].push_back(b_.reference(i, a.at(3)));
        } else if (k == K_PLUS_MINUS_TOLERANCE) {
          const Args a = b_.args(i);
          tolerance_[b_.reference(i, a.at(1))] = b_.reference(i, a.at(0));
        } else if (k == K_DIMENSIONAL_CHARACTERISTIC_REPRESENTATION) {
          const Args a = b_.args(i);
          value_[b_.reference(i, a.at(0))] = b_.reference(i, a.at(1));
        }
      } catch (const StepFault&) {
      }
    }
  }

  /// "0.2 mm", "30 deg": a measure with its own unit.
  std::string measure(std::int64_t id) const {
    const Instance& i = b_.instance(id);
    Args a = b_.args(i, K_MEASURE_WITH_UNIT);
    if (a.size() < 2) a = b_.args(i);
    if (b_.key(i) == K_MEASURE_REPRESENTATION_ITEM && i.record_count == 1) a = Args(a.at(1), a.size() - 1);
    if (a.size() < 2) b_.fail(i, "a measure is expected here");
    const double v = b_.real(i, a.at(0));
    double length = 0, angle = 0;
    unit(b_.reference(i, a.at(1)), 0, length, angle);
    if (length > 0) return shortest_number(rounded(v * length, 6)) + " mm";
    if (angle > 0) return shortest_number(rounded(deg_from_rad(v * angle), 6)) + " deg";
    return shortest_number(v);
  }
  void unit(std::int64_t id, int depth, double& length_mm, double& angle_rad) const {
    const Instance* i = f_.find(id);
    if (!i || depth > 4) return;
    const bool is_length = b_.has(*i, K_LENGTH_UNIT), is_angle = b_.has(*i, K_PLANE_ANGLE_UNIT);
    if (!is_length && !is_angle) return;
    double factor = 1;
    if (b_.has(*i, K_CONVERSION_BASED_UNIT)) {
      const Args c = b_.args(*i, K_CONVERSION_BASED_UNIT);
      const Instance& m = b_.instance(b_.reference(*i, c.at(c.size() - 1)));
      Args a = b_.args(m, K_MEASURE_WITH_UNIT);
      if (a.size() < 2) a = b_.args(m);
      double l = 0, g = 0;
      unit(b_.reference(m, a.at(a.size() - 1)), depth + 1, l, g);
      factor = b_.real(m, a.at(a.size() - 2));
      length_mm = l * factor, angle_rad = g * factor;
      return;
    }
    const Args s = b_.args(*i, K_SI_UNIT);
    if (s.size() < 2) return;
    const std::string_view prefix = b_.enumeration(s.at(s.size() - 2));
    if (prefix == "MILLI") factor = 1e-3;
    if (prefix == "CENTI") factor = 1e-2;
    if (prefix == "MICRO") factor = 1e-6;
    if (is_length) length_mm = 1000 * factor;
    if (is_angle) angle_rad = factor;
  }

  std::string datum_letter(std::int64_t id, int depth = 0) const {
    const Instance& i = b_.instance(id);
    if (depth > 4) return "?";
    if (b_.has(i, K_DATUM)) {
      const Args a = b_.args(i, K_DATUM);
      return b_.text(a.at(a.size() - 1));
    }
    const std::uint32_t k = b_.key(i);
    if (k == K_DATUM_SYSTEM) {
      std::string s;
      for (std::int64_t c : b_.references(i, b_.args(i).at(4))) s += (s.empty() ? "" : " | ") + datum_letter(c, depth + 1);
      return s;
    }
    if (k == K_DATUM_REFERENCE_COMPARTMENT || k == K_DATUM_REFERENCE_ELEMENT) {
      const Args a = b_.args(i);
      const Value* base = a.at(4);
      std::string s;
      if (base && base->kind == Kind::reference)
        s = datum_letter(base->integer, depth + 1);
      else if (base && base->kind == Kind::typed && base->inside >= 2)
        for (std::int64_t c : b_.references(i, base + 1)) s += (s.empty() ? "" : "-") + datum_letter(c, depth + 1);
      return s + modifiers(i, a.at(5));
    }
    if (k == K_DATUM_REFERENCE) return datum_letter(b_.reference(i, b_.args(i).at(1)), depth + 1);
    return "?";
  }
  std::string modifiers(const Instance& i, const Value* v) const {
    std::string s;
    if (!v || v->kind != Kind::list) return s;
    const Args a = b_.list(i, v);
    const Value* q = a.first();
    for (std::uint32_t k = 0; k < a.size(); ++k, q = next(q)) {
      const Value* w = q->kind == Kind::typed && q->inside >= 2 ? q + 2 : q;
      const std::string_view e = b_.enumeration(w);
      if (e == "MAXIMUM_MATERIAL_REQUIREMENT")
        s += " M";
      else if (e == "LEAST_MATERIAL_REQUIREMENT")
        s += " L";
      else if (!e.empty())
        s += " " + std::string(e);
    }
    return s;
  }

  std::string one(const Instance& i) const {
    const std::uint32_t k = b_.key(i);
    if (b_.has(i, K_DATUM) && (k == K_DATUM || i.record_count > 1)) return "datum " + datum_letter(i.id) + " #" + std::to_string(i.id);
    for (const Tolerance& t : kTolerances) {
      if (!b_.has(i, t.key)) continue;
      Args a = b_.args(i, K_GEOMETRIC_TOLERANCE);
      if (a.size() < 3) a = b_.args(i);
      std::string s = std::string(t.name) + " " + measure(b_.reference(i, a.at(2)));
      const Args m = b_.args(i, K_GEOMETRIC_TOLERANCE_WITH_MODIFIERS);
      if (m.size()) s += modifiers(i, m.at(0));
      Args d = b_.args(i, K_GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE);
      const Value* datums = d.size() ? d.at(0) : (i.record_count == 1 ? a.at(4) : nullptr);
      if (datums && datums->kind == Kind::list)
        for (std::int64_t r : b_.references(i, datums)) s += " | " + datum_letter(r);
      return s + " #" + std::to_string(i.id);
    }
    if (k == K_DIMENSIONAL_SIZE || k == K_DIMENSIONAL_LOCATION || k == K_ANGULAR_SIZE || k == K_ANGULAR_LOCATION) {
      const Args a = b_.args(i);
      std::string s = b_.text(a.at(k == K_DIMENSIONAL_SIZE || k == K_ANGULAR_SIZE ? 1 : 0));
      if (s.empty()) s = "dimension";
      const auto v = value_.find(i.id);
      if (v != value_.end()) {
        const Instance& r = b_.instance(v->second);
        for (std::int64_t item : b_.references(r, b_.args(r).at(1))) {
          const Instance* q = f_.find(item);
          if (q && (b_.has(*q, K_MEASURE_REPRESENTATION_ITEM) || b_.has(*q, K_MEASURE_WITH_UNIT))) {
            s += " " + measure(item);
            break;
          }
        }
      }
      const auto t = tolerance_.find(i.id);
      if (t != tolerance_.end()) {
        const Instance& r = b_.instance(t->second);
        if (b_.key(r) == K_TOLERANCE_VALUE) {
          const Args q = b_.args(r);
          const std::string low = measure(b_.reference(r, q.at(0))), high = measure(b_.reference(r, q.at(1)));
          s += " " + low + " .. " + (high[0] == '-' || high.rfind("0 ", 0) == 0 ? "" : "+") + high;
        }
      }
      return s + " #" + std::to_string(i.id);
    }
    return {};
  }

  /// " faces #a #b" for tolerances (by the aspect they tolerance) and datums.
  std::string faces(const Instance& i) const {
    std::vector<std::int64_t> list;
    const auto own = [&](std::int64_t aspect) {
      const auto it = faces_.find(aspect);
      if (it != faces_.end()) list.insert(list.end(), it->second.begin(), it->second.end());
    };
    const auto add = [&](std::int64_t aspect) {
      own(aspect);
      const auto it = members_.find(aspect);
      if (it != members_.end())
        for (std::int64_t m : it->second) own(m);
    };
    add(i.id);
    try {
      const std::uint32_t k = b_.key(i);
      if (k == K_DIMENSIONAL_SIZE || k == K_ANGULAR_SIZE) {
        add(b_.reference(i, b_.args(i).at(0)));
      } else if (k == K_DIMENSIONAL_LOCATION || k == K_ANGULAR_LOCATION) {
        add(b_.reference(i, b_.args(i).at(2))), add(b_.reference(i, b_.args(i).at(3)));
      } else {
        Args a = b_.args(i, K_GEOMETRIC_TOLERANCE);
        if (a.size() < 4) a = b_.args(i);
        if (a.at(3) && a.at(3)->kind == Kind::reference) add(a.at(3)->integer);
      }
    } catch (const StepFault&) {
    }
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
    std::string s = list.empty() ? "" : " faces";
    for (std::int64_t f : list) s += " #" + std::to_string(f);
    return s;
  }

  const Binder& b_;
  const File& f_;
  std::unordered_map<std::int64_t, std::vector<std::int64_t>> faces_, members_;
  std::unordered_map<std::int64_t, std::int64_t> tolerance_, value_;
};

}  // namespace

std::vector<std::string> read_pmi(const Binder& b) { return PmiReader(b).run(); }

}  // namespace asbuilt::step
