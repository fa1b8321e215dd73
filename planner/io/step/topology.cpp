// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/topology.hpp"

#include <algorithm>
#include <cmath>

#include "planner/io/step/curve_join.hpp"

namespace asbuilt::step {

using namespace p21;

namespace {

class BodyReader {
 public:
  BodyReader(const Binder& b, Body& body, std::vector<Unread>& unread) : b_(b), body_(body), unread_(unread) {}

  void read(std::int64_t id) {
    const Instance& i = b_.instance(id);
    body_.id = id, body_.line = i.line;
    const Args a = b_.args(i);
    if (b_.has(i, K_MANIFOLD_SOLID_BREP) || b_.has(i, K_BREP_WITH_VOIDS) || b_.has(i, K_FACETED_BREP)) {
      body_.is_solid = true;
      if (i.record_count > 1) {
        const Args m = b_.args(i, K_MANIFOLD_SOLID_BREP), v = b_.args(i, K_BREP_WITH_VOIDS);
        shell(b_.reference(i, m.at(m.size() > 1 ? 1 : 0)), true, false, 0);
        if (v.size())
          for (std::int64_t s : b_.references(i, v.at(v.size() - 1))) shell(s, true, true, 0);
        return;
      }
      shell(b_.reference(i, a.at(1)), true, false, 0);
      if (b_.key(i) == K_BREP_WITH_VOIDS)
        for (std::int64_t s : b_.references(i, a.at(2))) shell(s, true, true, 0);
    } else if (b_.key(i) == K_SHELL_BASED_SURFACE_MODEL || b_.key(i) == K_FACE_BASED_SURFACE_MODEL) {
      for (std::int64_t s : b_.references(i, a.at(1))) shell(s, true, false, 0);
    } else {
      shell(id, true, false, 0);
    }
  }

 private:
  void shell(std::int64_t id, bool is_forward, bool is_void, int depth) {
    try {
      const Instance& i = b_.instance(id);
      if (depth > 8) b_.fail(i, "shells refer to each other in a circle");
      const Args a = b_.args(i);
      switch (b_.key(i)) {
        case K_ORIENTED_CLOSED_SHELL:
        case K_ORIENTED_OPEN_SHELL:
          return shell(b_.reference(i, a.at(2)), b_.is_true(i, a.at(3)) == is_forward, is_void, depth + 1);
        case K_CLOSED_SHELL:
        case K_OPEN_SHELL:
        case K_CONNECTED_FACE_SET: {
          TopoShell s;
          s.id = id, s.is_closed = b_.key(i) == K_CLOSED_SHELL, s.is_void = is_void;
          body_.shells.push_back(s);
          const int k = static_cast<int>(body_.shells.size()) - 1;
          const std::vector<std::int64_t> ids = b_.references(i, a.at(1));
          body_.faces.reserve(body_.faces.size() + ids.size());
          for (std::int64_t f : ids) face(f, is_forward, k, 0);
          return;
        }
        case K_ADVANCED_FACE:
        case K_FACE_SURFACE: {
          TopoShell s;
          s.id = id, s.is_closed = false;
          body_.shells.push_back(s);
          return face(id, is_forward, static_cast<int>(body_.shells.size()) - 1, 0);
        }
        default:
          b_.fail(i, "a shell is expected here");
      }
    } catch (const StepFault& f) {
      note(f);
    }
  }

  void note(const StepFault& f) {
    if (unread_.size() < 1000)
      unread_.push_back({f.entity.empty() ? "#" + std::to_string(f.id) : f.entity, static_cast<int>(f.line), f.text()});
  }

