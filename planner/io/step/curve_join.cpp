// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/curve_join.hpp"

#include <algorithm>
#include <cmath>

#include "planner/geom/bspline.hpp"

namespace asbuilt::step {
namespace {

using Vec4 = Eigen::Vector4d;  // homogeneous: weight * point, weight
using Bezier = std::vector<Vec4>;

Vec4 lifted(const Vec3& p, double w) { return {w * p.x(), w * p.y(), w * p.z(), w}; }

/// Bezier pieces to one B-spline over [0, 1].
BSplineCurve chained(std::vector<Bezier> pieces) {
  std::size_t degree = 1;
  for (const Bezier& b : pieces) degree = std::max(degree, b.size() - 1);
  for (Bezier& b : pieces)
    while (b.size() < degree + 1) {  // degree elevation
      Bezier up(b.size() + 1, Vec4::Zero());
      const double n = static_cast<double>(b.size());
      for (std::size_t i = 0; i <= b.size(); ++i) {
        const double f = static_cast<double>(i) / n;
        up[i] = (i > 0 ? Vec4(f * b[i - 1]) : Vec4(Vec4::Zero())) + (i < b.size() ? Vec4((1 - f) * b[i]) : Vec4(Vec4::Zero()));
      }
      b = std::move(up);
    }
  for (std::size_t k = 1; k < pieces.size(); ++k) {  // weights are free by a factor: the same at the joint
    const double f = pieces[k - 1].back().w() / pieces[k].front().w();
    for (Vec4& v : pieces[k]) v *= f;
  }
  BSplineCurve out;
  out.degree = static_cast<int>(degree);
  bool is_rational = false;
  const double n = static_cast<double>(pieces.size());
  out.knots.assign(degree + 1, 0.0);
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    for (std::size_t i = k ? 1 : 0; i < pieces[k].size(); ++i) {
      out.poles.push_back(pieces[k][i].head<3>() / pieces[k][i].w());
      out.weights.push_back(pieces[k][i].w());
      is_rational = is_rational || std::abs(out.weights.back() - out.weights.front()) > 1e-14 * std::abs(out.weights.front());
    }
    out.knots.insert(out.knots.end(), degree + (k + 1 == pieces.size() ? 1 : 0), static_cast<double>(k + 1) / n);
  }
  if (!is_rational) out.weights.clear();
  return out;
}

/// The Bezier pieces of a B-spline between two parameters inside its range, by blossoms (de Boor with mixed arguments).
std::vector<Bezier> pieces_of(const BSplineCurve& c, double t0, double t1) {
  const auto p = static_cast<std::size_t>(c.degree);
  std::vector<double> breaks{t0};
  for (std::size_t k = p; k + p < c.knots.size(); ++k)
    if (c.knots[k] > breaks.back() + 1e-12 * (t1 - t0) && c.knots[k] < t1 - 1e-12 * (t1 - t0)) breaks.push_back(c.knots[k]);
  breaks.push_back(t1);
  std::vector<Bezier> out;
  for (std::size_t k = 0; k + 1 < breaks.size(); ++k) {
    const double a = breaks[k], b = breaks[k + 1];
    const auto span = static_cast<std::size_t>(knot_span(c.knots, c.degree, 0.5 * (a + b)));
    Bezier piece;
    for (std::size_t i = 0; i <= p; ++i) {  // blossom with p - i times a and i times b
      std::vector<Vec4> d;
      for (std::size_t j = 0; j <= p; ++j) d.push_back(lifted(c.poles[span - p + j], c.weights.empty() ? 1 : c.weights[span - p + j]));
      for (std::size_t r = 1; r <= p; ++r) {
        const double t = r <= p - i ? a : b;
        for (std::size_t j = p; j >= r; --j) {
          const double low = c.knots[span - p + j], high = c.knots[span + j - r + 1];
          const double f = high > low ? (t - low) / (high - low) : 0;
          d[j] = (1 - f) * d[j - 1] + f * d[j];
        }
      }
      piece.push_back(d[p]);
    }
    out.push_back(std::move(piece));
  }
  return out;
}

/// A conic arc of at most a quarter turn (or any piece of parabola or hyperbola): ends, tangents, and the middle give the three poles.
Bezier conic(const Curve& c, double a, double b) {
  const CurvePoint p = evaluate(c, a), q = evaluate(c, b), m = evaluate(c, 0.5 * (a + b));
  // The tangents meet at s: p + x p' = q + y q'.
  Eigen::Matrix<double, 3, 2> A;
  A.col(0) = p.d1, A.col(1) = -q.d1;
  const Vec2 x = A.colPivHouseholderQr().solve(q.p - p.p);
  const Vec3 s = p.p + x.x() * p.d1;
  // The shoulder of the conic lies between the middle of the chord and s: w / (1 + w) of the way.
  const Vec3 h = 0.5 * (p.p + q.p);
  const double l = (s - h).norm(), f = l > 0 ? (m.p - h).dot(s - h) / (l * l) : 0.5;
  const double w = std::clamp(f / std::max(1e-12, 1 - f), 1e-9, 1e9);
  return {lifted(p.p, 1), lifted(s, w), lifted(q.p, 1)};
}

}  // namespace

