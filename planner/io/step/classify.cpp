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
        // Arc length by Simpson's rule on the speed.
        const double dt = t[i] - t[i - 1];
        if (std::holds_alternative<LineCurve>(e.curve.shape) || std::holds_alternative<PolylineCurve>(e.curve.shape))
          s += (c.p - b.p.back()).norm();
        else
          s += std::abs(dt) / 6 *
               (evaluate(e.curve, t[i - 1]).d1.norm() + 4 * evaluate(e.curve, 0.5 * (t[i] + t[i - 1])).d1.norm() + c.d1.norm());
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
      b.is_seam = b.face_1 == b.face_2 && (b.kind == EdgeKind::smooth || b.kind == EdgeKind::near_tangent);
    }
    if (b.n_1.empty()) b.n_1.assign(b.p.size(), Vec3::Zero());
    if (b.n_2.empty()) b.n_2.assign(b.p.size(), Vec3::Zero());
    out.push_back(std::move(b));
  }
  return out;
}

}  // namespace asbuilt::step
