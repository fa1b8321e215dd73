// SPDX-License-Identifier: GPL-3.0-or-later
// Numbers the holes of a pass on the raster of the plate: neighbours first, then the whole, then which way round.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <optional>

#include "planner/calibrate/profilometer_holes.hpp"

namespace asbuilt {
namespace {

using Cell = std::pair<int, int>;

Eigen::Matrix<double, 10, 1> cubic(double i, double j) {
  Eigen::Matrix<double, 10, 1> m;
  m << 1, i, j, i * i, i * j, j * j, i * i * i, i * i * j, i * j * j, j * j * j;
  return m;
}

/// Smooth map raster -> whitened place by trimmed least squares; degree by how many holes there are.
struct RasterMap {
  Eigen::Matrix<double, 10, 2> k = Eigen::Matrix<double, 10, 2>::Zero();
  double scale = 1;
  Vec2 at(double i, double j) const { return k.transpose() * cubic(i / scale, j / scale); }
};
RasterMap fit_map(const std::map<Cell, std::size_t>& cells, const std::vector<Vec2>& q, double limit) {
  RasterMap map;
  for (const auto& [c, b] : cells) map.scale = std::max<double>(map.scale, std::max(std::abs(c.first), std::abs(c.second)));
  const int n = cells.size() > 40 ? 10 : cells.size() > 15 ? 6 : 3;
  for (int round = 0; round < 4; ++round) {
    Eigen::MatrixXd N = Eigen::MatrixXd::Zero(n, n), rhs = Eigen::MatrixXd::Zero(n, 2);
    for (const auto& [c, b] : cells) {
      const Eigen::VectorXd m = cubic(c.first / map.scale, c.second / map.scale).head(n);
      if (round > 0 && (map.at(c.first, c.second) - q[b]).norm() > limit) continue;
      N += m * m.transpose(), rhs += m * q[b].transpose();
    }
    N.diagonal().array() += 1e-9;
    map.k.setZero();
    map.k.topRows(n) = N.ldlt().solve(rhs);
  }
  return map;
}

enum class Size { small, large, unknown };

}  // namespace

Result<std::vector<NumberedHole>> number_holes(const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::string& scan_name) {
  auto no = [&](std::string code, std::string why, double measured, double limit, std::string unit) {
    return refuse({.code = std::move(code), .where = scan_name, .message = std::move(why), .measured = measured, .limit = limit, .unit = std::move(unit), .stage = "input"});
  };
  const std::size_t n = blobs.size();
  must(n >= 4, "too few holes to be numbered");
  // whitened by the usual shape of a hole, circles are circles again up to a turn: radius 2
  std::vector<double> entries[3];
  for (const HoleBlob& b : blobs) entries[0].push_back(b.moment(0, 0)), entries[1].push_back(b.moment(0, 1)), entries[2].push_back(b.moment(1, 1));
  for (auto& e : entries) std::nth_element(e.begin(), e.begin() + std::ptrdiff_t(n / 2), e.end());
  Eigen::Matrix2d M;
  M << entries[0][n / 2], entries[1][n / 2], entries[1][n / 2], entries[2][n / 2];
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> es(M);
  if (!(es.eigenvalues()[0] > 0)) return no("calibrate.holes_off_raster", "the dips have no common shape; scan the plate again", 0, 0, "holes");
  const Eigen::Matrix2d W = es.operatorInverseSqrt();
  std::vector<Vec2> q;
  for (const HoleBlob& b : blobs) q.push_back(W * Vec2(b.u, b.profile));

  std::vector<double> nearest(n);
  for (std::size_t a = 0; a < n; ++a) {
    nearest[a] = 1e300;
    for (std::size_t b = 0; b < n; ++b)
      if (a != b) nearest[a] = std::min(nearest[a], (q[a] - q[b]).norm());
  }
  std::vector<double> rims;
  for (const HoleBlob& b : blobs) rims.push_back(b.rim_ratio);
  std::nth_element(rims.begin(), rims.begin() + std::ptrdiff_t(n / 2), rims.end());
  auto sorted = nearest;
  std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(n / 2), sorted.end());
  const double pitch = sorted[n / 2], expected = 4 * plate.pitch_mm / (plate.diameter_mm * rims[n / 2]);
  if (pitch < 0.65 * expected || pitch > 1.55 * expected)
    return no("calibrate.plate_mismatch",
              fmt::format("the holes lie {:.2f} diameters apart, {:.2f} by the file of {}: another plate, or its pitch or diameter is wrong", pitch / 4 * rims[n / 2], expected / 4 * rims[n / 2], plate.name), pitch / 4 * rims[n / 2],
              expected / 4 * rims[n / 2], "diameters");
  double c4 = 0, s4 = 0;
  for (std::size_t a = 0; a < n; ++a)
    for (std::size_t b = 0; b < n; ++b) {
      const Vec2 d = q[b] - q[a];
      if (a == b || d.norm() > 1.25 * pitch) continue;
      const double phi = 4 * std::atan2(d.y(), d.x());
      c4 += std::cos(phi), s4 += std::sin(phi);
    }
  const double turn = std::atan2(s4, c4) / 4;