BSplineCurve as_bspline(const Curve& c, double t0, double t1) {
  std::vector<Bezier> pieces;
  const bool is_back = t1 < t0;
  const double low = std::min(t0, t1), high = std::max(t0, t1);
  if (std::holds_alternative<LineCurve>(c.shape)) {
    pieces.push_back({lifted(evaluate(c, low).p, 1), lifted(evaluate(c, high).p, 1)});
  } else if (const auto* l = std::get_if<PolylineCurve>(&c.shape)) {
    double t = low;
    while (t < high - 1e-12) {
      const double next = std::min(high, std::floor(t + 1e-9) + 1);
      pieces.push_back({lifted(evaluate(c, t).p, 1), lifted(evaluate(c, next).p, 1)});
      t = next;
    }
    if (pieces.empty()) pieces.push_back({lifted(l->points.front(), 1), lifted(l->points.front(), 1)});
  } else if (const auto* b = std::get_if<BSplineCurve>(&c.shape)) {
    const KnotRange r = knot_range(b->knots, b->degree);
    const double period = r.t1 - r.t0;
    for (double turn = std::floor((low - r.t0) / period); r.t0 + turn * period < high - 1e-12 * period && pieces.size() < 100000; ++turn) {
      const double from = std::max(low - turn * period, r.t0), to = std::min(high - turn * period, r.t1);
      if (!(to > from)) continue;
      for (Bezier& piece : pieces_of(*b, from, to)) pieces.push_back(std::move(piece));
    }
    if (pieces.empty()) pieces.push_back({lifted(evaluate(c, low).p, 1), lifted(evaluate(c, high).p, 1)});
  } else {
    const bool is_round = std::holds_alternative<CircleCurve>(c.shape) || std::holds_alternative<EllipseCurve>(c.shape);
    const int n = is_round ? std::max(1, static_cast<int>(std::ceil((high - low) / (kPi / 2) - 1e-9))) : 4;
    for (int k = 0; k < n; ++k) pieces.push_back(conic(c, low + (high - low) * k / n, low + (high - low) * (k + 1) / n));
  }
  if (is_back) {
    std::reverse(pieces.begin(), pieces.end());
    for (Bezier& piece : pieces) std::reverse(piece.begin(), piece.end());
  }
  return chained(std::move(pieces));
}

BSplineCurve joined(const std::vector<BSplineCurve>& curves) {
  std::vector<Bezier> pieces;
  for (const BSplineCurve& c : curves) {
    const KnotRange r = knot_range(c.knots, c.degree);
    for (Bezier& piece : pieces_of(c, r.t0, r.t1)) pieces.push_back(std::move(piece));
  }
  return chained(std::move(pieces));
}

