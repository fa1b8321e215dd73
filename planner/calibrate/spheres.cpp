// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/spheres.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>

namespace asbuilt {
namespace {

/// Cauchy-weighted Gauss-Newton on the centre; the points within `gate` of the sphere take part.
SphereFit refine(const SphereRecipe& recipe, const std::vector<Vec3>& points, Vec3 c) {
  SphereFit f;
  double gate = 20 * recipe.sigma_mm;
  Mat3 N = Mat3::Identity();
  for (int i = 0; i < 25; ++i) {
    N.setZero();
    Vec3 b = Vec3::Zero();
    double sum = 0;
    std::size_t n = 0;
    for (const Vec3& p : points) {
      const Vec3 d = p - c;
      const double r = d.norm() - recipe.radius_mm;
      if (std::abs(r) > gate) continue;
      const Vec3 u = d.normalized();
      const double w = 1 / (1 + r * r / (9 * recipe.sigma_mm * recipe.sigma_mm));
      N += w * u * u.transpose();
      b += w * r * u;
      sum += r * r, ++n;
    }
    f.points_count = n;
    if (n < 10) return f;
    f.rms_mm = std::sqrt(sum / static_cast<double>(n));
    const Vec3 step = N.ldlt().solve(b);
    c += step;
    gate = std::max(4 * recipe.sigma_mm, gate * 0.7);
    if (step.norm() < 1e-9 && gate <= 4 * recipe.sigma_mm) break;
  }
  f.center = c;
  f.covariance = N.inverse() * recipe.sigma_mm * recipe.sigma_mm;
  // free radius of the same points: |p|^2 = 2 c.p + (R^2 - |c|^2)
  Eigen::Matrix4d M = Eigen::Matrix4d::Zero();
  Eigen::Vector4d v = Eigen::Vector4d::Zero();
  Vec3 mean = Vec3::Zero();
  for (const Vec3& p : points) {
    const Vec3 d = p - f.center;
    if (std::abs(d.norm() - recipe.radius_mm) > 4 * recipe.sigma_mm) continue;
    Eigen::Vector4d row;
    row << 2 * d, 1;
    M += row * row.transpose();
    v += row * d.squaredNorm();
    mean += d.normalized();
  }
  const Eigen::Vector4d x = M.ldlt().solve(v);
  f.free_radius_mm = std::sqrt(std::max(0.0, x[3] + x.head<3>().squaredNorm()));
  if (mean.norm() > 0) {
    mean.normalize();
    std::vector<double> angle;
    for (const Vec3& p : points) {
      const Vec3 d = p - f.center;
      if (std::abs(d.norm() - recipe.radius_mm) <= 4 * recipe.sigma_mm) angle.push_back(std::acos(std::clamp(mean.dot(d.normalized()), -1.0, 1.0)));
    }
    std::sort(angle.begin(), angle.end());
    if (!angle.empty()) f.cap_rad = angle[static_cast<std::size_t>(0.98 * static_cast<double>(angle.size() - 1))];
  }
  return f;
}

}  // namespace

std::vector<SphereFit> find_spheres(const SphereRecipe& recipe, const std::vector<Vec3>& points, std::uint64_t seed) {
  std::vector<SphereFit> out;
  std::vector<Vec3> rest = points;
  Random random(seed);
  const double near = 2 * recipe.radius_mm, tolerance = std::max(4 * recipe.sigma_mm, 0.01 * recipe.radius_mm);
  while (static_cast<int>(out.size()) < recipe.balls_max_count && static_cast<int>(rest.size()) >= recipe.points_min_count) {
    // neighbours by a grid of one diameter: three more points within reach of the first
    std::map<std::array<long, 3>, std::vector<std::size_t>> grid;
    const auto cell = [&](const Vec3& p) {
      return std::array<long, 3>{static_cast<long>(std::floor(p.x() / near)), static_cast<long>(std::floor(p.y() / near)), static_cast<long>(std::floor(p.z() / near))};
    };
    for (std::size_t i = 0; i < rest.size(); ++i) grid[cell(rest[i])].push_back(i);
    const auto around = [&](const Vec3& p) {
      std::vector<std::size_t> v;
      const auto c = cell(p);
      for (long x = -1; x <= 1; ++x)
        for (long y = -1; y <= 1; ++y)
          for (long z = -1; z <= 1; ++z)
            if (const auto it = grid.find({c[0] + x, c[1] + y, c[2] + z}); it != grid.end()) v.insert(v.end(), it->second.begin(), it->second.end());
      return v;
    };
    Vec3 best = Vec3::Zero();
    int best_support = 0;
    for (int trial = 0; trial < 1500; ++trial) {
      const Vec3 a = rest[random.below(rest.size())];
      const std::vector<std::size_t> near_a = around(a);
      if (near_a.size() < 20) continue;
      Mat3 M;
      Vec3 v;
      for (int k = 0; k < 3; ++k) {
        const Vec3 d = rest[near_a[random.below(near_a.size())]] - a;
        M.row(k) = 2 * d.transpose();
        v[k] = d.squaredNorm();
      }
      if (std::abs(M.determinant()) < 1e-3 * std::pow(recipe.radius_mm, 3)) continue;
      const Vec3 c = M.partialPivLu().solve(v);
      if (std::abs(c.norm() - recipe.radius_mm) > 0.2 * recipe.radius_mm) continue;
      const Vec3 center = a + c * (recipe.radius_mm / c.norm());
      int support = 0;
      for (std::size_t i : near_a) support += std::abs((rest[i] - center).norm() - recipe.radius_mm) < tolerance;
      if (support > best_support) best_support = support, best = center;
    }
    if (best_support < recipe.points_min_count) break;
    SphereFit f = refine(recipe, rest, best);
    std::vector<Vec3> left;
    for (const Vec3& p : rest)
      if ((p - f.center).norm() > recipe.radius_mm * 1.1) left.push_back(p);
    if (left.size() == rest.size()) break;
    rest.swap(left);
    if (static_cast<int>(f.points_count) >= recipe.points_min_count && f.cap_rad >= recipe.cap_min_rad && f.rms_mm < 3 * recipe.sigma_mm) out.push_back(f);
  }
  std::stable_sort(out.begin(), out.end(), [](const SphereFit& a, const SphereFit& b) { return a.points_count > b.points_count; });
  return out;
}

std::vector<std::optional<int>> identify_balls(const std::vector<Vec3>& centers, const std::vector<Vec3>& target, double tolerance_mm) {
  std::vector<std::optional<int>> best(centers.size());
  std::size_t best_count = 0;
  double best_error = 1e300;
  bool is_ambiguous = false;
  std::vector<int> pick(centers.size(), -1);
  const auto consider = [&]() {
    std::vector<std::size_t> who;
    for (std::size_t i = 0; i < pick.size(); ++i)
      if (pick[i] >= 0) who.push_back(i);
    if (who.size() < 3) return;
    Eigen::Matrix3Xd a(3, who.size()), b(3, who.size());
    for (std::size_t k = 0; k < who.size(); ++k) a.col(k) = target[pick[who[k]]], b.col(k) = centers[who[k]];
    const Eigen::Matrix4d T = Eigen::umeyama(a, b, false);
    const double error = ((T.topLeftCorner<3, 3>() * a).colwise() + Vec3(T.topRightCorner<3, 1>()) - b).colwise().norm().maxCoeff();
    if (error > tolerance_mm) return;
    if (who.size() == best_count && error < 3 * best_error + 0.1 * tolerance_mm && error > best_error) is_ambiguous = true;
    if (who.size() > best_count || (who.size() == best_count && error < best_error)) {
      is_ambiguous = who.size() == best_count && best_error < 3 * error + 0.1 * tolerance_mm;
      best_count = who.size(), best_error = error;
      for (std::size_t i = 0; i < pick.size(); ++i) best[i] = pick[i] >= 0 ? std::optional<int>(pick[i]) : std::nullopt;
    }
  };
  // few balls: every assignment
  const auto assign = [&](auto&& self, std::size_t i) -> void {
    if (i == centers.size()) return consider();
    for (int t = -1; t < static_cast<int>(target.size()); ++t) {
      bool fits = true;
      for (std::size_t k = 0; k < i && fits && t >= 0; ++k)
        if (pick[k] >= 0) fits = pick[k] != t && std::abs((centers[k] - centers[i]).norm() - (target[pick[k]] - target[t]).norm()) < 2 * tolerance_mm;
      if (!fits) continue;
      pick[i] = t;
      self(self, i + 1);
      pick[i] = -1;
    }
  };
  assign(assign, 0);
  if (best_count < 3 || is_ambiguous) return std::vector<std::optional<int>>(centers.size());
  return best;
}

}  // namespace asbuilt
