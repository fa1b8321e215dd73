// SPDX-License-Identifier: GPL-3.0-or-later
// Surfaces from their entities.
#include <cmath>

#include "planner/io/step/bind.hpp"
#include "planner/io/step/curve_join.hpp"

namespace asbuilt::step {

using namespace p21;

Surface Binder::bspline_surface(const Instance& i) const {
  const bool is_complex = i.record_count > 1;
  const Args simple = args(i);
  const Args base = is_complex ? args(i, K_B_SPLINE_SURFACE) : simple;
  const std::uint32_t o = is_complex ? 0 : 1;
  if (base.size() < o + 3) fail(i, "a B-spline surface without degrees and poles");
  BSplineSurface s;
  const std::int64_t du = integer(i, base.at(o)), dv = integer(i, base.at(o + 1));
  if (du < 1 || du > 25 || dv < 1 || dv > 25) fail(i, "a degree outside 1 to 25");
  s.degree_u = static_cast<int>(du), s.degree_v = static_cast<int>(dv);
  const Args rows = list(i, base.at(o + 2));
  const Value* row = rows.first();
  for (std::uint32_t r = 0; r < rows.size(); ++r, row = next(row)) {
    const std::vector<std::int64_t> ids = references(i, row);
    if (r == 0) s.count_v = static_cast<int>(ids.size());
    if (static_cast<int>(ids.size()) != s.count_v) fail(i, "rows of poles differ in length");
    for (std::int64_t p : ids) s.poles.push_back(point(p));
  }
  s.count_u = static_cast<int>(rows.size());
  if (s.count_u < s.degree_u + 1 || s.count_v < s.degree_v + 1) fail(i, "fewer poles than degree + 1");
  const Args with = is_complex ? args(i, K_B_SPLINE_SURFACE_WITH_KNOTS) : (key(i) == K_B_SPLINE_SURFACE_WITH_KNOTS ? simple : Args());
  if (with.size()) {
    const std::uint32_t w = is_complex ? 0 : 8;
    s.knots_u = knots(i, with.at(w), with.at(w + 2), s.degree_u, static_cast<std::size_t>(s.count_u));
    s.knots_v = knots(i, with.at(w + 1), with.at(w + 3), s.degree_v, static_cast<std::size_t>(s.count_v));
  } else {
    std::uint32_t kind = key(i);
    for (std::uint32_t k : {K_BEZIER_SURFACE, K_UNIFORM_SURFACE, K_QUASI_UNIFORM_SURFACE})
      if (has(i, k)) kind = k;
    s.knots_u = default_knots(kind, s.degree_u, s.count_u);
    s.knots_v = default_knots(kind, s.degree_v, s.count_v);
    if (s.knots_u.size() != static_cast<std::size_t>(s.count_u + s.degree_u + 1) ||
        s.knots_v.size() != static_cast<std::size_t>(s.count_v + s.degree_v + 1))
      fail(i, "poles do not fit the degree");
  }
  const Args weights = args(i, K_RATIONAL_B_SPLINE_SURFACE);
  if (weights.size()) {
    const Args w = list(i, weights.at(0));
    const Value* q = w.first();
    bool all_one = true;
    for (std::uint32_t r = 0; r < w.size(); ++r, q = next(q)) {
      const Args line = list(i, q);
      for (std::uint32_t k = 0; k < line.size(); ++k) {
        s.weights.push_back(real(i, line.first() + k));
        if (!(s.weights.back() > 0)) fail(i, "a weight that is not positive");
        all_one = all_one && std::abs(s.weights.back() - s.weights.front()) < 1e-14;
      }
    }
    if (s.weights.size() != s.poles.size()) fail(i, "weights and poles differ in number");
    if (all_one) s.weights.clear();
  }
  return {s};
}

Surface Binder::surface(std::int64_t id, bool& is_reversed, int depth) const {
  const Instance& i = instance(id);
  if (depth > 16) fail(i, "surfaces refer to each other in a circle");
  const Args a = args(i);
  switch (key(i)) {
    case K_PLANE:
      return {PlaneSurface{placement(reference(i, a.at(1)))}};
    case K_CYLINDRICAL_SURFACE: {
      const CylinderSurface s{placement(reference(i, a.at(1))), length(i, a.at(2))};
      if (!(s.radius_mm > 0)) fail(i, "a radius that is not positive");
      return {s};
    }
    case K_CONICAL_SURFACE: {
      ConeSurface s{placement(reference(i, a.at(1))), length(i, a.at(2)), real(i, a.at(3)) * units.angle_rad};
      if (s.radius_mm > 0 && std::abs(s.half_angle_rad) <= 1e-9) return {CylinderSurface{s.at, s.radius_mm}};
      if (s.radius_mm < 0 || !(std::abs(s.half_angle_rad) > 1e-9 && std::abs(s.half_angle_rad) < kPi / 2 - 1e-9))
        fail(i, "a cone needs a radius of at least 0 and a half angle between 0 and 90 degrees");
      return {s};
    }
    case K_SPHERICAL_SURFACE: {
      const SphereSurface s{placement(reference(i, a.at(1))), length(i, a.at(2))};
      if (!(s.radius_mm > 0)) fail(i, "a radius that is not positive");
      return {s};
    }
    case K_TOROIDAL_SURFACE:
    case K_DEGENERATE_TOROIDAL_SURFACE: {
      TorusSurface s{placement(reference(i, a.at(1))), length(i, a.at(2)), length(i, a.at(3)), false};
      if (!(s.major_mm >= 0 && s.minor_mm > 0)) fail(i, "a torus radius that is not positive");
      if (key(i) == K_DEGENERATE_TOROIDAL_SURFACE) s.is_inner_lobe = !is_true(i, a.at(4));
      return {s};
    }
    case K_SURFACE_OF_LINEAR_EXTRUSION: {
      bool curve_reversed = false;
      const Instance& v = instance(reference(i, a.at(2)));
      const ExtrusionSurface s{curve(reference(i, a.at(1)), curve_reversed, depth + 1), direction(reference(v, args(v, K_VECTOR).at(1)))};
      if (curve_reversed) is_reversed = !is_reversed;
      return {s};
    }
    case K_SURFACE_OF_REVOLUTION: {
      bool curve_reversed = false;
      RevolutionSurface s;
      const std::int64_t profile = reference(i, a.at(1));
      s.profile = curve(profile, curve_reversed, depth + 1);
      const Placement axis = placement(reference(i, a.at(2)));
      s.axis_point = axis.origin, s.axis = axis.z;
      if (has(instance(profile), K_TRIMMED_CURVE)) {  // where the whole curve would cross the axis only the trimmed part is meant
        const BSplineCurve part = bounded_curve(profile, depth + 1);
        std::vector<Vec3> on;
        for (int k = 0; k <= 4; ++k) on.push_back(evaluate(Curve{part}, 0.25 * k).p);
        if (profile_beside_axis(s, on)) s.profile = {part}, curve_reversed = false;
      }
      if (curve_reversed) is_reversed = !is_reversed;
      return {s};
    }
    case K_OFFSET_SURFACE: {
      OffsetSurface s;
      s.basis = std::make_shared<Surface>(surface(reference(i, a.at(1)), is_reversed, depth + 1));
      s.distance_mm = length(i, a.at(2));
      return {s};
    }
    case K_RECTANGULAR_TRIMMED_SURFACE: {
      // (name, basis, u1, u2, v1, v2, usense, vsense): the trim is the loop's business, the senses turn the normal.
      if (is_true(i, a.at(6)) != is_true(i, a.at(7))) is_reversed = !is_reversed;
      return surface(reference(i, a.at(1)), is_reversed, depth + 1);
    }
    case K_SURFACE_REPLICA: {
      bool mirrored = false;
      const Surface s =
          transformed(transformation(reference(i, a.at(2))), surface(reference(i, a.at(1)), is_reversed, depth + 1), mirrored);
      if (mirrored) is_reversed = !is_reversed;
      return s;
    }
    case K_CURVE_BOUNDED_SURFACE:
      return surface(reference(i, a.at(1)), is_reversed, depth + 1);
    default:
      break;
  }
  if (has(i, K_B_SPLINE_SURFACE) || has(i, K_B_SPLINE_SURFACE_WITH_KNOTS) || has(i, K_BEZIER_SURFACE) || has(i, K_UNIFORM_SURFACE) ||
      has(i, K_QUASI_UNIFORM_SURFACE))
    return bspline_surface(i);
  fail(i, "a kind of surface that is not known");
}

}  // namespace asbuilt::step
