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

/// The direction in which the fin leans at each station (angle of (f_1, f_2)): where the proud points around it agree on one; else
/// continued from where they do. NaN where they never do.
std::vector<double> find_lean(const std::vector<SectionPoint>& proud, const std::vector<double>& stations) {
  std::vector<double> out;
  std::size_t a = 0, b = 0;
  std::vector<double> angles, kept;
  for (const double s : stations) {
    while (a < proud.size() && proud[a].s_mm < s - 4) ++a;
    while (b < proud.size() && proud[b].s_mm < s + 4) ++b;
    angles.clear(), kept.clear();
    for (std::size_t i = a; i < b; ++i) {
      const double e = proud[i].out_mm();
      if (e > 0.1 && std::hypot(proud[i].f_1_mm, proud[i].f_2_mm) < 1.25 * e + 0.04) angles.push_back(std::atan2(proud[i].f_2_mm, proud[i].f_1_mm));
    }
    double angle = kNan;
    if (angles.size() >= 8) {
      std::vector<double> work = angles;
      const double middle = quantile(work, 0.5);
      std::size_t close = 0;
      for (const double x : angles) {
        close += std::abs(x - middle) < 0.25;
        if (std::abs(x - middle) < 0.35) kept.push_back(x);
      }
      if (2 * close > angles.size()) angle = quantile(kept, 0.5);
    }
    out.push_back(angle);
  }
  // Continue over the gaps.
  std::ptrdiff_t before = -1;
  const std::ptrdiff_t count = static_cast<std::ptrdiff_t>(out.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    if (!std::isfinite(out[i])) continue;
    for (std::ptrdiff_t j = before + 1; j < i; ++j)
      out[j] = before < 0 ? out[i] : out[before] + (out[i] - out[before]) * static_cast<double>(j - before) / static_cast<double>(i - before);
    before = i;
  }
  if (before >= 0)
    for (std::ptrdiff_t j = before + 1; j < count; ++j) out[j] = out[before];
  return out;
}

