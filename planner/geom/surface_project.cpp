// SPDX-License-Identifier: GPL-3.0-or-later
// Nearest point on a surface: closed forms for plane, cylinder, cone, sphere, torus; one-dimensional search for extrusion and
// revolution; Newton from a grid (or the caller's seed) for B-splines; nearest triangle for patches.
#include <algorithm>
#include <cmath>

#include "planner/geom/bspline.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/geom/surface.hpp"

namespace asbuilt {
namespace {

double nearest_turn(double a, const std::optional<Vec2>& seed, int axis, double period = 2 * kPi) {
  if (!seed) return a - period * std::floor(a / period);
  return a + period * std::round(((*seed)[axis] - a) / period);
}

/// Minimum over t of |r(t)|^2 for a planar residual r with derivative; Gauss-Newton from the best of the seeds.
template <class F>
double search_1d(const CurveDomain& d, const std::vector<double>& seeds, const F& residual) {
  double best_t = seeds.front(), best = 1e300;
  std::vector<std::pair<double, double>> order;
  for (double t : seeds) {
    Vec2 dr;
    order.emplace_back(residual(t, dr).squaredNorm(), t);
  }
  std::sort(order.begin(), order.end());
  for (size_t k = 0; k < std::min<size_t>(order.size(), 3); ++k) {
    double t = order[k].second;
    for (int i = 0; i < 30; ++i) {
      Vec2 dr;
      const Vec2 r = residual(t, dr);
      const double h = dr.squaredNorm();
      if (r.squaredNorm() < best) best = r.squaredNorm(), best_t = t;
      if (h <= 0) break;
      double step = -r.dot(dr) / h;
      if (d.is_bounded) step = std::clamp(step, -0.2 * d.period(), 0.2 * d.period());
      double next = t + step;
      if (d.is_bounded && !d.is_closed) next = std::clamp(next, d.t0, d.t1);
      if (std::abs(next - t) * std::sqrt(h) < 1e-11) break;
      t = next;
    }
    Vec2 dr;
    const double f = residual(t, dr).squaredNorm();
    if (f < best) best = f, best_t = t;
    if (best < 1e-12) break;
  }
  return best_t;
}

std::vector<double> curve_seeds(const Curve& c, const CurveDomain& d) {
  std::vector<double> s;
  if (const auto* b = std::get_if<BSplineCurve>(&c.shape)) {
    for (size_t k = b->degree; k + 1 < b->knots.size() - b->degree; ++k) {
      if (b->knots[k + 1] <= b->knots[k]) continue;
      for (int j = 0; j < 4; ++j) s.push_back(b->knots[k] + (b->knots[k + 1] - b->knots[k]) * j / 4);
    }
    s.push_back(d.t1);
  } else if (d.is_bounded) {
    for (int j = 0; j <= 24; ++j) s.push_back(d.t0 + d.period() * j / 24);
  } else if (std::holds_alternative<LineCurve>(c.shape)) {
    s = {0};
  } else {
    for (int j = -8; j <= 8; ++j) s.push_back(j * 0.5);
  }
  return s;
}

/// Where the nearest point lies beside a pole, along the border's own direction nothing moves: the direction away from the pole is
/// chosen among sixteen. False: none leads nearer.
bool leave_pole(const Surface& s, const SurfaceDomain& d, const Vec3& p, int axis, Vec2& q) {
  const double t0 = axis == 1 ? d.u0 : d.v0, t1 = axis == 1 ? d.u1 : d.v1, span = axis == 1 ? d.v1 - d.v0 : d.u1 - d.u0;
  const bool is_low = axis == 1 ? q.y() <= 0.5 * (d.v0 + d.v1) : q.x() <= 0.5 * (d.u0 + d.u1);
  double best = 0, step = 0, at = 0;
  for (int k = 0; k < 16; ++k) {
    const double t = t0 + (t1 - t0) * (k + 0.5) / 16;
    const SurfaceJet j = axis == 1 ? evaluate_jet(s, t, q.y(), 1) : evaluate_jet(s, q.x(), t, 1);
    const Vec3 away = (is_low ? 1.0 : -1.0) * (axis == 1 ? j.dv : j.du);
    const double speed = away.norm(), along = speed > 0 ? (p - j.p).dot(away) / speed : 0;
    if (along > best) best = along, step = std::min(along / speed, 0.2 * span), at = t;
  }
  if (!(step > 0)) return false;
  if (axis == 1)
    q = {at, q.y() + (is_low ? step : -step)};
  else
    q = {q.x() + (is_low ? step : -step), at};
  return true;
}

Vec2 newton_uv(const Surface& s, const SurfaceDomain& d, const Vec3& p, Vec2 q, double& distance_2) {
  const double span_u = d.u1 - d.u0, span_v = d.v1 - d.v0;
  Vec2 best = q;
  distance_2 = 1e300;
  double damping = 0;
  const bool has_poles = d.is_pole_u0 || d.is_pole_u1 || d.is_pole_v0 || d.is_pole_v1;
  const auto pole_axis = [&](const Vec2& w) {  // 0 or 1: w lies on a border in u or v that is one point; -1: it does not
    if ((d.is_pole_v0 && w.y() <= d.v0) || (d.is_pole_v1 && w.y() >= d.v1)) return 1;
    return (d.is_pole_u0 && w.x() <= d.u0) || (d.is_pole_u1 && w.x() >= d.u1) ? 0 : -1;
  };
  if (has_poles)
    if (const int axis = pole_axis(q); axis >= 0) {
      distance_2 = (evaluate_jet(s, q.x(), q.y(), 1).p - p).squaredNorm();
      if (distance_2 < 1e-20 || !leave_pole(s, d, p, axis, q)) return best;
    }
  for (int i = 0; i < (has_poles ? 40 : 25); ++i) {
    double uu = q.x(), vv = q.y();
    if (d.is_periodic_u) uu = d.u0 + std::fmod(std::fmod(uu - d.u0, span_u) + span_u, span_u);
    if (d.is_periodic_v) vv = d.v0 + std::fmod(std::fmod(vv - d.v0, span_v) + span_v, span_v);
    const SurfaceJet j = evaluate_jet(s, uu, vv);
    const Vec3 r = j.p - p;
    const double f = r.squaredNorm();
    if (f < distance_2) {
      distance_2 = f, best = q;
      damping *= 0.1;
    } else {
      damping = std::max(10 * damping, 1e-3);
    }
    const double gu = r.dot(j.du), gv = r.dot(j.dv);
    const double a0 = j.du.squaredNorm(), c0 = j.dv.squaredNorm(), b0 = j.du.dot(j.dv);
    double a = a0 + r.dot(j.duu), b = b0 + r.dot(j.duv), c = c0 + r.dot(j.dvv);
    if (a <= 0.1 * a0 || c <= 0.1 * c0 || a * c - b * b <= 0.01 * (a0 * c0)) a = a0, b = b0, c = c0;
    a += damping * a0 + 1e-300, c += damping * c0 + 1e-300;
    double du = 0, dv = 0;
    const double det = a * c - b * b;
    if (det > 1e-14 * a * c) {
      du = -(gu * c - gv * b) / det, dv = -(gv * a - gu * b) / det;
    } else if (a > c) {
      du = -gu / a;
    } else if (c > 0) {
      dv = -gv / c;
    }
    du = std::clamp(du, -0.2 * span_u, 0.2 * span_u), dv = std::clamp(dv, -0.2 * span_v, 0.2 * span_v);
    Vec2 next = q + Vec2(du, dv);
    const bool hit_u = !d.is_periodic_u && (next.x() <= d.u0 || next.x() >= d.u1);
    const bool hit_v = !d.is_periodic_v && (next.y() <= d.v0 || next.y() >= d.v1);
    if (hit_u) {  // stay on the border and take the best step along it
      next.x() = std::clamp(next.x(), d.u0, d.u1);
      if (c > 0) next.y() = q.y() + std::clamp(-(gv + b * (next.x() - q.x())) / c, -0.2 * span_v, 0.2 * span_v);
    } else if (hit_v) {
      next.y() = std::clamp(next.y(), d.v0, d.v1);
      if (a > 0) next.x() = q.x() + std::clamp(-(gu + b * (next.y() - q.y())) / a, -0.2 * span_u, 0.2 * span_u);
    }
    if (!d.is_periodic_u) next.x() = std::clamp(next.x(), d.u0, d.u1);
    if (!d.is_periodic_v) next.y() = std::clamp(next.y(), d.v0, d.v1);
    if (has_poles)  // not onto a pole, where the way on is lost, but half the way
      if (const int axis = pole_axis(next); axis >= 0) next[axis] = 0.5 * (next[axis] + q[axis]);
    const double move = std::abs(next.x() - q.x()) * std::sqrt(a0) + std::abs(next.y() - q.y()) * std::sqrt(c0);
    q = next;
    if (move < 1e-10 * (1 + p.norm() * 1e-2)) break;
  }
  double uu = q.x(), vv = q.y();
  if (d.is_periodic_u) uu = d.u0 + std::fmod(std::fmod(uu - d.u0, span_u) + span_u, span_u);
  if (d.is_periodic_v) vv = d.v0 + std::fmod(std::fmod(vv - d.v0, span_v) + span_v, span_v);
  const double f = (evaluate_jet(s, uu, vv).p - p).squaredNorm();
  if (f <= distance_2) distance_2 = f, best = q;
  if (has_poles)
    for (const Vec2& w : {Vec2(best.x(), d.v0), Vec2(best.x(), d.v1), Vec2(d.u0, best.y()), Vec2(d.u1, best.y())})
      if (pole_axis(w) >= 0) {
        const double at_pole = (evaluate_jet(s, w.x(), w.y(), 1).p - p).squaredNorm();
        if (at_pole <= distance_2) distance_2 = at_pole, best = w;
      }
  return best;
}

std::vector<double> knot_seeds(const std::vector<double>& knots, int degree, int limit) {
  const KnotRange r = knot_range(knots, degree);
  int spans = 0;
  for (size_t k = degree; k + 1 < knots.size() - degree; ++k) spans += knots[k + 1] > knots[k];
  const int per = std::clamp(limit / std::max(1, spans), 1, std::max(2, degree));
  std::vector<double> s;
  const int stride = std::max(1, spans / limit);
  int n = 0;
  for (size_t k = degree; k + 1 < knots.size() - degree; ++k) {
    if (knots[k + 1] <= knots[k] || n++ % stride) continue;
    for (int j = 0; j < per; ++j) s.push_back(knots[k] + (knots[k + 1] - knots[k]) * (j + 0.5) / per);
  }
  s.push_back(r.t0), s.push_back(r.t1);
  return s;
}

Vec2 bspline_foot(const Surface& surface, const BSplineSurface& s, const SurfaceDomain& d, const Vec3& p, const std::optional<Vec2>& seed) {
  double f = 0;
  if (seed) {
    Vec2 q = *seed;
    if (!d.is_periodic_u) q.x() = std::clamp(q.x(), d.u0, d.u1);
    if (!d.is_periodic_v) q.y() = std::clamp(q.y(), d.v0, d.v1);
    return newton_uv(surface, d, p, q, f);
  }
  const std::vector<double> us = knot_seeds(s.knots_u, s.degree_u, 40), vs = knot_seeds(s.knots_v, s.degree_v, 40);
  std::vector<std::pair<double, Vec2>> order;
  order.reserve(us.size() * vs.size());
  const auto is_again = [](double t, double t0, bool is_pole_0, double t1, bool is_pole_1, bool is_first) {
    return !is_first && ((is_pole_0 && t <= t0) || (is_pole_1 && t >= t1));  // a pole is one seed, not a row of them
  };
  for (double u : us)
    for (double v : vs)
      if (!is_again(v, d.v0, d.is_pole_v0, d.v1, d.is_pole_v1, u == us.front()) &&
          !is_again(u, d.u0, d.is_pole_u0, d.u1, d.is_pole_u1, v == vs.front()))
        order.emplace_back((evaluate_jet(surface, u, v).p - p).squaredNorm(), Vec2(u, v));
  const size_t n = std::min<size_t>(order.size(), 6);
  std::partial_sort(order.begin(), order.begin() + n, order.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : (a.second.x() != b.second.x() ? a.second.x() < b.second.x()
        : a.second.y() < b.second.y());
  });
  Vec2 best = order[0].second;
  double best_f = 1e300;
  for (size_t i = 0; i < n; ++i) {
    const Vec2 q = newton_uv(surface, d, p, order[i].second, f);
    if (f < best_f) best_f = f, best = q;
    if (best_f < 1e-14) break;
  }
  return best;
}

struct FootOf {
  const Surface& surface;
  const SurfaceDomain& surface_domain;
  const Vec3& p;
  const std::optional<Vec2>& seed;

