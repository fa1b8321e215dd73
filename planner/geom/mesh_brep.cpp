// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/mesh_brep.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <unordered_map>

#include "planner/base/result.hpp"
#include "planner/geom/mesh_query.hpp"

namespace asbuilt {
namespace {

using Triangle = std::array<int, 3>;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// Vertices nearer than the tolerance become one (the first); degenerate triangles go.
Mesh welded(const Mesh& in, double tolerance_mm, std::vector<int>& kept) {
  Mesh out;
  std::vector<int> order(in.vertices.size()), to(in.vertices.size(), -1);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    const double x = in.vertices[at(a)].x(), y = in.vertices[at(b)].x();
    return x != y ? x < y : a < b;
  });
  std::vector<int> first(in.vertices.size());
  std::iota(first.begin(), first.end(), 0);
  const auto root = [&](int i) {
    while (first[at(i)] != i) i = first[at(i)] = first[at(first[at(i)])];
    return i;
  };
  for (std::size_t k = 0; k < order.size(); ++k)
    for (std::size_t j = k + 1; j < order.size(); ++j) {
      const Vec3 &a = in.vertices[at(order[k])], &b = in.vertices[at(order[j])];
      if (b.x() - a.x() > tolerance_mm) break;
      if ((a - b).squaredNorm() > tolerance_mm * tolerance_mm) continue;
      const int r = root(order[k]), s = root(order[j]);
      if (r != s) first[at(std::max(r, s))] = std::min(r, s);
    }
  for (std::size_t i = 0; i < in.vertices.size(); ++i) {
    const int r = root(static_cast<int>(i));
    if (to[at(r)] < 0) to[at(r)] = static_cast<int>(out.vertices.size()), out.vertices.push_back(in.vertices[at(r)]);
    to[i] = to[at(r)];
  }
  for (std::size_t i = 0; i < in.triangles.size(); ++i) {
    const Triangle& t = in.triangles[i];
    const Triangle w{to[at(t[0])], to[at(t[1])], to[at(t[2])]};
    if (w[0] != w[1] && w[1] != w[2] && w[2] != w[0]) out.triangles.push_back(w), kept.push_back(static_cast<int>(i));
  }
  return out;
}

struct Side {  // triangle and its side k, from corner k to k + 1
  int triangle, k;
};
using Sides = std::map<std::pair<int, int>, std::vector<Side>>;

Sides sides_of(const Mesh& m) {
  Sides s;
  for (std::size_t t = 0; t < m.triangles.size(); ++t)
    for (int k = 0; k < 3; ++k) {
      const int a = m.triangles[t][at(k)], b = m.triangles[t][at((k + 1) % 3)];
      s[{std::min(a, b), std::max(a, b)}].push_back({static_cast<int>(t), k});
    }
  return s;
}

/// Connected groups of triangles over the sides that `joins` accepts.
template <class F>
std::vector<int> groups(const Mesh& m, const Sides& sides, const F& joins, int& count) {
  std::vector<int> parent(m.triangles.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](int i) {
    while (parent[at(i)] != i) i = parent[at(i)] = parent[at(parent[at(i)])];
    return i;
  };
  for (const auto& [key, list] : sides) {
    if (list.size() != 2 || !joins(list[0].triangle, list[1].triangle)) continue;
    const int a = root(list[0].triangle), b = root(list[1].triangle);
    if (a != b) parent[at(std::max(a, b))] = std::min(a, b);
  }
  std::vector<int> group(m.triangles.size(), -1);
  count = 0;
  for (std::size_t t = 0; t < group.size(); ++t) {
    const int r = root(static_cast<int>(t));
    if (group[at(r)] < 0) group[at(r)] = count++;
    group[t] = group[at(r)];
  }
  return group;
}

