// SPDX-License-Identifier: GPL-3.0-or-later
// The residual family: derivatives, statistics, what cannot be told.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/calibrate/network_detail.hpp"
#include "planner/calibrate/solve.hpp"
#include "planner/calibrate/statistics.hpp"
#include "tests/support/calibrate_rig.hpp"

namespace asbuilt {
namespace {

using testing_calibrate::make_rig;
using testing_calibrate::Rig;

TEST(Network, derivatives_are_those_of_the_residuals) {
  for (const Sight sight : {Sight::point, Sight::pixel, Sight::pose, Sight::sphere, Sight::plane})
    for (const bool is_fixed : {false, true}) {
      Rig g = make_rig({.seed = 4, .views_count = 3, .robot_mm = 0.2, .robot_rad = 2e-3, .noise_mm = 0.3, .is_sensor_fixed = is_fixed, .sight = sight == Sight::plane ? Sight::point : sight});
      g.network.sight = sight;
      for (NetworkView& v : g.network.views)
        for (Observation& o : v.observations)
          if (sight == Sight::plane) o.id = o.id % 3;
      g.truth.sensor[kScale] = 0.01;
      Vec6 e;
      e << 0.3, -0.2, 0.1, 0.01, -0.02, 0.015;
      const int rows = network::rows_of(sight);
      for (const NetworkView& v : g.network.views) {
        const Observation o = v.observations.empty() ? Observation{} : v.observations[1 % v.observations.size()];
        const auto at = [&](const Vec6& x, const Vec6& y, const Vec6& d, int constant, double step) {
          auto sensor = g.truth.sensor;
          if (constant >= 0) sensor[static_cast<std::size_t>(constant)] += step;
          const network::Bench b(g.network, v, g.truth.T_mount_sensor.disturbed(x), g.truth.T_place_target.disturbed(y), e + d, sensor.data());
          Eigen::VectorXd r(rows);
          network::residual_of(b, o, v.T_sensor_target, r.data(), nullptr);
          return r;
        };
        const network::Bench b(g.network, v, g.truth.T_mount_sensor, g.truth.T_place_target, e, g.truth.sensor.data());
        network::Derivatives d;
        double r[6];
        network::residual_of(b, o, v.T_sensor_target, r, &d);
        const Vec6 zero = Vec6::Zero();
        for (int i = 0; i < 6; ++i) {
          const double h = i < 3 ? 1e-4 : 1e-6;
          const Vec6 s = h * Vec6::Unit(i);
          const Eigen::VectorXd m = (at(s, zero, zero, -1, 0) - at(-s, zero, zero, -1, 0)) / (2 * h), t = (at(zero, s, zero, -1, 0) - at(zero, -s, zero, -1, 0)) / (2 * h),
                                f = (at(zero, zero, s, -1, 0) - at(zero, zero, -s, -1, 0)) / (2 * h);
          EXPECT_LT((m - d.mount.topRows(rows).col(i)).norm(), 1e-4 * (1 + m.norm())) << int(sight) << is_fixed << " mount " << i;
          if (sight != Sight::sphere || i < 3) EXPECT_LT((t - d.target.topRows(rows).col(i)).norm(), 1e-4 * (1 + t.norm())) << int(sight) << is_fixed << " target " << i;
          EXPECT_LT((f - d.robot.topRows(rows).col(i)).norm(), 1e-4 * (1 + f.norm())) << int(sight) << is_fixed << " robot " << i;
        }
        for (int c = 0; c < kSensorConstants; ++c) {
          const double h = 1e-6;
          const Eigen::VectorXd s = (at(zero, zero, zero, c, h) - at(zero, zero, zero, c, -h)) / (2 * h);
          EXPECT_LT((s - d.sensor.topRows(rows).col(c)).norm(), 2e-4 * (1 + s.norm())) << int(sight) << is_fixed << " constant " << c;
        }
      }
    }
}

TEST(Network, chi_squared_tails_are_the_tables) {
  EXPECT_NEAR(chi2_tail(3.841459, 1), 0.05, 1e-6);
  EXPECT_NEAR(chi2_tail(12.591587, 6), 0.05, 1e-6);
  EXPECT_NEAR(chi2_tail(124.342113, 100), 0.05, 1e-6);
  EXPECT_NEAR(chi2_limit(0.001, 6), 22.4577, 1e-3);
  EXPECT_NEAR(chi2_tail(1e-9, 3), 1, 1e-9);
}

/// 95 % bands over every parameter of the mount, both arrangements. The study binary does 500 of each (docs/how_to).
TEST(Network, bands_cover_the_truth) {
  for (const bool is_fixed : {false, true}) {
    int inside = 0, all = 0;
    for (std::uint64_t seed = 1; seed <= 40; ++seed) {
      const Rig g = make_rig({.seed = 900 + seed, .views_count = 20, .tilt_deg = 35, .robot_mm = 0.2, .robot_rad = 3e-4, .noise_mm = 0.02, .is_sensor_fixed = is_fixed});
      NetworkRecipe recipe;
      recipe.sensor_sd_mm = 0.02, recipe.robot_sd_mm = 0.2, recipe.robot_sd_rad = 3e-4;
      NetworkState start = g.truth;
      start.T_mount_sensor = g.truth.T_mount_sensor.disturbed((Vec6() << 3, -2, 1, 0.02, 0.01, -0.02).finished());
      const NetworkSolution s = solve_network(recipe, g.network, start);
      const Vec6 d = twist_between(s.state.T_mount_sensor, g.truth.T_mount_sensor);
      for (int i = 0; i < 6; ++i, ++all) inside += std::abs(d[i]) < 1.96 * std::sqrt(s.covariance(i, i));
    }
    // 240 values: 95 % +- 4 sd of the binomial
    EXPECT_GT(inside, all * 0.89);
    EXPECT_LT(inside, all);
  }
}

TEST(Network, robot_worse_than_stated_widens_the_covariance) {
  const Rig g = make_rig({.seed = 5, .views_count = 25, .robot_mm = 0.8, .robot_rad = 1e-3, .noise_mm = 0.01});
  NetworkRecipe recipe;
  recipe.robot_sd_mm = 0.1, recipe.robot_sd_rad = 1e-4;
  const NetworkSolution s = solve_network(recipe, g.network, g.truth);
  EXPECT_GT(s.robot_sd_mm, 0.5);
  EXPECT_LT(s.robot_sd_mm, 1.2);
  EXPECT_GT(s.robot_sd_rad, 6e-4);
}

TEST(Network, a_wrong_pose_and_a_wrong_point_are_named_and_left_out) {
  Rig g = make_rig({.seed = 8, .views_count = 24, .robot_mm = 0.1, .robot_rad = 2e-4, .noise_mm = 0.01, .drop_ball_every = 0});
  g.network.views[6].T_base_flange.p_mm += Vec3(8, 0, 3);
  g.network.views[11].observations[2].z += Vec3(0, 0.6, 0);
  CalibrateRecipe recipe;
  recipe.network.robot_sd_mm = 0.1, recipe.network.robot_sd_rad = 2e-4;
  const auto r = calibrate_network(recipe, g.network, motion_starts(g.motions(), 0.26));
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  bool has_pose = false, has_point = false;
  for (const NetworkOutlier& o : r->artefact.solution.outliers) {
    has_pose = has_pose || (o.view == 6 && o.observation < 0);
    has_point = has_point || (o.view == 11 && o.observation == 2);
  }
  EXPECT_TRUE(has_pose);
  EXPECT_TRUE(has_point);
  EXPECT_LE(r->artefact.solution.outliers.size(), 2u);
  const Vec6 d = twist_between(g.truth.T_mount_sensor, r->artefact.solution.state.T_mount_sensor);
  EXPECT_LT(d.head<3>().norm(), 0.3);
}

TEST(Network, poses_to_add_lessen_what_they_promise_to) {
  const Rig g = make_rig({.seed = 3, .views_count = 8, .tilt_deg = 30, .robot_mm = 0.2, .robot_rad = 3e-4, .noise_mm = 0.01});
  CalibrateRecipe recipe;
  recipe.network.robot_sd_mm = 0.2, recipe.network.robot_sd_rad = 3e-4;
  const auto r = calibrate_network(recipe, g.network, motion_starts(g.motions(), 0.1));
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  const Calibrated& c = r->artefact;
  ASSERT_EQ(c.poses_to_add.size(), 3u);
  EXPECT_LT(c.poses_to_add[2].turn_sd_rad, 0.7 * c.turn_sd_rad);
  double before = c.turn_sd_rad;
  for (const PoseToAdd& p : c.poses_to_add) EXPECT_LT(p.turn_sd_rad, before * 1.0001), before = p.turn_sd_rad;
  EXPECT_FALSE(c.weak.empty());
}

TEST(Network, refuses_what_the_views_cannot_tell) {
  CalibrateRecipe recipe;
  const Rig few = make_rig({.seed = 1, .views_count = 3, .tilt_deg = 40, .noise_mm = 0.01});
  const auto a = calibrate_network(recipe, few.network, motion_starts(few.motions(), 0.1));
  ASSERT_FALSE(a.has_value());
  EXPECT_EQ(a.error().front().code, "calibrate.too_few_views");
  const Rig flat = make_rig({.seed = 2, .views_count = 20, .tilt_deg = 60, .noise_mm = 0.01, .is_one_axis = true});
  const auto b = calibrate_network(recipe, flat.network, motion_starts(flat.motions(), 0.1));
  ASSERT_FALSE(b.has_value());
  EXPECT_EQ(b.error().front().code, "calibrate.motion_degenerate");
  EXPECT_NE(b.error().front().message.find("xyz"), std::string::npos);  // names poses to add
  Rig mixed = make_rig({.seed = 9, .views_count = 20, .tilt_deg = 40, .noise_mm = 0.01});
  for (std::size_t k = 0; k < 8; ++k) mixed.network.views[k].T_base_flange.p_mm += Vec3(40.0 * (k % 3), 25.0 * (k % 2), -30.0 * (k % 5));
  const auto c = calibrate_network(recipe, mixed.network, motion_starts(mixed.motions(), 0.1));
  ASSERT_FALSE(c.has_value());
  EXPECT_EQ(c.error().front().code, "calibrate.too_many_outliers") << c.error().front().message;
}

}  // namespace
}  // namespace asbuilt