/// Points per mm^2 that the captures would put on the flank of a fin leaning by `angle` at s. A flank seen at less than about 10
/// degrees returns nothing.
double flank_density(const EdgeSection& section, const MeasuredCloud& cloud, double s, double angle) {
  double density = 0;
  for (std::size_t k = 0; k < section.sights.size(); ++k) {
    const auto& sights = section.sights[k];
    if (sights.empty()) continue;
    const double per_mm2 = 1 / std::max(1e-4, cloud.captures[k].spacing_mm * cloud.captures[k].spacing_mm);
    double points = 0, ray_1 = 0, ray_2 = 0, seen = 1;
    const int middle = std::min(static_cast<int>(s), static_cast<int>(sights.size()) - 1);
    for (int j = std::max(0, middle - 1); j <= std::min(static_cast<int>(sights.size()) - 1, middle + 1); ++j) {
      const Sight& sight = sights[static_cast<std::size_t>(j)];
      const double n = sight.points_1_count + sight.points_2_count;
      const double expected = per_mm2 * 2.25 * (std::max(0.0f, -sight.ray_1) + std::max(0.0f, -sight.ray_2));
      seen = std::min(seen, n / std::max(1.0, 0.5 * expected));  // at the end of a capture's view nothing is promised
      points += n, ray_1 += n * sight.ray_1, ray_2 += n * sight.ray_2;
    }
    if (points < 3) continue;
    ray_1 /= points, ray_2 /= points;
    const double facing = std::abs(-std::sin(angle) * ray_1 + std::cos(angle) * ray_2);
    density += seen * per_mm2 * facing * std::clamp((facing - 0.17) / 0.2, 0.0, 1.0);
  }
  return density;
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
    for (std::size_t i = 0; i < count; ++i) {
      const double a = edge.s_mm[i] - recipe.window_mm - 0.5, b = edge.s_mm[i] + recipe.window_mm + 0.5;
      const double side_1 = std::min(1.0, static_cast<double>(count_between(section.face_1_s, a, b)) / 6.0);
      const double side_2 = std::min(1.0, static_cast<double>(count_between(section.face_2_s, a, b)) / 6.0);
      std::size_t proud = 0;
      for (const SectionPoint& p : section.proud) proud += p.s_mm > a && p.s_mm < b;
      coverage[i] = std::min(1.0, std::max(0.5 * (side_1 + side_2), std::min(1.0, static_cast<double>(proud) / 6.0)));
    }

    const std::vector<double> lean = find_lean(section.proud, edge.s_mm);
    std::vector<HeightSample> samples;
    double tallest = 0;
    for (const SectionPoint& p : section.proud) {
      const std::size_t i = std::min(count - 1, static_cast<std::size_t>(std::lround(p.s_mm / std::max(step, 1e-9))));
      double fits = 0.7;
      if (std::isfinite(lean[i])) {
        const double across = -std::sin(lean[i]) * p.f_1_mm + std::cos(lean[i]) * p.f_2_mm;
        fits = 0.02 + 0.96 * std::exp(-0.5 * across * across / (0.09 * 0.09 + 0.15 * 0.15 * p.out_mm() * p.out_mm()));
      }
      samples.push_back({p.s_mm, p.out_mm(), std::max(0.006, static_cast<double>(p.sigma_mm)), fits});
      if (fits > 0.3) tallest = std::max(tallest, static_cast<double>(p.out_mm()));
    }

    ChainOptions chain;
    chain.threshold_mm = how.threshold_mm;
    chain.height_max_mm = std::max({1.0, 1.5 * limit, 1.3 * tallest + 0.2});
    // How densely the fin would be hit: from how the captures look at it, scaled by the hits on what was found.
    // A fin that no view would have hit, because all look along it, is not seen to be absent: `least` over the leans.
    constexpr int kLooks = 13;
    std::vector<double> foreseen(count, 0), density(count, 0), heights(count, 0), hits(count, 0), least(count, 1e300);
    for (std::size_t i = 0; i < count; ++i) {
      if (std::isfinite(lean[i])) {
        foreseen[i] = flank_density(section, cloud, edge.s_mm[i], lean[i]);
      } else {  // no fin was found: it could lean anyhow
        foreseen[i] = 1e300;
        double mean = 0;
        for (int k = 0; k < kLooks; ++k) {
          const double d = flank_density(section, cloud, edge.s_mm[i], 0.2 + 1.2 * k / (kLooks - 1));
          foreseen[i] = std::min(foreseen[i], d), mean += d / kLooks;
        }
        least[i] = foreseen[i], foreseen[i] = mean;
      }
    }
    for (const HeightSample& p : samples) {
      if (p.inlier_ratio < 0.3) continue;
      const std::size_t i = std::min(count - 1, static_cast<std::size_t>(std::lround(p.s_mm / std::max(step, 1e-9))));
      heights[i] = std::max(heights[i], p.height_mm), hits[i] += 1;
    }
    ChainPosterior posterior;
    for (int round = 0; round < 3; ++round) {
      constexpr double kPriorHits = 5, kPriorRatio = 0.6;
      double found = kPriorHits, exposed = kPriorHits / kPriorRatio;
      for (std::size_t i = 0; i < count; ++i) found += hits[i], exposed += foreseen[i] * std::max(0.0, heights[i] - how.threshold_mm) * step;
      for (std::size_t i = 0; i < count; ++i) density[i] = coverage[i] > 0 ? std::max(0.1, foreseen[i] * found / exposed) : 0.0;
      posterior = height_profile(chain, edge.s_mm, samples, density, edge.is_closed);
      heights = posterior.mean_mm;
    }
    // How rough the burr is along the edge the samples themselves say; without clear evidence it is taken as smooth.
    constexpr double kClear = 3;
    double best_evidence = posterior.log_evidence + kClear;
    const ChainOptions smooth = chain;
    for (const double rougher : {1.7, 2.8, 4.5}) {
      ChainOptions rough = smooth;
      rough.walk_mm *= rougher, rough.walk_ratio *= rougher;
      const ChainPosterior other = height_profile(rough, edge.s_mm, samples, density, edge.is_closed);
      if (other.log_evidence > best_evidence) best_evidence = other.log_evidence, posterior = other, chain = rough;
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
      // Absence counts as seen only where a burr of 0.15 mm over 3 mm would have been hit.
      const bool is_hidden = !std::isfinite(lean[i]) && least[i] * 0.15 * 3 < 2;  // a fin leaning just so would have been missed
      const bool is_none = !is_hidden && posterior.none_ratio[i] > 0.7 && coverage[i] >= recipe.coverage_min_ratio && density[i] * 0.15 * 3 > 2;
      const double h = is_none ? 0.0 : posterior.mean_mm[i];
      burr.height_mm.push_back(is_seen ? h : kNan);
      burr.height_sd_mm.push_back(is_seen ? posterior.sd_mm[i] : kNan);
      // What cannot be ruled out: where the flank was sampled well, what the samples make likely and no less than the tallest one
      // within a millimetre; else all that the process knows of; but never more than the rays leave room for.
      double likely = posterior.upper_mm[i];
      for (const HeightSample& p : samples)
        if (p.inlier_ratio > 0.3 && std::abs(p.s_mm - edge.s_mm[i]) < 1) likely = std::max(likely, p.height_mm);
      const bool is_sampled = is_seen && !is_hidden && density[i] * 0.15 * 3 > 2;
      const double carved = carved_height_mm(section, edge.s_mm[i], lean[i], 0.5) + 3 * section.noise_mm;
      burr.height_upper_mm.push_back(std::max(is_seen ? h : 0.0, std::min(is_sampled ? likely : std::max(limit, likely), carved)));
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
