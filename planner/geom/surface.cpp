// SPDX-License-Identifier: GPL-3.0-or-later
// Evaluation of surfaces with derivatives; projection is in surface_project.cpp, domains in surface_domain.cpp.
#include "planner/geom/surface.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "planner/geom/bspline.hpp"

namespace asbuilt {
namespace {

/// Position and first derivatives.
SurfaceJet bspline_tangents(const BSplineSurface& s, const Basis& bu, const Basis& bv, int ku, int kv) {
  const int pu = s.degree_u, pv = s.degree_v;
  const bool rational = !s.weights.empty();
  Vec3 a = Vec3::Zero(), au = a, av = a;
  double w = 0, wu = 0, wv = 0;
  for (int i = 0; i <= pu; ++i) {
    Vec3 r0 = Vec3::Zero(), r1 = r0;
    double w0 = 0, w1 = 0;
    const size_t row = static_cast<size_t>(ku - pu + i) * s.count_v + (kv - pv);
    if (rational) {
      for (int j = 0; j <= pv; ++j) {
        const double b0 = bv.n[0][j] * s.weights[row + j], b1 = bv.n[1][j] * s.weights[row + j];
        r0 += b0 * s.poles[row + j], r1 += b1 * s.poles[row + j];
        w0 += b0, w1 += b1;
      }
      w += bu.n[0][i] * w0, wu += bu.n[1][i] * w0, wv += bu.n[0][i] * w1;
    } else {
      for (int j = 0; j <= pv; ++j) r0 += bv.n[0][j] * s.poles[row + j], r1 += bv.n[1][j] * s.poles[row + j];
    }
    a += bu.n[0][i] * r0, au += bu.n[1][i] * r0, av += bu.n[0][i] * r1;
  }
  SurfaceJet o;
  if (!rational) {
    o.p = a, o.du = au, o.dv = av;
    return o;
  }
  o.p = a / w;
  o.du = (au - wu * o.p) / w, o.dv = (av - wv * o.p) / w;
  return o;
}

SurfaceJet bspline_jet(const BSplineSurface& s, double u, double v, int order) {
  const int pu = s.degree_u, pv = s.degree_v;
  const KnotRange ru = knot_range(s.knots_u, pu), rv = knot_range(s.knots_v, pv);
  u = std::clamp(u, ru.t0, ru.t1), v = std::clamp(v, rv.t0, rv.t1);
  const int ku = knot_span(s.knots_u, pu, u), kv = knot_span(s.knots_v, pv, v);
  Basis bu, bv;
  basis_at(s.knots_u, pu, ku, u, order, bu);
  basis_at(s.knots_v, pv, kv, v, order, bv);
  const bool rational = !s.weights.empty();
  if (order < 2) return bspline_tangents(s, bu, bv, ku, kv);
  // Homogeneous sums: index 0 p, 1 u, 2 v, 3 uu, 4 uv, 5 vv.
  Vec3 a[6];
  double w[6] = {0, 0, 0, 0, 0, 0};
  for (Vec3& x : a) x.setZero();
  for (int i = 0; i <= pu; ++i) {
    Vec3 r0 = Vec3::Zero(), r1 = r0, r2 = r0;
    double w0 = 0, w1 = 0, w2 = 0;
    const size_t row = static_cast<size_t>(ku - pu + i) * s.count_v + (kv - pv);
    for (int j = 0; j <= pv; ++j) {
      if (rational) {
        const double wj = s.weights[row + j];
        const Vec3 q = wj * s.poles[row + j];
        r0 += bv.n[0][j] * q, r1 += bv.n[1][j] * q, r2 += bv.n[2][j] * q;
        w0 += bv.n[0][j] * wj, w1 += bv.n[1][j] * wj, w2 += bv.n[2][j] * wj;
      } else {
        const Vec3& q = s.poles[row + j];
        r0 += bv.n[0][j] * q, r1 += bv.n[1][j] * q, r2 += bv.n[2][j] * q;
      }
    }
    const double n0 = bu.n[0][i], n1 = bu.n[1][i], n2 = bu.n[2][i];
    a[0] += n0 * r0, a[1] += n1 * r0, a[2] += n0 * r1, a[3] += n2 * r0, a[4] += n1 * r1, a[5] += n0 * r2;
    if (rational) w[0] += n0 * w0, w[1] += n1 * w0, w[2] += n0 * w1, w[3] += n2 * w0, w[4] += n1 * w1, w[5] += n0 * w2;
  }
  if (!rational) return {a[0], a[1], a[2], a[3], a[4], a[5]};
  SurfaceJet o;
  o.p = a[0] / w[0];
  o.du = (a[1] - w[1] * o.p) / w[0];
  o.dv = (a[2] - w[2] * o.p) / w[0];
  o.duu = (a[3] - 2 * w[1] * o.du - w[3] * o.p) / w[0];
  o.duv = (a[4] - w[1] * o.dv - w[2] * o.du - w[4] * o.p) / w[0];
  o.dvv = (a[5] - 2 * w[2] * o.dv - w[5] * o.p) / w[0];
  return o;
}

Vec3 rotated(const Vec3& v, const Vec3& axis, double co, double si) {
  const Vec3 along = axis.dot(v) * axis;
  return along + co * (v - along) + si * axis.cross(v);
}

struct JetOf {
  double u, v;
  int order = 2;
  SurfaceJet operator()(const PlaneSurface& s) const {
    const Vec3 o = Vec3::Zero();
    return {s.at.origin + u * s.at.x + v * s.at.y, s.at.x, s.at.y, o, o, o};
  }
  SurfaceJet operator()(const CylinderSurface& s) const {
    const double co = std::cos(u), si = std::sin(u), r = s.radius_mm;
    const Vec3 e = co * s.at.x + si * s.at.y, t = -si * s.at.x + co * s.at.y, o = Vec3::Zero();
    return {s.at.origin + r * e + v * s.at.z, r * t, s.at.z, -r * e, o, o};
  }
  SurfaceJet operator()(const ConeSurface& s) const {
    const double co = std::cos(u), si = std::sin(u), k = std::tan(s.half_angle_rad), r = s.radius_mm + v * k;
    const Vec3 e = co * s.at.x + si * s.at.y, t = -si * s.at.x + co * s.at.y;
    return {s.at.origin + r * e + v * s.at.z, r * t, k * e + s.at.z, -r * e, k * t, Vec3::Zero()};
  }
  SurfaceJet operator()(const SphereSurface& s) const {
    const double co = std::cos(u), si = std::sin(u), cv = std::cos(v), sv = std::sin(v), r = s.radius_mm;
    const Vec3 e = co * s.at.x + si * s.at.y, t = -si * s.at.x + co * s.at.y;
    const Vec3 n = cv * e + sv * s.at.z;
    return {s.at.origin + r * n, r * cv * t, r * (-sv * e + cv * s.at.z), -r * cv * e, -r * sv * t, -r * n};
  }
  SurfaceJet operator()(const TorusSurface& s) const {
    const double co = std::cos(u), si = std::sin(u), cv = std::cos(v), sv = std::sin(v), r = s.minor_mm;
    const Vec3 e = co * s.at.x + si * s.at.y, t = -si * s.at.x + co * s.at.y;
    const double rho = s.major_mm + r * cv;
    return {s.at.origin + rho * e + r * sv * s.at.z, rho * t, r * (-sv * e + cv * s.at.z), -rho * e, -r * sv * t,
            -r * (cv * e + sv * s.at.z)};
  }
  SurfaceJet operator()(const BSplineSurface& s) const { return bspline_jet(s, u, v, order); }
  SurfaceJet operator()(const RevolutionSurface& s) const {
    const CurvePoint c = evaluate(s.profile, v);
    const double co = std::cos(u), si = std::sin(u);
    SurfaceJet o;
    const Vec3 arm = rotated(c.p - s.axis_point, s.axis, co, si);
    o.p = s.axis_point + arm;
    o.du = s.axis.cross(arm);
    o.duu = s.axis.cross(o.du);
    o.dv = rotated(c.d1, s.axis, co, si);
    o.duv = s.axis.cross(o.dv);
    o.dvv = rotated(c.d2, s.axis, co, si);
    return o;
  }
  SurfaceJet operator()(const ExtrusionSurface& s) const {
    const CurvePoint c = evaluate(s.profile, u);
    return {c.p + v * s.direction, c.d1, s.direction, c.d2, Vec3::Zero(), Vec3::Zero()};
  }
  SurfaceJet operator()(const OffsetSurface& s) const {
    SurfaceJet b = evaluate_jet(*s.basis, u, v);
    const Vec3 m = b.du.cross(b.dv);
    const double l = m.norm();
    if (l > 0) {
      const Vec3 n = m / l;
      const Vec3 mu = b.duu.cross(b.dv) + b.du.cross(b.duv), mv = b.duv.cross(b.dv) + b.du.cross(b.dvv);
      b.du += s.distance_mm / l * (mu - n * n.dot(mu));
      b.dv += s.distance_mm / l * (mv - n * n.dot(mv));
      b.p += s.distance_mm * n;
    } else {
      b.p += s.distance_mm * evaluate(*s.basis, u, v).n;
    }
    return b;
  }
  SurfaceJet operator()(const FacetSurface& s) const {
    SurfaceJet o;
    if (!s.patch || s.patch->triangles.empty()) return o;
    const int t = std::clamp(static_cast<int>(u), 0, static_cast<int>(s.patch->triangles.size()) - 1);
    const auto& f = s.patch->triangles[t];
    const Vec3 &a = s.patch->vertices[f[0]], &b = s.patch->vertices[f[1]], &c = s.patch->vertices[f[2]];
    o.p = (a + b + c) / 3, o.du = b - a, o.dv = c - a;
    return o;
  }
};

}  // namespace

std::string_view surface_type(const Surface& s) {
  constexpr std::string_view names[] = {"plane",   "cylinder",   "cone",      "sphere", "torus",
                                        "bspline", "revolution", "extrusion", "offset", "facets"};
  static_assert(std::size(names) == std::variant_size_v<decltype(s.shape)>, "a name for every kind of surface");
  return names[s.shape.index()];
}

bool has_closed_form_foot(const Surface& s) {
  return std::holds_alternative<PlaneSurface>(s.shape) || std::holds_alternative<CylinderSurface>(s.shape) ||
         std::holds_alternative<ConeSurface>(s.shape) || std::holds_alternative<SphereSurface>(s.shape) ||
         std::holds_alternative<TorusSurface>(s.shape);
}

SurfaceJet evaluate_jet(const Surface& s, double u, double v, int order) { return std::visit(JetOf{u, v, order}, s.shape); }

SurfacePoint evaluate(const Surface& s, double u, double v) {
  const SurfaceJet j = evaluate_jet(s, u, v, 1);
  SurfacePoint o;
  o.p = j.p, o.du = j.du, o.dv = j.dv;
  const Vec3 m = j.du.cross(j.dv);
  const double l = m.norm(), size = std::max(j.du.norm(), j.dv.norm());
  if (l > 1e-9 * size * size && l > 0) {
    o.n = m / l;
    return o;
  }
  // A pole: closed forms where they exist, else the limit from inside the domain.
  if (const auto* q = std::get_if<SphereSurface>(&s.shape)) {
    o.n = (o.p - q->at.origin).normalized();
    return o;
  }
  if (const auto* q = std::get_if<ConeSurface>(&s.shape)) {
    const Vec3 e = std::cos(u) * q->at.x + std::sin(u) * q->at.y;
    o.n = (e * std::cos(q->half_angle_rad) - q->at.z * std::sin(q->half_angle_rad)).normalized();
    return o;
  }
  const SurfaceDomain d = domain(s);
  const double su = d.u1 - d.u0 < 1e200 ? 1e-4 * (d.u1 - d.u0) : 1e-4, sv = d.v1 - d.v0 < 1e200 ? 1e-4 * (d.v1 - d.v0) : 1e-4;
  const double step_u = d.u1 - d.u0 < 1e200 && u > 0.5 * (d.u0 + d.u1) ? -su : su;
  const double step_v = d.v1 - d.v0 < 1e200 && v > 0.5 * (d.v0 + d.v1) ? -sv : sv;
  for (const auto& [a, b] : {std::pair{0.0, step_v}, std::pair{step_u, 0.0}, std::pair{step_u, step_v}}) {
    const SurfaceJet k = evaluate_jet(s, u + a, v + b);
    const Vec3 n = k.du.cross(k.dv);
    const double m2 = std::max(k.du.norm(), k.dv.norm());
    if (n.norm() > 1e-9 * m2 * m2 && n.norm() > 0) {
      o.n = n.normalized();
      return o;
    }
  }
  if (l > 0) o.n = m / l;
  return o;
}

namespace {

/// Axes for a surface of revolution or a plane: z mapped, x mapped, y right-handed. The natural normal of a cylinder, cone,
/// sphere, torus points away from the axis whatever the hand; that of a plane is z.
Placement mapped_axes(const Eigen::Affine3d& T, const Placement& at) {
  Placement out;
  out.origin = T * at.origin;
  out.x = (T.linear() * at.x).normalized();
  out.z = (T.linear() * at.z).normalized();
  out.y = out.z.cross(out.x);
  return out;
}

}  // namespace

Surface transformed(const Eigen::Affine3d& T, const Surface& surface, bool& is_reversed) {
  const double det = T.linear().determinant(), scale = std::cbrt(std::abs(det));
  const bool is_mirror = det < 0;
  is_reversed = false;
  Surface out = surface;
  if (auto* a = std::get_if<PlaneSurface>(&out.shape)) {
    a->at = mapped_axes(T, a->at);
  } else if (auto* b = std::get_if<CylinderSurface>(&out.shape)) {
    b->at = mapped_axes(T, b->at), b->radius_mm *= scale;
  } else if (auto* c = std::get_if<ConeSurface>(&out.shape)) {
    c->at = mapped_axes(T, c->at), c->radius_mm *= scale;
  } else if (auto* d = std::get_if<SphereSurface>(&out.shape)) {
    d->at = mapped_axes(T, d->at), d->radius_mm *= scale;
  } else if (auto* e = std::get_if<TorusSurface>(&out.shape)) {
    e->at = mapped_axes(T, e->at), e->major_mm *= scale, e->minor_mm *= scale;
  } else if (auto* f = std::get_if<BSplineSurface>(&out.shape)) {
    for (Vec3& p : f->poles) p = T * p;
    is_reversed = is_mirror;
  } else if (auto* g = std::get_if<RevolutionSurface>(&out.shape)) {
    g->profile = transformed(T, g->profile);
    g->axis_point = T * g->axis_point, g->axis = (T.linear() * g->axis).normalized();
  } else if (auto* h = std::get_if<ExtrusionSurface>(&out.shape)) {
    h->profile = transformed(T, h->profile), h->direction = (T.linear() * h->direction).normalized();
    is_reversed = is_mirror;
  } else if (auto* i = std::get_if<OffsetSurface>(&out.shape)) {
    if (i->basis) i->basis = std::make_shared<Surface>(transformed(T, *i->basis, is_reversed));
    i->distance_mm *= is_reversed ? -scale : scale;
  } else if (auto* j = std::get_if<FacetSurface>(&out.shape)) {
    if (j->patch) {
      Mesh m = *j->patch;
      for (Vec3& p : m.vertices) p = T * p;
      if (is_mirror)
        for (auto& t : m.triangles) std::swap(t[1], t[2]);
      j->patch = std::make_shared<Mesh>(std::move(m));
    }
  }
  return out;
}

}  // namespace asbuilt
