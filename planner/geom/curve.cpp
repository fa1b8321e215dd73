// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/curve.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "planner/geom/bspline.hpp"

namespace asbuilt {
namespace {

template <class... F>
struct Overload : F... {
  using F::operator()...;
};
template <class... F>
Overload(F...) -> Overload<F...>;

CurvePoint bspline_point(const BSplineCurve& c, double t) {
  const KnotRange r = knot_range(c.knots, c.degree);
  if (t < r.t0 || t > r.t1) {
    const bool is_closed = (c.poles.front() - c.poles.back()).norm() <= 1e-7 * (1 + c.poles.front().norm());
    const double period = r.t1 - r.t0;
    if ((is_closed || domain(Curve{c}).is_closed) && period > 0) {
      t = r.t0 + std::fmod(t - r.t0, period);
      if (t < r.t0) t += period;
    }
    t = std::clamp(t, r.t0, r.t1);
  }
  const int span = knot_span(c.knots, c.degree, t);
  Basis b;
  basis_at(c.knots, c.degree, span, t, 2, b);
  CurvePoint out;
  const int first = span - c.degree;
  if (c.weights.empty()) {
    for (int j = 0; j <= c.degree; ++j) {
      const Vec3& q = c.poles[first + j];
      out.p += b.n[0][j] * q, out.d1 += b.n[1][j] * q, out.d2 += b.n[2][j] * q;
    }
    return out;
  }
  double w0 = 0, w1 = 0, w2 = 0;
  Vec3 a0 = Vec3::Zero(), a1 = a0, a2 = a0;
  for (int j = 0; j <= c.degree; ++j) {
    const double w = c.weights[first + j];
    const Vec3 q = w * c.poles[first + j];
    a0 += b.n[0][j] * q, a1 += b.n[1][j] * q, a2 += b.n[2][j] * q;
    w0 += b.n[0][j] * w, w1 += b.n[1][j] * w, w2 += b.n[2][j] * w;
  }
  out.p = a0 / w0;
  out.d1 = (a1 - w1 * out.p) / w0;
  out.d2 = (a2 - 2 * w1 * out.d1 - w2 * out.p) / w0;
  return out;
}

CurvePoint polyline_point(const PolylineCurve& c, double t) {
  CurvePoint out;
  if (c.points.empty()) return out;
  if (c.points.size() == 1) return {c.points[0], Vec3::Zero(), Vec3::Zero()};
  const double last = static_cast<double>(c.points.size() - 1);
  if ((t < 0 || t > last) && (c.points.front() - c.points.back()).norm() < 1e-9) t -= last * std::floor(t / last);
  t = std::clamp(t, 0.0, last);
  const size_t i = std::min(static_cast<size_t>(t), c.points.size() - 2);
  out.d1 = c.points[i + 1] - c.points[i];
  out.p = c.points[i] + (t - static_cast<double>(i)) * out.d1;
  return out;
}

/// Newton on (c(t) - p) . c'(t) = 0 with steps held inside [t0, t1] (wrapping left to evaluate for closed curves).
double refine_foot(const Curve& c, const CurveDomain& d, const Vec3& p, double t) {
  double best_t = t, best = 1e300;
  for (int i = 0; i < 12; ++i) {
    const CurvePoint e = evaluate(c, t);
    const Vec3 r = e.p - p;
    if (r.squaredNorm() < best) best = r.squaredNorm(), best_t = t;
    const double g = r.dot(e.d1), d1_2 = e.d1.squaredNorm();
    if (d1_2 <= 0) break;
    double h = d1_2 + r.dot(e.d2);
    if (h < 0.2 * d1_2) h = d1_2;
    double step = -g / h;
    if (d.is_bounded) step = std::clamp(step, -0.25 * d.period(), 0.25 * d.period());
    double next = t + step;
    if (d.is_bounded && !d.is_closed) next = std::clamp(next, d.t0, d.t1);
    if (std::abs(next - t) * std::sqrt(d1_2) < 1e-11 * (1 + p.norm())) break;
    t = next;
  }
  const CurvePoint e = evaluate(c, t);
  return (e.p - p).squaredNorm() <= best ? t : best_t;
}

double global_foot(const Curve& c, const CurveDomain& d, const Vec3& p) {
  std::vector<double> seeds;
  if (const auto* b = std::get_if<BSplineCurve>(&c.shape)) {
    const int per_span = std::max(2, std::min(b->degree + 1, 6));
    for (size_t k = b->degree; k + 1 < b->knots.size() - b->degree; ++k) {
      if (b->knots[k + 1] <= b->knots[k]) continue;
      for (int j = 0; j < per_span; ++j) seeds.push_back(b->knots[k] + (b->knots[k + 1] - b->knots[k]) * j / per_span);
    }
    seeds.push_back(d.t1);
  } else if (const auto* l = std::get_if<PolylineCurve>(&c.shape)) {
    double best = 1e300, best_t = 0;
    for (size_t i = 0; i + 1 < l->points.size(); ++i) {
      const Vec3 e = l->points[i + 1] - l->points[i];
      const double f = e.squaredNorm() > 0 ? std::clamp((p - l->points[i]).dot(e) / e.squaredNorm(), 0.0, 1.0) : 0.0;
      const double q = (l->points[i] + f * e - p).squaredNorm();
      if (q < best) best = q, best_t = static_cast<double>(i) + f;
    }
    return best_t;
  } else {
    for (int j = 0; j <= 32; ++j) seeds.push_back(d.t0 + d.period() * j / 32);
  }
  std::vector<double> q(seeds.size());
  for (size_t i = 0; i < seeds.size(); ++i) q[i] = (evaluate(c, seeds[i]).p - p).squaredNorm();
  double best = 1e300, best_t = d.t0;
  const double q_min = *std::min_element(q.begin(), q.end());
  for (size_t i = 0; i < seeds.size(); ++i) {  // every local minimum that could still win
    if ((i > 0 && q[i - 1] < q[i]) || (i + 1 < q.size() && q[i + 1] < q[i]) || q[i] > 4 * q_min + 1e-12) continue;
    const double t = refine_foot(c, d, p, seeds[i]);
    const double e = (evaluate(c, t).p - p).squaredNorm();
    if (e < best) best = e, best_t = t;
  }
  return best_t;
}

}  // namespace

std::string_view curve_type(const Curve& c) {
  constexpr std::string_view names[] = {"line", "circle", "ellipse", "hyperbola", "parabola", "bspline", "polyline"};
  static_assert(std::size(names) == std::variant_size_v<decltype(c.shape)>, "a name for every kind of curve");
  return names[c.shape.index()];
}

CurvePoint evaluate(const Curve& curve, double t) {
  return std::visit(
      Overload{
          [&](const LineCurve& c) { return CurvePoint{c.origin + t * c.direction, c.direction, Vec3::Zero()}; },
          [&](const CircleCurve& c) {
            const Vec3 x = c.radius_mm * c.at.x, y = c.radius_mm * c.at.y;
            const double co = std::cos(t), si = std::sin(t);
            return CurvePoint{c.at.origin + co * x + si * y, -si * x + co * y, -co * x - si * y};
          },
          [&](const EllipseCurve& c) {
            const Vec3 x = c.a_mm * c.at.x, y = c.b_mm * c.at.y;
            const double co = std::cos(t), si = std::sin(t);
            return CurvePoint{c.at.origin + co * x + si * y, -si * x + co * y, -co * x - si * y};
          },
          [&](const HyperbolaCurve& c) {
            const Vec3 x = c.a_mm * c.at.x, y = c.b_mm * c.at.y;
            const double ch = std::cosh(std::clamp(t, -300.0, 300.0)), sh = std::sinh(std::clamp(t, -300.0, 300.0));
            return CurvePoint{c.at.origin + ch * x + sh * y, sh * x + ch * y, ch * x + sh * y};
          },
          [&](const ParabolaCurve& c) {
            const Vec3 x = c.focal_mm * c.at.x, y = 2 * c.focal_mm * c.at.y;
            return CurvePoint{c.at.origin + t * t * x + t * y, 2 * t * x + y, 2 * x};
          },
          [&](const BSplineCurve& c) { return bspline_point(c, t); },
          [&](const PolylineCurve& c) { return polyline_point(c, t); },
      },
      curve.shape);
}

CurveDomain domain(const Curve& curve) {
  CurveDomain d;
  if (std::holds_alternative<CircleCurve>(curve.shape) || std::holds_alternative<EllipseCurve>(curve.shape)) {
    d = {0, 2 * kPi, true, true};
  } else if (const auto* b = std::get_if<BSplineCurve>(&curve.shape)) {
    const KnotRange r = knot_range(b->knots, b->degree);
    d = {r.t0, r.t1, true, false};
    double size = 0;
    for (const Vec3& q : b->poles) size = std::max(size, (q - b->poles.front()).norm());
    d.is_closed = r.t1 > r.t0 && (evaluate(curve, r.t0).p - evaluate(curve, r.t1).p).norm() <= 1e-6 * size;
  } else if (const auto* l = std::get_if<PolylineCurve>(&curve.shape)) {
    d = {0, std::max(0.0, static_cast<double>(l->points.size()) - 1), true, false};
    d.is_closed = l->points.size() > 2 && (l->points.front() - l->points.back()).norm() < 1e-9;
  }
  return d;
}

CurveFoot project(const Curve& curve, const Vec3& p, const std::optional<double>& seed) {
  double t = 0;
  if (const auto* l = std::get_if<LineCurve>(&curve.shape)) {
    t = (p - l->origin).dot(l->direction);
  } else if (const auto* c = std::get_if<CircleCurve>(&curve.shape)) {
    const Vec3 r = p - c->at.origin;
    t = std::atan2(r.dot(c->at.y), r.dot(c->at.x));
    if (t < 0) t += 2 * kPi;
  } else if (const auto* e = std::get_if<EllipseCurve>(&curve.shape)) {
    const Vec3 r = p - e->at.origin;
    const CurveDomain d = domain(curve);
    if (seed) {
      t = refine_foot(curve, d, p, *seed);
    } else {
      // The point with the same ellipse angle is the foot for points on the ellipse; four starts cover the rest.
      const double t_0 = std::atan2(r.dot(e->at.y) / e->b_mm, r.dot(e->at.x) / e->a_mm);
      double best = 1e300;
      for (int k = 0; k < 4; ++k) {
        const double q = refine_foot(curve, d, p, t_0 + k * kPi / 2);
        const double f = (evaluate(curve, q).p - p).norm();
        if (f < best - 1e-12) best = f, t = q;
        if (best < 1e-7) break;
      }
    }
    t -= 2 * kPi * std::floor(t / (2 * kPi));
  } else if (const auto* h = std::get_if<HyperbolaCurve>(&curve.shape)) {
    const Vec3 r = p - h->at.origin;
    CurveDomain d;
    t = refine_foot(curve, d, p, seed ? *seed : std::asinh(r.dot(h->at.y) / h->b_mm));
  } else if (const auto* q = std::get_if<ParabolaCurve>(&curve.shape)) {
    const Vec3 r = p - q->at.origin;
    CurveDomain d;
    t = refine_foot(curve, d, p, seed ? *seed : r.dot(q->at.y) / (2 * q->focal_mm));
  } else {
    const CurveDomain d = domain(curve);
    t = seed && !std::holds_alternative<PolylineCurve>(curve.shape) ? refine_foot(curve, d, p, *seed) : global_foot(curve, d, p);
  }
  CurveFoot f;
  f.t = t;
  f.p = evaluate(curve, t).p;
  f.distance_mm = (f.p - p).norm();
  return f;
}

Placement transformed_axes(const Eigen::Affine3d& T, const Placement& at) {
  Placement out;
  out.origin = T * at.origin;
  out.x = (T.linear() * at.x).normalized();
  out.y = (T.linear() * at.y).normalized();
  out.z = out.x.cross(out.y);
  return out;
}

Curve transformed(const Eigen::Affine3d& T, const Curve& curve) {
  const double scale = std::cbrt(std::abs(T.linear().determinant()));
  return std::visit(Overload{
                        [&](LineCurve c) {
                          c.origin = T * c.origin, c.direction = (T.linear() * c.direction).normalized();
                          return Curve{c};
                        },
                        [&](CircleCurve c) {
                          c.at = transformed_axes(T, c.at), c.radius_mm *= scale;
                          return Curve{c};
                        },
                        [&](EllipseCurve c) {
                          c.at = transformed_axes(T, c.at), c.a_mm *= scale, c.b_mm *= scale;
                          return Curve{c};
                        },
                        [&](HyperbolaCurve c) {
                          c.at = transformed_axes(T, c.at), c.a_mm *= scale, c.b_mm *= scale;
                          return Curve{c};
                        },
                        [&](ParabolaCurve c) {
                          c.at = transformed_axes(T, c.at), c.focal_mm *= scale;
                          return Curve{c};
                        },
                        [&](BSplineCurve c) {
                          for (Vec3& q : c.poles) q = T * q;
                          return Curve{c};
                        },
                        [&](PolylineCurve c) {
                          for (Vec3& q : c.points) q = T * q;
                          return Curve{c};
                        },
                    },
                    curve.shape);
}

}  // namespace asbuilt
