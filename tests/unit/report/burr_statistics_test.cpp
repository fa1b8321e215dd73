// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/burr_statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

std::vector<double> row(double mean, double sd, double correlation, int n, std::uint64_t seed) {
  Random r(seed);
  std::vector<double> v;
  double x = r.normal();
  for (int i = 0; i < n; ++i) {
    x = correlation * x + std::sqrt(1 - correlation * correlation) * r.normal();
    v.push_back(mean + sd * x);
  }
  return v;
}

TEST(Equivalence, IsShownForSmallMeansAndNeverForLargeOnes) {
  EXPECT_TRUE(equivalence_to_zero(row(0.01, 0.05, 0, 200, 1), 0.05).is_equivalent);
  EXPECT_FALSE(equivalence_to_zero(row(0.08, 0.05, 0, 200, 2), 0.05).is_equivalent);
  EXPECT_FALSE(equivalence_to_zero(row(0.01, 0.5, 0, 20, 3), 0.05).is_equivalent);  // too little was seen to say so
  EXPECT_FALSE(equivalence_to_zero({}, 0.05).is_equivalent);
  EXPECT_TRUE(equivalence_to_zero(std::vector<double>(50, 0.0), 0.05).is_equivalent);
}

TEST(Equivalence, NeighboursThatGoTogetherCountForFewer) {
  const Equivalence alone = equivalence_to_zero(row(0, 1, 0, 400, 4), 0.05), together = equivalence_to_zero(row(0, 1, 0.9, 400, 4), 0.05);
  EXPECT_GT(alone.count_effective, 250);
  EXPECT_LT(together.count_effective, 60);  // (1 - 0.9) / (1 + 0.9) * 400 = 21 on average
  EXPECT_GT(together.count_effective, 6);
  EXPECT_LE(alone.count_effective, 400);
}

/// A mean right on the margin is called equivalent in at most one case of twenty.
TEST(Equivalence, ErrsAtMostAsOftenAsItSays) {
  int wrong = 0;
  const int trials = 400;
  for (int k = 0; k < trials; ++k) wrong += equivalence_to_zero(row(0.05, 0.05, 0.5, 150, 100 + static_cast<std::uint64_t>(k)), 0.05).is_equivalent;
  EXPECT_LT(wrong, 2 * 0.05 * trials);
}

TEST(Equivalence, UnseenIsLeftOut) {
  std::vector<double> v = row(0.01, 0.02, 0, 100, 7);
  const Equivalence all = equivalence_to_zero(v, 0.05);
  v.push_back(std::nan(""));
  const Equivalence with_hole = equivalence_to_zero(v, 0.05);
  EXPECT_EQ(all.count, with_hole.count);
  EXPECT_DOUBLE_EQ(all.mean, with_hole.mean);
}

}  // namespace
}  // namespace asbuilt