  void face(std::int64_t id, bool is_forward, int shell, int depth) {
    TopoFace f;
    f.id = id, f.shell = shell;
    try {
      const Instance& i = b_.instance(id);
      f.line = i.line;
      const Args a = b_.args(i);
      if (depth > 8) b_.fail(i, "faces refer to each other in a circle");
      if (b_.key(i) == K_ORIENTED_FACE) return face(b_.reference(i, a.at(2)), b_.is_true(i, a.at(3)) == is_forward, shell, depth + 1);
      if (b_.key(i) != K_ADVANCED_FACE && b_.key(i) != K_FACE_SURFACE) b_.fail(i, "a face with a surface is expected here");
      const std::int64_t surface_id = b_.reference(i, a.at(2));
      f.same_sense = b_.is_true(i, a.at(3));
      for (std::int64_t bound : b_.references(i, a.at(1))) {
        const Instance& bi = b_.instance(bound);
        if (b_.key(bi) != K_FACE_BOUND && b_.key(bi) != K_FACE_OUTER_BOUND) b_.fail(bi, "a face bound is expected here");
        const Args ba = b_.args(bi);
        f.loops.push_back(loop(b_.reference(bi, ba.at(1)), b_.is_true(bi, ba.at(2))));
      }
      bool is_reversed = false;
      f.surface = surface(surface_id, is_reversed);
      if (is_reversed) f.same_sense = !f.same_sense;
      halve_revolution(f);
    } catch (const StepFault& e) {
      f.fault = e.text();
      note(e);
    }
    if (!is_forward) {
      f.same_sense = !f.same_sense;
      for (TopoLoop& l : f.loops) reverse(l);
    }
    const int k = static_cast<int>(body_.faces.size());
    for (const TopoLoop& l : f.loops)
      for (const EdgeUse& u : l.uses) {
        TopoEdge& e = body_.edges[static_cast<std::size_t>(u.edge)];
        e.uses.emplace_back(k, u.is_forward);
        if (e.is_chord && f.fault.empty())
          f.fault = "its edge #" + std::to_string(e.id) + " could not be read and is replaced by its chord";
      }
    body_.shells[static_cast<std::size_t>(shell)].faces.push_back(k);
    body_.faces.push_back(std::move(f));
  }

  static void reverse(TopoLoop& l) {
    std::reverse(l.uses.begin(), l.uses.end());
    for (EdgeUse& u : l.uses) u.is_forward = !u.is_forward;
  }

  int surface(std::int64_t id, bool& is_reversed) {
    const auto it = surfaces_.find(id);
    if (it != surfaces_.end()) {
      is_reversed = it->second.second;
      return it->second.first;
    }
    body_.surfaces.push_back(b_.surface(id, is_reversed));
    body_.domains.push_back(domain(body_.surfaces.back()));
    const int k = static_cast<int>(body_.surfaces.size()) - 1;
    surfaces_.emplace(id, std::pair{k, is_reversed});
    return k;
  }

  /// A surface turned from a profile that crosses its axis covers itself twice: the face keeps the part of the profile it lies on.
  void halve_revolution(TopoFace& f) {
    const auto* r = std::get_if<RevolutionSurface>(&body_.surfaces[static_cast<std::size_t>(f.surface)].shape);
    if (!r) return;
    std::vector<Vec3> on_face, on_seam;
    for (const TopoLoop& l : f.loops)
      for (const EdgeUse& u : l.uses) {
        const TopoEdge& e = body_.edges[static_cast<std::size_t>(u.edge)];
        const bool is_seam = std::count_if(l.uses.begin(), l.uses.end(), [&](const EdgeUse& o) { return o.edge == u.edge; }) > 1;
        for (double x : {0.0, 0.25, 0.5, 0.75}) (is_seam ? on_seam : on_face).push_back(evaluate(e.curve, e.t0 + (e.t1 - e.t0) * x).p);
      }
    const auto part = profile_beside_axis(*r, on_face, on_seam);
    if (!part) return;
    RevolutionSurface half = *r;
    half.profile = *part;
    body_.surfaces.push_back({std::move(half)});
    body_.domains.push_back(domain(body_.surfaces.back()));
    f.surface = static_cast<int>(body_.surfaces.size()) - 1;
  }

