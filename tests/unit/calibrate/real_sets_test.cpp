// SPDX-License-Identifier: GPL-3.0-or-later
// The public calibration sets beside the project, through captures files as a customer would write them: our residuals and
// held-out errors beside what was published. Each prints one line; each skips where ../shared/data is absent.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "planner/calibrate/arm.hpp"
#include "planner/calibrate/calibrate.hpp"
#include "planner/calibrate/image_targets.hpp"
#include "planner/calibrate/streams.hpp"
#include "planner/inputs/inputs.hpp"
#include "tests/support/calibration_sets.hpp"

namespace asbuilt {
namespace {

using namespace calibration_sets;

class RealSets : public ::testing::Test {
 protected:
  fs::path folder;
  void SetUp() override {
    if (!fs::exists(kData)) GTEST_SKIP() << "../shared/data/calibration is not here";
    folder = fs::temp_directory_path() / ("asbuilt-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder);
    fs::create_directories(folder);
  }
  void TearDown() override {
    if (!folder.empty()) fs::remove_all(folder);
  }
  /// As it is written for the command line.
  Result<Done<CalibrationRequest>> read_set(const std::string& set) const {
    if (!write_set(set, folder)) return refuse({.code = "test.no_set", .where = set, .message = "is not beside the project"});
    return again();
  }
  Result<Done<CalibrationRequest>> again() const { return load_captures(folder / "captures.yaml", {false, "2026-11-20"}); }
  /// The captures file with one text in place of another.
  Result<Done<CalibrationRequest>> changed(const std::string& from, const std::string& to) const {
    std::string text = whole(folder / "captures.yaml");
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    if (at != std::string::npos) text.replace(at, from.size(), to);
    put(folder / "captures.yaml", text);
    return again();
  }
};

/// Rms of every point within `gate` of the ball, not only of those that took part.
double surface_rms(const CalibrationRequest& job, const Calibrated& c, double radius, double gate) {
  double sum = 0;
  std::size_t n = 0;
  const auto& s = c.solution.state;
  for (const TargetCapture& t : job.captures)
    for (const Vec3& p : t.points_mm) {
      const Vec3 b = t.T_base_flange.point(s.T_mount_sensor.point(p));
      const double r = (b - s.T_place_target.p_mm).norm() - radius;
      if (std::abs(r) < gate) sum += r * r, ++n;
    }
  return std::sqrt(sum / static_cast<double>(n));
}

/// Plain least squares on the same points, the robot taken for exact: what the published fits minimise.
Calibrated least_squares(const Calibrated& c) {
  Calibrated out = c;
  NetworkRecipe r;
  r.sensor_sd_mm = 0.15, r.robot_sd_mm = 1e-5, r.robot_sd_rad = 1e-8, r.belief_count = 1e9, r.outlier_probability_ratio = 1e-9;
  out.solution = solve_network(r, c.network, c.solution.state);
  return out;
}

/// The same with every point within `gate` of the ball, until the choice of points stands: nothing thinned, nobody left out.
double whole_least_squares_rms(const CalibrationRequest& job, const Calibrated& c, double radius, double gate) {
  Calibrated out = least_squares(c);
  for (int round = 0; round < 6; ++round) {
    Network n = out.network;
    for (std::size_t k = 0; k < n.views.size(); ++k) {
      n.views[k].observations.clear();
      for (const Vec3& p : job.captures[k].points_mm) {
        const Vec3 b = n.views[k].T_base_flange.point(out.solution.state.T_mount_sensor.point(p));
        if (std::abs((b - out.solution.state.T_place_target.p_mm).norm() - radius) < gate) n.views[k].observations.push_back({Vec3::Zero(), p, 0});
      }
    }
    out.network = n;
    out = least_squares(out);
  }
  return surface_rms(job, out, radius, gate);
}

TEST_F(RealSets, line_laser_on_an_80_mm_ball) {
  if (!fs::exists(kData / "line_laser_sphere80_a")) GTEST_SKIP() << "no line_laser_sphere80_a";
  const auto job = read_set("line_laser_sphere80_a");
  ASSERT_TRUE(job.has_value()) << job.error().front().where << job.error().front().message;
  CalibrationRequest j = job->artefact;
  j.nominal.reset();  // nothing is known beforehand
  const auto r = calibrate(j);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  const CalibrationResult& c = r->artefact;
  const double rms = surface_rms(j, c.solved, 40, 1.5);
  const double plain = surface_rms(j, least_squares(c.solved), 40, 1.5);
  std::printf("sphere80_a: surface rms %.4f mm by least squares, %.4f mm with the robot's error modelled (independent fit 0.121, published tool 0.212), held out %.4f mm (expected %.4f), weakest: %s; free radius %.3f +- %.3f\n", plain, rms, c.accuracy_mm, c.solved.held_out_expected,
              c.solved.weak[0].text.c_str(), *c.radius_mm, *c.radius_sd_mm);
  EXPECT_LE(plain, 0.125);
  EXPECT_LE(rms, 0.15);
  EXPECT_GT(c.solved.turn_sd_rad, rad_from_deg(0.1));  // the weakly observable turn is told
  EXPECT_NEAR(c.solved.solution.state.T_place_target.p_mm.x(), -507.03, 0.5);
  EXPECT_NEAR(c.solved.solution.state.T_place_target.p_mm.y(), 1841.15, 0.5);
  EXPECT_NEAR(c.solved.solution.state.T_place_target.p_mm.z(), 100.21, 0.5);
}

TEST_F(RealSets, line_laser_on_a_25_mm_ball_with_clutter_and_holes) {
  if (!fs::exists(kData / "line_laser_sphere25")) GTEST_SKIP() << "no line_laser_sphere25";
  const auto job = read_set("line_laser_sphere25");
  ASSERT_TRUE(job.has_value()) << job.error().front().where << job.error().front().message;
  CalibrationRequest j = job->artefact;
  j.nominal.reset();
  const auto r = calibrate(j);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  const CalibrationResult& c = r->artefact;
  const double rms = surface_rms(j, c.solved, 12.7, 1.5);
  const double plain = surface_rms(j, least_squares(c.solved), 12.7, 1.5);
  std::printf("sphere25: with all points and no outliers left out %.4f mm\n", whole_least_squares_rms(j, c.solved, 12.7, 1.5));
  std::printf("sphere25: surface rms %.4f mm by least squares, %.4f mm with the robot's error modelled (independent fit 0.246), held out %.4f mm, weakest: %s; free radius %.3f +- %.3f (independent fit 12.42, nominal 12.70)\n", plain, rms, c.accuracy_mm, c.solved.weak[0].text.c_str(),
              c.radius_mm.value_or(0), c.radius_sd_mm.value_or(0));
  EXPECT_LE(plain, 0.27);
  EXPECT_LT(c.accuracy_mm, 0.7);
  EXPECT_GT(c.solved.turn_sd_rad, rad_from_deg(0.5));  // ten profiles leave the turn open, and the report says so
}

TEST_F(RealSets, tracker_on_a_ur10_the_residual_is_the_robot) {
  if (!fs::exists(kData / "tracker_ur10_B")) GTEST_SKIP() << "no tracker_ur10_B";
  const auto job = read_set("tracker_ur10_B");
  ASSERT_TRUE(job.has_value()) << job.error().front().where << job.error().front().message;
  EXPECT_TRUE(std::any_of(job->notes.begin(), job->notes.end(), [](const Note& n) { return n.code == "input.decimal_comma"; }));
  const auto r = calibrate(job->artefact);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  const Calibrated& c = r->artefact.solved;
  double mean = 0, most = 0, turn = 0;
  for (std::size_t k = 0; k < c.network.views.size(); ++k) {
    const Eigen::VectorXd e = raw_residuals(c.network, c.network.views[k], c.solution.state);
    mean += e.head<3>().norm() / 25, most = std::max(most, e.head<3>().norm()), turn += deg_from_rad(e.tail<3>().norm()) / 25;
  }
  std::printf("tracker B: fit mean %.3f max %.3f mm %.4f deg (published refined 0.793 / 1.593 / 0.0516, closed form 0.798 / 1.581); held out mean %.3f rms %.3f max %.3f mm, %.4f deg; robot sd %.3f mm per axis\n", mean, most,
              turn, c.held_out_mean, c.held_out_rms, c.held_out_max, deg_from_rad(c.held_out_rad), c.solution.robot_sd_mm);
  EXPECT_EQ(c.network.views.size(), 25u);
  EXPECT_LT(mean, 0.83);
  EXPECT_GE(c.held_out_mean, 0.7);  // less would be a lie
  EXPECT_GE(r->artefact.accuracy_mm, 0.7);
  // stray NUL bytes are left out and said
  std::string text = whole(kData / "tracker_ur10_B" / "calibration_handeye.csv");
  text.insert(text.find('\n') + 1, std::string(3, '\0'));
  put(folder / "t.csv", text);
  const auto nul = again();
  ASSERT_TRUE(nul.has_value());
  EXPECT_TRUE(std::any_of(nul->notes.begin(), nul->notes.end(), [](const Note& n) { return n.code == "input.nul_bytes"; }));
  EXPECT_EQ(nul->artefact.captures.size(), 25u);
}

TEST_F(RealSets, ur10_identified_from_tracker_poses) {
  for (const char* set : {"tracker_ur10_B/measurements_joint_configurations.csv", "tracker_ur10_C/measurements_random_poses.csv"}) {
    if (!fs::exists(kData / set)) GTEST_SKIP() << "no " << set;
    Network n;
    n.sight = Sight::pose, n.is_sensor_fixed = true;
    const std::vector<NetworkView> all = ur10_views(kData / set);
    // 60 for the fit, 60 others to judge by
    std::vector<NetworkView> judge;
    for (std::size_t i = 0; i < 120; ++i) (i % 2 ? judge : n.views).push_back(all[i * all.size() / 120]);
    const ArmRecipe recipe;
    const ArmParameters arm = dh_parameters(recipe, ur10());
    const auto held_out = [&](Network net, bool is_corrected, NetworkSolution& sol, std::vector<Vec3>& errors) {
      if (is_corrected) correct_arm(net, arm);
      else
        for (NetworkView& v : net.views) v.T_base_flange = arm.forward(Eigen::VectorXd::Zero(arm.sd.size()), v.joints);
      std::vector<MotionView> motions;
      for (const NetworkView& v : net.views) motions.push_back({v.name, place_mount(v.T_base_flange, true), *v.T_sensor_target});
      const auto start = motion_starts(motions, 0.26).front();
      NetworkState s;
      s.T_mount_sensor = start.T_mount_sensor, s.T_place_target = start.T_place_target;
      NetworkRecipe r;
      r.sensor_sd_mm = 0.03, r.sensor_sd_rad = 1e-4, r.robot_sd_mm = 0.2, r.robot_sd_rad = 3e-4;
      sol = solve_network(r, net, s);
      double mean = 0;
      for (NetworkView v : judge) {
        v.T_base_flange = arm.forward(is_corrected ? sol.state.arm : Eigen::VectorXd::Zero(arm.sd.size()), v.joints);
        errors.push_back(raw_residuals(net, v, sol.state).head<3>());
        mean += errors.back().norm() / static_cast<double>(judge.size());
      }
      return mean;
    };
    NetworkSolution plain, corrected;
    std::vector<Vec3> e0, e1;
    const double before = held_out(n, false, plain, e0), after = held_out(n, true, corrected, e1);
    std::string held;
    for (const std::string& d : held_directions(arm, corrected, recipe.held_ratio)) held += (held.empty() ? "" : "; ") + d;
    std::printf("%s: %zu rows; 60 views unseen by the fit: nominal %.3f mm mean, identified %.3f mm; robot sd %.3f -> %.3f mm; left to the beliefs: %s\n", set, all.size(), before, after, plain.robot_sd_mm, corrected.robot_sd_mm,
                held.c_str());
    EXPECT_LT(after, 0.75 * before);
    EXPECT_FALSE(held.empty());  // the base's frame and d2, d3, d4 along parallel axes cannot be told apart
  }
}

TEST_F(RealSets, fixed_camera_and_board_on_the_flange) {
  if (!fs::exists(kData / "zivid_eye_to_hand_a")) GTEST_SKIP() << "no zivid_eye_to_hand_a";
  const auto job = read_set("zivid_eye_to_hand_a");
  ASSERT_TRUE(job.has_value()) << job.error().front().where << job.error().front().message;
  const auto r = calibrate(job->artefact);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  const CalibrationResult& c = r->artefact;
  // as the published figure: board poses by themselves against the chain
  double mean = 0, most = 0, turn = 0, n = 0;
  const auto board = board_points(job->artefact.target);
  for (std::size_t k = 0; k < c.solved.network.views.size(); ++k) {
    const NetworkView& v = c.solved.network.views[k];
    if (v.observations.empty()) continue;
    const auto ref = std::find_if(c.references.begin(), c.references.end(), [&](const ReferenceView& x) { return x.name == v.name; });
    if (ref == c.references.end()) continue;
    const auto T = target_in_sensor(c.solved.network, v, c.solved.solution.state);
    mean += (T.p_mm - ref->T_sensor_target.p_mm).norm(), most = std::max(most, (T.p_mm - ref->T_sensor_target.p_mm).norm());
    turn += deg_from_rad(quat_log(T.q.conjugate() * ref->T_sensor_target.q).norm()), n += 1;
  }
  std::printf("zivid a: %.0f images, board pitch by the robot's moves %.3f +- %.3f mm (published 9.96-9.97), pose mean %.3f max %.3f mm %.3f deg (published 0.63 / 1.31 / 0.264), fx %.1f fy %.1f (published 2748.8 2750.9); held out %.3f px = %.3f mm\n",
              n, 10 * *c.scale_ratio, 10 * *c.scale_sd_ratio, mean / n, most, turn / n, (*c.camera)[0], (*c.camera)[1], c.solved.held_out_rms, c.accuracy_mm);
  EXPECT_NEAR(10 * *c.scale_ratio, 9.965, 0.05);
  EXPECT_LT(c.solved.held_out_rms, 1.5);
  EXPECT_LT(mean / n, 0.63);
  EXPECT_LT(turn / n, 0.264);
  // the extrinsics that came with the set are another set's: the target's place contradicts them by more than they could be off
  EXPECT_GT(c.T_flange_sensor.p_mm.norm(), 1000);  // upstream says 264 mm
  const auto wrong = changed("pitch: 10}", "pitch: 10.5}");
  ASSERT_TRUE(wrong.has_value());
  const auto w = calibrate(wrong->artefact);
  ASSERT_FALSE(w.has_value());
  EXPECT_EQ(w.error().front().code, "calibrate.scale_wrong") << w.error().front().message;
}

TEST_F(RealSets, charuco_before_a_fixed_camera_with_stale_intrinsics) {
  if (!fs::exists(kData / "charuco_static_camera")) GTEST_SKIP() << "no charuco_static_camera";
  const auto free_job = read_set("charuco_static_camera");
  ASSERT_TRUE(free_job.has_value()) << free_job.error().front().where << free_job.error().front().message;
  const auto stale_job = changed("intrinsics_free: true\n", "");
  ASSERT_TRUE(stale_job.has_value()) << stale_job.error().front().where << stale_job.error().front().message;
  const auto stale = calibrate(stale_job->artefact);
  ASSERT_FALSE(stale.has_value());
  EXPECT_EQ(stale.error().front().code, "calibrate.intrinsics_stale") << stale.error().front().message;
  const auto free = calibrate(free_job->artefact);
  ASSERT_TRUE(free.has_value()) << free.error().front().message;
  double sum = 0, n = 0;
  const Calibrated& c = free->artefact.solved;
  for (const NetworkView& v : c.network.views) {
    const Eigen::VectorXd e = raw_residuals(c.network, v, c.solution.state);
    sum += e.squaredNorm(), n += static_cast<double>(e.size()) / 2;
  }
  NetworkRecipe pixels;  // least squares of the pixels alone, the robot taken for exact
  pixels.sensor_sd_mm = 1, pixels.robot_sd_mm = 1e-5, pixels.robot_sd_rad = 1e-8, pixels.belief_count = 1e9, pixels.outlier_probability_ratio = 1e-12;
  const NetworkSolution plain = solve_network(pixels, c.network, c.solution.state);
  double square = 0, count = 0;
  for (const NetworkView& v : c.network.views) {
    const Eigen::VectorXd e = raw_residuals(c.network, v, plain.state);
    square += e.squaredNorm(), count += static_cast<double>(e.size()) / 2;
  }
  std::printf("charuco: by least squares of the pixels alone %.3f px\n", std::sqrt(square / count));
  EXPECT_LT(std::sqrt(square / count), 1.064);
  std::printf("charuco: free %.3f px rms of all points (published 1.064), held out %.3f px = %.3f mm; given: refused, %.2f px against %.2f (published 2.478); fx %.1f cx %.1f (independent 1345.9, 766.8)\n    %s\n", std::sqrt(sum / n),
              c.held_out_rms, free->artefact.accuracy_mm, stale.error().front().measured, stale.error().front().limit / 1.15, (*free->artefact.camera)[0], (*free->artefact.camera)[2],
              stale.error().front().message.c_str());
  EXPECT_LT(std::sqrt(sum / n), 2.3);  // with the robot's error modelled; least squares of the pixels alone would be lower
}

TEST_F(RealSets, two_axis_positioner_with_two_parameters_that_cannot_be_known) {
  if (!fs::exists(kData / "positioner_2axis")) GTEST_SKIP() << "no positioner_2axis";
  Network n;
  n.sight = Sight::pose, n.is_sensor_fixed = true;
  n.views = positioner_views();
  ASSERT_EQ(n.views.size(), 205u);
  const ArmRecipe recipe{.length_sd_mm = 2, .angle_sd_rad = 5e-3};
  const ArmParameters arm = positioner(recipe);
  double turn_sd_rad = 5e-4, robot_sd_mm = 0.2, robot_sd_rad = 5e-4;
  const auto mean_of = [&](bool is_corrected, NetworkSolution& sol) {
    Network net = n;
    if (is_corrected) correct_arm(net, arm);
    else
      for (NetworkView& v : net.views) v.T_base_flange = arm.forward(Eigen::VectorXd::Zero(arm.sd.size()), v.joints);
    std::vector<MotionView> motions;
    for (std::size_t k = 0; k < net.views.size(); k += 5) motions.push_back({net.views[k].name, place_mount(net.views[k].T_base_flange, true), *net.views[k].T_sensor_target});
    const auto start = motion_starts(motions, 0.26).front();
    NetworkState s;
    s.T_mount_sensor = start.T_mount_sensor, s.T_place_target = start.T_place_target;
    NetworkRecipe r;
    r.sensor_sd_mm = 0.2, r.sensor_sd_rad = turn_sd_rad, r.robot_sd_mm = robot_sd_mm, r.robot_sd_rad = robot_sd_rad, r.outlier_probability_ratio = 1e-9;
    if (robot_sd_mm < 0.01) r.belief_count = 1e9;
    sol = solve_network(r, net, s);
    if (net.relinearise) net.relinearise(sol.state.arm, net.views);
    double mean = 0;
    for (const NetworkView& v : net.views) mean += raw_residuals(net, v, sol.state).head<3>().norm() / static_cast<double>(net.views.size());
    return mean;
  };
  NetworkSolution plain, corrected;
  const double before = mean_of(false, plain), after = mean_of(true, corrected);
  const auto held = held_directions(arm, corrected, 0.9);
  std::string text;
  for (const std::string& d : held) text += (text.empty() ? "" : "; ") + d;
  NetworkSolution places;
  turn_sd_rad = 0.05, robot_sd_mm = 1e-4, robot_sd_rad = 1e-7;  // the places alone, the axes taken for exact: what the published figure minimises
  std::printf("positioner: least squares of the places alone %.4f mm mean\n", mean_of(true, places));
  std::printf("positioner: nominal %.3f mm mean, corrected %.3f mm (published 0.420 -> 0.381); left to the beliefs: %s\n", before, after, text.c_str());
  for (const ArmLine& l : arm_lines(recipe, arm, corrected)) std::printf("    %s %.4f +- %.4f %s%s\n", l.name.c_str(), l.value, l.sd, l.unit.c_str(), l.is_held ? " (held)" : "");
  EXPECT_NEAR(before, 0.420, 0.02);
  EXPECT_LT(after, before);
  EXPECT_GE(held.size(), 2u);
}

TEST_F(RealSets, moving_robot_and_camera_with_clocks_of_their_own) {
  if (!fs::exists(kData / "eth_handeye")) GTEST_SKIP() << "no eth_handeye";
  const auto [hand, eye] = eth_streams();
  ASSERT_GT(hand.size(), 1000u);
  ASSERT_GT(eye.size(), 1000u);
  const auto match = match_streams({}, hand, eye);
  ASSERT_TRUE(match.has_value()) << match.error().front().message;
  Network n;
  n.sight = Sight::pose;
  n.views = eth_views({hand, eye}, match->offset_s);
  std::vector<MotionView> motions;
  for (const NetworkView& v : n.views) motions.push_back({v.name, place_mount(v.T_base_flange, false), *v.T_sensor_target});
  CalibrateRecipe r;
  r.network.sensor_sd_mm = 3, r.network.sensor_sd_rad = 5e-3, r.network.robot_sd_mm = 3, r.network.robot_sd_rad = 3e-3, r.point_sd_max_mm = 5, r.poses_to_add_count = 0;
  const auto solved = calibrate_network(r, n, motion_starts(motions, 0.5));
  ASSERT_TRUE(solved.has_value()) << solved.error().front().message;
  std::vector<double> error, held;
  for (const NetworkView& v : n.views) error.push_back((target_in_sensor(n, v, solved->artefact.solution.state).p_mm - v.T_sensor_target->p_mm).norm());
  for (const ViewLine& l : solved->artefact.views) held.push_back(l.held_out_rms);
  std::sort(error.begin(), error.end());
  std::sort(held.begin(), held.end());
  const Vec3 t = solved->artefact.solution.state.T_mount_sensor.p_mm;
  std::printf("eth real: offset %.4f +- %.4f s (published -0.02), %zu views, median %.2f p95 %.2f mm (published 6.9 / 21.1), held out median %.2f mm, X (%.1f, %.1f, %.1f) mm (published -2.6, -18.1, 4.4)\n", match->offset_s,
              match->offset_sd_s, n.views.size(), error[error.size() / 2], error[error.size() * 95 / 100], held[held.size() / 2], t.x(), t.y(), t.z());
  EXPECT_NEAR(std::abs(match->offset_s), 0.02, 0.015);
  EXPECT_LT(error[error.size() / 2], 9);
}

}  // namespace
}  // namespace asbuilt
