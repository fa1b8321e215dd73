// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/feed/feed.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

EdgeBurr burr_of(double height, double upper, double width, double area) {
  EdgeBurr b;
  b.height_mm = {height}, b.height_upper_mm = {upper}, b.width_mm = {width}, b.area_mm2 = {area}, b.height_sd_mm = {0.02}, b.coverage_ratio = {1};
  return b;
}
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Feed, unseen_burr_is_reckoned_with_not_forgotten) {
  EXPECT_DOUBLE_EQ(burr_bounds(burr_of(0, 0.02, kNan, 0), 1.5, 0.2)[0].height_mm, 0.02);
  EXPECT_DOUBLE_EQ(burr_bounds(burr_of(kNan, 0.8, kNan, kNan), 1.5, 0.2)[0].height_mm, 0.8);
  EXPECT_NEAR(burr_bounds(burr_of(kNan, 0.8, kNan, kNan), 1.5, 0.2)[0].area_mm2, 0.16, 1e-12);
  EXPECT_DOUBLE_EQ(burr_bounds(burr_of(kNan, kNan, kNan, kNan), 1.5, 0.2)[0].height_mm, 1.5);
}

TEST(Feed, thickness_is_that_of_the_kind_of_burr_and_a_thick_one_still_counts) {
  Random random(4);
  EdgeBurr b;
  for (int i = 0; i < 400; ++i) {
    const double h = 0.3 + 0.1 * std::sin(0.05 * i);
    b.height_mm.push_back(h), b.height_upper_mm.push_back(h + 0.02), b.width_mm.push_back(0.1), b.height_sd_mm.push_back(0.01);
    b.area_mm2.push_back(h * 0.3 * std::exp(0.4 * random.normal())), b.coverage_ratio.push_back(1);
  }
  const double thickness = burr_thickness_mm({&b});
  EXPECT_NEAR(thickness, 0.3 * std::exp(0.4 * 1.0364), 0.06);
  for (int i = 200; i < 240; ++i) b.area_mm2[static_cast<std::size_t>(i)] = 0.9;
  const auto bounds = burr_bounds(b, 1.5, thickness);
  EXPECT_NEAR(bounds[100].area_mm2, bounds[100].height_mm * thickness, 1e-9);
  EXPECT_GT(bounds[220].area_mm2, 0.5);
  EXPECT_DOUBLE_EQ(burr_thickness_mm({}), 0.2);
  for (double& a : b.area_mm2) a *= 0.1;  // seen from one side: read thin, not believed
  EXPECT_DOUBLE_EQ(burr_thickness_mm({&b}), 0.2);
}

TEST(Feed, a_larger_burr_never_takes_a_smaller_cross_section) {
  Random random(1);
  for (int k = 0; k < 2000; ++k) {
    const BurrBound a{random.uniform(0, 2), random.uniform(0, 0.5)};
    const double outer = random.uniform(0.1, 3), inner = random.uniform(0, outer);
    EXPECT_LE(pass_area_mm2(a, 1e9, inner, 0.08), pass_area_mm2({a.height_mm, a.area_mm2 * 1.3}, 1e9, inner, 0.08) + 1e-12);
    EXPECT_LE(pass_area_mm2(a, 1e9, inner, 0.08), pass_area_mm2({a.height_mm * 1.3, a.area_mm2}, 1e9, inner, 0.08) + 1e-12);
    EXPECT_LE(pass_area_mm2(a, outer, inner, 0.08), pass_area_mm2(a, 1e9, 0, 0.08) + 1e-12);
  }
  EXPECT_DOUBLE_EQ(pass_area_mm2({0.5, 0.2}, 1e9, 0, 0.08), 0.28);
}

TEST(Feed, passes_keep_every_cross_section_under_the_limit_and_are_as_few_as_can_be) {
  const std::vector<BurrBound> burr{{2.0, 1.2}, {0.2, 0.05}};
  const std::vector<double> chamfer{0.08, 0.08};
  EXPECT_EQ(choose_passes(burr, chamfer, 1.3, 3).offsets_mm.size(), 1u);
  const PassDepths two = choose_passes(burr, chamfer, 1.0, 3);
  ASSERT_EQ(two.offsets_mm.size(), 2u);
  EXPECT_GT(two.offsets_mm[0], 0);
  EXPECT_EQ(two.offsets_mm[1], 0);
  EXPECT_LE(two.worst_area_mm2, 1.0);
  const PassDepths none = choose_passes(burr, chamfer, 0.2, 3);
  EXPECT_TRUE(none.offsets_mm.empty());
  EXPECT_GT(none.worst_area_mm2, 0.2);
}

TEST(Feed, blocks_stay_under_every_limit_on_the_grid_within_the_chord) {
  std::vector<Vec3> p, axis;
  std::vector<double> limit;
  for (int i = 0; i <= 400; ++i) {
    const double a = 0.5 * i / 60.0;
    p.push_back(60 * Vec3(std::cos(a), std::sin(a), 0)), axis.push_back(-Vec3::UnitZ());
    limit.push_back(25 + 10 * std::sin(0.05 * i));
  }
  std::vector<char> keep(p.size(), 0);
  keep[200] = 1;
  const auto blocks = feed_blocks(p, axis, limit, keep, 0.008, 3);
  EXPECT_EQ(blocks.front().begin, 0u);
  EXPECT_EQ(blocks.back().end, 400u);
  bool has_kept = false;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const FeedBlock& b = blocks[k];
    if (k > 0) {
      EXPECT_EQ(b.begin, blocks[k - 1].end);
    }
    has_kept = has_kept || b.end == 200;
    EXPECT_NEAR(b.feed_mm_s * 10, std::round(b.feed_mm_s * 10), 1e-9);
    const Vec3 d = p[b.end] - p[b.begin];
    for (std::size_t i = b.begin; i <= b.end; ++i) {
      EXPECT_LE(b.feed_mm_s, limit[i] + 1e-9);
      EXPECT_GE(b.feed_mm_s, limit[i] * 0.85);
      const double t = (p[i] - p[b.begin]).dot(d) / d.squaredNorm();
      EXPECT_LE((p[b.begin] + t * d - p[i]).norm(), 0.008 + 1e-9);
    }
  }
  EXPECT_TRUE(has_kept);
  EXPECT_LT(blocks.size(), 200u);
}

TEST(Feed, the_window_looks_ahead_and_behind) {
  const auto w = windowed_min({0, 1, 2, 3, 4}, {5, 5, 1, 5, 5}, 1.0);
  EXPECT_EQ(w, (std::vector<double>{5, 1, 1, 1, 5}));
}

}  // namespace
}  // namespace asbuilt