  TopoLoop loop(std::int64_t id, bool orientation) {
    const Instance& i = b_.instance(id);
    const Args a = b_.args(i);
    TopoLoop l;
    l.id = id;
    if (b_.key(i) == K_VERTEX_LOOP) {
      l.vertex = vertex(b_.reference(i, a.at(1)));
      return l;
    }
    if (b_.key(i) == K_POLY_LOOP) {
      const std::vector<std::int64_t> ids = b_.references(i, a.at(1));
      std::vector<int> v;
      for (std::int64_t p : ids) v.push_back(point_vertex(p));
      for (std::size_t k = 0; k < v.size(); ++k)
        if (v[k] != v[(k + 1) % v.size()]) l.uses.push_back(straight(v[k], v[(k + 1) % v.size()], i.line));
      if (l.uses.size() < 3) b_.fail(i, "a loop of fewer than three points");
      if (!orientation) reverse(l);
      return l;
    }
    if (b_.key(i) != K_EDGE_LOOP && !b_.has(i, K_EDGE_LOOP)) b_.fail(i, "an edge loop is expected here");
    const Value* list = b_.key(i) == K_EDGE_LOOP ? a.at(1) : b_.args(i, K_EDGE_LOOP).at(0);
    for (std::int64_t oe : b_.references(i, list)) {
      const Instance& oi = b_.instance(oe);
      const Args oa = b_.args(oi);
      if (b_.key(oi) == K_ORIENTED_EDGE) {
        l.uses.push_back({edge(b_.reference(oi, oa.at(3))), b_.is_true(oi, oa.at(4))});
      } else {
        l.uses.push_back({edge(oe), true});
      }
    }
    if (l.uses.empty()) b_.fail(i, "a loop without edges");
    // Poles and apexes written as edges of no length: the vertex alone says as much.
    const int vertex_at = body_.edges[static_cast<std::size_t>(l.uses.front().edge)].v0;
    std::erase_if(l.uses, [&](const EdgeUse& u) { return body_.edges[static_cast<std::size_t>(u.edge)].is_point; });
    if (l.uses.empty()) l.vertex = vertex_at;
    if (!orientation) reverse(l);
    return l;
  }

  int vertex(std::int64_t id) {
    const auto it = vertices_.find(id);
    if (it != vertices_.end()) return it->second;
    const Instance& i = b_.instance(id);
    if (b_.key(i) != K_VERTEX_POINT && !b_.has(i, K_VERTEX_POINT)) b_.fail(i, "a VERTEX_POINT is expected here");
    const Args a = b_.args(i, K_VERTEX_POINT);
    const int k = point_vertex(b_.reference(i, a.at(a.size() - 1)), id);
    vertices_.emplace(id, k);
    return k;
  }
  int point_vertex(std::int64_t point, std::int64_t vertex_id = 0) {
    if (vertex_id == 0) {
      const auto it = points_.find(point);
      if (it != points_.end()) return it->second;
    }
    body_.vertices.push_back({vertex_id ? vertex_id : point, b_.point(point)});
    const int k = static_cast<int>(body_.vertices.size()) - 1;
    if (vertex_id == 0) points_.emplace(point, k);
    return k;
  }

  EdgeUse straight(int v0, int v1, std::uint32_t line) {
    const auto key = std::pair{std::min(v0, v1), std::max(v0, v1)};
    const std::int64_t hash = static_cast<std::int64_t>(key.first) << 32 | key.second;
    const auto it = straights_.find(hash);
    if (it != straights_.end()) return {it->second, body_.edges[static_cast<std::size_t>(it->second)].v0 == v0};
    TopoEdge e;
    const Vec3 p0 = body_.vertices[static_cast<std::size_t>(v0)].p, d = body_.vertices[static_cast<std::size_t>(v1)].p - p0;
    e.v0 = v0, e.v1 = v1, e.line = line;
    e.curve = {LineCurve{p0, d.norm() > 0 ? Vec3(d.normalized()) : Vec3::UnitX()}};
    e.t0 = 0, e.t1 = d.norm();
    body_.edges.push_back(std::move(e));
    straights_.emplace(hash, static_cast<int>(body_.edges.size()) - 1);
    return {static_cast<int>(body_.edges.size()) - 1, true};
  }

