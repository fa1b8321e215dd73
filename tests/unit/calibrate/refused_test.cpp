// SPDX-License-Identifier: GPL-3.0-or-later
// Refusals of the calibration that the other tests do not meet by themselves.
#include <gtest/gtest.h>

#include "planner/calibrate/solve.hpp"
#include "planner/calibrate/streams.hpp"
#include "tests/support/calibrate_rig.hpp"

namespace asbuilt {
namespace {

using testing_calibrate::make_rig;
using testing_calibrate::Rig;

TEST(Refused, a_solve_that_needs_more_iterations_than_allowed_has_not_settled) {
  const Rig g = make_rig({.seed = 3, .views_count = 20, .robot_mm = 0.05, .robot_rad = 1e-4, .noise_mm = 0.01});
  CalibrateRecipe recipe;
  recipe.network.robot_sd_mm = 0.05, recipe.network.robot_sd_rad = 1e-4;
  const auto starts = motion_starts(g.motions(), 0.2);
  ASSERT_TRUE(calibrate_network(recipe, g.network, starts));
  recipe.network.iterations_max_count = 0;
  const auto r = calibrate_network(recipe, g.network, starts);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().front().code, "calibrate.not_converged");
}

// The flange turns by half turns about its own three axes only. Every turn of the sensor's mount by one of these half turns gives the
// same sightings: four answers, none better than the other.
TEST(Refused, half_turns_alone_have_four_answers) {
  Random random(8);
  NetworkState truth;
  truth.T_mount_sensor = {quat_exp(Vec3(0.3, -0.5, 1.4)), Vec3(80, -30, 150)};
  const Pose<frame::Base, frame::Mount> at(quat_exp(Vec3(0.2, 2.8, 0.3)), Vec3(900, 100, 700));
  const std::vector<Eigen::Quaterniond> turns{Eigen::Quaterniond::Identity(), Eigen::Quaterniond(0, 1, 0, 0), Eigen::Quaterniond(0, 0, 1, 0), Eigen::Quaterniond(0, 0, 0, 1)};
  const Pose<frame::Mount, frame::Target> ahead(quat_exp(Vec3(0.1, 0.2, -0.3)), Vec3(60, -20, 400));
  Network n;
  n.sight = Sight::pose;
  std::vector<NetworkState> answers;
  for (const Eigen::Quaterniond& d : turns) {
    NetworkState s;
    const Pose<frame::Mount, frame::Mount> D(d, Vec3::Zero());
    s.T_mount_sensor = D * truth.T_mount_sensor;
    const auto T = at * D * ahead;
    s.T_place_target = {T.q, T.p_mm};
    answers.push_back(s);
  }
  const double sd_mm = 0.02, sd_rad = 4e-5;
  for (int k = 0; k < 16; ++k) {
    NetworkView v;
    v.name = "view " + std::to_string(k);
    const auto F = at * Pose<frame::Mount, frame::Mount>(turns[std::size_t(k % 4)], Vec3::Zero());
    v.T_base_flange = {F.q, F.p_mm};
    const auto T_base_target = at * ahead;
    const auto seen = truth.T_mount_sensor.inverse() * F.inverse() * T_base_target;
    Vec6 e;
    for (int i = 0; i < 6; ++i) e[i] = random.normal(0, i < 3 ? sd_mm : sd_rad);
    v.T_sensor_target = Pose<frame::Sensor, frame::Target>(seen.q, seen.p_mm).disturbed(e);
    n.views.push_back(v);
  }
  CalibrateRecipe recipe;
  recipe.network.sensor_sd_mm = sd_mm, recipe.network.sensor_sd_rad = sd_rad, recipe.network.robot_sd_mm = 0.01, recipe.network.robot_sd_rad = 2e-5;
  std::vector<MotionStart> starts;
  for (std::size_t i = 0; i < 2; ++i) starts.push_back({i ? "turned" : "true", answers[i].T_mount_sensor, answers[i].T_place_target});
  const auto r = calibrate_network(recipe, n, starts);
  ASSERT_FALSE(r);
  EXPECT_EQ(r.error().front().code, "calibrate.starts_disagree") << r.error().front().message;
  EXPECT_NE(r.error().front().message.find("180.000 deg"), std::string::npos) << r.error().front().message;
  EXPECT_NE(r.error().front().message.find("add views"), std::string::npos);
  // one more kind of turn decides
  for (int k = 0; k < 6; ++k) {
    NetworkView v = n.views.front();
    v.name = "tilted " + std::to_string(k);
    const auto F = at * Pose<frame::Mount, frame::Mount>(quat_exp(Vec3(0.3 * std::cos(k), 0.3 * std::sin(k), 0.1)), Vec3(5, 3, -4));
    v.T_base_flange = {F.q, F.p_mm};
    const auto seen = truth.T_mount_sensor.inverse() * F.inverse() * (at * ahead);
    v.T_sensor_target = Pose<frame::Sensor, frame::Target>(seen.q, seen.p_mm);
    n.views.push_back(v);
  }
  const auto decided = calibrate_network(recipe, n, starts);
  ASSERT_TRUE(decided) << decided.error().front().code << " " << decided.error().front().message;
  EXPECT_LT((decided->artefact.solution.state.T_mount_sensor.p_mm - truth.T_mount_sensor.p_mm).norm(), 0.5);
}

TEST(Refused, streams_without_common_motion) {
  const auto stream = [](double shift_s, auto&& angle) {
    std::vector<TimedPose> s;
    for (int k = 0; k < 600; ++k) {
      const double t = 0.05 * k;
      TimedPose p;
      p.t_s = t;
      p.q = quat_exp(angle(t - shift_s));
      s.push_back(p);
    }
    return s;
  };
  const auto wave = [](double t) { return Vec3(0.4 * std::sin(0.7 * t + 0.3 * std::sin(0.31 * t)), 0.3 * std::sin(1.13 * t), 0); };
  MotionStreamRecipe recipe;
  recipe.offset_max_s = 2;
  const auto good = match_streams(recipe, stream(0, wave), stream(0.4, wave));
  ASSERT_TRUE(good) << good.error().front().message;
  EXPECT_NEAR(std::abs(good->offset_s), 0.4, 0.01);
  const auto still = match_streams(recipe, stream(0, wave), stream(0, [](double) { return Vec3(0.1, 0, 0); }));
  ASSERT_FALSE(still);
  EXPECT_EQ(still.error().front().code, "calibrate.streams_do_not_match");
  // one even beat: each period fits as well as the next
  const auto beat = [](double t) { return Vec3(0.4 * std::sin(2 * kPi * t), 0, 0); };
  const auto beats = match_streams(recipe, stream(0, beat), stream(0.4, beat));
  ASSERT_FALSE(beats);
  EXPECT_EQ(beats.error().front().code, "calibrate.streams_do_not_match");
}

}  // namespace
}  // namespace asbuilt