std::optional<Curve> fitted(const std::function<std::optional<Vec3>(double)>& at, std::vector<double> breaks) {
  for (int round = 0; round < 12; ++round) {
    std::vector<double> finer{breaks.front()};
    std::vector<Bezier> pieces;
    bool is_fine = true;
    for (std::size_t k = 1; k < breaks.size(); ++k) {
      const double a = breaks[k - 1], b = breaks[k], h = b - a, e = 1e-5 * h;
      const auto p0 = at(a), p1 = at(b), p0_in = at(a + e), p1_in = at(b - e), m = at(0.5 * (a + b));
      if (!p0 || !p1 || !p0_in || !p1_in || !m) return std::nullopt;
      const Vec3 d0 = (*p0_in - *p0) / e, d1 = (*p1 - *p1_in) / e;
      const Vec3 middle = 0.5 * (*p0 + *p1) + h * (d0 - d1) / 8;
      pieces.push_back({lifted(*p0, 1), lifted(*p0 + h * d0 / 3, 1), lifted(*p1 - h * d1 / 3, 1), lifted(*p1, 1)});
      if ((middle - *m).norm() > 1e-6) finer.push_back(0.5 * (a + b)), is_fine = false;
      finer.push_back(b);
    }
    if (is_fine || round == 11 || finer.size() > 5000) return Curve{chained(std::move(pieces))};
    breaks = std::move(finer);
  }
  return std::nullopt;
}

std::optional<Curve> offset_in_space(const Curve& c, double distance, const Vec3& direction) {
  const auto shift = [&](const CurvePoint& e) -> std::optional<Vec3> {
    const Vec3 side = direction.cross(e.d1);
    if (!(side.norm() > 1e-9 * e.d1.norm())) return std::nullopt;
    return Vec3(e.p + distance * side.normalized());
  };
  if (const auto* l = std::get_if<LineCurve>(&c.shape)) {
    const auto p = shift(evaluate(c, 0));
    if (!p) return std::nullopt;
    return Curve{LineCurve{*p, l->direction}};
  }
  if (const auto* q = std::get_if<CircleCurve>(&c.shape); q && q->at.z.cross(direction).norm() < 1e-9) {
    // direction x tangent points inwards when the direction is the circle's own axis.
    const double r = q->radius_mm - (q->at.z.dot(direction) > 0 ? distance : -distance);
    if (r > 0) return Curve{CircleCurve{q->at, r}};
  }
  CurveDomain d = domain(c);
  if (!d.is_bounded) return std::nullopt;
  std::vector<double> breaks{d.t0, d.t1};
  if (const auto* b = std::get_if<BSplineCurve>(&c.shape)) {
    breaks.clear();
    for (double k : b->knots)
      if (k >= d.t0 && k <= d.t1 && (breaks.empty() || k > breaks.back())) breaks.push_back(k);
  }
  return fitted([&](double t) { return shift(evaluate(c, t)); }, breaks);
}

