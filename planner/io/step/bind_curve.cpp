// SPDX-License-Identifier: GPL-3.0-or-later
// Curves from their entities.
#include <cmath>

#include "planner/io/step/bind.hpp"
#include "planner/io/step/curve_join.hpp"

namespace asbuilt::step {

using namespace p21;

Curve Binder::bspline_curve(const Instance& i) const {
  const bool is_complex = i.record_count > 1;
  const Args simple = args(i);
  // Simple: (name, degree, poles, form, closed, self, [multiplicities, knots, spec]); complex parts drop the name.
  const Args base = is_complex ? args(i, K_B_SPLINE_CURVE) : simple;
  const std::uint32_t o = is_complex ? 0 : 1;
  if (base.size() < o + 2) fail(i, "a B-spline curve without degree and poles");
  BSplineCurve c;
  const std::int64_t degree = integer(i, base.at(o));
  if (degree < 1 || degree > 25) fail(i, "a degree outside 1 to 25");
  c.degree = static_cast<int>(degree);
  for (std::int64_t p : references(i, base.at(o + 1))) c.poles.push_back(point(p));
  if (c.poles.size() < static_cast<std::size_t>(degree) + 1) fail(i, "fewer poles than degree + 1");
  const Args with = is_complex ? args(i, K_B_SPLINE_CURVE_WITH_KNOTS) : (key(i) == K_B_SPLINE_CURVE_WITH_KNOTS ? simple : Args());
  if (with.size()) {
    const std::uint32_t w = is_complex ? 0 : 6;
    c.knots = knots(i, with.at(w), with.at(w + 1), c.degree, c.poles.size());
  } else {
    std::uint32_t kind = key(i);
    for (std::uint32_t k : {K_BEZIER_CURVE, K_UNIFORM_CURVE, K_QUASI_UNIFORM_CURVE})
      if (has(i, k)) kind = k;
    c.knots = default_knots(kind, c.degree, static_cast<int>(c.poles.size()));
    if (c.knots.size() != c.poles.size() + static_cast<std::size_t>(c.degree) + 1) fail(i, "poles do not fit the degree");
  }
  const Args weights = args(i, K_RATIONAL_B_SPLINE_CURVE);
  if (weights.size()) {
    const Args w = list(i, weights.at(0));
    if (w.size() != c.poles.size()) fail(i, "weights and poles differ in number");
    bool all_one = true;
    for (std::uint32_t k = 0; k < w.size(); ++k) {
      c.weights.push_back(real(i, w.first() + k));
      if (!(c.weights.back() > 0)) fail(i, "a weight that is not positive");
      all_one = all_one && std::abs(c.weights.back() - c.weights.front()) < 1e-14;
    }
    if (all_one) c.weights.clear();
  }
  return {c};
}

/// Parameters of a TRIMMED_CURVE on its basis, in the direction of its sense.
std::pair<double, double> Binder::trim(const Instance& i, const Curve& basis, double per_unit) const {
  const bool is_complex = i.record_count > 1;
  const Args a = is_complex ? args(i, K_TRIMMED_CURVE) : args(i);
  const std::uint32_t o = is_complex ? 0 : 1;
  const bool sense = is_true(i, a.at(o + 3));
  const bool wants_points = enumeration(a.at(o + 4)) == "CARTESIAN";
  double t[2];
  for (std::uint32_t k = 0; k < 2; ++k) {
    const Args set = list(i, a.at(o + 1 + k));
    const Value *parameter = nullptr, *at = nullptr;
    const Value* v = set.first();
    for (std::uint32_t j = 0; j < set.size(); ++j, v = next(v)) (v->kind == Kind::reference ? at : parameter) = v;
    if (at && (wants_points || !parameter))
      t[k] = project(basis, point(at->integer)).t;
    else
      t[k] = real(i, parameter) * per_unit;
  }
  const CurveDomain d = domain(basis);
  if (d.is_closed && d.period() > 0) {
    const double eps = 1e-9 * d.period();
    if (sense)
      while (t[1] <= t[0] + eps) t[1] += d.period();
    else
      while (t[1] >= t[0] - eps) t[1] -= d.period();
    if (std::abs(t[1] - t[0]) > d.period() + eps) t[1] = t[0] + (sense ? d.period() : -d.period());
  } else if (d.is_bounded) {
    for (double& x : t) x = std::clamp(x, d.t0, d.t1);
  }
  return {t[0], t[1]};
}

/// A curve with ends as a B-spline in its own direction.
BSplineCurve Binder::bounded_curve(std::int64_t id, int depth) const {
  const Instance& i = instance(id);
  if (depth > 16) fail(i, "curves refer to each other in a circle");
  if (has(i, K_TRIMMED_CURVE)) {
    const Args a = i.record_count > 1 ? args(i, K_TRIMMED_CURVE) : args(i);
    const std::int64_t basis_id = reference(i, a.at(i.record_count > 1 ? 0 : 1));
    bool basis_reversed = false;
    const Curve basis = curve(basis_id, basis_reversed, depth + 1);
    double per_unit = 1;
    const Instance& bi = instance(basis_id);
    if (key(bi) == K_LINE) {
      const Instance& v = instance(reference(bi, args(bi).at(2)));
      per_unit = length(v, args(v, K_VECTOR).at(2));
    } else if (key(bi) == K_CIRCLE || key(bi) == K_ELLIPSE) {
      per_unit = units.angle_rad;
    }
    const auto [t0, t1] = trim(i, basis, per_unit);
    return as_bspline(basis, t0, t1);
  }
  if (has(i, K_COMPOSITE_CURVE)) return composite_curve(i, depth + 1);
  if (has(i, K_SURFACE_CURVE) && i.record_count == 1) return bounded_curve(reference(i, args(i).at(1)), depth + 1);
  bool is_reversed = false;
  const Curve c = curve(id, is_reversed, depth + 1);
  const CurveDomain d = domain(c);
  if (!d.is_bounded) fail(i, "a piece without ends");
  return is_reversed ? as_bspline(c, d.t1, d.t0) : as_bspline(c, d.t0, d.t1);
}

BSplineCurve Binder::composite_curve(const Instance& i, int depth) const {
  const bool is_complex = i.record_count > 1;
  const Args a = is_complex ? args(i, K_COMPOSITE_CURVE) : args(i);
  std::vector<BSplineCurve> pieces;
  for (std::int64_t s : references(i, a.at(is_complex ? 0 : 1))) {
    const Instance& si = instance(s);
    const Args sa = si.record_count > 1 ? args(si, K_COMPOSITE_CURVE_SEGMENT) : args(si);
    BSplineCurve c = bounded_curve(reference(si, sa.at(2)), depth + 1);
    if (!is_true(si, sa.at(1))) {
      const CurveDomain d = domain(Curve{c});
      c = as_bspline({c}, d.t1, d.t0);
    }
    if (!pieces.empty() && (c.poles.front() - pieces.back().poles.back()).norm() > std::max(10 * units.uncertainty_mm, 0.01))
      fail(si, "a piece that does not start where the one before ends");
    if (pieces.size() >= 10000) fail(i, "more than 10000 pieces");
    pieces.push_back(std::move(c));
  }
  if (pieces.empty()) fail(i, "a composite curve without pieces");
  return joined(pieces);
}

Curve Binder::curve(std::int64_t id, bool& is_reversed, int depth) const {
  const Instance& i = instance(id);
  if (depth > 16) fail(i, "curves refer to each other in a circle");
  const Args a = args(i);
  switch (key(i)) {
    case K_LINE: {
      const Instance& v = instance(reference(i, a.at(2)));
      const Args b = args(v, K_VECTOR);
      return {LineCurve{point(reference(i, a.at(1))), direction(reference(v, b.at(1)))}};
    }
    case K_CIRCLE: {
      const CircleCurve c{placement(reference(i, a.at(1))), length(i, a.at(2))};
      if (!(c.radius_mm > 0)) fail(i, "a radius that is not positive");
      return {c};
    }
    case K_ELLIPSE:
    case K_HYPERBOLA: {
      const Placement at = placement(reference(i, a.at(1)));
      const double x = length(i, a.at(2)), y = length(i, a.at(3));
      if (!(x > 0 && y > 0)) fail(i, "a half axis that is not positive");
      if (key(i) == K_ELLIPSE) return {EllipseCurve{at, x, y}};
      return {HyperbolaCurve{at, x, y}};
    }
    case K_PARABOLA: {
      const ParabolaCurve c{placement(reference(i, a.at(1))), length(i, a.at(2))};
      if (!(std::abs(c.focal_mm) > 0)) fail(i, "a focal distance of zero");
      return {c};
    }
    case K_POLYLINE: {
      PolylineCurve c;
      for (std::int64_t p : references(i, a.at(1))) c.points.push_back(point(p));
      if (c.points.size() < 2) fail(i, "fewer than two points");
      return {c};
    }
    case K_SURFACE_CURVE:
    case K_SEAM_CURVE:
    case K_BOUNDED_SURFACE_CURVE:
    case K_INTERSECTION_CURVE:
      return curve(reference(i, a.at(1)), is_reversed, depth + 1);
    case K_TRIMMED_CURVE: {
      if (!is_true(i, a.at(4))) is_reversed = !is_reversed;
      return curve(reference(i, a.at(1)), is_reversed, depth + 1);
    }
    case K_COMPOSITE_CURVE:
    case K_COMPOSITE_CURVE_ON_SURFACE:
    case K_BOUNDARY_CURVE:
    case K_OUTER_BOUNDARY_CURVE:
      return {composite_curve(i, depth)};
    case K_OFFSET_CURVE_3D: {
      bool basis_reversed = false;
      const Curve basis = curve(reference(i, a.at(1)), basis_reversed, depth + 1);
      const double distance = length(i, a.at(2)) * (basis_reversed ? -1 : 1);
      const auto c = offset_in_space(basis, distance, direction(reference(i, a.at(4))));
      if (!c) fail(i, "an offset of a curve without end or along its direction");
      if (basis_reversed) is_reversed = !is_reversed;
      return *c;
    }
    case K_CURVE_REPLICA:
      return transformed(transformation(reference(i, a.at(2))), curve(reference(i, a.at(1)), is_reversed, depth + 1));
    default:
      break;
  }
  if (has(i, K_B_SPLINE_CURVE) || has(i, K_B_SPLINE_CURVE_WITH_KNOTS) || has(i, K_BEZIER_CURVE) || has(i, K_UNIFORM_CURVE) ||
      has(i, K_QUASI_UNIFORM_CURVE))
    return bspline_curve(i);
  // complex form: SURFACE_CURVE(curve_3d, ..) without the name
  if (has(i, K_SURFACE_CURVE) || has(i, K_SEAM_CURVE) || has(i, K_INTERSECTION_CURVE)) {
    const Args s = args(i, K_SURFACE_CURVE);
    if (s.size()) return curve(reference(i, s.at(0)), is_reversed, depth + 1);
  }
  if (has(i, K_TRIMMED_CURVE)) {  // with its supertypes spelled out
    const Args t = args(i, K_TRIMMED_CURVE);
    if (t.size() >= 4 && !is_true(i, t.at(3))) is_reversed = !is_reversed;
    return curve(reference(i, t.at(0)), is_reversed, depth + 1);
  }
  if (has(i, K_COMPOSITE_CURVE)) return {composite_curve(i, depth)};
  fail(i, "a kind of curve that is not known");
}

}  // namespace asbuilt::step
