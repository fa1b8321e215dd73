// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/lift.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::step {
namespace {

std::vector<Pole> poles_of(const Surface& s, const SurfaceDomain& d) {
  std::vector<Pole> out;
  const double u = d.u0 > -1e200 ? d.u0 : 0, v = d.v0 > -1e200 ? d.v0 : 0;
  if (d.is_pole_v0) out.push_back({1, false, d.v0, evaluate_jet(s, u, d.v0).p});
  if (d.is_pole_v1) out.push_back({1, true, d.v1, evaluate_jet(s, u, d.v1).p});
  if (d.is_pole_u0) out.push_back({0, false, d.u0, evaluate_jet(s, d.u0, v).p});
  if (d.is_pole_u1) out.push_back({0, true, d.u1, evaluate_jet(s, d.u1, v).p});
  return out;
}

}  // namespace

Lifted loop_points(const Body& body, const TopoLoop& loop, bool is_reversed, const std::vector<Vec3>& vertices) {
  Lifted out;
  const std::size_t n = loop.uses.size();
  for (std::size_t k = 0; k < n; ++k) {
    EdgeUse u = loop.uses[is_reversed ? n - 1 - k : k];
    if (is_reversed) u.is_forward = !u.is_forward;
    const TopoEdge& e = body.edges[static_cast<std::size_t>(u.edge)];
    const std::size_t m = e.t.size();
    const bool is_line = std::holds_alternative<LineCurve>(e.curve.shape) || std::holds_alternative<PolylineCurve>(e.curve.shape);
    for (std::size_t i = 0; i + 1 < m; ++i) {
      const std::size_t a = u.is_forward ? i : m - 1 - i, b = u.is_forward ? i + 1 : m - 2 - i;
      LiftedPoint q;
      q.vertex = e.vertex[a];
      q.p = vertices[static_cast<std::size_t>(q.vertex)];
      q.edge = u.edge, q.t_a = e.t[a], q.t_b = e.t[b];
      if (!is_line) q.has_mid = true, q.p_mid = evaluate(e.curve, 0.5 * (e.t[a] + e.t[b])).p;
      out.push_back(q);
    }
  }
  return out;
}

Vec3 area_vector(const Lifted& l) {
  Vec3 a = Vec3::Zero();
  for (std::size_t i = 0; i < l.size(); ++i) a += (l[i].p - l[0].p).cross(l[(i + 1) % l.size()].p - l[0].p);
  return 0.5 * a;
}

Lifter::Lifter(const Surface& s, const SurfaceDomain& d) : s_(s), d_(d), walk_(s, d), poles_(poles_of(s, d)) {
  if (d.is_periodic_u) period_.u = d.u1 - d.u0;
  if (d.is_periodic_v) period_.v = d.v1 - d.v0;
}

const Pole* Lifter::pole_at(const Vec3& p) const {
  for (const Pole& q : poles_)
    if ((q.p - p).norm() < 1e-5 + 1e-7 * q.p.norm()) return &q;
  return nullptr;
}

Vec2 Lifter::lift(const Vec3& p, const std::optional<Vec2>& seed) {
  Vec2 uv = raw(p, seed);
  return seed ? near_to(uv, *seed) : uv;
}

bool Lifter::lift_loop(Lifted& loop, int& wind_u, int& wind_v) {
  std::size_t start = 0;
  while (start < loop.size() && pole_at(loop[start].p)) ++start;
  if (start == loop.size()) return false;
  std::rotate(loop.begin(), loop.begin() + static_cast<std::ptrdiff_t>(start), loop.end());
  Lifted out;
  std::optional<Vec2> seed;
  const Pole* pole = nullptr;
  const std::size_t n = loop.size();
  for (std::size_t i = 0; i <= n; ++i) {
    LiftedPoint q = loop[i % n];
    if (const Pole* here = i < n ? pole_at(q.p) : nullptr) {
      pole = here;
      q.uv = *seed;
      q.uv[here->axis] = here->value;
      out.push_back(q);
      seed = q.uv;
      continue;
    }
    Vec2 uv = lift(q.p, seed);
    if (pole) {
      const int a = 1 - pole->axis;
      const double period = a == 0 ? period_.u : period_.v;
      // Interior on the left: at the upper border the walk goes down in the other parameter, at the lower one up (v borders).
      const bool goes_up = pole->axis == 1 ? !pole->is_high : pole->is_high;
      if (period > 0) {
        double delta = uv[a] - (*seed)[a];
        if (goes_up) {
          while (delta <= 1e-7 * period) delta += period;
          while (delta > period * (1 + 1e-7)) delta -= period;
        } else {
          while (delta >= -1e-7 * period) delta -= period;
          while (delta < -period * (1 + 1e-7)) delta += period;
        }
        uv[a] = (*seed)[a] + delta;
      }
      // The pole seen from the next point; the piece along the border gets steps of its own.
      const LiftedPoint at_pole = out.back();
      out.back().has_mid = false, out.back().edge = -1;
      const int steps = period > 0 ? std::max(1, static_cast<int>(std::ceil(std::abs(uv[a] - (*seed)[a]) / (period / 24)))) : 8;
      for (int k = 1; k <= steps; ++k) {
        LiftedPoint r = at_pole;
        r.uv[a] = (*seed)[a] + (uv[a] - (*seed)[a]) * k / steps;
        r.has_mid = k == steps && at_pole.has_mid;
        r.edge = k == steps ? at_pole.edge : -1;
        out.push_back(r);
      }
      pole = nullptr;
    }
    if (i == n) {
      const Vec2 turn = uv - out.front().uv;
      wind_u = period_.u > 0 ? static_cast<int>(std::lround(turn.x() / period_.u)) : 0;
      wind_v = period_.v > 0 ? static_cast<int>(std::lround(turn.y() / period_.v)) : 0;
      break;
    }
    q.uv = uv;
    out.push_back(q);
    seed = uv;
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (!out[i].has_mid) continue;
    Vec2 next = out[(i + 1) % out.size()].uv;
    if (i + 1 == out.size()) next += Vec2(wind_u * period_.u, wind_v * period_.v);
    const Vec2 guess = 0.5 * (out[i].uv + next);
    out[i].uv_mid = lift(out[i].p_mid, guess);
    if ((out[i].uv_mid - guess).norm() > 0.5 * (next - out[i].uv).norm() + 1e-12) out[i].has_mid = false;
  }
  loop = std::move(out);
  return true;
}

Vec2 Lifter::near_to(Vec2 uv, const Vec2& seed) const {
  if (period_.u > 0) uv.x() += period_.u * std::round((seed.x() - uv.x()) / period_.u);
  if (period_.v > 0) uv.y() += period_.v * std::round((seed.y() - uv.y()) / period_.v);
  return uv;
}

Vec2 Lifter::raw(const Vec3& p, const std::optional<Vec2>& seed) {
  const SurfaceFoot f = walk_.at(p, seed);
  worst_mm = std::max(worst_mm, (f.p - p).norm());
  return {f.u, f.v};
}

}  // namespace asbuilt::step
