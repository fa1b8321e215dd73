// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/burr.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/number.hpp"
#include "planner/burr/profile.hpp"
#include "planner/burr/section.hpp"

namespace asbuilt {

namespace burring {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

double quantile(std::vector<double>& v, double q) {
  if (v.empty()) return 0;
  const std::size_t k = std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())));
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(k), v.end());
  return v[k];
}

/// The direction in which the fin leans at each station: robust mean direction of the proud points around it.
struct Lean {
  std::vector<double> angle_rad;  // of (f_1, f_2)
};
Lean find_lean(const std::vector<SectionPoint>& proud, const std::vector<double>& stations) {
  Lean out;
  std::size_t a = 0, b = 0;
  for (const double s : stations) {
    while (a < proud.size() && proud[a].s_mm < s - 4) ++a;
    while (b < proud.size() && proud[b].s_mm < s + 4) ++b;
    std::vector<double> angles;
    for (std::size_t i = a; i < b; ++i)
      if (proud[i].out_mm() > 0.08) angles.push_back(std::atan2(proud[i].f_2_mm, proud[i].f_1_mm));
    out.angle_rad.push_back(angles.size() < 5 ? kNan : quantile(angles, 0.5));
  }
  return out;
}

std::size_t count_between(const std::vector<float>& sorted, double a, double b) {
  return static_cast<std::size_t>(std::lower_bound(sorted.begin(), sorted.end(), static_cast<float>(b)) -
                                  std::lower_bound(sorted.begin(), sorted.end(), static_cast<float>(a)));
}

/// Thickness at the root: spread of the lower half of the fin square to its lean; both flanks are rarely seen, so the middle of
/// the seen flank is taken to be the fin's outside where only one is.
double root_width(const std::vector<SectionPoint>& proud, double s, double window, double angle, double height) {
  std::vector<double> across;
  for (const SectionPoint& p : proud) {
    if (std::abs(p.s_mm - s) > window) continue;
    if (p.out_mm() > 0.6 * height + 0.03) continue;
    across.push_back(-std::sin(angle) * p.f_1_mm + std::cos(angle) * p.f_2_mm);
  }
  if (across.size() < 6) return kNan;
  std::vector<double> work = across;
  const double low = quantile(work, 0.05), high = quantile(across, 0.95);
  return std::clamp(high - low, 0.02, 1.0);
}

}  // namespace
}  // namespace burring

