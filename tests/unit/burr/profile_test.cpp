// SPDX-License-Identifier: GPL-3.0-or-later
// The chain of heights alone: samples drawn from a known profile.
#include "planner/burr/profile.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "planner/base/random.hpp"

namespace asbuilt::burring {
namespace {

struct Case {
  std::vector<double> stations, truth, density;
  std::vector<HeightSample> samples;
};

Case draw(std::uint64_t seed, double level, double swing, double per_mm2, double noise) {
  Case c;
  Random random(seed);
  const double phase = random.uniform(0, 6.28);
  for (int i = 0; i <= 120; ++i) {
    c.stations.push_back(0.5 * i);
    c.truth.push_back(std::max(0.0, level + swing * std::sin(0.5 * i / 6 + phase)));
    c.density.push_back(per_mm2);
    const int hits = static_cast<int>(per_mm2 * std::max(0.0, c.truth.back() - 0.03) * 0.5 + random.uniform());
    for (int k = 0; k < hits; ++k)
      c.samples.push_back({0.5 * i + random.uniform(-0.25, 0.25), random.uniform(0.03, c.truth.back()) + noise * random.normal(), std::max(noise, 0.006), 0.97});
  }
  return c;
}

TEST(Profile, HeightsAreFoundWithinTheirSd) {
  double square = 0, bias = 0, normal = 0;
  int count = 0;
  for (int trial = 0; trial < 8; ++trial) {
    const Case c = draw(trial, 0.4, 0.2, 40, 0.006);
    const ChainPosterior p = height_profile({.outliers_mm2 = 0.5, .tip_mm = 0}, c.stations, c.samples, c.density, false);
    for (std::size_t i = 0; i < c.truth.size(); ++i) {
      const double d = p.mean_mm[i] - c.truth[i];
      square += d * d, bias += d, normal += d * d / (p.sd_mm[i] * p.sd_mm[i]);
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(square / count), 0.04);
  EXPECT_LT(std::abs(bias / count), 0.01);
  EXPECT_GT(normal / count, 0.3);
  EXPECT_LT(normal / count, 2.0);
}

TEST(Profile, NoSamplesWhereTheEdgeIsSeenMeansNoBurr) {
  Case c = draw(1, 0, 0, 40, 0.006);
  const ChainPosterior p = height_profile({}, c.stations, {}, c.density, false);
  for (std::size_t i = 0; i < c.stations.size(); ++i) EXPECT_GT(p.none_ratio[i], 0.9);
}

TEST(Profile, NoSamplesWhereTheEdgeIsNotSeenMeansNothing) {
  Case c = draw(2, 0, 0, 0, 0.006);
  const ChainPosterior p = height_profile({}, c.stations, {}, c.density, false);
  for (std::size_t i = 0; i < c.stations.size(); ++i) {
    EXPECT_LT(p.none_ratio[i], 0.5);
    EXPECT_GT(p.upper_mm[i], 1.0);
  }
}

TEST(Profile, AbsenceOnAFlankThatIsPoorlySeenIsNoProof) {
  Case c = draw(5, 0.4, 0.0, 40, 0.006);
  std::erase_if(c.samples, [](const HeightSample& p) { return p.s_mm > 24 && p.s_mm < 36; });
  std::vector<double> share(c.stations.size(), 0.05);
  const ChainPosterior clear = height_profile({}, c.stations, c.samples, c.density, false, share);
  for (std::size_t i = 48; i <= 72; ++i) c.density[i] = 4, share[i] = 0.9;  // what a grazing look promises
  const ChainPosterior poor = height_profile({}, c.stations, c.samples, c.density, false, share);
  EXPECT_GT(clear.none_ratio[60], 0.5);
  EXPECT_LT(poor.none_ratio[60], 0.3);
  EXPECT_NEAR(poor.median_mm[60], 0.4, 0.15);
  EXPECT_GT(poor.sd_mm[60], 3 * poor.sd_mm[20]);
}

TEST(Profile, HitsThatGatherAtTheCrestLiftNothingWhereTheModelKnows) {
  double bias_even = 0, bias_crest = 0, evidence = 0;
  for (int trial = 0; trial < 4; ++trial) {
    Case c = draw(40 + trial, 0.4, 0.1, 25, 0.006);
    Random random(90 + trial);
    for (std::size_t i = 0; i < c.stations.size(); ++i)  // 1.5 times more at the crest, falling off over 0.05 mm
      for (int k = 0; k < static_cast<int>(25 * 1.5 * 0.05 * 0.5 + random.uniform()); ++k)
        c.samples.push_back({c.stations[i], c.truth[i] + 0.05 * std::log(std::max(1e-3, random.uniform())) + 0.006 * random.normal(), 0.006, 0.97});
    const ChainPosterior even = height_profile({.tip_mm = 0}, c.stations, c.samples, c.density, false);
    const ChainPosterior crest = height_profile({.crest_ratio = 1.5, .crest_mm = 0.05, .tip_mm = 0}, c.stations, c.samples, c.density, false);
    evidence += crest.log_evidence - even.log_evidence;
    for (std::size_t i = 0; i < c.truth.size(); ++i) bias_even += even.mean_mm[i] - c.truth[i], bias_crest += crest.mean_mm[i] - c.truth[i];
  }
  EXPECT_GT(evidence, 3);
  EXPECT_LT(std::abs(bias_crest), std::abs(bias_even));
}

TEST(Profile, TheForwardPassAloneGivesTheSameEvidence) {
  const Case c = draw(6, 0.3, 0.1, 40, 0.006);
  const ChainOptions o;
  const auto grid = height_grid(o.height_max_mm);
  const double forward = log_evidence(o, grid, c.stations, emission_of(o, grid, c.stations, c.samples, c.density), false, {});
  EXPECT_NEAR(forward, height_profile(o, c.stations, c.samples, c.density, false).log_evidence, 1e-6);
}

TEST(Profile, OneStrayPointIsNoBurr) {
  Case c = draw(3, 0.3, 0.0, 60, 0.006);
  const ChainPosterior before = height_profile({}, c.stations, c.samples, c.density, false);
  c.samples.push_back({30, 1.6, 0.006, 0.3});
  const ChainPosterior after = height_profile({}, c.stations, c.samples, c.density, false);
  EXPECT_LT(after.mean_mm[60] - before.mean_mm[60], 0.02);
}

TEST(Profile, ClosedEdgeHasNoSeam) {
  // The same ring cut open at another place gives the same heights.
  Case c = draw(4, 0.4, 0.0, 40, 0.006);
  const double length = c.stations.back();
  std::vector<HeightSample> turned;
  for (HeightSample s : c.samples) {
    s.s_mm = std::fmod(s.s_mm + length / 2, length);
    turned.push_back(s);
  }
  const ChainPosterior a = height_profile({}, c.stations, c.samples, c.density, true);
  const ChainPosterior b = height_profile({}, c.stations, turned, c.density, true);
  EXPECT_NEAR(a.mean_mm[60], b.mean_mm[0], 0.05);
  EXPECT_NEAR(a.mean_mm[20], b.mean_mm[80], 0.02);
}

}  // namespace
}  // namespace asbuilt::burring
