// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/feed/feed.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

namespace {
constexpr double kRootWidthMm = 0.2;       // thickness where none was measured, and the least that is believed
constexpr double kThicknessQuantile = 0.85;
constexpr double kThinMm = 0.1;            // below this height a cross-section says little
constexpr std::size_t kRatiosLeastCount = 20, kAroundCount = 2;  // stations for a thickness; neighbours to either side
constexpr double kLeanLow = 0.7, kLeanHigh = 1.42;  // extent along the chamfer's normal per ISO height: fin along a face, along the bisector
constexpr double kCycleS = 0.012;          // slowest interpolation cycle among the controllers
constexpr double kStepRatio = 0.05;        // a block's feed may lie this far under its points' limits
constexpr double kTurnMaxRad = 0.07;       // 4 degrees of tool axis a block

}  // namespace

double burr_thickness_mm(const std::vector<const EdgeBurr*>& burrs) {
  std::vector<double> ratios;
  for (const EdgeBurr* b : burrs)
    for (std::size_t i = 0; i < b->height_mm.size(); ++i) {
      const double h = b->height_mm[i], a = b->area_mm2[i];
      if (std::isfinite(h) && std::isfinite(a) && h > kThinMm && a > 0) ratios.push_back(a / h);
    }
  if (ratios.size() < kRatiosLeastCount) return kRootWidthMm;
  const auto k = static_cast<std::ptrdiff_t>(kThicknessQuantile * static_cast<double>(ratios.size() - 1));
  std::nth_element(ratios.begin(), ratios.begin() + k, ratios.end());
  // A fin seen from one side reads thin: never faster than where nothing was measured.
  return std::max(kRootWidthMm, ratios[static_cast<std::size_t>(k)]);
}

std::vector<BurrBound> burr_bounds(const EdgeBurr& burr, double burr_max_height_mm, double thickness_mm) {
  const std::size_t n = burr.height_mm.size();
  must(burr.height_upper_mm.size() == n && burr.area_mm2.size() == n && burr.width_mm.size() == n, "burr arrays are not parallel");
  std::vector<BurrBound> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double height = burr.height_mm[i], upper = burr.height_upper_mm[i];
    if (std::isfinite(height)) {
      out[i].height_mm = std::max(std::isfinite(upper) ? std::max(upper, height) : height, 0.0);
    } else {
      out[i].height_mm = std::isfinite(upper) ? std::max(upper, 0.0) : burr_max_height_mm;
    }
    // a thick place counts where at least three of five neighbours say so
    std::vector<double> around;
    for (std::size_t k = i - std::min(i, kAroundCount); k <= std::min(i + kAroundCount, n - 1); ++k)
      if (std::isfinite(burr.height_mm[k]) && std::isfinite(burr.area_mm2[k]) && burr.height_mm[k] > kThinMm)
        around.push_back(std::max(burr.area_mm2[k], 0.0) / burr.height_mm[k]);
    std::sort(around.begin(), around.end());
    out[i].area_mm2 = out[i].height_mm * std::max(thickness_mm, around.empty() ? 0.0 : around[around.size() / 2]);
  }
  return out;
}

double feed_ceiling_mm_s(const Recipe& recipe, const Cutter& cutter) {
  double v = recipe.feed_max_mm_s;
  if (recipe.chip_load_mm) v = std::min(v, *recipe.chip_load_mm * cutter.teeth_count * recipe.spindle_rpm / 60.0);
  return v;
}

double pass_area_mm2(const BurrBound& burr, double outer_mm, double inner_mm, double chamfer_area_mm2) {
  double worst = 0;
  if (burr.height_mm > 0 && burr.area_mm2 > 0) {
    for (double lean : {kLeanLow, 1.0, kLeanHigh}) {
      const double extent = lean * burr.height_mm;
      const double a = std::clamp(1 - inner_mm / extent, 0.0, 1.0), b = std::clamp(1 - outer_mm / extent, 0.0, 1.0);
      worst = std::max({worst, a - b, a * a - b * b});
    }
  }
  return worst * burr.area_mm2 + (inner_mm <= 0 ? chamfer_area_mm2 : 0.0);
}

