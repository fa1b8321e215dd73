// SPDX-License-Identifier: GPL-3.0-or-later
// Vector distance transform of a triangle mesh: candidates travel from node to node, distances are always exact to the
// candidate triangle.
#include "planner/geom/distance_grid.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

Vec3 DistanceGrid::foot(int triangle, const Vec3& p) const {  // Ericson, Real-Time Collision Detection, 5.1.5
  const Corner& c = corners_[static_cast<std::size_t>(triangle)];
  const Vec3 ap = p - c.a;
  const double d1 = c.ab.dot(ap), d2 = c.ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return c.a;
  const double d3 = d1 - c.d00, d4 = d2 - c.d01;
  if (d3 >= 0 && d4 <= d3) return c.a + c.ab;
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return c.a + (d1 / (d1 - d3)) * c.ab;
  const double d5 = d1 - c.d01, d6 = d2 - c.d11;
  if (d6 >= 0 && d5 <= d6) return c.a + c.ac;
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return c.a + (d2 / (d2 - d6)) * c.ac;
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) {
    const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return c.a + c.ab + w * (c.ac - c.ab);
  }
  const double denominator = 1 / (va + vb + vc);
  return c.a + (vb * denominator) * c.ab + (vc * denominator) * c.ac;
}

DistanceGrid::DistanceGrid(const Mesh& mesh, double step_mm, double margin_mm) {
  const Box3 box = mesh.box();
  if (box.is_empty() || mesh.triangles.empty()) return;
  const Vec3 lo = box.min_mm - Vec3::Constant(margin_mm), size = box.max_mm - box.min_mm + Vec3::Constant(2 * margin_mm);
  step_mm_ = std::max(step_mm, std::cbrt(size.prod() / 12e6));
  origin_ = lo;
  for (int a = 0; a < 3; ++a) count_[a] = static_cast<int>(std::ceil(size[a] / step_mm_)) + 1;
  const std::size_t nodes = static_cast<std::size_t>(count_[0]) * static_cast<std::size_t>(count_[1]) * static_cast<std::size_t>(count_[2]);
  triangle_.assign(nodes, -1);
  distance_.assign(nodes, 1e9f);
  corners_.resize(mesh.triangles.size());
  const auto offer = [&](int i, int j, int k, int t) {
    const std::size_t at_node = node(i, j, k);
    if (triangle_[at_node] == t) return;
    const Vec3 p = at(i, j, k);
    const float d = static_cast<float>((foot(t, p) - p).norm());
    if (d < distance_[at_node]) distance_[at_node] = d, triangle_[at_node] = t;
  };
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& f = mesh.triangles[t];
    Corner& c = corners_[t];
    c.a = mesh.vertices[f[0]], c.ab = mesh.vertices[f[1]] - c.a, c.ac = mesh.vertices[f[2]] - c.a;
    c.d00 = c.ab.dot(c.ab), c.d01 = c.ab.dot(c.ac), c.d11 = c.ac.dot(c.ac);
    const Vec3 n = c.ab.cross(c.ac);
    if (n.norm() < 1e-12) continue;
    c.n = n.normalized();
    const double longest = std::sqrt(std::max({c.d00, c.d11, (c.ab - c.ac).squaredNorm()}));
    const int parts = std::max(1, static_cast<int>(std::ceil(longest / (0.8 * step_mm_))));
    for (int u = 0; u <= parts; ++u) {
      for (int v = 0; u + v <= parts; ++v) {
        const Vec3 s = c.a + (static_cast<double>(u) / parts) * c.ab + (static_cast<double>(v) / parts) * c.ac;
        const Vec3 g = (s - origin_) / step_mm_;
        const int i = std::clamp(static_cast<int>(g.x()), 0, count_[0] - 2), j = std::clamp(static_cast<int>(g.y()), 0, count_[1] - 2),
                  k = std::clamp(static_cast<int>(g.z()), 0, count_[2] - 2);
        for (int corner = 0; corner < 8; ++corner) offer(i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2), static_cast<int>(t));
      }
    }
  }
  for (int round = 0; round < 2; ++round) {
    for (int sweep = 0; sweep < 8; ++sweep) {
      const int si = sweep & 1 ? -1 : 1, sj = sweep & 2 ? -1 : 1, sk = sweep & 4 ? -1 : 1;
      for (int kk = 0; kk < count_[2]; ++kk) {
        const int k = sk > 0 ? kk : count_[2] - 1 - kk;
        for (int jj = 0; jj < count_[1]; ++jj) {
          const int j = sj > 0 ? jj : count_[1] - 1 - jj;
          for (int ii = 0; ii < count_[0]; ++ii) {
            const int i = si > 0 ? ii : count_[0] - 1 - ii;
            if (ii > 0 && triangle_[node(i - si, j, k)] >= 0) offer(i, j, k, triangle_[node(i - si, j, k)]);
            if (jj > 0 && triangle_[node(i, j - sj, k)] >= 0) offer(i, j, k, triangle_[node(i, j - sj, k)]);
            if (kk > 0 && triangle_[node(i, j, k - sk)] >= 0) offer(i, j, k, triangle_[node(i, j, k - sk)]);
          }
        }
      }
    }
  }
  for (const float d : distance_) far_mm_ = std::max(far_mm_, static_cast<double>(d));
}

