// SPDX-License-Identifier: GPL-3.0-or-later
// A mesh held against the exact surfaces and the topology it came from, by means the reader does not use.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <unordered_map>
#include <vector>

#include "planner/geom/brep.hpp"
#include "planner/io/step/model.hpp"
#include "planner/io/step/topology.hpp"

namespace asbuilt::test {

struct ChordCheck {
  double worst_mm = 0;        // of all samples on all triangles, less the gap of the file's own edges
  double worst_edge_mm = 0;   // of samples on mesh sides between two faces, to the exact curve
  double worst_gap_mm = 0;    // how far the file's own edges lie off their surfaces: no mesh can be nearer
  double worst_turn_rad = 0;  // normals of one face at the two ends of a mesh side
  std::size_t samples = 0, over = 0, turns_over = 0, turns = 0;  // over the limits given
  std::size_t singular = 0, short_singular = 0;  // sides held only because an end has no normal of its own; of these shorter than 2 um
  std::string face, turn_face;                   // of the worst
};

/// Distance of samples inside the triangles and on their sides from the exact surface of their face: barycentric grid of `n`
/// pieces a side. `limit_mm` and `limit_rad` are only for counting.
inline ChordCheck check_chords(const Brep& b, int n, double limit_mm, double limit_rad) {
  ChordCheck out;
  struct FaceData {
    SurfaceDomain domain;
    double gap = 0;
    std::unordered_map<int, SurfaceFoot> feet;
  };
  std::vector<FaceData> data(b.faces.size());
  for (std::size_t f = 0; f < b.faces.size(); ++f) {
    data[f].domain = domain(b.faces[f].surface);
    for (int e : b.faces[f].edges)
      for (const Vec3& p : b.edges[static_cast<std::size_t>(e)].p)
        data[f].gap = std::max(data[f].gap, (project(b.faces[f].surface, data[f].domain, p).p - p).norm());
    out.worst_gap_mm = std::max(out.worst_gap_mm, data[f].gap);
  }
  std::map<std::pair<int, int>, std::vector<int>> sides;  // mesh side -> faces
  for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t) {
    const int face = b.triangle_face[t];
    const BrepFace& f = b.faces[static_cast<std::size_t>(face)];
    const auto& tri = b.mesh.triangles[t];
    for (std::size_t k = 0; k < 3; ++k) sides[std::minmax(tri[k], tri[(k + 1) % 3])].push_back(face);
    if (!f.fault.empty()) continue;
    FaceData& d = data[static_cast<std::size_t>(face)];
    const auto foot_of = [&](int v) -> const SurfaceFoot& {
      const auto [it, is_new] = d.feet.try_emplace(v);
      if (is_new) it->second = project(f.surface, d.domain, b.mesh.vertices[static_cast<std::size_t>(v)]);
      return it->second;
    };
    const Vec3 p[3] = {b.mesh.vertices[static_cast<std::size_t>(tri[0])], b.mesh.vertices[static_cast<std::size_t>(tri[1])],
                       b.mesh.vertices[static_cast<std::size_t>(tri[2])]};
    const SurfaceFoot foot[3] = {foot_of(tri[0]), foot_of(tri[1]), foot_of(tri[2])};
    if (std::holds_alternative<PlaneSurface>(f.surface.shape)) {
      for (int k = 0; k < 3; ++k) out.worst_mm = std::max(out.worst_mm, std::abs(foot[k].signed_distance_mm));
      continue;
    }
    // Slivers between points of one straight border have no inside; their long side is the border again.
    const double longest = std::max({(p[1] - p[0]).norm(), (p[2] - p[1]).norm(), (p[0] - p[2]).norm()});
    const bool is_sliver = (p[1] - p[0]).cross(p[2] - p[0]).norm() < 1e-7 * longest * longest;
    for (int k = 0; k < 3 && !is_sliver; ++k) {  // the turn of the exact normal along each side
      const int k_next = (k + 1) % 3;
      const SurfaceFoot &x = foot[k], &y = foot[k_next];
      const auto between = [](const Vec3& m, const Vec3& w) { return std::atan2(m.cross(w).norm(), m.dot(w)); };
      double turn = between(x.n, y.n);
      if (turn > limit_rad) {  // an end whose normal is another one a micrometre inside has none of its own: that one counts
        const double l = (p[k_next] - p[k]).norm(), part = l > 2e-3 ? 1e-3 / l : 0.5;
        const Vec3 x_in = project(f.surface, d.domain, p[k] + part * (p[k_next] - p[k])).n;
        const Vec3 y_in = project(f.surface, d.domain, p[k_next] + part * (p[k] - p[k_next])).n;
        turn = between(between(x.n, x_in) > 0.5 * limit_rad ? x_in : x.n, between(y.n, y_in) > 0.5 * limit_rad ? y_in : y.n);
        out.singular += turn <= 1.001 * limit_rad, out.short_singular += turn <= 1.001 * limit_rad && l <= 2e-3;
      }
      ++out.turns;
      out.turns_over += turn > 1.001 * limit_rad;
      if (turn > out.worst_turn_rad) out.worst_turn_rad = turn, out.turn_face = f.id + " " + std::string(surface_type(f.surface));
    }
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j) {
        const double x = double(i) / n, y = double(j) / n, z = 1 - x - y;
        const Vec3 q = x * p[0] + y * p[1] + z * p[2];
        double off = 1e300;
        for (int k = 0; k < 3 && off > limit_mm + d.gap; ++k) {
          const SurfaceFoot g = project(f.surface, d.domain, q, Vec2(foot[k].u, foot[k].v));
          off = std::min(off, (g.p - q).norm());
        }
        if (off > limit_mm + d.gap) off = std::min(off, (project(f.surface, d.domain, q).p - q).norm());
        off = std::max(0.0, off - d.gap);
        ++out.samples, out.over += off > limit_mm * 1.001 + 1e-9;
        if (off > out.worst_mm) out.worst_mm = off, out.face = f.id + " " + std::string(surface_type(f.surface));
      }
  }
  for (const auto& [side, faces] : sides) {
    if (faces.size() != 2 || faces[0] == faces[1]) continue;
    const Vec3 &a = b.mesh.vertices[static_cast<std::size_t>(side.first)], &c = b.mesh.vertices[static_cast<std::size_t>(side.second)];
    double worst = 1e300;
    for (int e : b.faces[static_cast<std::size_t>(faces[0])].edges) {
      const BrepEdge& edge = b.edges[static_cast<std::size_t>(e)];
      if (std::minmax(edge.face_1, edge.face_2) != std::minmax(faces[0], faces[1])) continue;
      double off = 0;
      for (double x : {0.0, 0.25, 0.5, 0.75, 1.0}) {
        const Vec3 q = a + x * (c - a);
        off = std::max(off, project(edge.curve, q).distance_mm);
        if (off > worst) break;
      }
      worst = std::min(worst, off);
    }
    if (worst < 1e300) out.worst_edge_mm = std::max(out.worst_edge_mm, worst);
  }
  return out;
}

