// SPDX-License-Identifier: GPL-3.0-or-later
// Closed forms of intersection against the tracing, near tangency, corners, and the covariance of an edge against resampling.
#include "planner/fit/intersection.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "planner/fit/edge_curve.hpp"
#include "tests/unit/fit/synthetic_part.hpp"

namespace asbuilt::fitting {
namespace {

using synthetic::placed;

Surface plane(const Vec3& origin, const Vec3& n) {
  Surface s;
  s.shape = PlaneSurface{placed(origin, n.normalized(), Vec3::UnitX())};
  return s;
}
Surface cylinder(const Vec3& origin, const Vec3& axis, double r) {
  Surface s;
  s.shape = CylinderSurface{placed(origin, axis.normalized(), Vec3::UnitX()), r};
  return s;
}
Surface cone(const Vec3& origin, const Vec3& axis, double r, double angle) {
  Surface s;
  s.shape = ConeSurface{placed(origin, axis.normalized(), Vec3::UnitX()), r, angle};
  return s;
}
Surface sphere(const Vec3& origin, double r) {
  Surface s;
  s.shape = SphereSurface{placed(origin, Vec3::UnitZ(), Vec3::UnitX()), r};
  return s;
}
FaceModel face_of(const Surface& s) {
  FaceModel f;
  f.nominal = f.surface = s;
  return f;
}

void expect_on_both(const Surface& a, const Surface& b, std::size_t branches, double tolerance = 1e-9) {
  const auto curves = closed_form_intersection(a, b);
  ASSERT_TRUE(curves.has_value());
  ASSERT_EQ(curves->size(), branches);
  for (const Curve& c : *curves)
    for (double t = -3; t <= 3; t += 0.37) {
      const CurvePoint p = evaluate(c, t);
      Vec3 n;
      EXPECT_NEAR(signed_distance(a, p.p, n), 0, tolerance);
      EXPECT_NEAR(signed_distance(b, p.p, n), 0, tolerance);
      // The tracing finds the same point from a seed that is off.
      const Vec3 tangent = p.d1.normalized(), side = tangent.unitOrthogonal();
      const auto x = intersect_at(face_of(a), face_of(b), p.p + 0.2 * side, tangent, rad_from_deg(1));
      ASSERT_TRUE(x.has_value());
      EXPECT_LT((*x - p.p).norm(), 1e-6);
    }
}

TEST(Intersection, PlaneWithPlane) { expect_on_both(plane({1, 2, 3}, {0.1, 0.2, 1}), plane({0, 5, -1}, {1, 0.3, -0.2}), 1); }
TEST(Intersection, PlaneSquareToCylinderIsACircle) {
  expect_on_both(plane({0, 0, 7}, {0, 0, 1}), cylinder({3, -2, 0}, {0, 0, 1}, 12), 1);
  const auto c = closed_form_intersection(plane({0, 0, 7}, {0, 0, 1}), cylinder({3, -2, 0}, {0, 0, 1}, 12));
  EXPECT_TRUE(std::holds_alternative<CircleCurve>((*c)[0].shape));
}
TEST(Intersection, ObliquePlaneWithCylinderIsAnEllipse) { expect_on_both(plane({0, 1, 7}, {0.3, -0.4, 1}), cylinder({3, -2, 0}, {0.1, 0, 1}, 12), 1); }
TEST(Intersection, PlaneAlongCylinderGivesTwoLinesOrNone) {
  expect_on_both(plane({0, 4, 0}, {0, 1, 0}), cylinder({3, -2, 0}, {0, 0, 1}, 12), 2);
  EXPECT_TRUE(closed_form_intersection(plane({0, 40, 0}, {0, 1, 0}), cylinder({3, -2, 0}, {0, 0, 1}, 12))->empty());
}
TEST(Intersection, PlaneWithSphere) { expect_on_both(plane({0, 0, 3}, {0.2, 0.1, 1}), sphere({1, 1, 1}, 9), 1); }
TEST(Intersection, CoaxialSurfacesMeetInCircles) {
  expect_on_both(plane({0, 0, 5}, {0, 0, 1}), cone({2, 1, 0}, {0, 0, 1}, 8, 0.4), 1);
  expect_on_both(cylinder({2, 1, 0}, {0, 0, 1}, 10), cone({2, 1, 0}, {0, 0, 1}, 8, 0.4), 1);
  expect_on_both(cylinder({2, 1, 0}, {0, 0, 1}, 6), sphere({2, 1, 4}, 9), 2);
  expect_on_both(cone({2, 1, 0}, {0, 0, 1}, 8, 0.4), cone({2, 1, 3}, {0, 0, -1}, 11, 0.3), 1);
}
TEST(Intersection, NoClosedFormWhereThereIsNone) {
  EXPECT_FALSE(closed_form_intersection(cylinder({0, 0, 0}, {0, 0, 1}, 5), cylinder({0, 1, 0}, {1, 0, 0}, 4)).has_value());
}

TEST(Tracing, NearTangencyIsRefusedBelowTheAngleAndFoundAbove) {
  for (double angle = 2; angle < 30; angle += 1.5) {
    const double a = rad_from_deg(angle);
    const auto x = intersect_at(face_of(plane({0, 0, 0}, {0, 0, 1})), face_of(plane({0, 0, 0}, {0, std::sin(a), std::cos(a)})), {1, 0.05, 0.02},
                                Vec3::UnitX(), rad_from_deg(10));
    EXPECT_EQ(x.has_value(), angle > 10) << angle;
    if (x) EXPECT_LT((*x - Vec3(1, 0, 0)).norm(), 1e-6);
  }
}

TEST(Tracing, CornerOfThreeFaces) {
  const FaceModel a = face_of(plane({0, 0, 0.1}, {0, 0, 1})), b = face_of(cylinder({0, 0, 0}, {0, 0, 1}, 20)), c = face_of(plane({3, 0, 0}, {1, 0.05, 0}));
  const auto x = corner_at(a, b, c, {3, 19, 0});
  ASSERT_TRUE(x.has_value());
  Vec3 n;
  for (const FaceModel* f : {&a, &b, &c}) EXPECT_NEAR(face_distance(*f, *x, n), 0, 1e-7);
  EXPECT_FALSE(corner_at(a, b, face_of(plane({0, 20.1, 0}, {0, 1, 0.001})), {0, 20, 0}).has_value());  // tangent to the cylinder
}

/// Height of a flat patch with an offset field at q, by the posterior of the bundle and by refitting noise again and again.
TEST(Tracing, CovarianceOfAnEdgeMatchesResampling) {
  const auto T = synthetic::some_place();
  std::vector<FaceModel> start{face_of(plane({0, 0, 0}, {0, 0, 1})), face_of(plane({0, 0, 0}, {0, -1, 0.3}))};
  std::vector<Cell> cells;
  Random random(3);
  for (int slot = 0; slot < 2; ++slot) {
    const Vec3 n = std::get<PlaneSurface>(start[slot].surface.shape).at.z, into = slot == 0 ? Vec3::UnitY() : Vec3(Vec3::UnitX().cross(n));
    const Vec3 inward = into.z() > 0.5 ? Vec3(-into) : into;
    for (int i = 0; i < 20; ++i)
      for (int j = 0; j < 5; ++j) {
        Cell c;
        c.slot = slot, c.capture = 0, c.edge = 0, c.sd_mm = 0.01, c.points_count = 10;
        c.p_base = T.point(Vec3(2 * i, 0, 0) + inward * (1.5 + 2 * j));
        cells.push_back(c);
      }
    for (const double x : {4.0, 20.0, 36.0})
      for (const double d : {1.0, 5.0, 9.0}) start[slot].prior_points.push_back(Vec3(x, 0, 0) + inward * d);
    for (const Vec3& q : start[slot].prior_points) start[slot].center += q / 9.0;
  }
  EdgeModel edge;
  edge.slot_1 = 0, edge.slot_2 = 1;
  Mat3 predicted, found = Mat3::Zero();
  constexpr int kTrials = 1500;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<FaceModel> faces = start;
    std::vector<Cell> noisy = cells;
    for (Cell& c : noisy) c.p_base += T.direction(std::get<PlaneSurface>(start[c.slot].surface.shape).at.z) * c.sd_mm * random.normal();
    std::vector<CaptureModel> captures(1);
    const Bundle bundle = solve_bundle({.rounds_count = 2}, noisy, T, faces, captures);
    const auto x = intersect_at(faces[0], faces[1], Vec3(7, 0, 0), Vec3::UnitX(), 0.1);
    ASSERT_TRUE(x.has_value());
    const Vec3 d = *x - Vec3(7, 0, 0);
    found += d * d.transpose() / kTrials;
    if (trial == 0) predicted = edge_covariance(bundle, faces, edge, *x, Vec3::UnitX()) / bundle.factor;
  }
  for (const int i : {1, 2}) EXPECT_NEAR(std::sqrt(found(i, i) / predicted(i, i)), 1.0, 0.12) << i;
}

}  // namespace
}  // namespace asbuilt::fitting