float DistanceGrid::distance(const Vec3& p_mm) const {
  const Vec3 g = (p_mm - origin_) / step_mm_;
  if (!(g.x() >= 0 && g.y() >= 0 && g.z() >= 0) || g.x() >= count_[0] - 1 || g.y() >= count_[1] - 1 || g.z() >= count_[2] - 1)
    return static_cast<float>(far_mm_);
  const int i = static_cast<int>(g.x()), j = static_cast<int>(g.y()), k = static_cast<int>(g.z());
  const double x = g.x() - i, y = g.y() - j, z = g.z() - k;
  const auto line = [&](int jj, int kk) { return (1 - x) * distance_[node(i, jj, kk)] + x * distance_[node(i + 1, jj, kk)]; };
  return static_cast<float>((1 - z) * ((1 - y) * line(j, k) + y * line(j + 1, k)) + z * ((1 - y) * line(j, k + 1) + y * line(j + 1, k +
      1)));
}

SurfaceHit DistanceGrid::hit(int triangle, const Vec3& p, const Vec3& q) const {
  const Vec3& n = corners_[static_cast<std::size_t>(triangle)].n;
  const double d = (p - q).norm();
  return {q, n, triangle, (p - q).dot(n) < 0 ? -d : d};
}

std::optional<SurfaceHit> DistanceGrid::closest(const Vec3& p_mm) const {
  const Vec3 g = (p_mm - origin_) / step_mm_;
  if (!(g.x() >= 0 && g.y() >= 0 && g.z() >= 0) || g.x() >= count_[0] - 1 || g.y() >= count_[1] - 1 || g.z() >= count_[2] - 1)
    return std::nullopt;
  const int i = static_cast<int>(g.x()), j = static_cast<int>(g.y()), k = static_cast<int>(g.z());
  int seen[8], seen_count = 0, best = -1;
  double best_d2 = 1e300;
  Vec3 best_foot = Vec3::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    const int t = triangle_[node(i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2))];
    if (t < 0 || std::find(seen, seen + seen_count, t) != seen + seen_count) continue;
    seen[seen_count++] = t;
    const Vec3 q = foot(t, p_mm);
    const double d2 = (q - p_mm).squaredNorm();
    if (d2 < best_d2) best_d2 = d2, best = t, best_foot = q;
  }
  if (best < 0) return std::nullopt;
  return hit(best, p_mm, best_foot);
}

std::optional<SurfaceHit> DistanceGrid::closest_rough(const Vec3& p_mm) const {
  const Vec3 g = (p_mm - origin_) / step_mm_ + Vec3::Constant(0.5);
  if (!(g.x() >= 0 && g.y() >= 0 && g.z() >= 0) || g.x() >= count_[0] || g.y() >= count_[1] || g.z() >= count_[2]) return std::nullopt;
  const int t = triangle_[node(static_cast<int>(g.x()), static_cast<int>(g.y()), static_cast<int>(g.z()))];
  if (t < 0) return std::nullopt;
  return hit(t, p_mm, foot(t, p_mm));
}

}  // namespace asbuilt