  Vec2 operator()(const PlaneSurface& s) const {
    const Vec3 r = p - s.at.origin;
    return {r.dot(s.at.x), r.dot(s.at.y)};
  }
  Vec2 operator()(const CylinderSurface& s) const {
    const Vec3 r = p - s.at.origin;
    return {nearest_turn(std::atan2(r.dot(s.at.y), r.dot(s.at.x)), seed, 0), r.dot(s.at.z)};
  }
  Vec2 operator()(const ConeSurface& s) const {
    const Vec3 r = p - s.at.origin;
    const double x = r.dot(s.at.x), y = r.dot(s.at.y), h = r.dot(s.at.z), rho = std::hypot(x, y);
    const double co = std::cos(s.half_angle_rad), si = std::sin(s.half_angle_rad), k = std::tan(s.half_angle_rad);
    // Line (R, 0) + l (si, co) in the half-plane (rho, h); the second nappe is the point mirrored to -rho.
    const auto foot = [&](double rr, double& distance) {
      const double l = (rr - s.radius_mm) * si + h * co;
      double v = l * co;
      if (k != 0 && (s.radius_mm + v * k) * (rr >= 0 ? 1 : -1) < 0) v = -s.radius_mm / k;  // not past the apex
      distance = std::hypot(rr - s.radius_mm - v * k, h - v);
      return v;
    };
    double d_1 = 0, d_2 = 0;
    const double v_1 = foot(rho, d_1), v_2 = foot(-rho, d_2);
    const double a = std::atan2(y, x);
    if (d_2 < d_1 - 1e-12) return {nearest_turn(a + kPi, seed, 0), v_2};
    return {nearest_turn(a, seed, 0), v_1};
  }
  Vec2 operator()(const SphereSurface& s) const {
    const Vec3 r = p - s.at.origin;
    const double x = r.dot(s.at.x), y = r.dot(s.at.y);
    return {nearest_turn(std::atan2(y, x), seed, 0), std::atan2(r.dot(s.at.z), std::hypot(x, y))};
  }
  Vec2 operator()(const TorusSurface& s) const {
    const Vec3 r = p - s.at.origin;
    const double x = r.dot(s.at.x), y = r.dot(s.at.y), h = r.dot(s.at.z);
    double rho = std::hypot(x, y), u = std::atan2(y, x);
    const bool is_spindle = s.major_mm < s.minor_mm;
    if (is_spindle && s.is_inner_lobe) rho = -rho, u += kPi;
    double v = std::atan2(h, rho - s.major_mm);
    if (is_spindle) {
      const double v_axis = std::acos(std::clamp(-s.major_mm / s.minor_mm, -1.0, 1.0));
      if (!s.is_inner_lobe) {
        v = std::clamp(v, -v_axis, v_axis);
      } else {
        if (v < 0) v += 2 * kPi;
        v = std::clamp(v, v_axis, 2 * kPi - v_axis);
      }
      return {nearest_turn(u, seed, 0), v};
    }
    return {nearest_turn(u, seed, 0), nearest_turn(v, seed, 1)};
  }
  Vec2 operator()(const BSplineSurface& s) const { return bspline_foot(surface, s, surface_domain, p, seed); }
  Vec2 operator()(const RevolutionSurface& s) const {
    const CurveDomain d = domain(s.profile);
    const Vec3 q = p - s.axis_point;
    const double h = s.axis.dot(q);
    const Vec3 side = q - h * s.axis;
    const double rho = side.norm();
    const auto residual = [&](double t, Vec2& dr) {
      const CurvePoint c = evaluate(s.profile, t);
      const Vec3 a = c.p - s.axis_point;
      const double ch = s.axis.dot(a);
      const Vec3 cs = a - ch * s.axis;
      const double cr = cs.norm();
      dr = {cr > 1e-12 ? cs.dot(c.d1) / cr : (c.d1 - s.axis * s.axis.dot(c.d1)).norm(), s.axis.dot(c.d1)};
      return Vec2(cr - rho, ch - h);
    };
    const double v = search_1d(d, seed ? std::vector<double>{seed->y()} : curve_seeds(s.profile, d), residual);
    const Vec3 c = evaluate(s.profile, v).p - s.axis_point;
    const Vec3 cs = c - s.axis * s.axis.dot(c);
    const double u = cs.norm() > 1e-12 && rho > 1e-12 ? std::atan2(s.axis.dot(cs.cross(side)), cs.dot(side)) : (seed ? seed->x() : 0.0);
    Vec2 o(nearest_turn(u, seed, 0), v);
    if (!seed && d.is_closed) o.y() = nearest_turn(v - d.t0, seed, 1, d.period()) + d.t0;
    return o;
  }
  Vec2 operator()(const ExtrusionSurface& s) const {
    const CurveDomain d = domain(s.profile);
    const Vec3 other = std::abs(s.direction.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
    const Vec3 x = s.direction.cross(other).normalized(), y = s.direction.cross(x);
    const auto residual = [&](double t, Vec2& dr) {
      const CurvePoint c = evaluate(s.profile, t);
      dr = {c.d1.dot(x), c.d1.dot(y)};
      return Vec2((c.p - p).dot(x), (c.p - p).dot(y));
    };
    const double u = search_1d(d, seed ? std::vector<double>{seed->x()} : curve_seeds(s.profile, d), residual);
    return {!seed && d.is_closed ? nearest_turn(u - d.t0, seed, 0, d.period()) + d.t0 : u,
            (p - evaluate(s.profile, u).p).dot(s.direction)};
  }
  Vec2 operator()(const OffsetSurface& s) const {
    const SurfaceFoot f = project(*s.basis, surface_domain, p, seed);  // the domain of an offset is that of its basis
    return {f.u, f.v};
  }
  Vec2 operator()(const FacetSurface&) const { return {0, 0}; }
};

Vec3 nearest_on_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  // Ericson, Real-Time Collision Detection, 5.1.5.
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return b;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + ab * (d1 / (d1 - d3));
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return c;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + ac * (d2 / (d2 - d6));
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
  const double den = 1 / (va + vb + vc);
  return a + ab * (vb * den) + ac * (vc * den);
}

}  // namespace

