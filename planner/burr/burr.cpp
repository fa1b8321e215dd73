// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/burr.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/number.hpp"
#include "planner/burr/heights.hpp"
#include "planner/burr/section.hpp"

namespace asbuilt {

namespace burring {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

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

  std::vector<std::vector<double>> coverages(features.edges.size());
  std::vector<double> limits(features.edges.size(), 0);
  std::vector<EdgeHeights> heights(features.edges.size());
  tbb::parallel_for(std::size_t(0), features.edges.size(), [&](std::size_t e) {
    const AdaptedEdge& edge = features.edges[e];
    EdgeSection& section = sections[e];
    std::stable_sort(section.proud.begin(), section.proud.end(), [](const SectionPoint& a, const SectionPoint& b) { return a.s_mm < b.s_mm; });
    for (const FeatureSpec& f : job.part.features)
      if (f.id == edge.feature)
        if (const Recipe* r = job.recipe(f.recipe)) limits[e] = r->burr_max_height_mm;
    const std::size_t count = edge.s_mm.size();

    // Seen or not: face points on both sides close to the edge, or a burr itself.
    std::vector<double>& coverage = coverages[e];
    coverage.assign(count, 0);
    for (std::size_t i = 0; i < count; ++i) {
      const double a = edge.s_mm[i] - recipe.window_mm - 0.5, b = edge.s_mm[i] + recipe.window_mm + 0.5;
      const double side_1 = std::min(1.0, static_cast<double>(count_between(section.face_1_s, a, b)) / 6.0);
      const double side_2 = std::min(1.0, static_cast<double>(count_between(section.face_2_s, a, b)) / 6.0);
      const auto from = std::upper_bound(section.proud.begin(), section.proud.end(), a, [](double s, const SectionPoint& p) { return s < p.s_mm; });
      double proud = 0;
      for (auto p = from; p != section.proud.end() && p->s_mm < b; ++p) proud += p->out_mm() > how.threshold_mm;
      coverage[i] = std::min(1.0, std::max(0.5 * (side_1 + side_2), std::min(1.0, proud / 6.0)));
    }
    heights[e] = find_heights({how.threshold_mm, limits[e]}, cloud, edge, section, coverage);
  });

  for (std::size_t e = 0; e < features.edges.size(); ++e) {
    const AdaptedEdge& edge = features.edges[e];
    const EdgeSection& section = sections[e];
    const EdgeHeights& found = heights[e];
    const ChainPosterior& posterior = found.posterior;
    const std::vector<double>&lean = found.lean_rad, &density = found.density, &least = found.least, &coverage = coverages[e];
    const double limit = limits[e];
    const std::string where = "edge " + edge.id + " of " + edge.feature;
    const std::size_t count = edge.s_mm.size();
    const double step = count > 1 ? edge.s_mm.back() / static_cast<double>(count - 1) : 1;

    EdgeBurr burr;
    burr.edge_id = edge.id;
    burr.coverage_ratio = coverage;
    std::size_t unseen = 0;
    double worst = 0, worst_s = 0, worst_sd = 0;
    std::vector<double> none_sd;
    for (std::size_t i = 0; i < count; ++i) {
      const bool is_seen = coverage[i] > 0;
      if (!is_seen) ++unseen;
      // Absence counts as seen only where a burr of 0.15 mm over 3 mm would have been hit.
      const bool is_hidden = !std::isfinite(lean[i]) && least[i] * 0.15 * 3 < 2;  // a fin leaning just so would have been missed
      const bool is_none = !is_hidden && posterior.none_ratio[i] > 0.7 && coverage[i] >= recipe.coverage_min_ratio && density[i] * 0.15 * 3 > 2;
      // Where little was seen the posterior has a long tail of tall burrs, which the mean follows.
      const double h = is_none ? 0.0 : posterior.median_mm[i];
      burr.height_mm.push_back(is_seen ? h : kNan);
      burr.height_sd_mm.push_back(is_seen ? std::hypot(posterior.sd_mm[i], found.shared_sd_mm[i]) : kNan);
      // What cannot be ruled out: where the flank was sampled well, what the samples make likely and no less than the tallest one
      // within a millimetre, whatever rays of other captures seem to pass (a curled fin and the captures' own errors let them by); else all that the process knows of,
      // but no more than the rays leave room for.
      // What the captures' zeros leave open moves all samples of a stretch together: the chain does not know of it.
      double likely = h + std::hypot(std::max(0.0, posterior.upper_mm[i] - h), 1.96 * found.shared_sd_mm[i]);
      for (const HeightSample& p : found.samples)
        if (p.inlier_ratio > 0.3 && std::abs(p.s_mm - edge.s_mm[i]) < 1) likely = std::max(likely, p.height_mm);
      const bool is_sampled = is_seen && !is_hidden && density[i] * 0.15 * 3 > 2;
      const double carved = carved_height_mm(section, edge.s_mm[i], lean[i], 0.5) + 3 * section.noise_mm;
      burr.height_upper_mm.push_back(std::max(is_seen ? h : 0.0, is_sampled ? likely : std::min(std::max(limit, likely), carved)));
      double width = 0, area = 0;
      if (!is_none && is_seen && h > how.threshold_mm) {
        const double angle = std::isfinite(lean[i]) ? lean[i] : kPi / 4;
        width = root_width(section.proud, edge.s_mm[i], 1.5, angle, h);
        if (!std::isfinite(width)) width = std::min(0.15, 0.5 * h + 0.02);
        const double length = h / std::max(0.5, std::max(std::cos(angle), std::sin(angle)));
        area = 0.7 * width * length;
      }
      burr.width_mm.push_back(is_seen ? width : kNan);
      burr.area_mm2.push_back(is_seen ? area : kNan);
      if (is_seen && h > worst) worst = h, worst_s = edge.s_mm[i], worst_sd = burr.height_sd_mm.back();
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
