// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/bind.hpp"

#include <cmath>

namespace asbuilt::step {

using namespace p21;

std::string StepFault::text() const {
  std::string s = std::to_string(line) + ": ";
  if (id > 0) s += "#" + std::to_string(id) + " ";
  if (!entity.empty()) s += entity + ": ";
  return s + what;
}

const Instance& Binder::instance(std::int64_t id) const {
  const Instance* i = file_.find(id);
  if (!i) throw StepFault{0, id, "", "is referred to and not in the file"};
  return *i;
}

bool Binder::has(const Instance& i, std::uint32_t keyword) const {
  for (std::uint32_t r = 0; r < i.record_count; ++r)
    if (file_.records[i.record + r].keyword == keyword) return true;
  return false;
}

Args Binder::args(const Instance& i, std::uint32_t keyword) const {
  for (std::uint32_t r = 0; r < i.record_count; ++r) {
    const Record& q = file_.records[i.record + r];
    if (q.keyword == keyword) return {file_.values.data() + q.first, q.count};
  }
  return {};
}

Args Binder::args(const Instance& i) const {
  if (i.record_count == 0) return {};
  const Record& q = file_.records[i.record];
  return {file_.values.data() + q.first, q.count};
}

void Binder::fail(const Instance& i, std::string what) const {
  throw StepFault{i.line, i.id, i.record_count ? std::string(file_.keyword_name(key(i))) : std::string(), std::move(what)};
}

double Binder::real(const Instance& i, const Value* v) const {
  if (v && v->kind == Kind::typed && v->inside >= 2) v += 2;  // LENGTH_MEASURE(1.)
  if (v && v->kind == Kind::real && std::isfinite(v->real)) return v->real;
  if (v && v->kind == Kind::integer) return static_cast<double>(v->integer);
  fail(i, "a number is missing");
}

double Binder::length(const Instance& i, const Value* v) const {
  const double x = real(i, v) * units.length_mm;
  if (!(std::abs(x) <= 1e9)) fail(i, "a length beyond 1e9 mm");
  return x;
}

std::int64_t Binder::integer(const Instance& i, const Value* v) const {
  if (v && v->kind == Kind::integer) return v->integer;
  if (v && v->kind == Kind::real && v->real == std::floor(v->real) && std::abs(v->real) < 1e15) return static_cast<std::int64_t>(v->real);
  fail(i, "an integer is missing");
}

std::int64_t Binder::reference(const Instance& i, const Value* v) const {
  if (v && v->kind == Kind::reference) return v->integer;
  fail(i, "a reference is missing");
}

std::string_view Binder::enumeration(const Value* v) const {
  if (!v || v->kind != Kind::enumeration) return {};
  return file_.bytes.substr(v->offset, v->size);
}

bool Binder::is_true(const Instance& i, const Value* v) const {
  const std::string_view e = enumeration(v);
  if (e == "T" || e == "TRUE" || e == "t") return true;
  if (e == "F" || e == "FALSE" || e == "f") return false;
  fail(i, "a logical value is missing");
}

std::string Binder::text(const Value* v) const {
  if (v && v->kind == Kind::typed && v->inside >= 2) v += 2;
  return v && v->kind == Kind::string ? decoded(file_.bytes.substr(v->offset, v->size)) : std::string();
}

Args Binder::list(const Instance& i, const Value* v) const {
  if (!v || v->kind != Kind::list) fail(i, "a list is missing");
  return {v + 1, v->size};
}

std::vector<std::int64_t> Binder::references(const Instance& i, const Value* v) const {
  const Args a = list(i, v);
  std::vector<std::int64_t> out;
  out.reserve(a.size());
  const Value* q = a.first();
  for (std::uint32_t k = 0; k < a.size(); ++k, q = next(q))
    if (q->kind == Kind::reference) out.push_back(q->integer);
  return out;
}

Vec3 Binder::point(std::int64_t id) const {
  const Instance& i = instance(id);
  const Args a = args(i, K_CARTESIAN_POINT);
  if (a.size() < 2) fail(i, "a CARTESIAN_POINT is expected here");
  const Args c = list(i, a.at(1));
  if (c.size() < 1 || c.size() > 3) fail(i, "a point with other than 1 to 3 coordinates");
  Vec3 p = Vec3::Zero();
  for (std::uint32_t k = 0; k < c.size(); ++k) p[static_cast<int>(k)] = length(i, c.first() + k);
  return p;
}

Vec3 Binder::direction(std::int64_t id) const {
  const Instance& i = instance(id);
  const Args a = args(i, K_DIRECTION);
  if (a.size() < 2) fail(i, "a DIRECTION is expected here");
  const Args c = list(i, a.at(1));
  if (c.size() < 1 || c.size() > 3) fail(i, "a direction with other than 1 to 3 ratios");
  Vec3 d = Vec3::Zero();
  for (std::uint32_t k = 0; k < c.size(); ++k) d[static_cast<int>(k)] = real(i, c.first() + k);
  const double m = d.cwiseAbs().maxCoeff();
  if (!(m > 0)) fail(i, "a direction of length zero");
  return (d / m).normalized();
}

Placement Binder::placement(std::int64_t id) const {
  const Instance& i = instance(id);
  Placement p;
  Args a = args(i, K_AXIS2_PLACEMENT_3D);
  if (a.size() == 0) {
    a = args(i, K_AXIS1_PLACEMENT);
    if (a.size() < 2) fail(i, "a placement is expected here");
  }
  p.origin = point(reference(i, a.at(1)));
  if (a.at(2) && a.at(2)->kind == Kind::reference) p.z = direction(a.at(2)->integer);
  Vec3 x = Vec3::UnitX();
  bool has_x = false;
  if (a.at(3) && a.at(3)->kind == Kind::reference) x = direction(a.at(3)->integer), has_x = true;
  Vec3 side = x - p.z * p.z.dot(x);
  if (side.norm() < 1e-9) {  // parallel: the standard's default, then y
    if (has_x) x = Vec3::UnitX(), side = x - p.z * p.z.dot(x);
    if (side.norm() < 1e-9) x = Vec3::UnitY(), side = x - p.z * p.z.dot(x);
  }
  p.x = side.normalized();
  p.y = p.z.cross(p.x);
  return p;
}

std::vector<double> Binder::knots(const Instance& i, const Value* multiplicities, const Value* values, int degree,
                                  std::size_t poles) const {
  const Args m = list(i, multiplicities), k = list(i, values);
  if (m.size() != k.size() || m.size() < 2) fail(i, "knots and multiplicities differ in number");
  std::vector<double> out;
  const std::size_t want = poles + static_cast<std::size_t>(degree) + 1;
  double last = -1e308;
  for (std::uint32_t j = 0; j < m.size(); ++j) {
    const std::int64_t n = integer(i, m.first() + j);
    const double t = real(i, k.first() + j);
    if (n < 1 || n > degree + 1 || t < last) fail(i, "knots must rise and have multiplicities of 1 to degree + 1");
    if (out.size() + static_cast<std::size_t>(n) > want) fail(i, "more knots than poles + degree + 1");
    out.insert(out.end(), static_cast<std::size_t>(n), t);
    last = t;
  }
  if (out.size() != want) fail(i, "fewer knots than poles + degree + 1");
  if (!(out[poles] > out[static_cast<std::size_t>(degree)])) fail(i, "an empty knot range");
  return out;
}

namespace {

/// Knots of BEZIER, UNIFORM, QUASI_UNIFORM curves by the rule of ISO 10303-42.
std::vector<double> default_knots(std::uint32_t kind, int degree, int poles) {
  std::vector<double> k;
  const int n = poles + degree + 1;
  if (kind == K_UNIFORM_CURVE || kind == K_UNIFORM_SURFACE) {
    for (int j = 0; j < n; ++j) k.push_back(j - degree);
  } else if (kind == K_BEZIER_CURVE || kind == K_BEZIER_SURFACE) {
    const int spans = std::max(1, (poles - 1) / degree);
    k.push_back(0);
    for (int j = 0; j <= spans; ++j) k.insert(k.end(), static_cast<std::size_t>(degree), j);
    k.push_back(spans);
  } else {
    for (int j = 0; j <= degree; ++j) k.push_back(0);
    for (int j = 1; j < poles - degree; ++j) k.push_back(j);
    for (int j = 0; j <= degree; ++j) k.push_back(poles - degree);
  }
  return k;
}

}  // namespace

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
    case K_INTERSECTION_CURVE: return curve(reference(i, a.at(1)), is_reversed, depth + 1);
    case K_TRIMMED_CURVE: {
      if (!is_true(i, a.at(4))) is_reversed = !is_reversed;
      return curve(reference(i, a.at(1)), is_reversed, depth + 1);
    }
    default: break;
  }
  if (has(i, K_B_SPLINE_CURVE) || has(i, K_B_SPLINE_CURVE_WITH_KNOTS) || has(i, K_BEZIER_CURVE) || has(i, K_UNIFORM_CURVE) ||
      has(i, K_QUASI_UNIFORM_CURVE))
    return bspline_curve(i);
  if (has(i, K_SURFACE_CURVE) || has(i, K_SEAM_CURVE)) {  // complex form: SURFACE_CURVE(curve_3d, ..) without the name
    const Args s = args(i, K_SURFACE_CURVE);
    if (s.size()) return curve(reference(i, s.at(0)), is_reversed, depth + 1);
  }
  fail(i, "a kind of curve that is not known");
}