SurfaceFoot project(const Surface& s, const Vec3& p, const std::optional<Vec2>& seed) {
  // Only surfaces whose borders have to be found by evaluation look at the domain.
  const bool needs_domain = std::holds_alternative<BSplineSurface>(s.shape) || std::holds_alternative<OffsetSurface>(s.shape);
  return project(s, needs_domain ? domain(s) : SurfaceDomain{}, p, seed);
}

SurfaceFoot project(const Surface& s, const SurfaceDomain& surface_domain, const Vec3& p, const std::optional<Vec2>& seed) {
  SurfaceFoot o;
  if (const auto* f = std::get_if<FacetSurface>(&s.shape)) {
    if (!f->patch) return o;
    double best = 1e300;
    const Mesh& m = *f->patch;
    if (f->query) {
      const MeshHit hit = f->query->closest(p);
      o.p = hit.p_mm, o.u = hit.triangle;
      if (hit.triangle >= 0) o.n = m.triangle_normal(hit.triangle);
      o.signed_distance_mm = o.n.dot(p - o.p);
      return o;
    }
    for (size_t i = 0; i < m.triangles.size(); ++i) {
      const auto& t = m.triangles[i];
      const Vec3 q = nearest_on_triangle(p, m.vertices[t[0]], m.vertices[t[1]], m.vertices[t[2]]);
      const double d = (q - p).squaredNorm();
      if (d < best) best = d, o.p = q, o.u = static_cast<double>(i);
    }
    if (!m.triangles.empty()) o.n = m.triangle_normal(static_cast<int>(o.u));
  } else {
    const Vec2 q = std::visit(FootOf{s, surface_domain, p, seed}, s.shape);
    double u = q.x(), v = q.y();
    o.u = u, o.v = v;
    if (std::holds_alternative<BSplineSurface>(s.shape) || std::holds_alternative<OffsetSurface>(s.shape)) {
      const SurfaceDomain& d = surface_domain;
      if (d.is_periodic_u && d.u1 > d.u0) u -= (d.u1 - d.u0) * std::floor((u - d.u0) / (d.u1 - d.u0));
      if (d.is_periodic_v && d.v1 > d.v0) v -= (d.v1 - d.v0) * std::floor((v - d.v0) / (d.v1 - d.v0));
    }
    const SurfacePoint e = evaluate(s, u, v);
    o.p = e.p, o.n = e.n;
  }
  o.signed_distance_mm = o.n.dot(p - o.p);
  return o;
}

}  // namespace asbuilt