  // from hole to hole, with a basis that follows the perspective
  struct Basis {
    Vec2 e1, e2;
  };
  Vec2 mean = Vec2::Zero();
  for (const Vec2& p : q) mean += p / double(n);
  std::size_t seed = 0;
  for (std::size_t b = 1; b < n; ++b)
    if ((q[b] - mean).norm() < (q[seed] - mean).norm()) seed = b;
  std::map<Cell, std::size_t> cells;
  std::vector<std::optional<Cell>> cell_of(n);
  std::vector<Basis> basis(n);
  std::deque<std::size_t> queue{seed};
  cells[{0, 0}] = seed, cell_of[seed] = Cell{0, 0};
  basis[seed] = {pitch * Vec2(std::cos(turn), std::sin(turn)), pitch * Vec2(-std::sin(turn), std::cos(turn))};
  while (!queue.empty()) {
    const std::size_t a = queue.front();
    queue.pop_front();
    for (const auto& [di, dj] : {Cell{1, 0}, Cell{-1, 0}, Cell{0, 1}, Cell{0, -1}, Cell{2, 0}, Cell{-2, 0}, Cell{0, 2}, Cell{0, -2}}) {
      const Cell c{cell_of[a]->first + di, cell_of[a]->second + dj};
      if (cells.count(c)) continue;
      const Vec2 step = basis[a].e1 * di + basis[a].e2 * dj;
      std::size_t found = n;
      double best = (std::abs(di + dj) == 1 ? 0.3 : 0.35) * pitch;
      for (std::size_t b = 0; b < n; ++b)
        if (!cell_of[b] && (q[b] - q[a] - step).norm() < best) best = (q[b] - q[a] - step).norm(), found = b;
      if (found == n) continue;
      cells[c] = found, cell_of[found] = c, basis[found] = basis[a];
      const Vec2 real = (q[found] - q[a]) / (di + dj);
      Vec2& e = di ? basis[found].e1 : basis[found].e2;
      e = 0.5 * (e + real);
      queue.push_back(found);
    }
  }
  // the whole: what is off goes, what was left comes in
  const double limit = 0.22 * pitch;
  for (int round = 0; round < 3; ++round) {
    const RasterMap map = fit_map(cells, q, limit);
    std::erase_if(cells, [&](const auto& e) {
      const bool is_off = (map.at(e.first.first, e.first.second) - q[e.second]).norm() > limit;
      if (is_off) cell_of[e.second].reset();
      return is_off;
    });
    if (cells.empty()) break;
    int lo_i = 1 << 20, hi_i = -lo_i, lo_j = lo_i, hi_j = -lo_i;
    for (const auto& [c, b] : cells) lo_i = std::min(lo_i, c.first), hi_i = std::max(hi_i, c.first), lo_j = std::min(lo_j, c.second), hi_j = std::max(hi_j, c.second);
    for (std::size_t b = 0; b < n; ++b) {
      if (cell_of[b]) continue;
      for (int i = lo_i - 1; i <= hi_i + 1 && !cell_of[b]; ++i)
        for (int j = lo_j - 1; j <= hi_j + 1; ++j)
          if (!cells.count({i, j}) && (map.at(i, j) - q[b]).norm() < limit) {
            cells[{i, j}] = b, cell_of[b] = Cell{i, j};
            break;
          }
    }
  }
  if (double(cells.size()) < 0.95 * double(n) || cells.size() < 8)
    return no("calibrate.holes_off_raster", fmt::format("{} of {} holes lie on one raster, 95 % have to: dirt, a damaged plate, or a pass that was not steady", cells.size(), n),
              100.0 * double(cells.size()) / double(n), 95, "%");

