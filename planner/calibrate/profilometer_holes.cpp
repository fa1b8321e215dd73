// SPDX-License-Identifier: GPL-3.0-or-later
// Dips below the plate's face in a raw pass.
#include "planner/calibrate/profilometer_holes.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

constexpr float kGap = std::numeric_limits<float>::quiet_NaN();
constexpr int kTerms = 15;  // of degree 4 in two variables

struct Grid {
  int profiles = 0, columns = 0;
  double u_min = 0, u_step = 1;
  std::vector<float> v;
  float& at(int i, int c) { return v[std::size_t(i) * std::size_t(columns) + std::size_t(c)]; }
  float at(int i, int c) const { return v[std::size_t(i) * std::size_t(columns) + std::size_t(c)]; }
};

Grid grid_of(const ProfileScan& scan) {
  Grid g;
  std::vector<float> steps;
  float lo = std::numeric_limits<float>::max(), hi = -lo;
  for (std::size_t i = 0; i + 1 < scan.begin.size(); ++i)
    for (std::size_t k = scan.begin[i]; k < scan.begin[i + 1]; ++k) {
      const Eigen::Vector2f& p = scan.uv[k];
      if (!std::isfinite(p.x()) || !std::isfinite(p.y())) continue;
      lo = std::min(lo, p.x()), hi = std::max(hi, p.x());
      if (k > scan.begin[i] && i % 16 == 0 && p.x() > scan.uv[k - 1].x()) steps.push_back(p.x() - scan.uv[k - 1].x());
    }
  if (steps.empty() || !(hi > lo)) return g;
  std::nth_element(steps.begin(), steps.begin() + std::ptrdiff_t(steps.size() / 2), steps.end());
  g.u_min = lo, g.u_step = std::max<double>(steps[steps.size() / 2], (double(hi) - lo) / 8191);
  g.columns = int((hi - lo) / g.u_step) + 1, g.profiles = int(scan.begin.size()) - 1;
  g.v.assign(std::size_t(g.columns) * std::size_t(g.profiles), kGap);
  for (int i = 0; i < g.profiles; ++i)
    for (std::size_t k = scan.begin[std::size_t(i)]; k < scan.begin[std::size_t(i) + 1]; ++k) {
      const Eigen::Vector2f& p = scan.uv[k];
      if (std::isfinite(p.x()) && std::isfinite(p.y())) g.at(i, std::clamp(int(std::lround((p.x() - g.u_min) / g.u_step)), 0, g.columns - 1)) = p.y();
    }
  return g;
}

using Terms = Eigen::Matrix<double, kTerms, 1>;
/// Monomials by rising degree: the first 3 are a plane's.
Terms terms(const Grid& g, double i, double c) {
  const double s = 2 * i / g.profiles - 1, t = 2 * c / g.columns - 1;
  Terms m;
  int k = 0;
  for (int degree = 0; degree <= 4; ++degree)
    for (int j = 0; j <= degree; ++j) {
      double x = 1;
      for (int n = 0; n < degree - j; ++n) x *= s;
      for (int n = 0; n < j; ++n) x *= t;
      m[k++] = x;
    }
  return m;
}

struct Face {
  Terms coefficients = Terms::Zero();
  double sd = 0;
  double at(const Grid& g, double i, double c) const { return coefficients.dot(terms(g, i, c)); }
};

/// The largest smooth surface.
bool fit_face(const Grid& g, Face& face) {
  struct Sample {
    Terms m;
    double v;
  };
  std::vector<Sample> samples;
  const std::size_t stride = std::max<std::size_t>(1, g.v.size() / 30000);
  for (std::size_t k = 0; k < g.v.size(); k += stride)
    if (!std::isnan(g.v[k])) samples.push_back({terms(g, double(k / std::size_t(g.columns)), double(k % std::size_t(g.columns))), g.v[k]});
  if (samples.size() < 500) return false;
  Random random(11);
  std::vector<double> r(std::min<std::size_t>(samples.size(), 600));
  double best = 1e300;
  for (int trial = 0; trial < 300; ++trial) {
    Mat3 A;
    Vec3 b;
    for (int k = 0; k < 3; ++k) {
      const Sample& s = samples[random.below(samples.size())];
      A.row(k) = s.m.head<3>().transpose(), b[k] = s.v;
    }
    if (std::abs(A.determinant()) < 0.05) continue;
    const Vec3 x = A.inverse() * b;
    for (std::size_t k = 0; k < r.size(); ++k) {
      const Sample& s = samples[k * samples.size() / r.size()];
      r[k] = std::abs(s.v - x.dot(s.m.head<3>()));
    }
    const auto mid = r.begin() + std::ptrdiff_t(r.size() * 35 / 100);
    std::nth_element(r.begin(), mid, r.end());
    if (*mid < best) best = *mid, face.coefficients.setZero(), face.coefficients.head<3>() = x;
  }
  double limit = 4 * best;
  for (int round = 0; round < 14; ++round) {
    const int n = round < 3 ? 3 : round < 6 ? 6 : round < 9 ? 10 : kTerms;
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd rhs = Eigen::VectorXd::Zero(n);
    std::vector<double> inside;
    for (const Sample& s : samples) {
      const double e = s.v - face.coefficients.dot(s.m);
      if (std::abs(e) > limit) continue;
      inside.push_back(std::abs(e));
      N.selfadjointView<Eigen::Lower>().rankUpdate(s.m.head(n)), rhs += s.m.head(n) * s.v;
    }
    if (inside.size() < 200) return false;
    N.diagonal().array() += 1e-9 * double(inside.size());
    face.coefficients.setZero();
    face.coefficients.head(n) = N.selfadjointView<Eigen::Lower>().ldlt().solve(rhs);
    std::nth_element(inside.begin(), inside.begin() + std::ptrdiff_t(inside.size() / 2), inside.end());
    face.sd = 1.4826 * inside[inside.size() / 2];
    limit = std::max(3 * face.sd, 1e-12);
  }
  return true;
}

