// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/heights.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace asbuilt::burring {

double quantile(std::vector<double>& v, double q) {
  if (v.empty()) return 0;
  const std::size_t k = std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())));
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(k), v.end());
  return v[k];
}

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kPointSd_mm = 0.006;  // no point is better
constexpr int kLooks = 13;             // leans tried where none was found

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

/// How one capture sees the edge at s: its points per mm^2 across its rays, 0 where it does not see it, and its mean ray.
struct Glance {
  double per_mm2 = 0, ray_1 = 0, ray_2 = 0;
  double facing(double angle) const { return std::abs(-std::sin(angle) * ray_1 + std::cos(angle) * ray_2); }
  /// Points on a flank of a fin leaning by `angle`, per mm^2 of it. A flank seen at less than about 10 degrees returns nothing.
  double density(double angle) const {
    const double f = facing(angle);
    return per_mm2 * f * std::clamp((f - 0.17) / 0.2, 0.0, 1.0);
  }
};

Glance glance(const std::vector<Sight>& sights, double spacing_mm, double s) {
  Glance out;
  if (sights.empty()) return out;
  const double per_mm2 = 1 / std::max(1e-4, spacing_mm * spacing_mm);
  double points = 0, seen = 1;
  const int last = static_cast<int>(sights.size()) - 1, middle = std::min(static_cast<int>(s), last);
  for (int j = std::max(0, middle - 1); j <= std::min(last, middle + 1); ++j) {
    const Sight& sight = sights[static_cast<std::size_t>(j)];
    const double n = sight.points_1_count + sight.points_2_count;
    const double expected = per_mm2 * 2.25 * (std::max(0.0f, -sight.ray_1) + std::max(0.0f, -sight.ray_2));
    seen = std::min(seen, n / std::max(1.0, 0.5 * expected));  // at the end of a capture's view nothing is promised
    points += n, out.ray_1 += n * sight.ray_1, out.ray_2 += n * sight.ray_2;
  }
  if (points < 3) return {};
  out.ray_1 /= points, out.ray_2 /= points, out.per_mm2 = seen * per_mm2;
  return out;
}

struct Work {
  const HeightOptions& options;
  const AdaptedEdge& edge;
  const EdgeSection& section;
  const std::vector<double>& coverage;
  std::vector<std::vector<Glance>> glances;  // by capture, station; empty for captures that did not see the edge
  double step = 1;
  ChainOptions chain;

  std::size_t station(double s) const {
    return std::min(edge.s_mm.size() - 1, static_cast<std::size_t>(std::lround(std::max(0.0, s) / std::max(step, 1e-9))));
  }
};

double inlier_ratio(const SectionPoint& p, double lean) {
  if (!std::isfinite(lean)) return 0.7;
  const double across = -std::sin(lean) * p.f_1_mm + std::cos(lean) * p.f_2_mm;
  return 0.02 + 0.96 * std::exp(-0.5 * across * across / (0.09 * 0.09 + 0.15 * 0.15 * p.out_mm() * p.out_mm()));
}

/// The samples of the captures in use, as they stand with the zeros so far.
std::vector<SectionPoint> points_of(const Work& w, const std::vector<char>& use) {
  std::vector<SectionPoint> out;
  for (const SectionPoint& p : w.section.proud)
    if (use[static_cast<std::size_t>(p.capture)] && p.out_mm() > w.options.threshold_mm) out.push_back(p);
  return out;
}

/// How a set of captures looks at the fin, before it is known how well fins return light here.
struct Outlook {
  std::vector<double> foreseen, least, dim_share;
};

