// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>

#include "planner/base/random.hpp"
#include "samples.hpp"

namespace asbuilt {
namespace {

template <class F>
void at_places(const test::SurfaceSample& s, const F& f) {
  for (int i = 0; i <= 6; ++i)
    for (int j = 0; j <= 6; ++j) f(s.u0 + (s.u1 - s.u0) * i / 6, s.v0 + (s.v1 - s.v0) * j / 6);
}

TEST(Surface, DerivativesAgreeWithDifferences) {
  for (const auto& s : test::surfaces())
    at_places(s, [&](double u, double v) {
      const double h = 1e-5 * std::max(1.0, s.u1 - s.u0), k = 1e-5 * std::max(1.0, s.v1 - s.v0);
      const SurfaceJet j = evaluate_jet(s.surface, u, v);
      const auto p = [&](double a, double b) { return evaluate_jet(s.surface, a, b).p; };
      const double size = 1 + j.du.norm() + j.dv.norm();
      EXPECT_LT(((p(u + h, v) - p(u - h, v)) / (2 * h) - j.du).norm(), 1e-5 * size) << s.name;
      EXPECT_LT(((p(u, v + k) - p(u, v - k)) / (2 * k) - j.dv).norm(), 1e-5 * size) << s.name;
      if (s.name == "offset") return;  // second derivatives are those of its basis
      const auto du = [&](double a, double b) { return evaluate_jet(s.surface, a, b).du; };
      const auto dv = [&](double a, double b) { return evaluate_jet(s.surface, a, b).dv; };
      const double size_2 = 1 + j.duu.norm() + j.duv.norm() + j.dvv.norm();
      EXPECT_LT(((du(u + h, v) - du(u - h, v)) / (2 * h) - j.duu).norm(), 2e-4 * size_2) << s.name;
      EXPECT_LT(((du(u, v + k) - du(u, v - k)) / (2 * k) - j.duv).norm(), 2e-4 * size_2) << s.name;
      EXPECT_LT(((dv(u, v + k) - dv(u, v - k)) / (2 * k) - j.dvv).norm(), 2e-4 * size_2) << s.name;
    });
}

TEST(Surface, FootOfAPointOnANormalIsItsOrigin) {
  for (const auto& s : test::surfaces())
    at_places(s, [&](double u, double v) {
      const SurfacePoint e = evaluate(s.surface, u, v);
      for (double d : {-0.2, 0.0, 0.2}) {
        const Vec3 q = e.p + d * e.n;
        const SurfaceFoot f = project(s.surface, q);
        EXPECT_LT((f.p - e.p).norm(), 1e-6) << s.name << " at " << u << " " << v << " off " << d;
        EXPECT_NEAR(f.signed_distance_mm, d, 1e-6) << s.name;
        EXPECT_NEAR(f.n.norm(), 1, 1e-12);
        const SurfaceFoot g = project(s.surface, q, Vec2(u + 0.01 * (s.u1 - s.u0), v - 0.01 * (s.v1 - s.v0)));
        EXPECT_LT((g.p - e.p).norm(), 1e-6) << s.name << " seeded";
        EXPECT_LT(std::abs(g.u - u), 1e-4) << s.name << " seeded: the turn nearest to the seed";
      }
    });
}

TEST(Surface, NoNearerPointThanTheFoot) {
  Random random(7);
  for (const auto& s : test::surfaces()) {
    if (s.name == "offset") continue;
    for (int i = 0; i < 20; ++i) {
      const double u = s.u0 + (s.u1 - s.u0) * random.uniform(), v = s.v0 + (s.v1 - s.v0) * random.uniform();
      const Vec3 q = evaluate(s.surface, u, v).p + Vec3(random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5);
      const double d = (project(s.surface, q).p - q).norm();
      at_places(s, [&](double a, double b) { EXPECT_LE(d, (evaluate_jet(s.surface, a, b).p - q).norm() + 1e-9) << s.name; });
    }
  }
}

TEST(Surface, MovesWithARigidMotionAndAMirror) {
  for (const bool is_mirror : {false, true})
    for (const auto& s : test::surfaces()) {
      Eigen::Affine3d T = Eigen::Affine3d::Identity();
      T.linear() = 2.0 * Eigen::AngleAxisd(1.1, Vec3(0.3, -1, 0.2).normalized()).toRotationMatrix();
      if (is_mirror) T.linear().col(0) *= -1;
      T.translation() = Vec3(5, 6, 7);
      bool is_reversed = false;
      const Surface moved = transformed(T, s.surface, is_reversed);
      const Mat3 R = T.linear() / 2.0;
      at_places(s, [&](double u, double v) {
        const SurfacePoint e = evaluate(s.surface, u, v);
        const SurfaceFoot f = project(moved, T * e.p);
        EXPECT_LT((f.p - T * e.p).norm(), 1e-6) << s.name << " mirror " << is_mirror;
        EXPECT_LT(((is_reversed ? -1 : 1) * f.n - R * e.n).norm(), 1e-5) << s.name << " mirror " << is_mirror;
      });
    }
}

TEST(Surface, DomainKnowsPeriodsAndPoles) {
  const Placement at = test::tilted();
  const SurfaceDomain sphere = domain({SphereSurface{at, 3}});
  EXPECT_TRUE(sphere.is_periodic_u && sphere.is_pole_v0 && sphere.is_pole_v1);
  const SurfaceDomain cone = domain({ConeSurface{at, 3, 0.5}});
  EXPECT_TRUE(cone.is_pole_v0 && !cone.is_pole_v1);
  EXPECT_LT((evaluate({ConeSurface{at, 3, 0.5}}, 1, cone.v0).p - evaluate({ConeSurface{at, 3, 0.5}}, 4, cone.v0).p).norm(), 1e-9);
  const SurfaceDomain torus = domain({TorusSurface{at, 5, 2, false}});
  EXPECT_TRUE(torus.is_periodic_u && torus.is_periodic_v);
  BSplineSurface tube = test::wavy_surface(false);
  for (int j = 0; j < tube.count_v; ++j) tube.poles[static_cast<std::size_t>(4 * tube.count_v + j)] = tube.poles[static_cast<std::size_t>(j)];
  EXPECT_TRUE(domain({tube}).is_periodic_u);
  BSplineSurface tip = test::wavy_surface(false);
  for (int i = 0; i < tip.count_u; ++i) tip.poles[static_cast<std::size_t>(i * tip.count_v)] = Vec3(1, 2, 3);
  EXPECT_TRUE(domain({tip}).is_pole_v0);
  EXPECT_FALSE(domain({tip}).is_pole_v1);
  EXPECT_NEAR(evaluate({tip}, 0.5, 0).n.norm(), 1, 1e-9);
}

}  // namespace
}  // namespace asbuilt