/// Connected dips on one side of the face.
std::vector<HoleBlob> dips(const Grid& g, const std::vector<float>& below, double sign, double threshold) {
  const int P = g.profiles, C = g.columns;
  std::vector<std::int32_t> label(below.size(), -1);
  auto in = [&](std::size_t k) { return sign * below[k] > threshold; };
  // gaps inside a dip belong to it when both ends of the gap do
  std::vector<char> mask(below.size(), 0);
  for (int i = 0; i < P; ++i) {
    int last = -1;
    for (int c = 0; c < C; ++c) {
      const std::size_t k = std::size_t(i) * std::size_t(C) + std::size_t(c);
      if (std::isnan(below[k])) continue;
      mask[k] = in(k);
      if (mask[k] && last >= 0 && c - last > 1 && c - last <= 8 && mask[std::size_t(i) * std::size_t(C) + std::size_t(last)])
        for (int d = last + 1; d < c; ++d) mask[std::size_t(i) * std::size_t(C) + std::size_t(d)] = 1;
      last = c;
    }
  }
  std::vector<HoleBlob> all;
  std::vector<std::size_t> stack;
  for (std::size_t seed = 0; seed < mask.size(); ++seed) {
    if (!mask[seed] || label[seed] >= 0) continue;
    stack.assign(1, seed);
    label[seed] = 1;
    double n = 0, si = 0, sc = 0, sii = 0, sic = 0, scc = 0, depth = 0, deep = 0;
    bool is_cut = false;
    while (!stack.empty()) {
      const std::size_t k = stack.back();
      stack.pop_back();
      const int i = int(k / std::size_t(C)), c = int(k % std::size_t(C));
      if (!std::isnan(below[k])) depth += std::abs(below[k]), ++deep;
      ++n, si += i, sc += c, sii += double(i) * i, sic += double(i) * c, scc += double(c) * c;
      is_cut = is_cut || i == 0 || c == 0 || i == P - 1 || c == C - 1;
      for (const auto& [di, dc] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        const int a = i + di, b = c + dc;
        if (a < 0 || b < 0 || a >= P || b >= C) continue;
        const std::size_t j = std::size_t(a) * std::size_t(C) + std::size_t(b);
        if (mask[j] && label[j] < 0) label[j] = 1, stack.push_back(j);
      }
    }
    if (is_cut || n < 12 || n > 0.02 * double(mask.size())) continue;
    HoleBlob b;
    const double mi = si / n, mc = sc / n;
    // a cone cut off at the threshold has its mean depth a third of the way from there to the tip
    b.rim_ratio = std::clamp(1 - threshold / std::max(threshold, 3 * depth / std::max(1.0, deep) - 2 * threshold), 0.2, 1.0);
    b.profile = mi, b.u = g.u_min + g.u_step * mc, b.area_count = n;
    b.moment << (scc / n - mc * mc) * g.u_step * g.u_step, (sic / n - mi * mc) * g.u_step, (sic / n - mi * mc) * g.u_step, sii / n - mi * mi;
    all.push_back(b);
  }
  // the usual size: where half of all dip samples lie in larger ones; far smaller or larger is no hole
  std::vector<double> areas;
  double total = 0;
  for (const HoleBlob& b : all) areas.push_back(b.area_count), total += b.area_count;
  std::sort(areas.begin(), areas.end());
  double usual = 0, sum = 0;
  for (const double a : areas)
    if ((sum += a) >= 0.5 * total) {
      usual = a;
      break;
    }
  std::erase_if(all, [&](const HoleBlob& b) { return b.area_count < 0.3 * usual || b.area_count > 6 * usual || !(b.moment.determinant() > 0); });
  return all;
}

}  // namespace

Result<std::vector<HoleBlob>> find_holes(const ProfileScan& scan) {
  auto none = [&](std::string why, double found) {
    return refuse({.code = "calibrate.holes_not_found", .where = scan.name, .message = std::move(why), .measured = found, .limit = 12, .unit = "holes", .stage = "input"});
  };
  const Grid g = grid_of(scan);
  Face face;
  if (g.profiles < 20 || g.columns < 20 || !fit_face(g, face))
    return none("found no surface: fewer than 500 valid points or no plate in range; scan the plate again", 0);
  std::vector<float> below(g.v.size(), kGap);
  for (int i = 0; i < g.profiles; ++i)
    for (int c = 0; c < g.columns; ++c)
      if (!std::isnan(g.at(i, c))) below[std::size_t(i) * std::size_t(g.columns) + std::size_t(c)] = float(g.at(i, c) - face.at(g, i, c));
  std::vector<HoleBlob> best;
  for (const double sign : {1.0, -1.0}) {
    auto some = dips(g, below, sign, 5 * face.sd);
    if (some.size() > best.size()) best = std::move(some);
  }
  if (best.size() < 12)
    return none(fmt::format("found {} dips in the plate's face, 12 are the least: wrong target, holes hidden by the tilt, or too few profiles per hole", best.size()), double(best.size()));
  for (HoleBlob& b : best) b.v = face.at(g, b.profile, (b.u - g.u_min) / g.u_step);
  return best;
}

}  // namespace asbuilt
