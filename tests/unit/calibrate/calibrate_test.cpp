// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/base/random.hpp"
#include "planner/calibrate/hand_eye.hpp"
#include "planner/calibrate/spheres.hpp"

namespace asbuilt {
namespace {

struct Rig {
  Pose<frame::Flange, frame::Sensor> X;
  Pose<frame::Base, frame::Target> Y;
  std::vector<Vec3> balls;
  std::vector<TargetView> views;
};

Rig make_rig(std::uint64_t seed, int count, double tilt_deg, double robot_mm, double robot_rad, double noise_mm, bool one_axis = false) {
  Random r(seed);
  Rig g;
  g.X = {quat_exp(Vec3(0.3, -0.5, 1.4)), Vec3(80, -30, 150)};
  g.Y = {quat_exp(Vec3(r.normal(0, 0.1), r.normal(0, 0.1), r.normal())), Vec3(1200, 40, 600)};
  g.balls = {Vec3(0, 0, 0), Vec3(31, 4, 1), Vec3(8, 27, -2), Vec3(24, 20, 13)};
  for (int k = 0; k < count; ++k) {
    Vec3 axis(r.normal(), r.normal(), r.normal());
    if (one_axis) axis = Vec3(0, 0, 1);
    const Vec3 w = axis.normalized() * r.uniform(-1, 1) * rad_from_deg(tilt_deg);
    // the sensor looks at the target from 206 mm
    const Pose<frame::Target, frame::Sensor> view((quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()) * quat_exp(w)).normalized(), Vec3::Zero());
    const Pose<frame::Target, frame::Sensor> at(view.q, Vec3(16, 13, 3) - view.q * Vec3(r.normal(0, 6), r.normal(0, 6), 206 + r.uniform(-25, 25)));
    const auto T_true = g.Y * at * g.X.inverse();
    Vec6 e;
    for (int i = 0; i < 3; ++i) e[i] = r.normal(0, robot_mm), e[3 + i] = r.normal(0, robot_rad);
    TargetView v;
    v.name = "view " + std::to_string(k);
    // true = commanded.disturbed(error)
    v.T_base_flange = T_true * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse();
    for (std::size_t j = 0; j < g.balls.size(); ++j) {
      if (j == static_cast<std::size_t>(k % 7)) continue;
      v.p_target.push_back(g.balls[j]);
      v.p_sensor.push_back(at.inverse().point(g.balls[j]) + Vec3(r.normal(0, noise_mm), r.normal(0, noise_mm), r.normal(0, noise_mm)));
    }
    g.views.push_back(v);
  }
  return g;
}

TEST(HandEye, three_closed_forms_find_the_exact_answer_without_noise) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Rig g = make_rig(seed, 12, 60, 0, 0, 0);
    const auto starts = hand_eye_starts(g.views, 0.2);
    ASSERT_EQ(starts.size(), 3u);
    for (const HandEyeStart& s : starts) {
      const Vec6 d = twist_between(g.X, s.T_flange_sensor);
      EXPECT_LT(d.head<3>().norm(), 1e-6) << s.method << " seed " << seed;
      EXPECT_LT(d.tail<3>().norm(), 1e-8) << s.method;
    }
  }
}

TEST(HandEye, covariance_matches_the_scatter_of_many_calibrations) {
  HandEyeRecipe recipe;
  recipe.robot_sd_mm = 0.15, recipe.robot_sd_rad = 2e-4, recipe.sensor_sd_mm = 0.01;
  double nees = 0, square = 0, park = 0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const Rig g = make_rig(100 + seed, 27, 30, 0.15, 2e-4, 0.01);
    const auto r = calibrate_hand_eye(recipe, g.views);
    ASSERT_TRUE(r.has_value()) << r.error().front().message;
    const Vec6 d = twist_between(g.X, r->artefact.T_flange_sensor);
    nees += d.dot(r->artefact.covariance.ldlt().solve(d));
    // the point the sensor looks at is what counts
    const Vec3 look(0, 0, 206);
    square += (g.X.point(look) - r->artefact.T_flange_sensor.point(look)).squaredNorm();
    park += (g.X.point(look) - r->artefact.starts.front().T_flange_sensor.point(look)).squaredNorm();
    ++n;
  }
  EXPECT_GT(nees / n / 6, 0.6);
  EXPECT_LT(nees / n / 6, 1.5);
  EXPECT_LT(square, park * 1.02);  // never worse than the closed form it started from
}

TEST(HandEye, refuses_what_the_views_cannot_tell) {
  const HandEyeRecipe recipe;
  const auto few = calibrate_hand_eye(recipe, make_rig(1, 3, 40, 0, 0, 0.01).views);
  ASSERT_FALSE(few.has_value());
  EXPECT_EQ(few.error().front().code, "calibrate.too_few_views");
  const auto flat = calibrate_hand_eye(recipe, make_rig(2, 20, 60, 0, 0, 0.01, true).views);
  ASSERT_FALSE(flat.has_value());
  EXPECT_EQ(flat.error().front().code, "calibrate.motion_degenerate");
}

TEST(Spheres, found_and_named_in_clutter) {
  Random r(3);
  const std::vector<Vec3> target = {Vec3(0, 0, 0), Vec3(31, 4, 1), Vec3(8, 27, -2), Vec3(24, 20, 13)};
  const Pose<frame::Sensor, frame::Target> T(quat_exp(Vec3(2.9, 0.2, 0.4)), Vec3(-10, 5, 200));
  std::vector<Vec3> cloud;
  for (std::size_t b = 0; b < target.size(); ++b) {
    const Vec3 c = T.point(target[b]);
    for (int i = 0; i < 700; ++i) {
      const Vec3 u = Vec3(r.normal(), r.normal(), r.normal()).normalized();
      if (u.dot(c.normalized()) > -0.45) continue;  // the cap that faces the sensor
      cloud.push_back(c + u * (4.3655 + r.normal(0, 0.01)));
    }
  }
  for (int i = 0; i < 4000; ++i) cloud.push_back(Vec3(r.uniform(-60, 60), r.uniform(-60, 60), 215 + r.normal(0, 0.02)));
  const auto found = find_spheres({}, cloud, 1);
  ASSERT_EQ(found.size(), 4u);
  std::vector<Vec3> centers;
  for (const SphereFit& f : found) centers.push_back(f.center);
  const auto who = identify_balls(centers, target, 0.1);
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_TRUE(who[i].has_value());
    EXPECT_LT((T.point(target[*who[i]]) - centers[i]).norm(), 0.005);
    EXPECT_NEAR(found[i].free_radius_mm, 4.3655, 0.03);
  }
  // two balls are not enough
  const auto two = identify_balls({centers[0], centers[1]}, target, 0.1);
  EXPECT_FALSE(two[0].has_value());
}

}  // namespace
}  // namespace asbuilt