Outlook outlook_of(const Work& w, const std::vector<char>& use, const std::vector<double>& lean) {
  Outlook out;
  const std::size_t count = w.edge.s_mm.size();
  out.foreseen.assign(count, 0), out.least.assign(count, 1e300), out.dim_share.assign(count, w.chain.dim_share);
  for (std::size_t i = 0; i < count; ++i) {
    double best = 0;  // facing, of what looks at the flank
    const auto density = [&](double angle) {
      double sum = 0;
      for (std::size_t k = 0; k < w.glances.size(); ++k)
        if (use[k] && !w.glances[k].empty()) sum += w.glances[k][i].density(angle);
      return sum;
    };
    const auto facing = [&](double angle) {
      double most = 0;
      for (std::size_t k = 0; k < w.glances.size(); ++k)
        if (use[k] && !w.glances[k].empty() && w.glances[k][i].per_mm2 > 0) most = std::max(most, w.glances[k][i].facing(angle));
      return most;
    };
    if (std::isfinite(lean[i])) {
      out.foreseen[i] = density(lean[i]), best = facing(lean[i]);
    } else {  // no fin was found: it could lean anyhow, and one that no view would have hit is not seen to be absent
      out.least[i] = 1e300, best = 1;
      for (int k = 0; k < kLooks; ++k) {
        const double angle = 0.2 + 1.2 * k / (kLooks - 1), d = density(angle);
        out.least[i] = std::min(out.least[i], d), out.foreseen[i] += d / kLooks, best = std::min(best, facing(angle));
      }
    }
    // Below about 20 degrees it depends on the surface whether a flank returns anything.
    const double doubtful = std::clamp((0.45 - best) / 0.25, 0.0, 1.0);
    out.dim_share[i] = w.chain.dim_share + (0.9 - w.chain.dim_share) * doubtful;
  }
  return out;
}

struct Found {
  ChainPosterior posterior;
  std::vector<double> lean, density, hits, heights;
  Outlook outlook;
  std::vector<HeightSample> samples;
  double hit_ratio = 1;  // hits on fins to what was foreseen
};

/// How densely fins are hit follows from the hits on what was found, and what was found from how densely fins are hit: by rounds. How
/// well a fin returns light changes along the edge with its lean and the views, more than is foreseen: the ratio is that of the hits
/// within some millimetres, held to the whole edge's by a few hits' weight.
void settle(const Work& w, const ChainOptions& chain, int rounds, Found& f) {
  constexpr double kPriorHits = 5, kPriorRatio = 0.6, kLocal_mm = 4, kHeldBy = 8;
  const std::size_t count = w.edge.s_mm.size(), reach = static_cast<std::size_t>(std::lround(kLocal_mm / std::max(1e-9, w.step)));
  f.density.assign(count, 0);
  for (int round = 0; round < rounds; ++round) {
    std::vector<double> found{0}, exposed{0};  // sums up to each station
    for (std::size_t i = 0; i < count; ++i) {
      found.push_back(found.back() + f.hits[i]);
      exposed.push_back(exposed.back() + f.outlook.foreseen[i] * exposed_mm(chain, f.heights[i]) * w.step);
    }
    f.hit_ratio = (kPriorHits + found.back()) / (kPriorHits / kPriorRatio + exposed.back());
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t a = i > reach ? i - reach : 0, b = std::min(count, i + reach + 1);
      const double ratio = (kHeldBy + found[b] - found[a]) / (kHeldBy / f.hit_ratio + exposed[b] - exposed[a]);
      f.density[i] = w.coverage[i] > 0 ? std::max(0.1, f.outlook.foreseen[i] * ratio) : 0.0;
    }
    f.posterior = height_profile(chain, w.edge.s_mm, f.samples, f.density, w.edge.is_closed, f.outlook.dim_share);
    f.heights = f.posterior.mean_mm;
  }
}

Found run_chain(const Work& w, const std::vector<char>& use, const std::vector<double>& zero_sd, const Found* before, ChainOptions& chain) {
  Found f;
  const std::size_t count = w.edge.s_mm.size();
  const std::vector<SectionPoint> points = points_of(w, use);
  f.lean = find_lean(points, w.edge.s_mm);
  f.outlook = outlook_of(w, use, f.lean);
  double tallest = 0;
  std::vector<double> heights(count, 0), hits(count, 0);
  for (const SectionPoint& p : points) {
    const std::size_t i = w.station(p.s_mm);
    const double ratio = inlier_ratio(p, f.lean[i]), sd = zero_sd[2 * static_cast<std::size_t>(p.capture) + (p.f_1_mm > p.f_2_mm ? 0 : 1)];
    f.samples.push_back({p.s_mm, p.out_mm(), std::hypot(std::max(kPointSd_mm, static_cast<double>(p.sigma_out_mm())), sd), ratio});
    if (ratio <= 0.3) continue;
    tallest = std::max(tallest, static_cast<double>(p.out_mm()));
    heights[i] = std::max(heights[i], static_cast<double>(p.out_mm())), hits[i] += 1;
  }
  chain.height_max_mm = std::max({1.0, 1.5 * w.options.limit_mm, 1.3 * tallest + 0.2});
  f.hits = std::move(hits), f.heights = before ? before->heights : std::move(heights);
  settle(w, chain, before ? 1 : 3, f);
  return f;
}

