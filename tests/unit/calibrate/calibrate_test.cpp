// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/base/random.hpp"
#include "planner/calibrate/hand_eye.hpp"
#include "planner/calibrate/solve.hpp"
#include "planner/calibrate/spheres.hpp"
#include "tests/support/calibrate_rig.hpp"

namespace asbuilt {
namespace {

using testing_calibrate::Rig;
using testing_calibrate::make_rig;

TEST(HandEye, four_closed_forms_find_the_exact_answer_without_noise) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed)
    for (const bool is_fixed : {false, true}) {
      const Rig g = make_rig({.seed = seed, .views_count = 12, .tilt_deg = 60, .is_sensor_fixed = is_fixed});
      const auto starts = motion_starts(g.motions(), 0.2);
      ASSERT_EQ(starts.size(), 4u);
      for (const MotionStart& s : starts) {
        const Vec6 d = twist_between(g.truth.T_mount_sensor, s.T_mount_sensor), e = twist_between(g.truth.T_place_target, s.T_place_target);
        EXPECT_LT(d.head<3>().norm(), 1e-6) << s.method << " seed " << seed;
        EXPECT_LT(d.tail<3>().norm(), 1e-8) << s.method;
        EXPECT_LT(e.head<3>().norm(), 1e-6) << s.method;
      }
    }
}

TEST(HandEye, covariance_matches_the_scatter_of_many_calibrations) {
  double nees = 0, square = 0, park = 0;
  int n = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    const Rig g = make_rig({.seed = 100 + seed, .views_count = 27, .tilt_deg = 30, .robot_mm = 0.15, .robot_rad = 2e-4, .noise_mm = 0.01});
    CalibrateRecipe recipe;
    recipe.network.robot_sd_mm = 0.15, recipe.network.robot_sd_rad = 2e-4, recipe.network.sensor_sd_mm = 0.01;
    recipe.folds_count = 0, recipe.poses_to_add_count = 0;
    const auto starts = motion_starts(g.motions(), 0.26);
    const auto r = calibrate_network(recipe, g.network, starts);
    ASSERT_TRUE(r.has_value()) << r.error().front().message;
    const auto& X = r->artefact.solution.state.T_mount_sensor;
    const Vec6 d = twist_between(X, g.truth.T_mount_sensor);
    nees += d.dot(r->artefact.solution.mount_covariance().ldlt().solve(d));
    const Vec3 look(0, 0, 206);  // the point the sensor looks at is what counts
    square += (g.truth.T_mount_sensor.point(look) - X.point(look)).squaredNorm();
    park += (g.truth.T_mount_sensor.point(look) - starts.front().T_mount_sensor.point(look)).squaredNorm();
    ++n;
  }
  EXPECT_GT(nees / n / 6, 0.75);
  EXPECT_LT(nees / n / 6, 1.35);
  EXPECT_LT(square, park);  // better than the closed form it started from
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
