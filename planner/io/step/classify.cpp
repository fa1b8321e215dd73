// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/classify.hpp"

#include <algorithm>
#include <cmath>

#include "planner/io/step/foot_walk.hpp"

namespace asbuilt::step {
namespace {

/// Outward normals of one face along the samples.
void normals_along(const Body& body, int face, const std::vector<Vec3>& p, std::vector<Vec3>& out, double& off_mm) {
  const TopoFace& f = body.faces[static_cast<std::size_t>(face)];
  out.assign(p.size(), Vec3::Zero());
  if (f.surface < 0) return;
  const Surface& s = body.surfaces[static_cast<std::size_t>(f.surface)];
  const SurfaceDomain& d = body.domains[static_cast<std::size_t>(f.surface)];
  const double sign = f.same_sense ? 1 : -1;
  if (const auto* plane = std::get_if<PlaneSurface>(&s.shape)) {
    for (std::size_t i = 0; i < p.size(); ++i) out[i] = sign * plane->at.z;
    off_mm = std::max(off_mm, std::abs(plane->at.z.dot(p[p.size() / 2] - plane->at.origin)));
    return;
  }
  std::optional<Vec2> seed;
  FootWalk walk(s, d);
  for (std::size_t i = 0; i < p.size(); ++i) {
    const SurfaceFoot g = walk.at(p[i], seed);
    seed = Vec2(g.u, g.v);
    out[i] = sign * g.n;
    off_mm = std::max(off_mm, (g.p - p[i]).norm());
  }
  // An apex or a pole at an end has no normal of its own: the one a little inside counts.
  const std::size_t n = p.size();
  for (const std::size_t end : {std::size_t{0}, n - 1}) {
    const Vec3 chord = p[end ? n - 2 : 1] - p[end];
    if (n < 2 || chord.norm() < 2 * kNormalReach_mm) continue;
    const Vec3 inside = sign * walk.at(p[end] + kNormalReach_mm / chord.norm() * chord, std::nullopt).n;
    if (!is_settled(out[end], inside, rad_from_deg(1))) out[end] = inside;
  }
}

/// Gauss's rule of five points on the speed, halved until both agree.
double gauss_length(const Curve& c, double a, double b, double whole, int depth) {
  constexpr double x[] = {0, 0.5384693101056831, 0.9061798459386640}, w[] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  const auto rule = [&](double l, double h) {
    const double m = 0.5 * (l + h), r = 0.5 * (h - l);
    double sum = w[0] * evaluate(c, m).d1.norm();
    for (int k = 1; k < 3; ++k) sum += w[k] * (evaluate(c, m - r * x[k]).d1.norm() + evaluate(c, m + r * x[k]).d1.norm());
    return sum * std::abs(r);
  };
  const double m = 0.5 * (a + b), left = rule(a, m), right = rule(m, b);
  if (depth >= 8 || std::abs(left + right - whole) <= 1e-7 * (left + right) + 1e-12) return left + right;
  return gauss_length(c, a, m, left, depth + 1) + gauss_length(c, m, b, right, depth + 1);
}

double arc_length(const Curve& c, double a, double b, const Vec3& p_a, const Vec3& p_b) {
  if (std::holds_alternative<LineCurve>(c.shape) || std::holds_alternative<PolylineCurve>(c.shape)) return (p_b - p_a).norm();
  if (const auto* circle = std::get_if<CircleCurve>(&c.shape)) return circle->radius_mm * std::abs(b - a);
  double low = std::min(a, b), sum = 0;
  const double high = std::max(a, b);
  if (const auto* s = std::get_if<BSplineCurve>(&c.shape)) {  // the speed jumps or kinks at knots
    const CurveDomain d = domain(c);
    const double turns = d.is_closed ? d.period() * std::floor((low - d.t0) / d.period()) : 0;
    for (int turn = 0; turn < 2; ++turn) {
      const double shift = turns + turn * d.period();
      for (auto k = std::upper_bound(s->knots.begin(), s->knots.end(), low - shift); k != s->knots.end() && *k + shift < high; ++k)
        if (*k + shift > low && *k >= d.t0 && *k <= d.t1) sum += gauss_length(c, low, *k + shift, 0, 0), low = *k + shift;
      if (!d.is_closed) break;
    }
  }
  return sum + gauss_length(c, low, high, 0, 0);
}

std::vector<double> finer(const TopoEdge& e, double step_mm, double step_rad) {
  Tolerance t;
  t.chord_mm = 1e9, t.angle_rad = step_rad;
  std::vector<double> coarse = sample_curve(e.curve, e.t0, e.t1, t, e.is_closed ? 8 : 1), out{coarse.front()};
  Vec3 a = evaluate(e.curve, coarse.front()).p;
  for (std::size_t i = 1; i < coarse.size(); ++i) {
    const Vec3 b = evaluate(e.curve, coarse[i]).p;
    const int n = std::clamp(static_cast<int>(std::ceil((b - a).norm() / step_mm - 1e-6)), 1, 2000);
    for (int k = 1; k <= n; ++k) out.push_back(coarse[i - 1] + (coarse[i] - coarse[i - 1]) * k / n);
    a = b;
  }
  while (out.size() < 9) {  // enough for a median and a change of sign
    std::vector<double> more{out[0]};
    for (std::size_t i = 1; i < out.size(); ++i) more.push_back(0.5 * (out[i - 1] + out[i])), more.push_back(out[i]);
    out = std::move(more);
  }
  return out;
}

/// Faces that leave an edge side by side: material between them is a knife, none is a slot; the sign of the cross product cannot tell.
EdgeKind knife_or_slot(const Body& body, const BrepEdge& b) {
  const std::size_t m = b.p.size() / 2;
  const Vec3 n = b.n_1[m], q = b.p[m] + std::min(0.1 * b.length_mm, 0.1) * n.cross(b.tangent[m]).normalized();
  Vec3 foot[2];
  for (int k = 0; k < 2; ++k) {
    const int s = body.faces[static_cast<std::size_t>(k ? b.face_2 : b.face_1)].surface;
    foot[k] = project(body.surfaces[static_cast<std::size_t>(s)], body.domains[static_cast<std::size_t>(s)], q).p;
  }
  return (foot[1] - foot[0]).dot(n) <= 0 ? EdgeKind::sharp_convex : EdgeKind::sharp_concave;
}

}  // namespace

std::vector<BrepEdge> classify_edges(const Body& body, double step_mm, double step_rad) {
  std::vector<BrepEdge> out;
  out.reserve(body.edges.size());
  for (const TopoEdge& e : body.edges) {
    BrepEdge b;
    b.id = "#" + std::to_string(e.id);
    if (e.id == 0)  // a side of a polygon has no entity of its own: its two points name it
      b.id = "#" + std::to_string(body.vertices[static_cast<std::size_t>(e.v0)].id) + "-#" +
             std::to_string(body.vertices[static_cast<std::size_t>(e.v1)].id);
    b.fault = e.fault;
    b.curve = e.curve;
    b.curve_type = std::string(curve_type(e.curve));
    b.is_closed = e.is_closed;
    std::vector<double> t = finer(e, step_mm, step_rad);
    bool forward = e.t1 >= e.t0;
    if (!e.uses.empty() && !e.uses[0].second) std::reverse(t.begin(), t.end()), forward = !forward;
    double s = 0;
    for (std::size_t i = 0; i < t.size(); ++i) {
      const CurvePoint c = evaluate(e.curve, t[i]);
      if (i > 0) {
        s += arc_length(e.curve, t[i - 1], t[i], b.p.back(), c.p);
      }
      b.s_mm.push_back(s);
      b.p.push_back(c.p);
      const double l = c.d1.norm();
      b.tangent.push_back(l > 0 ? Vec3((forward ? 1 : -1) * c.d1 / l) : Vec3::Zero());
    }
    for (std::size_t i = 0; i < b.p.size(); ++i) {  // a derivative that vanishes or turns back at a knot: the chord instead
      const Vec3 chord = b.p[std::min(i + 1, b.p.size() - 1)] - b.p[i > 0 ? i - 1 : 0];
      if (b.tangent[i].dot(chord) <= 0 && chord.norm() > 0) b.tangent[i] = chord.normalized();
    }
    if (b.is_closed) b.p.back() = b.p.front();
    b.length_mm = s;
    double off = 0;
    if (e.uses.size() >= 1) b.face_1 = e.uses[0].first, normals_along(body, b.face_1, b.p, b.n_1, off);
    if (e.uses.size() >= 2) b.face_2 = e.uses[1].first, normals_along(body, b.face_2, b.p, b.n_2, off);
    if (off > 0.01 && b.fault.empty()) b.fault = "lies " + std::to_string(off) + " mm off its surfaces";
    const auto readable = [&](int f) { return body.faces[static_cast<std::size_t>(f)].surface >= 0; };
    if (e.uses.size() > 2) {
      b.kind = EdgeKind::nonmanifold;
    } else if (e.uses.size() < 2) {
      b.kind = EdgeKind::boundary;
    } else if (!readable(b.face_1) || !readable(b.face_2)) {
      b.kind = EdgeKind::boundary;
      if (b.fault.empty()) b.fault = "a face beside it could not be read";
    } else {
      b.kind = edge_kind(b.s_mm, b.tangent, b.n_1, b.n_2, b.dihedral_rad);
      if (b.dihedral_rad > rad_from_deg(179)) b.kind = knife_or_slot(body, b);
      b.is_seam = b.face_1 == b.face_2 && (b.kind == EdgeKind::smooth || b.kind == EdgeKind::near_tangent);
    }
    if (b.n_1.empty()) b.n_1.assign(b.p.size(), Vec3::Zero());
    if (b.n_2.empty()) b.n_2.assign(b.p.size(), Vec3::Zero());
    out.push_back(std::move(b));
  }
  return out;
}

}  // namespace asbuilt::step