  int edge(std::int64_t id) {
    const auto it = edges_.find(id);
    if (it != edges_.end()) {
      if (it->second < 0) throw StepFault{b_.instance(id).line, id, "EDGE_CURVE", "could not be read"};
      return it->second;
    }
    edges_.emplace(id, -1);
    const Instance& i = b_.instance(id);
    if (b_.key(i) != K_EDGE_CURVE && !b_.has(i, K_EDGE_CURVE)) b_.fail(i, "an EDGE_CURVE is expected here");
    const Args a = b_.args(i);
    TopoEdge e;
    e.id = id, e.line = i.line;
    e.v0 = vertex(b_.reference(i, a.at(1))), e.v1 = vertex(b_.reference(i, a.at(2)));
    bool is_reversed = !b_.is_true(i, a.at(4));
    try {
      const std::int64_t curve = b_.reference(i, a.at(3)), pcurve = b_.pcurve_alone(curve);
      e.curve = pcurve ? b_.curve_on_surface(pcurve, body_.vertices[static_cast<std::size_t>(e.v0)].p,
                                             body_.vertices[static_cast<std::size_t>(e.v1)].p, is_reversed)
                       : b_.curve(curve, is_reversed);
      range(e, is_reversed);
      if (e.is_closed) {
        e.is_point = true;
        for (int k = 1; k < 8 && e.is_point; ++k)
          e.is_point = (evaluate(e.curve, e.t0 + (e.t1 - e.t0) * k / 8).p - body_.vertices[static_cast<std::size_t>(e.v0)].p).norm() < 1e-7;
      }
    } catch (const StepFault& f) {  // the rest of its faces still comes in: the chord stands for it, and says so
      const Vec3 p0 = body_.vertices[static_cast<std::size_t>(e.v0)].p, d = body_.vertices[static_cast<std::size_t>(e.v1)].p - p0;
      if (!(d.norm() > 0)) throw;
      note(f);
      e.curve = {LineCurve{p0, d.normalized()}}, e.t0 = 0, e.t1 = d.norm();
      e.fault = "replaced by its chord: " + f.text(), e.is_chord = true;
    }
    body_.edges.push_back(std::move(e));
    const int k = static_cast<int>(body_.edges.size()) - 1;
    edges_[id] = k;
    return k;
  }

  /// Curve parameters at the two vertices, in the direction of the edge.
  void range(TopoEdge& e, bool is_reversed) {
    const Vec3 p0 = body_.vertices[static_cast<std::size_t>(e.v0)].p, p1 = body_.vertices[static_cast<std::size_t>(e.v1)].p;
    const CurveDomain d = domain(e.curve);
    e.is_closed = e.v0 == e.v1;
    CurveFoot f0 = project(e.curve, p0), f1 = e.is_closed ? f0 : project(e.curve, p1);
    const double off = std::max(f0.distance_mm, f1.distance_mm), limit = std::max(10 * b_.units.uncertainty_mm, 0.01);
    if (off > limit) e.fault = "a vertex is " + std::to_string(off) + " mm off its curve";
    e.t0 = f0.t, e.t1 = f1.t;
    const double period = d.period();
    if (d.is_closed) {
      const double scale = period > 0 ? 1e-9 * period : 0;
      const bool is_whole = e.is_closed || ((p0 - p1).norm() < 1e-7 && std::abs(e.t0 - e.t1) < 1e-3 * period);
      if (is_whole) {
        e.t1 = e.t0 + (is_reversed ? -period : period);
      } else if (!is_reversed) {
        while (e.t1 <= e.t0 + scale) e.t1 += period;
        while (e.t1 > e.t0 + period + scale) e.t1 -= period;
      } else {
        while (e.t1 >= e.t0 - scale) e.t1 -= period;
        while (e.t1 < e.t0 - period - scale) e.t1 += period;
      }
    } else if (e.is_closed && d.is_bounded) {  // a closed edge on a curve whose ends nearly meet
      e.t0 = is_reversed ? d.t1 : d.t0, e.t1 = is_reversed ? d.t0 : d.t1;
    } else if ((e.t1 < e.t0) != is_reversed && std::abs(e.t1 - e.t0) > 1e-12 && d.is_bounded && e.fault.empty()) {
      // The sense says otherwise: the vertices rule, as they are what the loops are made of.
    }
  }