  // large or small, against the holes around
  const double ratio = std::pow(plate.large_diameter_mm / plate.diameter_mm, 2), cut = std::sqrt(ratio);
  std::map<Cell, Size> size;
  std::vector<Cell> large;
  for (const auto& [c, b] : cells) {
    std::vector<std::pair<double, double>> around;
    for (const auto& [c2, b2] : cells)
      if (b2 != b) around.push_back({(q[b2] - q[b]).norm(), blobs[b2].area_count});
    const std::size_t m = std::min<std::size_t>(12, around.size());
    std::partial_sort(around.begin(), around.begin() + std::ptrdiff_t(m), around.end());
    std::vector<double> areas;
    for (std::size_t k = 0; k < m; ++k) areas.push_back(around[k].second);
    std::nth_element(areas.begin(), areas.begin() + std::ptrdiff_t(m / 2), areas.end());
    const double r = blobs[b].area_count / areas[m / 2];
    size[c] = r > cut * 1.06 ? Size::large : r < cut / 1.06 ? Size::small : Size::unknown;
    if (size[c] == Size::large) large.push_back(c);
  }
  // all turns, reflections and shifts
  int lo_i = 1 << 20, hi_i = -lo_i, lo_j = lo_i, hi_j = -lo_i;
  for (const auto& [c, b] : cells) lo_i = std::min(lo_i, c.first), hi_i = std::max(hi_i, c.first), lo_j = std::min(lo_j, c.second), hi_j = std::max(hi_j, c.second);
  struct Fit {
    int mismatch_count = 1 << 20, match_count = 0;
    int a = 1, b = 0, c = 0, d = 1, di = 0, dj = 0;
  } best, second;
  bool is_any_inside = false;
  for (const auto& [a, b, c, d] : {std::array{1, 0, 0, 1}, {0, -1, 1, 0}, {-1, 0, 0, -1}, {0, 1, -1, 0}, {-1, 0, 0, 1}, {0, 1, 1, 0}, {1, 0, 0, -1}, {0, -1, -1, 0}}) {
    int x0 = 1 << 20, x1 = -x0, y0 = x0, y1 = -x0;
    for (const auto& [i, j] : {Cell{lo_i, lo_j}, Cell{lo_i, hi_j}, Cell{hi_i, lo_j}, Cell{hi_i, hi_j}}) {
      x0 = std::min(x0, a * i + b * j), x1 = std::max(x1, a * i + b * j), y0 = std::min(y0, c * i + d * j), y1 = std::max(y1, c * i + d * j);
    }
    for (int dx = -x0; dx + x1 < plate.columns_count; ++dx)
      for (int dy = -y0; dy + y1 < plate.rows_count; ++dy) {
        is_any_inside = true;
        Fit f{0, 0, a, b, c, d, dx, dy};
        for (const Cell& l : large) {
          if (is_large_hole(plate, a * l.first + b * l.second + dx, c * l.first + d * l.second + dy)) ++f.match_count;
          else ++f.mismatch_count;
        }
        for (const auto& p : plate.large) {
          // back: the matrix is its own inverse transposed
          const int x = p[0] - dx, y = p[1] - dy;
          const auto it = size.find({a * x + c * y, b * x + d * y});
          if (it != size.end() && it->second == Size::small) ++f.mismatch_count;
        }
        auto is_better = [](const Fit& l, const Fit& r) {
          return l.mismatch_count < r.mismatch_count || (l.mismatch_count == r.mismatch_count && l.match_count > r.match_count);
        };
        if (is_better(f, best)) second = best, best = f;
        else if (is_better(f, second)) second = f;
      }
  }
  if (!is_any_inside)
    return no("calibrate.plate_mismatch",
              fmt::format("the pass shows a raster of {} x {} holes, {} has {} x {}: another plate's file", hi_i - lo_i + 1, hi_j - lo_j + 1, plate.name, plate.columns_count, plate.rows_count),
              std::max(hi_i - lo_i, hi_j - lo_j) + 1, std::max(plate.columns_count, plate.rows_count), "holes");
  if (best.mismatch_count > 2 || (best.mismatch_count > 0 && best.match_count < 2))
    return no("calibrate.plate_mismatch",
              fmt::format("the {} large holes seen do not stand as in the file of {} ({} contradictions in the best of all turns and shifts): another plate, or its large holes are entered wrong",
                          large.size(), plate.name, best.mismatch_count),
              best.mismatch_count, 2, "holes");
  if (second.mismatch_count <= best.mismatch_count && second.match_count >= best.match_count)
    return no("calibrate.plate_ambiguous",
              fmt::format("{} large holes are seen, which leaves more than one way to lay the plate under them: scan so that all three are seen, or clean them", large.size()), double(large.size()), 3,
              "holes");
  std::vector<NumberedHole> out;
  for (const auto& [c, b] : cells) out.push_back({b, best.a * c.first + best.b * c.second + best.di, best.c * c.first + best.d * c.second + best.dj});
  std::sort(out.begin(), out.end(), [](const NumberedHole& l, const NumberedHole& r) { return std::pair(l.row, l.column) < std::pair(r.row, r.column); });
  return out;
}

}  // namespace asbuilt
