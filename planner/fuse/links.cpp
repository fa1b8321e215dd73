// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/links.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "planner/base/number.hpp"

namespace asbuilt {

namespace {

struct CellMean {
  std::array<std::int64_t, 3> cell{};
  int capture = 0;
  Vec3 p = Vec3::Zero(), n = Vec3::Zero();
  int count = 0;
};

/// Means of every capture in every cell, sorted by cell, then capture. Sums in fixed point, so that the order of points does not matter.
std::vector<CellMean> means_of(const MeasuredCloud& cloud, const LinkRecipe& recipe) {
  struct Tag {
    std::array<std::int64_t, 3> cell;
    std::int32_t capture;
    std::uint32_t point;
  };
  std::vector<Tag> tags;
  tags.reserve(cloud.p_base.size());
  for (std::size_t i = 0; i < cloud.p_base.size(); ++i) {
    if (cloud.n_base[i].squaredNorm() < 0.5f) continue;
    const Vec3 c = (cloud.p_base[i] / recipe.cell_mm).array().floor();
    tags.push_back({{std::int64_t(c.x()), std::int64_t(c.y()), std::int64_t(c.z())}, cloud.capture[i], std::uint32_t(i)});
  }
  std::sort(tags.begin(), tags.end(), [](const Tag& a, const Tag& b) { return std::tie(a.cell, a.capture, a.point) < std::tie(b.cell, b.capture, b.point); });
  std::vector<CellMean> out;
  constexpr double kUnit = 1e6;
  for (std::size_t i = 0; i < tags.size();) {
    std::size_t k = i;
    std::array<std::int64_t, 6> sum{};
    for (; k < tags.size() && tags[k].cell == tags[i].cell && tags[k].capture == tags[i].capture; ++k)
      for (int a = 0; a < 3; ++a) {
        sum[std::size_t(a)] += std::llround(kUnit * cloud.p_base[tags[k].point][a]);
        sum[std::size_t(3 + a)] += std::llround(kUnit * double(cloud.n_base[tags[k].point][a]));
      }
    const double n = double(k - i);
    const Vec3 normal = Vec3(double(sum[3]), double(sum[4]), double(sum[5])) / (n * kUnit);
    // normals that spread over the cell are an edge, not a face
    if (int(k - i) >= recipe.points_min_count && normal.norm() > 0.95)
      out.push_back({tags[i].cell, tags[i].capture, Vec3(double(sum[0]), double(sum[1]), double(sum[2])) / (n * kUnit), normal.normalized(), int(k - i)});
    i = k;
  }
  return out;
}

std::string words_of(const Vec6& w) {
  const auto three = [](const Vec3& v) { return fmt::format("({}, {}, {})", fixed_number(v.x(), 2), fixed_number(v.y(), 2), fixed_number(v.z(), 2)); };
  const double shift = w.head<3>().norm(), turn = w.tail<3>().norm();
  return shift >= turn ? "shift along " + three(w.head<3>() / shift) : "turn about " + three(w.tail<3>() / turn);
}

std::vector<CaptureLink> links_at(const MeasuredCloud& cloud, const LinkRecipe& recipe) {
  const std::vector<CellMean> means = means_of(cloud, recipe);
  std::map<std::pair<int, int>, std::vector<std::pair<std::size_t, std::size_t>>> shared;
  for (std::size_t i = 0; i < means.size();) {
    std::size_t k = i;
    while (k < means.size() && means[k].cell == means[i].cell) ++k;
    for (std::size_t a = i; a < k; ++a)
      for (std::size_t b = a + 1; b < k; ++b)
        if (means[a].n.dot(means[b].n) > std::cos(recipe.turn_max_rad)) shared[{means[a].capture, means[b].capture}].emplace_back(a, b);
    i = k;
  }
  std::vector<CaptureLink> out;
  for (const auto& [pair, cells] : shared) {
    if (cells.size() < 6) continue;
    CaptureLink l;
    l.first = pair.first, l.second = pair.second, l.cells_count = int(cells.size());
    Vec3 middle = Vec3::Zero();
    for (const auto& c : cells) middle += means[c.first].p / double(cells.size());
    double size = 0;
    for (const auto& c : cells) size += (means[c.first].p - middle).squaredNorm() / double(cells.size());
    size = std::max(1e-3, std::sqrt(size));
    const double na = cloud.captures[std::size_t(l.first)].noise_mm, nb = cloud.captures[std::size_t(l.second)].noise_mm;
    Mat6 H = Mat6::Zero();
    double square = 0;
    for (const auto& c : cells) {
      const CellMean &a = means[c.first], &b = means[c.second];
      const Vec3 n = (a.n + b.n).normalized();
      const double d = n.dot(a.p - b.p);
      // a cell's points share much of their noise: they count as one
      const double var = std::max(1e-8, na * na + nb * nb);
      Vec6 row;
      row << n, (a.p - middle).cross(n) / size;
      H += row * row.transpose() / var;
      square += d * d;
    }
    l.rms_mm = std::sqrt(square / double(cells.size()));
    const Eigen::SelfAdjointEigenSolver<Mat6> es(H);
    for (int i = 0; i < 6; ++i) l.sd_mm[std::size_t(i)] = 1 / std::sqrt(std::max(1e-12, es.eigenvalues()[5 - i]));
    l.weakest = es.eigenvectors().col(0);
    Eigen::Index most = 0;
    l.weakest.cwiseAbs().maxCoeff(&most);
    if (l.weakest[most] < 0) l.weakest = -l.weakest;
    l.text = fmt::format("{} and {}: {} cells, {} mm rms apart, {} known to {} mm", cloud.captures[std::size_t(l.first)].name, cloud.captures[std::size_t(l.second)].name, l.cells_count, fixed_number(l.rms_mm, 3),
                         words_of(l.weakest), fixed_number(std::min(l.sd_mm[5], 999.0), 3));
    out.push_back(std::move(l));
  }
  return out;
}

}  // namespace

std::vector<CaptureLink> capture_links(const MeasuredCloud& cloud, const LinkRecipe& recipe) {
  std::vector<CaptureLink> out = links_at(cloud, recipe);
  // coarse captures hold too few points in a fine cell: their pairs are looked at again in cells that suit them
  LinkRecipe coarse = recipe;
  for (const CloudCapture& c : cloud.captures) coarse.cell_mm = std::max(coarse.cell_mm, 4 * c.spacing_mm);
  if (coarse.cell_mm > recipe.cell_mm)
    for (CaptureLink& l : links_at(cloud, coarse)) {
      const bool is_known = std::any_of(out.begin(), out.end(), [&](const CaptureLink& o) { return o.first == l.first && o.second == l.second; });
      if (!is_known) out.push_back(std::move(l));
    }
  std::stable_sort(out.begin(), out.end(), [](const CaptureLink& a, const CaptureLink& b) { return std::tie(a.first, a.second) < std::tie(b.first, b.second); });
  return out;
}

}  // namespace asbuilt
