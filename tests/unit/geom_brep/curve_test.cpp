// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "samples.hpp"

namespace asbuilt {
namespace {

std::pair<double, double> place(const Curve& c) {
  const CurveDomain d = domain(c);
  if (d.is_bounded) return {d.t0, d.t1};
  return {-2, 2};
}

TEST(Curve, DerivativesAgreeWithDifferences) {
  for (const auto& [name, c] : test::curves()) {
    const auto [a, b] = place(c);
    for (int i = 1; i < 12; ++i) {
      const double t = a + (b - a) * (i + 0.13) / 13, h = 1e-5;
      const CurvePoint e = evaluate(c, t), p = evaluate(c, t + h), m = evaluate(c, t - h);
      EXPECT_LT(((p.p - m.p) / (2 * h) - e.d1).norm(), 1e-5 * (1 + e.d1.norm())) << name;
      EXPECT_LT(((p.d1 - m.d1) / (2 * h) - e.d2).norm(), 1e-4 * (1 + e.d2.norm())) << name;
    }
  }
}

TEST(Curve, FootOfAPointOnTheCurveIsItself) {
  for (const auto& [name, c] : test::curves()) {
    const auto [a, b] = place(c);
    for (int i = 1; i < 12; ++i) {
      const double t = a + (b - a) * i / 12;
      const CurveFoot f = project(c, evaluate(c, t).p);
      EXPECT_LT(f.distance_mm, 1e-8) << name;
      EXPECT_NEAR(f.t, t, 1e-6) << name;
      EXPECT_NEAR(project(c, evaluate(c, t).p, t + 0.05).t, t, 1e-6) << name;
    }
  }
}

TEST(Curve, RationalQuarterIsACircle) {
  BSplineCurve c;
  c.degree = 2;
  c.knots = {0, 0, 0, 1, 1, 1};
  c.poles = {{5, 0, 0}, {5, 5, 0}, {0, 5, 0}};
  c.weights = {1, std::sqrt(0.5), 1};
  for (int i = 0; i <= 10; ++i) EXPECT_NEAR(evaluate({c}, i / 10.0).p.norm(), 5, 1e-12);
}

TEST(Curve, ClosedSplineWrapsAndOpenOneStops) {
  BSplineCurve c = test::wavy_curve(false);
  EXPECT_FALSE(domain({c}).is_closed);
  EXPECT_LT((evaluate({c}, 9).p - evaluate({c}, 4).p).norm(), 1e-12);
  c.poles.back() = c.poles.front();
  EXPECT_TRUE(domain({c}).is_closed);
  EXPECT_LT((evaluate({c}, 4.5).p - evaluate({c}, 0.5).p).norm(), 1e-12);
}

TEST(Curve, UnclampedKnotsAreEvaluatedOnTheirValidRange) {
  BSplineCurve c;
  c.degree = 2;
  c.knots = {0, 1, 2, 3, 4, 5, 6};
  c.poles = {{0, 0, 0}, {2, 0, 0}, {4, 0, 0}, {6, 0, 0}};
  const CurveDomain d = domain({c});
  EXPECT_EQ(d.t0, 2);
  EXPECT_EQ(d.t1, 4);
  EXPECT_NEAR(evaluate({c}, 2).p.x(), 1, 1e-12);  // the mean of the first two poles
  EXPECT_NEAR(evaluate({c}, 4).p.x(), 5, 1e-12);
}

}  // namespace
}  // namespace asbuilt
