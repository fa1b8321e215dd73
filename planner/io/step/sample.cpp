// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/sample.hpp"

#include <algorithm>
#include <cmath>

#include "planner/io/step/foot_walk.hpp"

namespace asbuilt::step {
namespace {

void bisect(const Curve& c, double ta, const CurvePoint& a, double tb, const CurvePoint& b, const Tolerance& tol, int depth,
            std::vector<double>& out) {
  const double tm = 0.5 * (ta + tb);
  const CurvePoint m = evaluate(c, tm);
  const Vec3 chord = b.p - a.p;
  const double l = chord.norm();
  const auto off = [&](const Vec3& p) { return l > 0 ? (p - a.p).cross(chord).norm() / l : (p - a.p).norm(); };
  const auto turn = [](const Vec3& x, const Vec3& y) { return std::atan2(x.cross(y).norm(), x.dot(y)); };
  bool split = off(m.p) > tol.chord_mm || (l > 1e-7 && (turn(a.d1, m.d1) > 0.5 * tol.angle_rad || turn(m.d1, b.d1) > 0.5 * tol.angle_rad) &&
                                           off(m.p) > 1e-6 + 1e-4 * l * tol.angle_rad);
  if (!split && depth < 3 && l > tol.chord_mm)  // an S-curve passes through the middle of its chord
    split = std::max(off(evaluate(c, ta + 0.25 * (tb - ta)).p), off(evaluate(c, ta + 0.75 * (tb - ta)).p)) > tol.chord_mm;
  if (split && depth < 12 && out.size() < 50000) {
    bisect(c, ta, a, tm, m, tol, depth + 1, out);
    bisect(c, tm, m, tb, b, tol, depth + 1, out);
  } else {
    out.push_back(tb);
  }
}

}  // namespace

bool is_settled(const Vec3& normal, const Vec3& inside, double angle_rad) {
  return inside.isZero() || (!normal.isZero() && std::atan2(normal.cross(inside).norm(), normal.dot(inside)) <= 0.5 * angle_rad);
}

std::vector<double> sample_curve(const Curve& c, double t0, double t1, const Tolerance& tol, int count_min) {
  std::vector<double> breaks{t0};
  const auto uniform = [&](int n) {
    for (int i = 1; i < n; ++i) breaks.push_back(t0 + (t1 - t0) * i / n);
    breaks.push_back(t1);
  };
  if (std::holds_alternative<LineCurve>(c.shape)) {
    uniform(count_min);
    return breaks;
  }
  if (const auto* q = std::get_if<CircleCurve>(&c.shape)) {
    double step = tol.angle_rad;
    if (q->radius_mm > 0.5 * tol.chord_mm) step = std::min(step, 2 * std::acos(std::max(0.0, 1 - tol.chord_mm / q->radius_mm)));
    const double n = std::ceil(std::abs(t1 - t0) / std::max(step, 1e-3) - 1e-9);
    uniform(std::clamp(static_cast<int>(n), count_min, 7000));
    return breaks;
  }
  if (std::holds_alternative<PolylineCurve>(c.shape)) {
    if (t1 > t0)
      for (double k = std::floor(t0 + 1e-9) + 1; k < t1 - 1e-9; ++k) breaks.push_back(k);
    else
      for (double k = std::ceil(t0 - 1e-9) - 1; k > t1 + 1e-9; --k) breaks.push_back(k);
    breaks.push_back(t1);
    return breaks;
  }
  if (const auto* b = std::get_if<BSplineCurve>(&c.shape)) {
    const CurveDomain d = domain(c);
    const double low = std::min(t0, t1), high = std::max(t0, t1), eps = 1e-9 * d.period();
    std::vector<double> inner;
    for (int turn = -1; turn <= 1; ++turn) {
      if (turn != 0 && !d.is_closed) continue;
      for (std::size_t k = static_cast<std::size_t>(b->degree); k < b->knots.size() - static_cast<std::size_t>(b->degree); ++k) {
        const double t = b->knots[k] + turn * d.period();
        if (t > low + eps && t < high - eps && (inner.empty() || t > inner.back() + eps)) inner.push_back(t);
      }
    }
    if (inner.size() > 400) {  // very many spans: let bisection find the detail
      std::vector<double> some;
      for (std::size_t k = 0; k < 400; ++k) some.push_back(inner[k * inner.size() / 400]);
      inner = some;
    }
    if (t1 < t0) std::reverse(inner.begin(), inner.end());
    breaks.insert(breaks.end(), inner.begin(), inner.end());
    breaks.push_back(t1);
  } else {
    uniform(4);
  }
  while (static_cast<int>(breaks.size()) < count_min + 1) {
    std::vector<double> finer{breaks[0]};
    for (std::size_t i = 1; i < breaks.size(); ++i) finer.push_back(0.5 * (breaks[i - 1] + breaks[i])), finer.push_back(breaks[i]);
    breaks = finer;
  }
  std::vector<double> out{t0};
  CurvePoint a = evaluate(c, breaks[0]);
  for (std::size_t i = 1; i < breaks.size(); ++i) {
    const CurvePoint b = evaluate(c, breaks[i]);
    bisect(c, breaks[i - 1], a, breaks[i], b, tol, 0, out);
    a = b;
  }
  if (count_min <= 1 && out.size() > 2) {  // spans far below the tolerance are merged again
    std::vector<double> kept{out[0]};
    std::vector<Vec3> p;
    for (double t : out) p.push_back(evaluate(c, t).p);
    std::size_t last = 0;
    for (std::size_t i = 1; i + 1 < out.size(); ++i) {
      const Vec3 chord = p[i + 1] - p[last];
      const double l = chord.norm();
      double worst = 0;
      for (std::size_t k = last + 1; k <= i; ++k) worst = std::max(worst, l > 0 ? (p[k] - p[last]).cross(chord).norm() / l : 0.0);
      if (l < 2 * tol.chord_mm && worst < 0.2 * tol.chord_mm && i - last < 16) continue;
      kept.push_back(out[i]), last = i;
    }
    kept.push_back(out.back());
    return kept;
  }
  return out;
}

namespace {

/// Parameters added where the normal of a face beside the edge turns by more than the angle between two samples.
void follow_normals(const Body& body, TopoEdge& e, double angle_rad) {
  const bool is_line = std::holds_alternative<LineCurve>(e.curve.shape);
  for (std::size_t use = 0; use < std::min<std::size_t>(e.uses.size(), 2); ++use) {
    const TopoFace& f = body.faces[static_cast<std::size_t>(e.uses[use].first)];
    if (f.surface < 0 || (use == 1 && e.uses[0].first == e.uses[1].first)) continue;
    const Surface& s = body.surfaces[static_cast<std::size_t>(f.surface)];
    const SurfaceDomain& d = body.domains[static_cast<std::size_t>(f.surface)];
    if (std::holds_alternative<PlaneSurface>(s.shape)) continue;
    if (is_line && (std::holds_alternative<CylinderSurface>(s.shape) || std::holds_alternative<ConeSurface>(s.shape))) continue;
    std::optional<Vec2> seed;
    FootWalk walk(s, d);
    const auto normal_at = [&](const Vec3& p) -> Vec3 {
      const SurfaceFoot g = walk.at(p, seed);
      seed = Vec2(g.u, g.v);
      const SurfaceJet j = evaluate_jet(s, g.u, g.v, 1);
      const bool is_pole = j.du.cross(j.dv).norm() < 1e-6 * std::max(j.du.squaredNorm(), j.dv.squaredNorm());
      return is_pole ? Vec3(Vec3::Zero()) : g.n;
    };
    const auto point = [&](double t) -> Vec3 {  // ends are the vertices, which need not lie on the curve
      const int end = t == e.t.front() ? e.v0 : t == e.t.back() ? e.v1 : -1;
      return end < 0 ? evaluate(e.curve, t).p : body.vertices[static_cast<std::size_t>(end)].p;
    };
    const auto turn_of = [](const Vec3& a, const Vec3& b) {
      return a.isZero() || b.isZero() ? 0 : std::atan2(a.cross(b).norm(), a.dot(b));
    };
    for (int round = 0; round < 10 && e.t.size() < 20000; ++round) {
      std::vector<double> t{e.t[0]};
      seed.reset();
      Vec3 p = point(e.t[0]), a = normal_at(p);
      for (std::size_t i = 1; i < e.t.size(); ++i) {
        const Vec3 q = point(e.t[i]), b = normal_at(q);
        double turn = turn_of(a, b);
        const double l = (q - p).norm();
        if (turn > angle_rad || a.isZero() || b.isZero()) {  // an end may have no normal of its own: it is taken a little inside then
          const double part = l > 2 * kNormalReach_mm ? kNormalReach_mm / l : 0.5;
          seed.reset();  // where sides run together the way from foot to foot may lead astray
          const Vec3 a_in = normal_at(p + part * (q - p));
          seed.reset();
          const Vec3 b_in = normal_at(q + part * (p - q));
          turn = turn_of(is_settled(a, a_in, angle_rad) ? a : a_in, is_settled(b, b_in, angle_rad) ? b : b_in);
        }
        const int n = std::clamp(static_cast<int>(std::ceil(turn / angle_rad - 1e-3)), 1, 16);
        for (int k = 1; k < n; ++k) t.push_back(e.t[i - 1] + (e.t[i] - e.t[i - 1]) * k / n);
        t.push_back(e.t[i]);
        p = q, a = b;
      }
      if (t.size() == e.t.size()) break;
      e.t = std::move(t);
    }
  }
}

}  // namespace

void sample_edges(Body& body, const Tolerance& tol, std::vector<Vec3>& vertices) {
  vertices.clear();
  for (const TopoVertex& v : body.vertices) vertices.push_back(v.p);
  for (TopoEdge& e : body.edges) {
    e.t = sample_curve(e.curve, e.t0, e.t1, tol, e.is_closed ? 4 : 1);
    follow_normals(body, e, tol.angle_rad);
    if (!e.t_extra.empty()) {
      e.t.insert(e.t.end(), e.t_extra.begin(), e.t_extra.end());
      std::sort(e.t.begin(), e.t.end());
      const double gap = 1e-9 * std::abs(e.t1 - e.t0);
      e.t.erase(std::unique(e.t.begin(), e.t.end(), [&](double a, double b) { return b - a <= gap; }), e.t.end());
      if (e.t1 < e.t0) std::reverse(e.t.begin(), e.t.end());
      e.t.front() = e.t0, e.t.back() = e.t1;
    }
    e.vertex.assign(e.t.size(), -1);
    e.vertex.front() = e.v0, e.vertex.back() = e.v1;
    for (std::size_t i = 1; i + 1 < e.t.size(); ++i) {
      e.vertex[i] = static_cast<int>(vertices.size());
      vertices.push_back(evaluate(e.curve, e.t[i]).p);
    }
  }
}

}  // namespace asbuilt::step
