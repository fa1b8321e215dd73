// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/flat_face.hpp"

#include <algorithm>
#include <cmath>

#include "planner/io/step/planar_mesh.hpp"

namespace asbuilt::step {

bool flat_fallback(const Body& body, int face, BodyMesh& mesh) {
  const TopoFace& f = body.faces[static_cast<std::size_t>(face)];
  std::vector<std::vector<int>> loops;
  Vec3 normal = Vec3::Zero(), center = Vec3::Zero();
  int n = 0;
  for (const TopoLoop& l : f.loops) {
    std::vector<int> ids;
    for (const EdgeUse& u : l.uses) {
      const TopoEdge& e = body.edges[static_cast<std::size_t>(u.edge)];
      for (std::size_t i = 0; i + 1 < e.vertex.size(); ++i) ids.push_back(u.is_forward ? e.vertex[i] : e.vertex[e.vertex.size() - 1 - i]);
    }
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const Vec3 &a = mesh.vertices[static_cast<std::size_t>(ids[i])],
                 &b = mesh.vertices[static_cast<std::size_t>(ids[(i + 1) % ids.size()])];
      normal += (a - mesh.vertices[static_cast<std::size_t>(ids[0])]).cross(b - mesh.vertices[static_cast<std::size_t>(ids[0])]);
      center += a, ++n;
    }
    if (!ids.empty()) loops.push_back(std::move(ids));
  }
  if (n < 3 || !(normal.norm() > 0)) return false;
  center /= n;
  const Eigen::Quaterniond r = quat_from_z(normal.normalized(), Vec3::UnitX()).conjugate();
  std::vector<Vec2> q;
  std::vector<int> id;
  std::vector<std::array<int, 2>> segments;
  for (const auto& l : loops) {
    const int first = static_cast<int>(q.size());
    for (int v : l) q.push_back((r * (mesh.vertices[static_cast<std::size_t>(v)] - center)).head<2>()), id.push_back(v);
    for (int i = 0; i < static_cast<int>(l.size()); ++i) segments.push_back({first + i, first + (i + 1) % static_cast<int>(l.size())});
  }
  PlanarMesh planar;
  planar.build(q, segments);
  for (int k = static_cast<int>(id.size()); k < planar.size(); ++k) {
    id.push_back(static_cast<int>(mesh.vertices.size()));
    const Vec2 p = planar.point(k);
    mesh.vertices.push_back(center + r.conjugate() * Vec3(p.x(), p.y(), 0));
  }
  double area = 0, volume = 0;
  for (const auto& t : planar.inside().triangles) {
    const std::array<int, 3> v{id[static_cast<std::size_t>(t[0])], id[static_cast<std::size_t>(t[1])], id[static_cast<std::size_t>(t[2])]};
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) continue;
    mesh.triangles.push_back(v), mesh.face.push_back(face);
    const Vec3 a = mesh.vertices[static_cast<std::size_t>(v[0])] - mesh.origin,
               b = mesh.vertices[static_cast<std::size_t>(v[1])] - mesh.origin,
               c = mesh.vertices[static_cast<std::size_t>(v[2])] - mesh.origin;
    area += 0.5 * (b - a).cross(c - a).norm();
    volume += a.dot(b.cross(c)) / 6;
  }
  mesh.area_mm2[static_cast<std::size_t>(face)] = area, mesh.volume_mm3[static_cast<std::size_t>(face)] = volume;
  return area > 0;
}

int count_open_edges(const std::vector<std::array<int, 3>>& triangles) {
  std::vector<std::uint64_t> sides;
  sides.reserve(3 * triangles.size());
  for (const auto& t : triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto a = static_cast<std::uint32_t>(t[k]), b = static_cast<std::uint32_t>(t[(k + 1) % 3]);
      sides.push_back(a < b ? (std::uint64_t(a) << 33 | std::uint64_t(b) << 1) : (std::uint64_t(b) << 33 | std::uint64_t(a) << 1 | 1));
    }
  std::sort(sides.begin(), sides.end());
  int open = 0;
  for (std::size_t i = 0; i < sides.size();) {
    const std::uint64_t pair = sides[i] >> 1;
    int balance = 0;
    for (; i < sides.size() && sides[i] >> 1 == pair; ++i) balance += sides[i] & 1 ? -1 : 1;
    open += std::abs(balance);
  }
  return open;
}

}  // namespace asbuilt::step