PassDepths choose_passes(const std::vector<BurrBound>& burr, const std::vector<double>& chamfer, double area_max, int passes_max) {
  must(burr.size() == chamfer.size(), "burr and chamfer are not parallel");
  double extent = 0;
  for (const BurrBound& b : burr) extent = std::max(extent, kLeanHigh * b.height_mm);
  const auto worst = [&](const std::vector<double>& offsets) {
    double w = 0, outer = 1e9;
    for (double inner : offsets) {
      for (std::size_t i = 0; i < burr.size(); ++i) w = std::max(w, pass_area_mm2(burr[i], outer, inner, chamfer[i]));
      outer = inner;
    }
    return w;
  };
  PassDepths best;
  best.worst_area_mm2 = worst({0.0});
  if (best.worst_area_mm2 <= area_max) {
    best.offsets_mm = {0.0};
    return best;
  }
  constexpr int kGrid = 20;
  for (int n = 2; n <= passes_max; ++n) {
    std::vector<double> chosen;
    double least = 1e300;
    std::vector<int> k(static_cast<std::size_t>(n - 1));
    // every descending choice of n - 1 grid depths; more than three planes are spread evenly between the best two
    const auto consider = [&](std::vector<double> offsets) {
      offsets.push_back(0.0);
      const double w = worst(offsets);
      if (w < least - 1e-12) least = w, chosen = offsets;
    };
    for (int i = 1; i < kGrid; ++i) {
      if (n == 2) consider({extent * i / kGrid});
      for (int j = 1; n > 2 && j < i; ++j) {
        std::vector<double> offsets;
        for (int p = 0; p < n - 1; ++p) offsets.push_back(extent * (i + (j - i) * static_cast<double>(p) / (n - 2)) / kGrid);
        consider(offsets);
      }
    }
    best.worst_area_mm2 = std::min(best.worst_area_mm2, least);
    if (least <= area_max) {
      best.offsets_mm = chosen;
      best.worst_area_mm2 = least;
      return best;
    }
  }
  return best;
}

std::vector<double> windowed_min(const std::vector<double>& position, const std::vector<double>& value, double reach) {
  std::vector<double> out(value.size());
  std::size_t a = 0, b = 0;
  for (std::size_t i = 0; i < value.size(); ++i) {
    while (position[a] < position[i] - reach) ++a;
    while (b < value.size() && position[b] <= position[i] + reach) ++b;
    out[i] = *std::min_element(value.begin() + static_cast<std::ptrdiff_t>(a), value.begin() + static_cast<std::ptrdiff_t>(b));
  }
  return out;
}

std::vector<FeedBlock> feed_blocks(const std::vector<Vec3>& point, const std::vector<Vec3>& axis, const std::vector<double>& limit,
                                   const std::vector<char>& keep, double chord_mm, double feed_min_mm_s) {
  const std::size_t n = point.size();
  must(axis.size() == n && limit.size() == n && keep.size() == n, "path arrays are not parallel");
  const auto chord_holds = [&](std::size_t a, std::size_t b) {
    const Vec3 d = point[b] - point[a];
    const double l2 = std::max(d.squaredNorm(), 1e-12);
    for (std::size_t i = a + 1; i < b; ++i) {
      const double t = std::clamp((point[i] - point[a]).dot(d) / l2, 0.0, 1.0);
      if ((point[a] + t * d - point[i]).norm() > chord_mm) return false;
    }
    return std::acos(std::clamp(axis[a].dot(axis[b]), -1.0, 1.0)) <= kTurnMaxRad;
  };
  std::vector<FeedBlock> out;
  std::size_t a = 0;
  while (a + 1 < n) {
    std::size_t b = a + 1;
    double low = std::min(limit[a], limit[b]), high = std::max(limit[a], limit[b]), length = (point[b] - point[a]).norm();
    while (b + 1 < n && !keep[b]) {
      const double low_next = std::min(low, limit[b + 1]), high_next = std::max(high, limit[b + 1]);
      const double shortest = std::max(3 * low * kCycleS, 1.0);
      if (length >= shortest && low_next < high_next * (1 - kStepRatio)) break;
      if (!chord_holds(a, b + 1)) break;
      length += (point[b + 1] - point[b]).norm();
      ++b, low = low_next, high = high_next;
    }
    double feed = std::floor(low * 10 + 1e-6) / 10;
    if (!out.empty()) {  // hysteresis: a smaller step than half a percent step is no step
      const double before = out.back().feed_mm_s;
      if (before <= feed && before >= feed * (1 - 0.4 * kStepRatio)) feed = before;
    }
    feed = std::max(feed, std::ceil(feed_min_mm_s * 10 - 1e-6) / 10);
    out.push_back({a, b, rounded(feed, 1)});
    a = b;
  }
  return out;
}

}  // namespace asbuilt
