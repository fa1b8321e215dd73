// SPDX-License-Identifier: GPL-3.0-or-later
// Parameter domains: borders, periods and poles, all found by evaluation (flags in files are unreliable).
#include <algorithm>
#include <cmath>

#include "planner/geom/bspline.hpp"
#include "planner/geom/surface.hpp"

namespace asbuilt {
namespace {

SurfaceDomain bspline_domain(const Surface& surface, const BSplineSurface& s) {
  SurfaceDomain d;
  const KnotRange ru = knot_range(s.knots_u, s.degree_u), rv = knot_range(s.knots_v, s.degree_v);
  d.u0 = ru.t0, d.u1 = ru.t1, d.v0 = rv.t0, d.v1 = rv.t1;
  double size = 0;
  for (const Vec3& p : s.poles) size = std::max(size, (p - s.poles.front()).norm());
  const double tolerance = 1e-6 * size;
  constexpr int n = 8;
  double gap_u = 0, gap_v = 0, ext[4] = {0, 0, 0, 0};
  Vec3 first[4];
  for (int i = 0; i <= n; ++i) {
    const double u = d.u0 + (d.u1 - d.u0) * i / n, v = d.v0 + (d.v1 - d.v0) * i / n;
    const Vec3 p[4] = {evaluate_jet(surface, d.u0, v).p, evaluate_jet(surface, d.u1, v).p, evaluate_jet(surface, u, d.v0).p,
                       evaluate_jet(surface, u, d.v1).p};
    gap_u = std::max(gap_u, (p[0] - p[1]).norm());
    gap_v = std::max(gap_v, (p[2] - p[3]).norm());
    for (int k = 0; k < 4; ++k) {
      if (i == 0) first[k] = p[k];
      ext[k] = std::max(ext[k], (p[k] - first[k]).norm());
    }
  }
  d.is_pole_u0 = ext[0] <= tolerance, d.is_pole_u1 = ext[1] <= tolerance;
  d.is_pole_v0 = ext[2] <= tolerance, d.is_pole_v1 = ext[3] <= tolerance;
  d.is_periodic_u = gap_u <= tolerance && !(d.is_pole_u0 && d.is_pole_u1);
  d.is_periodic_v = gap_v <= tolerance && !(d.is_pole_v0 && d.is_pole_v1);
  d.is_bounded_u = !d.is_periodic_u, d.is_bounded_v = !d.is_periodic_v;
  return d;
}

}  // namespace

SurfaceDomain domain(const Surface& s) {
  SurfaceDomain d;
  if (std::holds_alternative<CylinderSurface>(s.shape)) {
    d.u0 = 0, d.u1 = 2 * kPi, d.is_periodic_u = true;
  } else if (const auto* c = std::get_if<ConeSurface>(&s.shape)) {
    d.u0 = 0, d.u1 = 2 * kPi, d.is_periodic_u = true;
    const double k = std::tan(c->half_angle_rad);
    if (k > 0) d.v0 = -c->radius_mm / k, d.is_pole_v0 = true;
    if (k < 0) d.v1 = -c->radius_mm / k, d.is_pole_v1 = true;
  } else if (std::holds_alternative<SphereSurface>(s.shape)) {
    d = {0, 2 * kPi, -kPi / 2, kPi / 2, false, true, true, false, false, false, true, true};
  } else if (const auto* t = std::get_if<TorusSurface>(&s.shape)) {
    d.u0 = 0, d.u1 = 2 * kPi, d.is_periodic_u = true;
    if (t->major_mm < t->minor_mm) {  // spindle: the outer lobe around v = 0, the inner one around v = pi
      const double v_axis = std::acos(std::clamp(-t->major_mm / t->minor_mm, -1.0, 1.0));
      d.v0 = t->is_inner_lobe ? v_axis : -v_axis;
      d.v1 = t->is_inner_lobe ? 2 * kPi - v_axis : v_axis;
      d.is_bounded_v = d.is_pole_v0 = d.is_pole_v1 = true;
    } else {
      d.v0 = 0, d.v1 = 2 * kPi, d.is_periodic_v = true;
    }
  } else if (const auto* b = std::get_if<BSplineSurface>(&s.shape)) {
    d = bspline_domain(s, *b);
  } else if (const auto* r = std::get_if<RevolutionSurface>(&s.shape)) {
    const CurveDomain c = domain(r->profile);
    d.u0 = 0, d.u1 = 2 * kPi, d.is_periodic_u = true;
    d.v0 = c.t0, d.v1 = c.t1, d.is_bounded_v = c.is_bounded && !c.is_closed, d.is_periodic_v = c.is_closed;
    if (c.is_bounded) {
      const auto rho = [&](double t) {
        const Vec3 a = evaluate(r->profile, t).p - r->axis_point;
        return (a - r->axis * r->axis.dot(a)).norm();
      };
      double size = 0;
      for (int i = 0; i <= 8; ++i) size = std::max(size, rho(c.t0 + (c.t1 - c.t0) * i / 8));
      d.is_pole_v0 = rho(c.t0) <= 1e-7 * size, d.is_pole_v1 = rho(c.t1) <= 1e-7 * size;
      if (d.is_pole_v0 || d.is_pole_v1) d.is_periodic_v = false, d.is_bounded_v = true;
    }
  } else if (const auto* e = std::get_if<ExtrusionSurface>(&s.shape)) {
    const CurveDomain c = domain(e->profile);
    d.u0 = c.t0, d.u1 = c.t1, d.is_bounded_u = c.is_bounded && !c.is_closed, d.is_periodic_u = c.is_closed;
  } else if (const auto* o = std::get_if<OffsetSurface>(&s.shape)) {
    if (o->basis) d = domain(*o->basis);
  }
  return d;
}

}  // namespace asbuilt