Result<Done<Burrs>> measure_burrs(const BurrRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location,
                                  const Features& features) {
  using namespace burring;
  Done<Burrs> done;
  Refusals refusals;

  double finest_mm = 1e300;
  for (const CloudCapture& c : cloud.captures)
    if (c.end > c.begin) finest_mm = std::min(finest_mm, std::max(1e-4, c.noise_mm));
  std::vector<char> use;
  for (const CloudCapture& c : cloud.captures) use.push_back(c.end > c.begin && c.noise_mm <= 4 * finest_mm);

  double limit_most = 0;
  for (const AdaptedEdge& e : features.edges)
    for (const FeatureSpec& f : job.part.features)
      if (f.id == e.feature)
        if (const Recipe* r = job.recipe(f.recipe)) limit_most = std::max(limit_most, r->burr_max_height_mm);
  SectionOptions how;
  how.threshold_mm = std::max(0.03, 5 * finest_mm);
  how.reach_mm = std::max(3.0, 2.2 * limit_most + 0.5);
  std::vector<EdgeSection> sections = cut_sections(how, cloud, location, features, use);

  for (std::size_t e = 0; e < features.edges.size(); ++e) {
    const AdaptedEdge& edge = features.edges[e];
    EdgeSection& section = sections[e];
    std::stable_sort(section.proud.begin(), section.proud.end(), [](const SectionPoint& a, const SectionPoint& b) { return a.s_mm < b.s_mm; });
    const std::string where = "edge " + edge.id + " of " + edge.feature;
    double limit = 0;
    for (const FeatureSpec& f : job.part.features)
      if (f.id == edge.feature)
        if (const Recipe* r = job.recipe(f.recipe)) limit = r->burr_max_height_mm;
    const std::size_t count = edge.s_mm.size();
    const double step = count > 1 ? edge.s_mm.back() / static_cast<double>(count - 1) : 1;

    // Seen or not: face points on both sides close to the edge, or a burr itself.
    std::vector<double> coverage(count, 0);
    std::size_t face_points = section.face_1_s.size() + section.face_2_s.size();
    for (std::size_t i = 0; i < count; ++i) {
      const double a = edge.s_mm[i] - recipe.window_mm - 0.5, b = edge.s_mm[i] + recipe.window_mm + 0.5;
      const double side_1 = std::min(1.0, static_cast<double>(count_between(section.face_1_s, a, b)) / 6.0);
      const double side_2 = std::min(1.0, static_cast<double>(count_between(section.face_2_s, a, b)) / 6.0);
      std::size_t proud = 0;
      for (const SectionPoint& p : section.proud) proud += p.s_mm > a && p.s_mm < b;
      coverage[i] = std::min(1.0, std::max(0.5 * (side_1 + side_2), std::min(1.0, static_cast<double>(proud) / 6.0)));
    }

    const Lean lean = find_lean(section.proud, edge.s_mm);
    std::vector<HeightSample> samples;
    double tallest = 0;
    for (const SectionPoint& p : section.proud) {
      const std::size_t i = std::min(count - 1, static_cast<std::size_t>(std::lround(p.s_mm / std::max(step, 1e-9))));
      double fits = 0.7;
      if (std::isfinite(lean.angle_rad[i])) {
        const double across = -std::sin(lean.angle_rad[i]) * p.f_1_mm + std::cos(lean.angle_rad[i]) * p.f_2_mm;
        fits = 0.02 + 0.96 * std::exp(-0.5 * across * across / (0.09 * 0.09 + 0.15 * 0.15 * p.out_mm() * p.out_mm()));
      }
      samples.push_back({p.s_mm, p.out_mm(), std::max(0.006, static_cast<double>(p.sigma_mm)), fits});
      if (fits > 0.3) tallest = std::max(tallest, static_cast<double>(p.out_mm()));
    }

    ChainOptions chain;
    chain.threshold_mm = how.threshold_mm;
    chain.height_max_mm = std::max({1.0, 1.5 * limit, 1.3 * tallest + 0.2});
    // How densely the fin is hit: from the hits themselves, against the heights found; a face's density where there are none.
    const double face_density = static_cast<double>(face_points) / std::max(1.0, 2 * 2.25 * edge.s_mm.back());
    std::vector<double> density(count, 0), heights(count, 0);
    for (const HeightSample& p : samples) {
      const std::size_t i = std::min(count - 1, static_cast<std::size_t>(std::lround(p.s_mm / std::max(step, 1e-9))));
      if (p.inlier_ratio > 0.3) heights[i] = std::max(heights[i], p.height_mm);
    }
    ChainPosterior posterior;
    for (int round = 0; round < 3; ++round) {
      for (std::size_t i = 0; i < count; ++i) {
        double hits = 0, exposed = 0;
        const int half = static_cast<int>(std::lround(5 / std::max(step, 1e-9)));
        const int from = std::max(0, static_cast<int>(i) - half), to = std::min(static_cast<int>(count) - 1, static_cast<int>(i) + half);
        for (int j = from; j <= to; ++j) exposed += std::max(0.0, heights[j] - how.threshold_mm) * step;
        const double a = edge.s_mm[from] - step / 2, b = edge.s_mm[to] + step / 2;
        for (const HeightSample& p : samples)
          if (p.s_mm >= a && p.s_mm < b) hits += p.inlier_ratio > 0.3;
        const double prior = std::max(2.0, 0.5 * face_density);
        density[i] = coverage[i] <= 0 ? 0.0 : coverage[i] * (hits + 3) / (exposed + 3 / prior);
      }
      posterior = height_profile(chain, edge.s_mm, samples, density, edge.is_closed);
      heights = posterior.mean_mm;
    }

    EdgeBurr burr;
    burr.edge_id = edge.id;
    burr.coverage_ratio = coverage;
    std::size_t unseen = 0;
    double worst = 0, worst_s = 0, worst_sd = 0;
    std::vector<double> none_sd;
    for (std::size_t i = 0; i < count; ++i) {
      const bool is_seen = coverage[i] > 0;
      if (!is_seen) ++unseen;
      const bool is_none = posterior.none_ratio[i] > 0.7 && coverage[i] >= recipe.coverage_min_ratio;
      const double h = is_none ? 0.0 : posterior.mean_mm[i];
      burr.height_mm.push_back(is_seen ? h : kNan);
      burr.height_sd_mm.push_back(is_seen ? posterior.sd_mm[i] : kNan);
      burr.height_upper_mm.push_back(is_seen ? std::max(h, posterior.upper_mm[i]) : std::max(limit, posterior.upper_mm[i]));
      double width = 0, area = 0;
      if (!is_none && is_seen && h > how.threshold_mm) {
        const double angle = std::isfinite(lean.angle_rad[i]) ? lean.angle_rad[i] : kPi / 4;
        width = root_width(section.proud, edge.s_mm[i], 1.5, angle, h);
        if (!std::isfinite(width)) width = std::min(0.15, 0.5 * h + 0.02);
        const double length = h / std::max(0.5, std::max(std::cos(angle), std::sin(angle)));
        area = 0.7 * width * length;
      }
      burr.width_mm.push_back(is_seen ? width : kNan);
      burr.area_mm2.push_back(is_seen ? area : kNan);
      if (is_seen && h > worst) worst = h, worst_s = edge.s_mm[i], worst_sd = posterior.sd_mm[i];
      none_sd.push_back(posterior.sd_mm[i]);
    }
    burr.detection_limit_mm = how.threshold_mm + 2 * quantile(none_sd, 0.25);
    if (unseen > 0 && static_cast<double>(unseen) > 0.2 * static_cast<double>(count)) {
      const double length = static_cast<double>(unseen) * step;
      refusals.push_back({.code = "burr.not_seen", .where = where,
                          .message = "Nothing was seen at the edge itself along " + fixed_number(length, 1) + " mm of " +
                                     fixed_number(edge.s_mm.back(), 1) + " mm, so a burr there cannot be ruled out. Add a capture that looks at the edge.",
                          .measured = length, .limit = 0.2 * edge.s_mm.back(), .unit = "mm", .stage = "burr"});
    }
    if (limit > 0 && worst - 2 * worst_sd > limit)
      refusals.push_back({.code = "burr.above_limit", .where = where + " at " + fixed_number(worst_s, 1) + " mm",
                          .message = "The burr is " + fixed_number(worst, 2) + " mm high; the recipe removes at most " + fixed_number(limit, 2) +
                                     " mm. Remove it by other means or use a recipe for taller burrs.",
                          .measured = worst, .limit = limit, .unit = "mm", .stage = "burr"});
    done.artefact.edges.push_back(std::move(burr));
  }
  if (!refusals.empty()) return refuse_all(std::move(refusals));
  return done;
}

}  // namespace asbuilt
