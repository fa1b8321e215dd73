// SPDX-License-Identifier: GPL-3.0-or-later
// Edges given only in the parameters of a surface: their course in space.
#include <algorithm>
#include <cmath>

#include "planner/io/step/bind.hpp"
#include "planner/io/step/curve_join.hpp"

namespace asbuilt::step {

using namespace p21;

std::int64_t Binder::pcurve_alone(std::int64_t id) const {
  const Instance* i = file_.find(id);
  if (!i || i->record_count == 0) return 0;
  if (key(*i) == K_PCURVE) return id;
  Args a;
  std::uint32_t o = 1;  // after the name, which complex instances keep elsewhere
  for (std::uint32_t k : {K_SURFACE_CURVE, K_SEAM_CURVE, K_INTERSECTION_CURVE, K_BOUNDED_SURFACE_CURVE})
    if (a.size() == 0 && has(*i, k)) a = args(*i, k), o = i->record_count > 1 ? 0 : 1;
  if (a.size() < o + 2 || !a.at(o + 1) || a.at(o + 1)->kind != Kind::list) return 0;
  const Instance* course = a.at(o)->kind == Kind::reference ? file_.find(a.at(o)->integer) : nullptr;
  if (course && course->record_count > 0 && key(*course) != K_PCURVE) return 0;
  for (std::int64_t p : references(*i, a.at(o + 1)))
    if (const Instance* q = file_.find(p); q && q->record_count > 0 && key(*q) == K_PCURVE) return p;
  return course ? course->id : 0;
}

/// What one unit of u and of v in the file is in ours.
Vec2 Binder::parameter_units(const Instance& i) const {
  const double mm = units.length_mm, rad = units.angle_rad;
  const auto along = [&](std::int64_t profile) {
    const Instance& c = instance(profile);
    switch (key(c)) {
      case K_LINE: {
        const Instance& v = instance(reference(c, args(c).at(2)));
        return length(v, args(v, K_VECTOR).at(2));
      }
      case K_CIRCLE:
      case K_ELLIPSE:
        return rad;
      default:
        if (!has(c, K_B_SPLINE_CURVE) && !has(c, K_B_SPLINE_CURVE_WITH_KNOTS) && !has(c, K_POLYLINE))
          fail(i, "a profile whose parameters are not known");
        return 1.0;
    }
  };
  switch (key(i)) {
    case K_PLANE:
      return {mm, mm};
    case K_CYLINDRICAL_SURFACE:
    case K_CONICAL_SURFACE:
      return {rad, mm};
    case K_SPHERICAL_SURFACE:
    case K_TOROIDAL_SURFACE:
    case K_DEGENERATE_TOROIDAL_SURFACE:
      return {rad, rad};
    case K_SURFACE_OF_LINEAR_EXTRUSION: {
      const Instance& v = instance(reference(i, args(i).at(2)));
      return {along(reference(i, args(i).at(1))), length(v, args(v, K_VECTOR).at(2))};
    }
    case K_SURFACE_OF_REVOLUTION:
      return {rad, along(reference(i, args(i).at(1)))};
    default:
      if (has(i, K_B_SPLINE_SURFACE) || has(i, K_B_SPLINE_SURFACE_WITH_KNOTS)) return {1, 1};
      fail(i, "a surface whose parameters are not known");
  }
}

Curve Binder::curve_on_surface(std::int64_t id, const Vec3& from, const Vec3& to, bool is_reversed) const {
  const Instance& i = instance(id);
  const std::int64_t surface_id = reference(i, args(i).at(1));
  bool surface_reversed = false;
  const Surface s = surface(surface_id, surface_reversed);
  const SurfaceDomain d = domain(s);
  const Vec2 unit = parameter_units(instance(surface_id));
  const Instance& definition = instance(reference(i, args(i).at(2)));
  const std::vector<std::int64_t> items = references(definition, args(definition).at(1));
  if (items.empty()) fail(i, "no curve in the parameters of its surface");
  Binder bare(file_);  // numbers as they stand: parameters have no length
  bool flat_reversed = false;
  const Curve flat = bare.curve(items.front(), flat_reversed);
  const auto at = [&](double t) -> std::optional<Vec3> {
    const Vec3 q = evaluate(flat, t).p;
    const Vec3 p = evaluate_jet(s, q.x() * unit.x(), q.y() * unit.y(), 1).p;
    return p.allFinite() ? std::optional(p) : std::nullopt;
  };
  const CurveDomain f = domain(flat);
  std::vector<double> breaks;
  if (f.is_bounded && !has(instance(items.front()), K_TRIMMED_CURVE)) {
    breaks = {f.t0, f.t1};
    if (const auto* b = std::get_if<BSplineCurve>(&flat.shape)) {
      breaks.clear();
      for (double k : b->knots)
        if (k >= f.t0 && k <= f.t1 && (breaks.empty() || k > breaks.back())) breaks.push_back(k);
    } else {
      for (int k = 1; k < 8; ++k) breaks.insert(breaks.end() - 1, f.t0 + (f.t1 - f.t0) * k / 8);
    }
  } else {  // between the two points, each sought on every turn of the surface
    const double limit = std::max(10 * units.uncertainty_mm, 0.01);
    const auto parameters_of = [&](const Vec3& p) {
      std::vector<double> t;
      const SurfaceFoot g = project(s, d, p);
      for (int ku = -2; ku <= 2; ++ku)
        for (int kv = -2; kv <= 2; ++kv) {
          if ((ku != 0 && !d.is_periodic_u) || (kv != 0 && !d.is_periodic_v)) continue;
          const Vec3 q((g.u + ku * (d.u1 - d.u0)) / unit.x(), (g.v + kv * (d.v1 - d.v0)) / unit.y(), 0);
          const double x = project(flat, q).t;
          for (int turn = f.is_closed ? -1 : 0; turn <= (f.is_closed ? 1 : 0); ++turn)
            if (const auto r = at(x); r && (*r - p).norm() <= limit) t.push_back(x + turn * (f.is_closed ? f.period() : 0));
        }
      std::sort(t.begin(), t.end());
      return t;
    };
    const std::vector<double> first = parameters_of(from), last = parameters_of(to);
    double best = 1e300, a = 0, b = 0;
    const bool runs_back = is_reversed != flat_reversed;
    for (double x : first)
      for (double y : last)
        if (const double span = runs_back ? x - y : y - x; span > 1e-9 * (1 + std::abs(x)) && span < best - 1e-9) best = span, a = x, b = y;
    if (best > 1e299) fail(i, "its ends do not lie on it");
    for (int k = 0; k <= 8; ++k) breaks.push_back(std::min(a, b) + (std::max(a, b) - std::min(a, b)) * k / 8);
  }
  if (breaks.size() < 2) fail(i, "an empty range");
  const auto course = fitted(at, breaks);
  if (!course) fail(i, "its course leaves the surface");
  return *course;
}

}  // namespace asbuilt::step