struct Zero {
  double at_mm = 0, sd_mm = 0;
};

constexpr double kClearly_rad = 0.1;

/// Whether a fin leaning by `lean` stands out farther over face `side` than over the other, or may.
bool may_tell(double lean, int side) {
  return !std::isfinite(lean) || (side == 0 ? lean < kPi / 4 : lean > kPi / 4);
}

/// The zero of captures over face `side`, common to them and on top of what is already taken off, from their samples under the heights
/// that the others found. `before`: what is taken off already, by capture; `doubt`: 1 sd of the whole, by capture. Fin and, below it, the other
/// face are hit up to the crest, alike; so only where it ends decides. Stations whose fin stands out over the other face tell nothing.
Zero find_zero(const Work& w, const Found& others, const ChainOptions& chain, const std::vector<std::size_t>& group, int side,
               const std::vector<double>& before, const std::vector<double>& doubt) {
  constexpr std::size_t kPointsMost = 300;
  const std::size_t count = w.edge.s_mm.size();
  double doubt_mm = 0;
  std::vector<char> use(w.glances.size(), 0);
  for (const std::size_t k : group) use[k] = 1, doubt_mm = std::max(doubt_mm, doubt[k]);
  const double lowest = w.options.threshold_mm - 2 * doubt_mm;
  std::vector<char> tells(count, 0);
  for (std::size_t i = 0; i < count; ++i) {
    const double lean = others.lean[i];
    tells[i] = w.coverage[i] > 0 && (!std::isfinite(lean) || (side == 0 ? lean < kPi / 4 - kClearly_rad : lean > kPi / 4 + kClearly_rad));
  }
  const auto height = [&](const SectionPoint& p) { return static_cast<double>(side == 0 ? p.f_1_mm : p.f_2_mm); };
  std::vector<SectionPoint> points;
  for (const SectionPoint& p : w.section.proud)
    if (use[static_cast<std::size_t>(p.capture)] && height(p) > lowest && tells[w.station(p.s_mm)]) points.push_back(p);
  if (points.size() < 5) return {0, doubt_mm};
  const std::size_t every = points.size() / kPointsMost + 1;
  const Outlook outlook = outlook_of(w, use, others.lean);
  std::vector<double> density(count, 0);
  for (std::size_t i = 0; i < count; ++i)
    if (tells[i]) density[i] = std::max(0.1, outlook.foreseen[i] * others.hit_ratio) / static_cast<double>(every);
  const std::vector<double> grid = height_grid(chain.height_max_mm);
  const Emission seen = emission_of(chain, grid, w.edge.s_mm, others.samples, others.density);
  const auto likelihood = [&](double zero) {
    double prior = 0;
    for (const std::size_t k : group) prior -= 0.5 * (before[k] + zero) * (before[k] + zero) / (doubt[k] * doubt[k]);
    std::vector<HeightSample> samples;
    for (std::size_t i = 0; i < points.size(); i += every) {
      SectionPoint p = points[i];
      (side == 0 ? p.f_1_mm : p.f_2_mm) -= static_cast<float>(zero);
      const double sigma = p.sigma_mm * std::max(0.3f, std::abs(side == 0 ? p.ray_1 : p.ray_2));
      samples.push_back({p.s_mm, height(p), std::max(kPointSd_mm, sigma), inlier_ratio(p, others.lean[w.station(p.s_mm)])});
    }
    ChainOptions shifted = chain;
    shifted.threshold_mm = lowest - zero;
    Emission e = emission_of(shifted, grid, w.edge.s_mm, samples, density);
    e.clear += seen.clear, e.dim += seen.dim;
    return log_evidence(chain, grid, w.edge.s_mm, e, false, others.outlook.dim_share) + prior;
  };
  Zero best{0, doubt_mm};
  double middle = 0, half = 3 * doubt_mm;
  for (int pass = 0; pass < 2; ++pass) {
    constexpr int kSteps = 6;
    std::vector<double> value;
    for (int k = -kSteps; k <= kSteps; ++k) value.push_back(likelihood(middle + half * k / kSteps));
    const double most = *std::max_element(value.begin(), value.end());
    double weight = 0, mean = 0, square = 0;
    for (int k = -kSteps; k <= kSteps; ++k) {
      const double p = std::exp(value[static_cast<std::size_t>(k + kSteps)] - most), at = middle + half * k / kSteps;
      weight += p, mean += p * at, square += p * at * at;
    }
    mean /= weight, square /= weight;
    const double cell = half / kSteps;
    best = {mean, std::sqrt(std::max(0.0, square - mean * mean) + cell * cell / 12)};
    if (best.sd_mm > 2 * cell) break;
    middle = mean, half = 3 * cell;
  }
  return best;
}

}  // namespace

