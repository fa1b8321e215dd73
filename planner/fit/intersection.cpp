// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/intersection.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::fitting {

namespace {

constexpr double kParallelSin = 1e-9;

Placement placement(const Vec3& origin, const Vec3& z, const Vec3& x_hint) {
  const Mat3 m = quat_from_z(z, x_hint).toRotationMatrix();
  return {origin, m.col(0), m.col(1), m.col(2)};
}

Curve circle(const Vec3& center, const Vec3& axis, const Vec3& x_hint, double radius_mm) {
  Curve c;
  c.shape = CircleCurve{placement(center, axis, x_hint), radius_mm};
  return c;
}

std::vector<Curve> plane_plane(const PlaneSurface& a, const PlaneSurface& b) {
  const Vec3 n_1 = a.at.z, n_2 = b.at.z, t = n_1.cross(n_2);
  const double t2 = t.squaredNorm();
  if (t2 < kParallelSin * kParallelSin) return {};
  const Vec3 p = (n_1.dot(a.at.origin) * n_2.cross(t) + n_2.dot(b.at.origin) * t.cross(n_1)) / t2;
  Curve c;
  c.shape = LineCurve{p, t.normalized()};
  return {c};
}

std::vector<Curve> plane_cylinder(const PlaneSurface& plane, const CylinderSurface& cylinder) {
  const Vec3 n = plane.at.z, a = cylinder.at.z;
  const double r = cylinder.radius_mm, along = n.dot(a), height = n.dot(plane.at.origin - cylinder.at.origin);
  const double across = a.cross(n).norm();
  if (std::abs(along) < std::sin(rad_from_deg(1e-4))) {  // axis in the plane's direction: none, one or two lines
    if (std::abs(height) > r) return {};
    const Vec3 foot = cylinder.at.origin + n * height, side = n.cross(a).normalized();
    const double half = std::sqrt(std::max(0.0, r * r - height * height));
    std::vector<Curve> out(half > 0 ? 2 : 1);
    out[0].shape = LineCurve{foot + side * half, a};
    if (half > 0) out[1].shape = LineCurve{foot - side * half, a};
    return out;
  }
  const Vec3 center = cylinder.at.origin + a * (height / along);
  if (across < kParallelSin) return {circle(center, a, cylinder.at.x, r)};
  Curve c;  // long half axis along the projection of the cylinder's axis on the plane
  c.shape = EllipseCurve{placement(center, n, a - n * along), r / std::abs(along), r};
  return {c};
}

std::vector<Curve> plane_sphere(const PlaneSurface& plane, const SphereSurface& sphere) {
  const double h = plane.at.z.dot(sphere.at.origin - plane.at.origin);
  if (std::abs(h) >= sphere.radius_mm) return {};
  return {circle(sphere.at.origin - plane.at.z * h, plane.at.z, plane.at.x, std::sqrt(sphere.radius_mm * sphere.radius_mm - h * h))};
}

/// Profile of a surface of revolution as rho(h): value and whether it exists there.
struct Revolved {
  Placement at;
  int kind;  // 0 plane, 1 cylinder, 2 cone, 3 sphere
  double radius = 0, slope = 0;
};
std::optional<Revolved> revolved(const Surface& s) {
  if (const auto* p = std::get_if<PlaneSurface>(&s.shape)) return Revolved{p->at, 0};
  if (const auto* c = std::get_if<CylinderSurface>(&s.shape)) return Revolved{c->at, 1, c->radius_mm};
  if (const auto* k = std::get_if<ConeSurface>(&s.shape)) return Revolved{k->at, 2, k->radius_mm, std::tan(k->half_angle_rad)};
  if (const auto* b = std::get_if<SphereSurface>(&s.shape)) return Revolved{b->at, 3, b->radius_mm};
  return std::nullopt;
}

bool is_on_axis(const Placement& axis, const Vec3& p) { return (p - axis.origin).cross(axis.z).norm() < 1e-7; }

/// Both about the axis of `a` (not both planes): circles where the profiles meet.
std::optional<std::vector<Curve>> coaxial(const Revolved& a, const Revolved& b) {
  const bool b_free = b.kind == 3;  // a sphere has every axis through its centre
  if (!b_free && a.at.z.cross(b.at.z).norm() > 1e-9) return std::nullopt;
  if (b.kind != 0 && !is_on_axis(a.at, b.at.origin)) return std::nullopt;
  const Vec3 z = a.at.z;
  const double shift = z.dot(b.at.origin - a.at.origin), sign = b_free ? 1.0 : (z.dot(b.at.z) < 0 ? -1.0 : 1.0);
  std::vector<Curve> out;
  const auto put = [&](double h, double rho) {
    if (rho > 0) out.push_back(circle(a.at.origin + z * h, z, a.at.x, rho));
  };
  const auto line_of = [&](const Revolved& s, double offset, double direction) {  // rho = m h + q along z of a
    const double m = s.kind == 2 ? s.slope * direction : 0.0;
    return std::pair<double, double>(m, s.radius - m * offset);
  };
  if (a.kind == 3) return std::nullopt;
  const auto [m_a, q_a] = line_of(a, 0, 1);
  if (b.kind == 0) {
    put(shift, m_a * shift + q_a);
  } else if (b.kind == 3) {
    // (m h + q)^2 + (h - shift)^2 = r^2
    const double aa = 1 + m_a * m_a, bb = m_a * q_a - shift, cc = q_a * q_a + shift * shift - b.radius * b.radius;
    const double disc = bb * bb - aa * cc;
    if (disc > 0)
      for (const double s : {-1.0, 1.0}) {
        const double h = (-bb + s * std::sqrt(disc)) / aa;
        put(h, m_a * h + q_a);
      }
  } else {
    const auto [m_b, q_b] = line_of(b, shift, sign);
    if (std::abs(m_a - m_b) < 1e-12) return out;
    const double h = (q_b - q_a) / (m_a - m_b);
    put(h, m_a * h + q_a);
  }
  return out;
}

}  // namespace

std::optional<std::vector<Curve>> closed_form_intersection(const Surface& a, const Surface& b) {
  const auto* plane_a = std::get_if<PlaneSurface>(&a.shape);
  const auto* plane_b = std::get_if<PlaneSurface>(&b.shape);
  if (plane_a && plane_b) return plane_plane(*plane_a, *plane_b);
  if (plane_b && !plane_a) return closed_form_intersection(b, a);
  if (plane_a) {
    if (const auto* c = std::get_if<CylinderSurface>(&b.shape)) return plane_cylinder(*plane_a, *c);
    if (const auto* s = std::get_if<SphereSurface>(&b.shape)) return plane_sphere(*plane_a, *s);
    if (std::holds_alternative<ConeSurface>(b.shape)) return coaxial(*revolved(b), *revolved(a));
    return std::nullopt;
  }
  const auto ra = revolved(a), rb = revolved(b);
  if (!ra || !rb) return std::nullopt;
  if (ra->kind == 3 && rb->kind != 3) return coaxial(*rb, *ra);
  return coaxial(*ra, *rb);
}

}  // namespace asbuilt::fitting
