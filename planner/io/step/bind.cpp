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
  if (has(i, K_AXIS2_PLACEMENT_2D)) {  // in the parameters of a surface
    const Args flat = args(i, K_AXIS2_PLACEMENT_2D);
    p.origin = point(reference(i, flat.at(1)));
    if (flat.at(2) && flat.at(2)->kind == Kind::reference) p.x = direction(flat.at(2)->integer);
    p.y = p.z.cross(p.x);
    return p;
  }
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

Eigen::Affine3d Binder::transformation(std::int64_t id) const {
  const Instance& i = instance(id);
  // (name, [name, description,] axis1, axis2, local_origin, scale, axis3); the parts of a complex instance stand apart.
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  const Args own = args(i, K_CARTESIAN_TRANSFORMATION_OPERATOR_3D);
  const Args base = i.record_count > 1 ? args(i, K_CARTESIAN_TRANSFORMATION_OPERATOR) : own;
  if (base.size() < 4) fail(i, "a transformation is expected here");
  std::uint32_t o = 0;
  while (o < base.size() && base.at(o)->kind == Kind::string) ++o;
  const auto dir = [&](const Value* v, const Vec3& standard) { return v && v->kind == Kind::reference ? direction(v->integer) : standard; };
  const Vec3 z = dir(i.record_count > 1 ? own.at(0) : base.at(o + 4), Vec3::UnitZ());
  Vec3 x = dir(base.at(o), Vec3::UnitX());
  x -= z * z.dot(x);
  if (x.norm() < 1e-9) x = std::abs(z.x()) < 0.9 ? Vec3(Vec3::UnitX() - z * z.x()) : Vec3(Vec3::UnitY() - z * z.y());
  x.normalize();
  Vec3 y = z.cross(x);
  if (y.dot(dir(base.at(o + 1), y)) < 0) y = -y;
  double scale = 1;
  if (base.at(o + 3) && (base.at(o + 3)->kind == Kind::real || base.at(o + 3)->kind == Kind::integer)) scale = real(i, base.at(o + 3));
  if (!(scale > 1e-6 && scale < 1e6)) fail(i, "a scale outside 1e-6 to 1e6");
  T.linear().col(0) = scale * x, T.linear().col(1) = scale * y, T.linear().col(2) = scale * z;
  T.translation() = point(reference(i, base.at(o + 2)));
  return T;
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

}  // namespace asbuilt::step
