// SPDX-License-Identifier: GPL-3.0-or-later
// Areas and volumes by ways the reader does not go: the definition of B-splines, Gauss over whole knot spans, limits of meshes.
#pragma once

#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "planner/geom/brep.hpp"

namespace asbuilt::test {

/// N_i,p(t) straight from the definition of Cox and de Boor (half-open spans; t inside the range).
inline double basis_by_definition(const std::vector<double>& knots, int i, int p, double t) {
  const auto k = [&](int j) { return knots[static_cast<std::size_t>(j)]; };
  if (p == 0) return k(i) <= t && t < k(i + 1) ? 1 : 0;
  double sum = 0;
  if (k(i + p) > k(i)) sum += (t - k(i)) / (k(i + p) - k(i)) * basis_by_definition(knots, i, p - 1, t);
  if (k(i + p + 1) > k(i + 1)) sum += (k(i + p + 1) - t) / (k(i + p + 1) - k(i + 1)) * basis_by_definition(knots, i + 1, p - 1, t);
  return sum;
}

struct PatchSums {
  double area_mm2 = 0;
  Vec3 flux_mm3 = Vec3::Zero();  // integrals of x n_x, y n_y, z n_z
};

/// A whole B-spline patch: Gauss with eight nodes a direction on every knot span; tangents by central differences of positions.
inline PatchSums whole_patch(const BSplineSurface& s) {
  constexpr std::array<double, 4> x{0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363};
  constexpr std::array<double, 4> w{0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763};
  struct Row {
    double t, weight;
    std::array<std::vector<double>, 3> n;  // at t - h, t, t + h
    double h;
  };
  const auto rows = [&](const std::vector<double>& knots, int degree, int count) {
    std::vector<Row> all;
    for (std::size_t k = static_cast<std::size_t>(degree); k + 1 < knots.size() - static_cast<std::size_t>(degree); ++k) {
      const double a = knots[k], b = knots[k + 1];
      if (!(b > a)) continue;
      for (int j = 0; j < 8; ++j) {
        const double q = j < 4 ? -x[static_cast<std::size_t>(3 - j)] : x[static_cast<std::size_t>(j - 4)];
        Row r{0.5 * (a + b) + 0.5 * (b - a) * q, 0.5 * (b - a) * w[static_cast<std::size_t>(j < 4 ? 3 - j : j - 4)], {}, 1e-5 * (b - a)};
        for (int m = 0; m < 3; ++m)
          for (int i = 0; i < count; ++i)
            r.n[static_cast<std::size_t>(m)].push_back(basis_by_definition(knots, i, degree, r.t + (m - 1) * r.h));
        all.push_back(std::move(r));
      }
    }
    return all;
  };
  const std::vector<Row> us = rows(s.knots_u, s.degree_u, s.count_u), vs = rows(s.knots_v, s.degree_v, s.count_v);
  const auto point = [&](const std::vector<double>& nu, const std::vector<double>& nv) {
    Vec3 p = Vec3::Zero();
    double sum = 0;
    for (int i = 0; i < s.count_u; ++i) {
      if (nu[static_cast<std::size_t>(i)] == 0) continue;
      for (int j = 0; j < s.count_v; ++j) {
        const auto at = static_cast<std::size_t>(i * s.count_v + j);
        const double b = nu[static_cast<std::size_t>(i)] * nv[static_cast<std::size_t>(j)] * (s.weights.empty() ? 1 : s.weights[at]);
        p += b * s.poles[at], sum += b;
      }
    }
    return Vec3(p / sum);
  };
  PatchSums out;
  for (const Row& u : us)
    for (const Row& v : vs) {
      const Vec3 du = (point(u.n[2], v.n[1]) - point(u.n[0], v.n[1])) / (2 * u.h),
                 dv = (point(u.n[1], v.n[2]) - point(u.n[1], v.n[0])) / (2 * v.h);
      const Vec3 n = du.cross(dv);
      out.area_mm2 += u.weight * v.weight * n.norm();
      out.flux_mm3 += u.weight * v.weight * point(u.n[1], v.n[1]).cwiseProduct(n);
    }
  return out;
}

/// Area and volume of triangles alone, three ways round: the volume by x n_x, y n_y and z n_z.
struct TriangleSums {
  double area_mm2 = 0;
  Vec3 volume_mm3 = Vec3::Zero();
};
inline TriangleSums triangle_sums(const Mesh& m) {
  TriangleSums out;
  for (const auto& t : m.triangles) {
    const Vec3 &a = m.vertices[static_cast<std::size_t>(t[0])], &b = m.vertices[static_cast<std::size_t>(t[1])],
               &c = m.vertices[static_cast<std::size_t>(t[2])];
    const Vec3 n = 0.5 * (b - a).cross(c - a);
    out.area_mm2 += n.norm();
    out.volume_mm3 += n.cwiseProduct((a + b + c) / 3);
  }
  return out;
}

}  // namespace asbuilt::test