  const Binder& b_;
  Body& body_;
  std::vector<Unread>& unread_;
  std::unordered_map<std::int64_t, int> vertices_, points_, edges_, straights_;
  std::unordered_map<std::int64_t, std::pair<int, bool>> surfaces_;
};

/// Where a loop goes from one edge to the next over two vertices at one place, they become one, as the loop means them to be.
void unite_vertices(Body& body, double reach_mm) {
  std::vector<int> root(body.vertices.size());
  for (std::size_t k = 0; k < root.size(); ++k) root[k] = static_cast<int>(k);
  const auto find = [&](int k) {
    while (root[static_cast<std::size_t>(k)] != k)
      k = root[static_cast<std::size_t>(k)] = root[static_cast<std::size_t>(root[static_cast<std::size_t>(k)])];
    return k;
  };
  const auto apart = [&](int a, int b) {
    return (body.vertices[static_cast<std::size_t>(a)].p - body.vertices[static_cast<std::size_t>(b)].p).norm();
  };
  bool any = false;
  for (const TopoFace& f : body.faces)
    for (const TopoLoop& l : f.loops)
      for (std::size_t k = 0; k < l.uses.size(); ++k) {
        const EdgeUse &u = l.uses[k], &w = l.uses[(k + 1) % l.uses.size()];
        const TopoEdge &e = body.edges[static_cast<std::size_t>(u.edge)], &g = body.edges[static_cast<std::size_t>(w.edge)];
        const int a = find(u.is_forward ? e.v1 : e.v0), b = find(w.is_forward ? g.v0 : g.v1);
        if (a == b || apart(a, b) > reach_mm) continue;
        root[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b), any = true;
      }
  if (!any) return;
  for (TopoEdge& e : body.edges) {
    const int a = find(e.v0), b = find(e.v1);
    if (a == b && e.v0 != e.v1) {  // the whole of a closed curve, or an edge shorter than the reach
      const CurveDomain d = domain(e.curve);
      e.is_closed = d.is_closed && std::abs(std::abs(e.t1 - e.t0) - d.period()) < 1e-3 * d.period();
    }
    e.v0 = a, e.v1 = b;
  }
}

}  // namespace

Body read_body(const Binder& b, std::int64_t id, std::vector<Unread>& unread) {
  Body body;
  try {
    BodyReader(b, body, unread).read(id);
  } catch (const StepFault& f) {
    unread.push_back({f.entity, static_cast<int>(f.line), f.text()});
  }
  unite_vertices(body, 1e-6);
  return body;
}

void reverse_loops(Body& body, int face) {
  std::vector<int> edges;
  for (TopoLoop& l : body.faces[static_cast<std::size_t>(face)].loops) {
    std::reverse(l.uses.begin(), l.uses.end());
    for (EdgeUse& u : l.uses) u.is_forward = !u.is_forward, edges.push_back(u.edge);
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  for (int e : edges)
    for (auto& [f, forward] : body.edges[static_cast<std::size_t>(e)].uses)
      if (f == face) forward = !forward;
}

void reverse_shell(Body& body, int shell) {
  for (int k : body.shells[static_cast<std::size_t>(shell)].faces) {
    body.faces[static_cast<std::size_t>(k)].same_sense = !body.faces[static_cast<std::size_t>(k)].same_sense;
    reverse_loops(body, k);
  }
}

}  // namespace asbuilt::step