/// Triangle sides of one body that do not have exactly one partner the other way, and V - E + F.
struct Closedness {
  int odd_sides = 0, euler = 0;
};
inline std::map<int, Closedness> closedness(const Brep& b) {
  std::vector<int> body;
  std::map<int, std::vector<std::array<int, 3>>> triangles;
  for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t)
    triangles[b.faces[static_cast<std::size_t>(b.triangle_face[t])].body].push_back(b.mesh.triangles[t]);
  std::map<int, Closedness> out;
  for (const auto& [key, list] : triangles) {
    std::vector<std::pair<std::uint64_t, int>> sides;
    std::vector<int> vertices;
    for (const auto& t : list)
      for (std::size_t k = 0; k < 3; ++k) {
        const auto p = static_cast<std::uint64_t>(t[k]), q = static_cast<std::uint64_t>(t[(k + 1) % 3]);
        sides.emplace_back(std::min(p, q) << 32 | std::max(p, q), p < q ? 1 : -1);
        vertices.push_back(t[k]);
      }
    std::sort(sides.begin(), sides.end());
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    Closedness& c = out[key];
    int edges = 0;
    for (std::size_t i = 0; i < sides.size();) {
      std::size_t j = i;
      int balance = 0;
      for (; j < sides.size() && sides[j].first == sides[i].first; ++j) balance += sides[j].second;
      ++edges, c.odd_sides += j - i != 2 || balance != 0;
      i = j;
    }
    c.euler = static_cast<int>(vertices.size()) - edges + static_cast<int>(list.size());
  }
  return out;
}

/// V - E + F - (loops - F) of a body as its faces and loops stand in the file: what the mesh has to come to. A face is taken to be a
/// disc with holes; the whole torus, which has no loop or a vertex loop, is told apart.
inline int euler_by_topology(const step::Body& body) {
  std::set<int> vertices, edges;
  int sum = 0;
  for (const step::TopoFace& f : body.faces) {
    int loops = 0;
    for (const step::TopoLoop& l : f.loops) {
      ++loops;
      if (l.vertex >= 0) vertices.insert(l.vertex);
      for (const step::EdgeUse& u : l.uses) edges.insert(u.edge);
    }
    const bool is_whole = std::all_of(f.loops.begin(), f.loops.end(), [](const step::TopoLoop& l) { return l.vertex >= 0; });
    const auto* torus = f.surface >= 0 ? std::get_if<TorusSurface>(&body.surfaces[static_cast<std::size_t>(f.surface)].shape) : nullptr;
    sum += (is_whole && torus && torus->major_mm >= torus->minor_mm ? 0 : 2) - loops;
  }
  for (int e : edges)
    vertices.insert(body.edges[static_cast<std::size_t>(e)].v0), vertices.insert(body.edges[static_cast<std::size_t>(e)].v1);
  return static_cast<int>(vertices.size()) - static_cast<int>(edges.size()) + sum;
}

/// By the order in which read_step places bodies: one Euler number for each solid of the file.
inline std::vector<int> eulers_of_file(std::string_view bytes) {
  std::vector<int> out;
  p21::File file;
  if (p21::parse(bytes, file)) return out;
  step::Binder binder(file);
  std::vector<Unread> unread;
  const step::Model model = step::read_model(binder, unread);
  std::map<std::int64_t, int> known;
  std::vector<std::int64_t> order;
  for (const step::BodyUse& u : model.bodies)
    if (std::find(order.begin(), order.end(), u.body) == order.end()) order.push_back(u.body);
  for (std::int64_t id : order) {
    int uses = 0;
    for (const step::BodyUse& u : model.bodies)
      if (u.body == id) binder.units = u.units, ++uses;
    const step::Body body = step::read_body(binder, id, unread);
    if (!body.is_solid) continue;
    out.insert(out.end(), static_cast<std::size_t>(uses), euler_by_topology(body));
  }
  return out;
}

}  // namespace asbuilt::test