std::optional<Curve> profile_beside_axis(const RevolutionSurface& s, const std::vector<Vec3>& on_face, const std::vector<Vec3>& on_seam) {
  std::vector<Vec3> points = on_face;
  points.insert(points.end(), on_seam.begin(), on_seam.end());
  const auto arm = [&](const Vec3& p) {
    const Vec3 a = p - s.axis_point;
    return Vec3(a - s.axis * s.axis.dot(a));
  };
  double reach = 0;  // how far from the axis, or along it, the face goes
  for (const Vec3& p : points) reach = std::max(reach, (p - s.axis_point).norm());
  CurveDomain d = domain(s.profile);
  if (const auto* l = std::get_if<LineCurve>(&s.profile.shape)) {
    const Vec3 side = l->direction - s.axis * s.axis.dot(l->direction);
    if (side.norm() < 1e-9) return std::nullopt;
    const double t = -arm(l->origin).dot(side) / side.squaredNorm(), size = std::max({1.0, reach, std::abs(t)});
    if (arm(evaluate(s.profile, t).p).norm() > 1e-7 * size || points.empty()) return std::nullopt;
    double sum = 0, far = 0;
    for (const Vec3& p : points) {  // the half of the line whose turn passes p: same height
      const double rho = arm(p).norm(), h = s.axis.dot(p - s.axis_point);
      double best = 1e300, at = t;
      for (double x : {t + rho / side.norm(), t - rho / side.norm()}) {
        const double off = std::abs(s.axis.dot(evaluate(s.profile, x).p - s.axis_point) - h);
        if (off < best) best = off, at = x;
      }
      sum += at - t, far = std::max(far, std::abs(at - t));
    }
    if (!(far > 0)) return std::nullopt;
    double seam_sum = 0;
    for (const Vec3& p : on_seam)
      if (const CurveFoot g = project(s.profile, p); g.distance_mm < 1e-4) seam_sum += g.t - t;
    if (seam_sum != 0) sum = seam_sum;
    const double end = t + (sum >= 0 ? 2 : -2) * far;
    return Curve{sum >= 0 ? as_bspline(s.profile, t, end) : as_bspline(s.profile, end, t)};
  }
  if (!d.is_bounded || !(d.period() > 0)) return std::nullopt;
  // Crossings inside the range: minima of the distance from the axis that are zero.
  const auto rho = [&](double t) { return arm(evaluate(s.profile, t).p).norm(); };
  constexpr int n = 256;
  double size = 0;
  for (int k = 0; k < n; ++k) size = std::max(size, rho(d.t0 + d.period() * k / n));
  std::vector<double> crossings;
  for (int k = 0; k <= n; ++k) {
    if ((k == 0 || k == n) && !d.is_closed) continue;
    if (k == n) continue;
    double a = d.t0 + d.period() * (k - 1) / n, b = d.t0 + d.period() * (k + 1) / n;
    const double m = d.t0 + d.period() * k / n;
    if (rho(m) > rho(a) || rho(m) > rho(b)) continue;
    for (int i = 0; i < 80; ++i) {  // golden section
      const double x = a + 0.381966 * (b - a), y = a + 0.618034 * (b - a);
      (rho(x) < rho(y) ? b : a) = rho(x) < rho(y) ? y : x;
    }
    const double t = 0.5 * (a + b);
    if (rho(t) < 1e-7 * size && (crossings.empty() || t > crossings.back() + 1e-6 * d.period())) crossings.push_back(t);
  }
  if (crossings.empty()) return std::nullopt;
  std::vector<double> cuts = crossings;
  if (d.is_closed) {
    if (cuts.size() < 2) return std::nullopt;
    cuts.push_back(cuts.front() + d.period());
  } else {
    cuts.insert(cuts.begin(), d.t0), cuts.push_back(d.t1);
  }
  std::vector<double> votes(cuts.size() - 1, 0);
  for (const Vec3& p : on_seam) {
    const CurveFoot g = project(s.profile, p);
    if (g.distance_mm > 1e-4 || arm(p).norm() < 1e-6 * size) continue;
    for (std::size_t k = 0; k < votes.size(); ++k)
      for (double t : {g.t, g.t + d.period()}) votes[k] += t > cuts[k] && t < cuts[k + 1] ? static_cast<double>(points.size()) : 0;
  }
  for (const Vec3& p : points) {
    const double r = arm(p).norm(), h = s.axis.dot(p - s.axis_point);
    if (r < 1e-6 * size) continue;
    double best = 1e300;
    std::vector<double> off(votes.size(), 1e300);
    for (std::size_t k = 0; k < votes.size(); ++k) {
      for (int i = 0; i <= 64; ++i) {
        const Vec3 q = evaluate(s.profile, cuts[k] + (cuts[k + 1] - cuts[k]) * i / 64).p;
        off[k] = std::min(off[k], std::hypot(arm(q).norm() - r, s.axis.dot(q - s.axis_point) - h));
      }
      best = std::min(best, off[k]);
    }
    for (std::size_t k = 0; k < votes.size(); ++k) votes[k] += off[k] <= best + 0.02 * size;
  }
  const auto pick = static_cast<std::size_t>(std::max_element(votes.begin(), votes.end()) - votes.begin());
  return Curve{as_bspline(s.profile, cuts[pick], cuts[pick + 1])};
}

}  // namespace asbuilt::step