double angle(const Vec3& a, const Vec3& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

bool fit_plane(const Mesh& m, const std::vector<int>& triangles, double tolerance_mm, Surface& out) {
  Vec3 n = Vec3::Zero(), c = Vec3::Zero();
  double area = 0;
  for (int t : triangles) {
    const Triangle& f = m.triangles[at(t)];
    const Vec3 w = 0.5 * (m.vertices[at(f[1])] - m.vertices[at(f[0])]).cross(m.vertices[at(f[2])] - m.vertices[at(f[0])]);
    n += w, area += w.norm();
    c += w.norm() * (m.vertices[at(f[0])] + m.vertices[at(f[1])] + m.vertices[at(f[2])]) / 3;
  }
  if (!(n.norm() > 1e-12) || !(area > 0)) return false;
  n.normalize(), c /= area;
  for (int t : triangles)
    for (int v : m.triangles[at(t)])
      if (std::abs(n.dot(m.vertices[at(v)] - c)) > tolerance_mm) return false;
  const Eigen::Quaterniond q = quat_from_z(n, Vec3::UnitX());
  out = {PlaneSurface{{c, q * Vec3::UnitX(), q * Vec3::UnitY(), q * Vec3::UnitZ()}}};
  return true;
}

bool fit_cylinder(const Mesh& m, const std::vector<int>& triangles, double tolerance_mm, Surface& out, bool& same_sense) {
  Mat3 spread = Mat3::Zero();
  for (int t : triangles) {
    const Triangle& f = m.triangles[at(t)];
    const Vec3 w = (m.vertices[at(f[1])] - m.vertices[at(f[0])]).cross(m.vertices[at(f[2])] - m.vertices[at(f[0])]);
    if (w.norm() > 0) spread += w * w.transpose() / w.norm();
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> eig(spread);
  if (eig.eigenvalues()[1] < 1e-3 * eig.eigenvalues()[2] || eig.eigenvalues()[0] > 1e-4 * eig.eigenvalues()[1]) return false;
  const Vec3 z = eig.eigenvectors().col(0);
  const Eigen::Quaterniond q = quat_from_z(z, Vec3::UnitX());
  const Vec3 x = q * Vec3::UnitX(), y = q * Vec3::UnitY();
  // Circle through the projected vertices, linear least squares (Kasa) about their mean.
  std::vector<int> used;
  for (int t : triangles)
    for (int v : m.triangles[at(t)]) used.push_back(v);
  std::sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  if (used.size() < 6) return false;
  Vec3 mean = Vec3::Zero();
  for (int v : used) mean += m.vertices[at(v)];
  mean /= static_cast<double>(used.size());
  Mat3 a = Mat3::Zero();
  Vec3 b = Vec3::Zero();
  for (int v : used) {
    const Vec3 r = m.vertices[at(v)] - mean;
    const Vec3 row(r.dot(x), r.dot(y), 1);
    a += row * row.transpose();
    b += row * (row.x() * row.x() + row.y() * row.y());
  }
  const Vec3 s = a.ldlt().solve(b);
  const double cx = 0.5 * s.x(), cy = 0.5 * s.y(), r2 = s.z() + cx * cx + cy * cy;
  if (!(r2 > 0) || !std::isfinite(r2)) return false;
  const double radius = std::sqrt(r2);
  const Vec3 origin = mean + cx * x + cy * y;
  for (int v : used) {
    const Vec3 r = m.vertices[at(v)] - origin;
    if (std::abs(std::hypot(r.dot(x), r.dot(y)) - radius) > tolerance_mm) return false;
  }
  double votes = 0;
  for (int t : triangles) {
    const Triangle& f = m.triangles[at(t)];
    const Vec3 w = (m.vertices[at(f[1])] - m.vertices[at(f[0])]).cross(m.vertices[at(f[2])] - m.vertices[at(f[0])]);
    Vec3 r = (m.vertices[at(f[0])] + m.vertices[at(f[1])] + m.vertices[at(f[2])]) / 3 - origin;
    r -= z * z.dot(r);
    if (w.norm() > 0 && std::abs(w.dot(r)) < 0.7 * w.norm() * r.norm()) return false;  // a wall across the cylinder
    votes += w.dot(r);
  }
  same_sense = votes > 0;
  out = {CylinderSurface{{origin, x, y, z}, radius}};
  return true;
}

class Builder {
 public:
  Builder(const Mesh& mesh, double sharp_rad, const std::vector<int>* group, const std::vector<std::string>* ids) : sharp_(sharp_rad) {
    const double diagonal = mesh.box().diagonal_mm();
    m_ = welded(mesh, std::max(1e-6, 1e-7 * diagonal), kept_);
    if (group && ids) {
      for (int t : kept_) group_.push_back((*group)[at(t)]);
      ids_ = *ids;
    }
    fit_mm_ = std::max(0.005, 1e-5 * diagonal);
    normals_.reserve(m_.triangles.size());
    for (std::size_t t = 0; t < m_.triangles.size(); ++t) normals_.push_back(m_.triangle_normal(static_cast<int>(t)));
    sides_ = sides_of(m_);
  }

  Brep run() {
    if (group_.empty()) {
      segment();
    } else {
      int count = 0;
      face_ = groups(m_, sides_, [&](int a, int b) { return group_[at(a)] == group_[at(b)]; }, count);
      triangles_.assign(at(count), {});
      for (std::size_t t = 0; t < face_.size(); ++t) triangles_[at(face_[t])].push_back(static_cast<int>(t));
    }
    faces();
    edges();
    out_.mesh = m_;
    out_.triangle_face = face_;
    for (std::size_t t = 0; t < m_.triangles.size(); ++t) {
      const Triangle& f = m_.triangles[t];
      const Vec3 &a = m_.vertices[at(f[0])], &b = m_.vertices[at(f[1])], &c = m_.vertices[at(f[2])];
      const double area = 0.5 * (b - a).cross(c - a).norm();
      BrepFace& g = out_.faces[at(face_[t])];
      g.area_mm2 += area, out_.area_mm2 += area;
      for (const Vec3& p : {a, b, c}) g.box.extend(p), out_.box.extend(p);
      out_.volume_mm3 += a.dot(b.cross(c)) / 6;
    }
    for (const auto& [key, list] : sides_)
      if (list.size() != 2) out_.open_edges_count += static_cast<int>(list.size() % 2 ? 1 : 0);
    out_.units = "mm", out_.schema = "mesh";
    (out_.open_edges_count == 0 ? out_.solids_count : out_.shells_count) = 1;
    out_.bodies = {{"mesh", "", "", "", "", out_.open_edges_count == 0}};
    return std::move(out_);
  }

 private:
  void segment() {
    int smooth_count = 0;
    smooth_ = groups(m_, sides_, [&](int a, int b) { return angle(normals_[at(a)], normals_[at(b)]) < sharp_; }, smooth_count);
    int flat_count = 0;
    const std::vector<int> flat = groups(
        m_, sides_, [&](int a, int b) { return smooth_[at(a)] == smooth_[at(b)] && angle(normals_[at(a)],
            normals_[at(b)]) < rad_from_deg(0.2); },
        flat_count);
    // A flat group is a face of its own when it has a share of its region and is larger than the strips of a fillet.
    std::vector<double> area_smooth(at(smooth_count)), area_flat(at(flat_count));
    for (std::size_t t = 0; t < m_.triangles.size(); ++t) {
      const Triangle& f = m_.triangles[t];
      const double a = 0.5 * (m_.vertices[at(f[1])] - m_.vertices[at(f[0])]).cross(m_.vertices[at(f[2])] - m_.vertices[at(f[0])]).norm();
      area_smooth[at(smooth_[t])] += a, area_flat[at(flat[t])] += a;
    }
    std::vector<int> label(m_.triangles.size());
    std::vector<std::vector<int>> regions(at(smooth_count));
    for (std::size_t t = 0; t < label.size(); ++t) regions[at(smooth_[t])].push_back(static_cast<int>(t));
    int next = 0;
    for (const std::vector<int>& region : regions) {
      Surface s;
      bool sense = true;
      const bool is_one = fit_plane(m_, region, fit_mm_, s) || fit_cylinder(m_, region, fit_mm_, s, sense);
      const int rest = next++;
      std::vector<double> areas;
      for (int t : region) areas.push_back(area_flat[at(flat[at(t)])]);  // weighted by triangles: strips outnumber walls
      std::nth_element(areas.begin(), areas.begin() + static_cast<std::ptrdiff_t>(areas.size() / 2), areas.end());
      const double usual = areas[areas.size() / 2];
      std::map<int, int> own;
      for (int t : region) {
        const int g = flat[at(t)];
        label[at(t)] = rest;
        if (is_one || area_flat[at(g)] < 0.03 * area_smooth[at(smooth_[at(t)])] || area_flat[at(g)] < 3 * usual) continue;
        const auto it = own.find(g);
        label[at(t)] = it != own.end() ? it->second : own.emplace(g, next++).first->second;
      }
    }
    int count = 0;  // what is left of a region may fall apart
    face_ = groups(m_, sides_, [&](int a, int b) { return label[at(a)] == label[at(b)]; }, count);
    triangles_.assign(at(count), {});
    for (std::size_t t = 0; t < face_.size(); ++t) triangles_[at(face_[t])].push_back(static_cast<int>(t));
  }

  void faces() {
    vertex_normal_.resize(triangles_.size());
    for (std::size_t k = 0; k < triangles_.size(); ++k) {
      BrepFace f;
      f.id = group_.empty() ? "face_" + std::to_string(k + 1) : ids_[at(group_[at(triangles_[k][0])])];
      if (!fit_plane(m_, triangles_[k], fit_mm_, f.surface) && !fit_cylinder(m_, triangles_[k], fit_mm_, f.surface, f.same_sense)) {
        auto patch = std::make_shared<Mesh>();
        std::unordered_map<int, int> to;
        for (int t : triangles_[k]) {
          Triangle w;
          for (int c = 0; c < 3; ++c) {
            const int v = m_.triangles[at(t)][at(c)];
            const auto [it, is_new] = to.emplace(v, static_cast<int>(patch->vertices.size()));
            if (is_new) patch->vertices.push_back(m_.vertices[at(v)]);
            w[at(c)] = it->second;
            Vec3& n = vertex_normal_[k].emplace(v, Vec3::Zero()).first->second;
            const Vec3 e1 = (m_.vertices[at(m_.triangles[at(t)][at((c + 1) % 3)])] - m_.vertices[at(v)]).normalized();
            const Vec3 e2 = (m_.vertices[at(m_.triangles[at(t)][at((c + 2) % 3)])] - m_.vertices[at(v)]).normalized();
            n += angle(e1, e2) * normals_[at(t)];
          }
          patch->triangles.push_back(w);
        }
        FacetSurface s;
        s.patch = patch, s.query = std::make_shared<MeshQuery>(*patch);
        f.surface = {s};
      }
      out_.faces.push_back(std::move(f));
    }
  }

  Vec3 normal(int face, const Vec3& p, int v0, int v1, double f) const {
    const BrepFace& b = out_.faces[at(face)];
    if (std::holds_alternative<FacetSurface>(b.surface.shape)) {
      const auto& map = vertex_normal_[at(face)];
      const Vec3 n = (1 - f) * map.at(v0).normalized() + f * map.at(v1).normalized();
      return n.norm() > 0 ? Vec3(n.normalized()) : map.at(v0).normalized();
    }
    return (b.same_sense ? 1 : -1) * project(b.surface, p).n;
  }

  /// Chains of mesh edges between the same two faces, each walked as face_1 has it.
  void edges() {
    struct Link {
      int to, face_1, face_2;
      bool used = false;
    };
    std::map<std::pair<int, int>, std::map<int, std::vector<Link>>> by_faces;  // face pair -> vertex -> outgoing links
    std::map<int, int> degree;                                                // border edges at a vertex, all faces
    for (const auto& [key, list] : sides_) {
      if (list.size() == 2) {
        const int fa = face_[at(list[0].triangle)], fb = face_[at(list[1].triangle)];
        const bool is_sharp = angle(normals_[at(list[0].triangle)], normals_[at(list[1].triangle)]) >= sharp_;
        if (fa == fb && !is_sharp) continue;
        const Side& s = fa <= fb ? list[0] : list[1];
        const Triangle& t = m_.triangles[at(s.triangle)];
        by_faces[{std::min(fa, fb), std::max(fa, fb)}][t[at(s.k)]].push_back({t[at((s.k + 1) % 3)], std::min(fa, fb), std::max(fa, fb)});
      } else {
        const Side& s = list[0];
        const Triangle& t = m_.triangles[at(s.triangle)];
        const int fa = face_[at(s.triangle)];
        const int mark = list.size() == 1 ? -1 : -2;
        by_faces[{fa, mark}][t[at(s.k)]].push_back({t[at((s.k + 1) % 3)], fa, mark});
      }
      ++degree[key.first], ++degree[key.second];
    }
    for (auto& entry : by_faces) {
      const std::pair<int, int> faces = entry.first;
      std::map<int, std::vector<Link>>& out = entry.second;
      std::map<int, int> in;
      for (const auto& [v, list] : out)
        for (const Link& l : list) ++in[l.to];
      const auto is_corner = [&](int v) {
        const auto o = out.find(v);
        return degree[v] != 2 || o == out.end() || o->second.size() != 1 || in[v] != 1;
      };
      const auto follow = [&](int v, Link& first) {
        std::vector<int> chain{v};
        Link* l = &first;
        for (;;) {
          l->used = true;
          chain.push_back(l->to);
          if (is_corner(l->to) || l->to == v) break;
          Link& n = out[l->to][0];
          if (n.used) break;
          const Vec3 d0 = m_.vertices[at(chain.back())] - m_.vertices[at(chain[chain.size() - 2])];
          const Vec3 d1 = m_.vertices[at(n.to)] - m_.vertices[at(chain.back())];
          if (angle(d0, d1) > std::max(sharp_, rad_from_deg(40))) break;
          l = &n;
        }
        return chain;
      };
      for (auto& [v, list] : out)
        for (Link& l : list)
          if (!l.used && is_corner(v)) add(follow(v, l), faces.first, faces.second);
      for (auto& [v, list] : out)
        for (Link& l : list) {
          if (l.used) continue;
          // A loop without corners, or what a sharp turn left: start where the chain turns most.
          std::vector<int> loop = follow(v, l);
          add(loop, faces.first, faces.second);
        }
    }
  }

  void add(const std::vector<int>& chain, int face_1, int face_2) {
    BrepEdge e;
    e.id = "edge_" + std::to_string(out_.edges.size() + 1);
    e.face_1 = face_1, e.face_2 = std::max(face_2, -1);
    e.is_closed = chain.front() == chain.back();
    const auto is_exact = [&](int f) { return f >= 0 && !std::holds_alternative<FacetSurface>(out_.faces[at(f)].surface.shape); };
    const bool move = is_exact(face_1) && is_exact(e.face_2) && face_1 != e.face_2;
    PolylineCurve curve;
    for (int v : chain) curve.points.push_back(m_.vertices[at(v)]);
    for (std::size_t i = 0; i + 1 < chain.size(); ++i) {
      const Vec3 &a = curve.points[i], &b = curve.points[i + 1];
      const int n = std::max(1, static_cast<int>(std::ceil((b - a).norm() - 1e-6)));
      for (int k = i == 0 ? 0 : 1; k <= n; ++k) {
        const double f = static_cast<double>(k) / n;
        Vec3 p = a + f * (b - a);
        if (move) {  // onto both surfaces, while that stays near
          Vec3 q = p;
          for (int it = 0; it < 20; ++it) q = project(out_.faces[at(e.face_2)].surface, project(out_.faces[at(face_1)].surface, q).p).p;
          if ((q - p).norm() < 0.2 * (b - a).norm() + 0.01) p = q;
        }
        e.p.push_back(p);
        e.n_1.push_back(normal(face_1, p, chain[i], chain[i + 1], f));
        e.n_2.push_back(e.face_2 >= 0 ? normal(e.face_2, p, chain[i], chain[i + 1], f) : Vec3(Vec3::Zero()));
      }
    }
    if (e.is_closed) e.p.back() = e.p.front();
    e.s_mm.push_back(0);
    for (std::size_t i = 1; i < e.p.size(); ++i) e.s_mm.push_back(e.s_mm.back() + (e.p[i] - e.p[i - 1]).norm());
    for (std::size_t i = 0; i < e.p.size(); ++i) {
      const std::size_t last = e.p.size() - 1;
      const Vec3 &before = i > 0 ? e.p[i - 1] : (e.is_closed ? e.p[last - 1] : e.p[0]), &after = i < last ? e.p[i + 1]
          : (e.is_closed ? e.p[1] : e.p[last]);
      const Vec3 d = after - before;
      e.tangent.push_back(d.norm() > 0 ? Vec3(d.normalized()) : Vec3::Zero());
    }
    e.length_mm = e.s_mm.back();
    const bool is_line = !e.is_closed && std::all_of(e.p.begin(), e.p.end(), [&](const Vec3& p) {
      const Vec3 d = (e.p.back() - e.p.front()).normalized();
      return (p - e.p.front() - d * d.dot(p - e.p.front())).norm() < 1e-3;
    });
    if (is_line) e.curve = {LineCurve{e.p.front(), (e.p.back() - e.p.front()).normalized()}};
    else e.curve = {curve};
    e.curve_type = std::string(curve_type(e.curve));
    if (face_2 == -2) e.kind = EdgeKind::nonmanifold;
    else if (e.face_2 < 0) e.kind = EdgeKind::boundary;
    else e.kind = edge_kind(e.s_mm, e.tangent, e.n_1, e.n_2, e.dihedral_rad);
    for (int f : {e.face_1, e.face_2})
      if (f >= 0 && (out_.faces[at(f)].edges.empty() || out_.faces[at(f)].edges.back() != static_cast<int>(out_.edges.size())))
        out_.faces[at(f)].edges.push_back(static_cast<int>(out_.edges.size()));
    out_.edges.push_back(std::move(e));
  }

  double sharp_, fit_mm_ = 0.005;
  Mesh m_;
  std::vector<Vec3> normals_;
  Sides sides_;
  std::vector<int> smooth_, face_, kept_, group_;
  std::vector<std::string> ids_;
  std::vector<std::vector<int>> triangles_;
  std::vector<std::map<int, Vec3>> vertex_normal_;
  Brep out_;
};

}  // namespace

Brep brep_from_mesh(const Mesh& mesh, double sharp_rad) {
  if (mesh.triangles.empty()) return {};
  return Builder(mesh, sharp_rad, nullptr, nullptr).run();
}

Brep brep_from_mesh(const Mesh& mesh, const std::vector<int>& group, const std::vector<std::string>& ids, double sharp_rad) {
  must(group.size() == mesh.triangles.size(), "one group a triangle");
  if (mesh.triangles.empty()) return {};
  return Builder(mesh, sharp_rad, &group, &ids).run();
}

}  // namespace asbuilt