EdgeHeights find_heights(const HeightOptions& options, const MeasuredCloud& cloud, const AdaptedEdge& edge, EdgeSection& section,
                         const std::vector<double>& coverage) {
  const std::size_t count = edge.s_mm.size(), captures = section.sights.size();
  Work w{options, edge, section, coverage, {}, 1, {}};
  w.step = count > 1 ? edge.s_mm.back() / static_cast<double>(count - 1) : 1;
  w.chain.threshold_mm = options.threshold_mm;
  w.glances.resize(captures);
  for (std::size_t k = 0; k < captures; ++k)
    if (!section.sights[k].empty())
      for (const double s : edge.s_mm) w.glances[k].push_back(glance(section.sights[k], cloud.captures[k].spacing_mm, s));

  std::vector<char> use(captures, 0);
  std::vector<char> has_points(captures, 0);
  for (const SectionPoint& p : section.proud) has_points[static_cast<std::size_t>(p.capture)] = 1;
  std::vector<std::size_t> waiting;
  std::vector<double> zero_sd(2 * captures, 0);
  for (std::size_t k = 0; k < captures; ++k) {
    if (!has_points[k] && section.sights[k].empty()) continue;
    const auto& sd = section.zero_sd_mm[k];
    zero_sd[2 * k] = sd[0], zero_sd[2 * k + 1] = sd[1];
    if (sd[0] > 0 || sd[1] > 0) waiting.push_back(k);
    else use[k] = 1;
  }
  const auto doubt = [&](std::size_t k) { return std::hypot(zero_sd[2 * k], zero_sd[2 * k + 1]); };
  std::stable_sort(waiting.begin(), waiting.end(), [&](std::size_t a, std::size_t b) { return doubt(a) < doubt(b); });
  if (waiting.size() > 0 && std::find(use.begin(), use.end(), 1) == use.end()) use[waiting.front()] = 1, waiting.erase(waiting.begin());

  ChainOptions chain = w.chain;
  Found found = run_chain(w, use, zero_sd, nullptr, chain);
  std::vector<double> doubts(captures, 0), zeros(captures, 0);
  std::vector<std::size_t> told[2];
  const auto take_off = [&](std::size_t k, int side, double zero, bool is_first) {
    for (SectionPoint& p : section.proud) {
      if (p.capture != static_cast<int>(k)) continue;
      float& over = side == 0 ? p.f_1_mm : p.f_2_mm;
      const float other = side == 0 ? p.f_2_mm : p.f_1_mm;
      const bool may = may_tell(found.lean[w.station(p.s_mm)], side);
      if (may || is_first) over -= static_cast<float>(zero);
      if (!may) over = std::min(over, other);  // what it saw itself decides
    }
    zeros[k] += zero;
  };
  const Found known = found;
  const ChainOptions chain_known = chain;
  const bool has_known = std::any_of(known.samples.begin(), known.samples.end(), [](const HeightSample& p) { return p.inlier_ratio > 0.3; });
  for (const std::size_t k : waiting) {
    if (zero_sd[2 * k] > 0 && zero_sd[2 * k + 1] > 0) continue;  // it sees neither face
    use[k] = 1;
    if (!has_points[k]) continue;
    const int side = zero_sd[2 * k] > 0 ? 0 : 1;
    doubts[k] = doubt(k);
    const Zero zero = find_zero(w, found, chain, {k}, side, zeros, doubts);
    take_off(k, side, zero.at_mm, true);
    if (zero.sd_mm < 0.9 * doubts[k]) told[side].push_back(k);
    zero_sd[2 * k + static_cast<std::size_t>(side)] = zero.sd_mm;
    found = run_chain(w, use, zero_sd, &found, chain);
  }
  // One after the other they follow the first; all together they are held by all their priors.
  for (int side = 0; side < 2 && has_known; ++side) {
    if (told[side].size() < 2) continue;
    const Zero common = find_zero(w, known, chain_known, told[side], side, zeros, doubts);
    for (const std::size_t k : told[side]) {
      take_off(k, side, common.at_mm, false);
      double& sd = zero_sd[2 * k + static_cast<std::size_t>(side)];
      sd = std::max(sd, common.sd_mm);
    }
  }
  if (!waiting.empty()) found = run_chain(w, use, zero_sd, nullptr, chain);
  // How rough the burr is along the edge the samples themselves say; without clear evidence it is taken as smooth.
  // Just so whether its crest is hit more densely than its flank.
  constexpr double kClear = 3;
  const auto try_other = [&](const ChainOptions& other, double& best) {
    Found f = found;
    settle(w, other, 2, f);
    if (f.posterior.log_evidence <= best) return;
    best = f.posterior.log_evidence, found = std::move(f), chain = other;
  };
  double best = found.posterior.log_evidence + kClear;
  const ChainOptions smooth = chain;
  for (const double rougher : {1.7, 2.8, 4.5}) {
    ChainOptions rough = smooth;
    rough.walk_mm *= rougher, rough.walk_ratio *= rougher;
    try_other(rough, best);
  }
  best = found.posterior.log_evidence + kClear;
  const ChainOptions even = chain;
  for (const double ratio : {0.7, 1.5})
    for (const double depth : {0.05, 0.12}) {
      ChainOptions crest = even;
      crest.crest_ratio = ratio, crest.crest_mm = depth;
      try_other(crest, best);
    }

  EdgeHeights out;
  section.proud = points_of(w, use);
  // What the zeros of the captures that carry a stretch leave open does not average out along it.
  std::vector<double> square(count, 0), weight(count, 0);
  out.shared_sd_mm.assign(count, 0);
  std::vector<std::vector<double>> by_capture(captures);
  for (std::size_t i = 0; i < section.proud.size(); ++i) {
    const SectionPoint& p = section.proud[i];
    if (found.samples[i].inlier_ratio < 0.3) continue;
    const std::size_t j = w.station(p.s_mm), k = static_cast<std::size_t>(p.capture);
    if (p.out_mm() < found.posterior.mean_mm[j] - 0.1) continue;  // the tip decides
    if (by_capture[k].empty()) by_capture[k].assign(count, 0);
    by_capture[k][j] += zero_sd[2 * k + (p.f_1_mm > p.f_2_mm ? 0 : 1)], weight[j] += 1;
  }
  const std::size_t reach = static_cast<std::size_t>(std::lround(2 / w.step));
  for (std::size_t j = 0; j < count; ++j) {
    const std::size_t a = j > reach ? j - reach : 0, b = std::min(count - 1, j + reach);
    const double total = std::accumulate(weight.begin() + static_cast<std::ptrdiff_t>(a), weight.begin() + static_cast<std::ptrdiff_t>(b) + 1, 0.0);
    for (std::size_t k = 0; k < captures && total > 0; ++k) {
      if (by_capture[k].empty()) continue;
      const double part = std::accumulate(by_capture[k].begin() + static_cast<std::ptrdiff_t>(a), by_capture[k].begin() + static_cast<std::ptrdiff_t>(b) + 1, 0.0) / total;
      square[j] += part * part;
    }
    out.shared_sd_mm[j] = std::sqrt(square[j]);
  }
  out.posterior = std::move(found.posterior);
  out.lean_rad = std::move(found.lean), out.density = std::move(found.density), out.least = std::move(found.outlook.least);
  out.samples = std::move(found.samples);
  return out;
}

}  // namespace asbuilt::burring