Surface Binder::surface(std::int64_t id, bool& is_reversed, int depth) const {
  const Instance& i = instance(id);
  if (depth > 16) fail(i, "surfaces refer to each other in a circle");
  const Args a = args(i);
  switch (key(i)) {
    case K_PLANE: return {PlaneSurface{placement(reference(i, a.at(1)))}};
    case K_CYLINDRICAL_SURFACE: {
      const CylinderSurface s{placement(reference(i, a.at(1))), length(i, a.at(2))};
      if (!(s.radius_mm > 0)) fail(i, "a radius that is not positive");
      return {s};
    }
    case K_CONICAL_SURFACE: {
      ConeSurface s{placement(reference(i, a.at(1))), length(i, a.at(2)), real(i, a.at(3)) * units.angle_rad};
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
      return {ExtrusionSurface{curve(reference(i, a.at(1)), curve_reversed, depth + 1), direction(reference(v, args(v, K_VECTOR).at(1)))}};
    }
    case K_SURFACE_OF_REVOLUTION: {
      bool curve_reversed = false;
      RevolutionSurface s;
      s.profile = curve(reference(i, a.at(1)), curve_reversed, depth + 1);
      const Placement axis = placement(reference(i, a.at(2)));
      s.axis_point = axis.origin, s.axis = axis.z;
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
    case K_CURVE_BOUNDED_SURFACE: return surface(reference(i, a.at(1)), is_reversed, depth + 1);
    default: break;
  }
  if (has(i, K_B_SPLINE_SURFACE) || has(i, K_B_SPLINE_SURFACE_WITH_KNOTS) || has(i, K_BEZIER_SURFACE) || has(i, K_UNIFORM_SURFACE) ||
      has(i, K_QUASI_UNIFORM_SURFACE))
    return bspline_surface(i);
  fail(i, "a kind of surface that is not known");
}

}  // namespace asbuilt::step
