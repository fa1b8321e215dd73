// SPDX-License-Identifier: GPL-3.0-or-later
// Many simulated calibrations against their known truth. study_calibrate hand-eye|cover|check|arm [COUNT] [SEED] [ONLY]
#include <Eigen/Dense>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include <opencv2/calib3d.hpp>

#include "planner/calibrate/arm.hpp"
#include "planner/calibrate/calibrate.hpp"
#include "planner/calibrate/check.hpp"
#include "planner/calibrate/statistics.hpp"
#include "tests/support/calibrate_jobs.hpp"

namespace {

using namespace asbuilt;
using testing_calibrate::make_job;
using testing_calibrate::make_rig;
using testing_calibrate::Rig;
using testing_calibrate::RigOptions;

Eigen::Matrix<double, 3, 6> at_point(const Vec3& p) {
  Eigen::Matrix<double, 3, 6> J;
  J << Mat3::Identity(), -skew(p);
  return J;
}

/// Covariance of the mount that no unbiased estimator beats, at the truth and the true sds.
Mat6 cramer_rao(const NetworkRecipe& sds, const Network& n, const NetworkState& truth) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(12 + kSensorConstants, 12 + kSensorConstants);
  for (const NetworkView& v : n.views) H += information_of_view(sds, n, v, truth);
  const Eigen::Matrix<double, 12, 12> A = H.topLeftCorner<12, 12>();
  return A.ldlt().solve(Eigen::Matrix<double, 12, 12>::Identity()).topLeftCorner<6, 6>();
}

Pose<frame::Mount, frame::Sensor> opencv_park(const std::vector<MotionView>& views) {
  std::vector<cv::Mat> Rg, tg, Rt, tt;
  const auto push = [](const Mat3& R, const Vec3& t, std::vector<cv::Mat>& rs, std::vector<cv::Mat>& ts) {
    cv::Mat r(3, 3, CV_64F), v(3, 1, CV_64F);
    for (int i = 0; i < 3; ++i) {
      v.at<double>(i) = t[i];
      for (int k = 0; k < 3; ++k) r.at<double>(i, k) = R(i, k);
    }
    rs.push_back(r), ts.push_back(v);
  };
  for (const MotionView& v : views) push(v.T_place_mount.rotation(), v.T_place_mount.p_mm, Rg, tg), push(v.T_sensor_target.rotation(), v.T_sensor_target.p_mm, Rt, tt);
  cv::Mat R, t;
  cv::calibrateHandEye(Rg, tg, Rt, tt, R, t, cv::CALIB_HAND_EYE_PARK);
  Mat3 M;
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) M(i, k) = R.at<double>(i, k);
  return {Eigen::Quaterniond(M).normalized(), Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2))};
}

void hand_eye(int count, std::uint64_t seed) {
  std::printf("27 captures of the four-ball target, sensor 0.01 mm, error of what the sensor looks at (206 mm), rms of %d runs\n", count);
  std::printf("%-34s %8s %8s %8s %8s %8s %8s %8s %8s %8s %8s\n", "robot mm/axis, deg/axis, tilt", "joint", "bound", "ratio", "park", "opencv", "andreff", "daniil.", "shah", "j/park", "NEES/6");
  struct Setting {
    double mm, deg, tilt;
  };
  for (const Setting& s : {Setting{0.2425, 0.0173, 30}, Setting{0.2425, 0.0173, 15}, Setting{0.2425, 0.0173, 45}, Setting{0.04, 0.003, 30}, Setting{0.04, 0.003, 15}, Setting{0.04, 0.0005, 30}}) {
    double joint = 0, bound = 0, nees = 0, other[4] = {0, 0, 0, 0}, cv_park = 0;
    for (int k = 0; k < count; ++k) {
      const Rig g = make_rig({.seed = seed + static_cast<std::uint64_t>(k), .views_count = 27, .tilt_deg = s.tilt, .robot_mm = s.mm, .robot_rad = rad_from_deg(s.deg), .noise_mm = 0.01});
      NetworkRecipe r;
      r.sensor_sd_mm = 0.01, r.robot_sd_mm = s.mm, r.robot_sd_rad = rad_from_deg(s.deg);
      const auto motions = g.motions();
      const auto starts = motion_starts(motions, 0.17);
      NetworkState at = g.truth;
      at.T_mount_sensor = starts[0].T_mount_sensor, at.T_place_target = starts[0].T_place_target;
      const NetworkSolution sol = solve_network(r, g.network, at);
      const Vec3 look(0, 0, 206);
      const auto error = [&](const Pose<frame::Mount, frame::Sensor>& X) { return (g.truth.T_mount_sensor.point(look) - X.point(look)).squaredNorm() / count; };
      joint += error(sol.state.T_mount_sensor);
      for (int i = 0; i < 4; ++i) other[i] += error(starts[static_cast<std::size_t>(i)].T_mount_sensor);
      cv_park += error(opencv_park(motions));
      const auto J = at_point(look);
      bound += (J * cramer_rao(r, g.network, g.truth) * J.transpose()).trace() / count;
      const Vec6 d = twist_between(sol.state.T_mount_sensor, g.truth.T_mount_sensor);
      nees += d.dot(sol.mount_covariance().ldlt().solve(d)) / 6 / count;
    }
    std::printf("%8.4f mm %8.4f deg  +-%4.0f deg  %8.4f %8.4f %8.3f %8.4f %8.4f %8.4f %8.4f %8.4f %8.3f %8.3f\n", s.mm, s.deg, s.tilt, std::sqrt(joint), std::sqrt(bound), std::sqrt(joint / bound), std::sqrt(other[0]),
                std::sqrt(cv_park), std::sqrt(other[1]), std::sqrt(other[2]), std::sqrt(other[3]), std::sqrt(joint / other[0]), nees);
  }
}

/// `only`: part of a case's name, for long runs of one.
void cover(int count, std::uint64_t seed, const std::string& only) {
  std::printf("%d simulated calibrations each: share of truths inside the 95 %% bands of the six parameters, of the looked-at point's 95 %% ellipsoid, NEES/6\n", count);
  struct Case {
    const char* name;
    RigOptions options;
    bool is_camera_free = false;
  };
  const Case cases[] = {{"balls, sensor on the flange", {.views_count = 27, .tilt_deg = 30, .robot_mm = 0.2, .robot_rad = 3e-4, .noise_mm = 0.01}},
                        {"balls, fixed sensor", {.views_count = 27, .tilt_deg = 30, .robot_mm = 0.2, .robot_rad = 3e-4, .noise_mm = 0.01, .is_sensor_fixed = true}},
                        {"whole poses, fixed sensor", {.views_count = 25, .tilt_deg = 40, .robot_mm = 0.3, .robot_rad = 3e-4, .noise_mm = 0.02, .is_sensor_fixed = true, .sight = Sight::pose}},
                        {"board, camera given", {.views_count = 20, .tilt_deg = 35, .robot_mm = 0.1, .robot_rad = 2e-4, .noise_mm = 0.1, .sight = Sight::pixel}},
                        {"board, camera free", {.views_count = 20, .tilt_deg = 35, .robot_mm = 0.1, .robot_rad = 2e-4, .noise_mm = 0.1, .sight = Sight::pixel}, true},
                        {"laser lines on a ball", {.views_count = 20, .tilt_deg = 45, .robot_mm = 0.1, .robot_rad = 1e-4, .noise_mm = 0.02, .sight = Sight::sphere}}};
  for (const Case& c : cases) {
    if (std::string(c.name).find(only) == std::string::npos) continue;
    double inside = 0, ellipsoid = 0, nees = 0;
    for (int k = 0; k < count; ++k) {
      RigOptions o = c.options;
      o.seed = seed + static_cast<std::uint64_t>(k);
      Rig g = make_rig(o);
      if (c.is_camera_free)
        for (int i = kFx; i <= kP2; ++i) g.network.sensor_sd[static_cast<std::size_t>(i)] = INFINITY;
      NetworkRecipe r;
      r.sensor_sd_mm = o.noise_mm, r.sensor_sd_rad = 1e-2 * o.noise_mm, r.robot_sd_mm = o.robot_mm, r.robot_sd_rad = o.robot_rad;
      NetworkState at = g.truth;
      Random random(o.seed + 77);
      Vec6 off;
      for (int i = 0; i < 3; ++i) off[i] = random.normal(0, 2), off[3 + i] = random.normal(0, 0.01);
      at.T_mount_sensor = at.T_mount_sensor.disturbed(off);
      if (c.is_camera_free) at.sensor[kFx] *= 1.01, at.sensor[kCx] += 5;
      const NetworkSolution s = solve_network(r, g.network, at);
      const Vec6 d = twist_between(s.state.T_mount_sensor, g.truth.T_mount_sensor);
      const Mat6 C = s.mount_covariance();
      for (int i = 0; i < 6; ++i) inside += std::abs(d[i]) < 1.959964 * std::sqrt(C(i, i));
      const auto J = at_point(g.seen.front().p_mm);
      const Vec3 e = J * d;
      ellipsoid += e.dot((J * C * J.transpose()).ldlt().solve(e)) < chi2_limit(0.05, 3);
      nees += d.dot(C.ldlt().solve(d)) / 6 / count;
    }
    std::printf("%-28s bands %5.1f %%  ellipsoid %5.1f %%  NEES/6 %.3f\n", c.name, 100 * inside / (6.0 * count), 100 * ellipsoid / count, nees);
  }
}

void check(int count, std::uint64_t seed) {
  const testing_calibrate::JobOptions o{.seed = seed, .captures_count = 20, .robot_mm = 0.2, .robot_rad = 3e-4};
  const auto was = make_job(o);
  const auto made = calibrate(was.request);
  if (!made) return void(std::printf("%s\n", made.error().front().message.c_str()));
  EarlierCalibration e;
  e.file = "calibration.yaml", e.T_flange_sensor = made->artefact.T_flange_sensor, e.covariance = made->artefact.covariance, e.references = made->artefact.references;
  e.sensor_sd = made->artefact.solved.solution.sensor_sd;
  std::printf("one capture from a pose of the calibration, robot repeatable to 0.02 mm and 0.0023 deg per axis, %d tries each\n", count);
  struct Case {
    const char* name;
    double shift_mm, turn_deg, scale;
  };
  for (const Case& c : {Case{"not moved", 0, 0, 1}, Case{"0.1 mm", 0.1, 0, 1}, Case{"0.2 mm", 0.2, 0, 1}, Case{"0.05 deg", 0, 0.05, 1}, Case{"0.1 deg", 0, 0.1, 1}, Case{"depth scale 2 % off", 0, 0, 1.02}}) {
    int alarms = 0, named = 0;
    double measured = 0;
    Random r(seed + 3);
    for (int k = 0; k < count; ++k) {
      CalibrationRequest q = was.request;
      std::swap(q.captures[0], q.captures[static_cast<std::size_t>(k) % q.captures.size()]);
      q.captures.resize(1);
      const Vec3 way = Vec3(r.normal(), r.normal(), r.normal()).normalized();
      Vec6 moved, error;
      moved << c.shift_mm * way, rad_from_deg(c.turn_deg) * way;
      for (int i = 0; i < 3; ++i) error[i] = r.normal(0, 0.02), error[3 + i] = r.normal(0, 4e-5);
      const auto M = Pose<frame::Sensor, frame::Sensor>().disturbed(moved).inverse() * was.T_true.inverse() * Pose<frame::Flange, frame::Flange>().disturbed(error).inverse() * was.T_true;
      for (Vec3& p : q.captures[0].points_mm) p = c.scale * M.point(p) + Vec3(r.normal(0, 0.003), r.normal(0, 0.003), r.normal(0, 0.003));
      const auto a = check_calibration(q, e);
      if (a) continue;
      ++alarms;
      named += a.error().front().code == (c.scale == 1 ? "calibrate.sensor_moved" : "calibrate.scale_wrong");
      measured += a.error().front().measured;
    }
    std::printf("%-22s alarms %4d of %d, right name %4d, mean of the number told %.3f\n", c.name, alarms, count, named, alarms ? measured / alarms : 0.0);
  }
}

void arm(int count, std::uint64_t seed) {
  const std::vector<DhJoint> nominal{{480, 0, 175, -kPi / 2}, {0, -kPi / 2, 560, 0}, {0, 0, 35, -kPi / 2}, {515, 0, 0, kPi / 2}, {0, 0, 0, -kPi / 2}, {90, 0, 0, 0}};
  const ArmRecipe recipe;
  const ArmParameters a = dh_parameters(recipe, nominal);
  std::printf("an arm with errors of 0.2 mm and 0.02 deg in every constant, tracker poses 0.02 mm and 0.003 deg, scatter 0.03 mm and 0.002 deg; 50 poses for the fit, 50 to judge by, %d arms\n", count);
  double before = 0, after = 0, expected = 0, within = 0, all = 0;
  for (int k = 0; k < count; ++k) {
    Random r(seed + static_cast<std::uint64_t>(k));
    Eigen::VectorXd truth(a.sd.size());
    for (Eigen::Index i = 0; i < truth.size(); ++i) truth[i] = a.units[static_cast<std::size_t>(i)] == "mm" ? r.normal(0, 0.2) : r.normal(0, rad_from_deg(0.02));
    const Pose<frame::Base, frame::Sensor> tracker(quat_exp(Vec3(0.1, 0.2, 2)), Vec3(2500, 600, 300));
    const Pose<frame::Flange, frame::Target> held(quat_exp(Vec3(0.4, 0, 0.3)), Vec3(20, 10, 140));
    Network n;
    n.sight = Sight::pose, n.is_sensor_fixed = true;
    std::vector<NetworkView> judge;
    const auto noise = [&](double mm, double rad) {
      Vec6 e;
      for (int i = 0; i < 3; ++i) e[i] = r.normal(0, mm), e[3 + i] = r.normal(0, rad);
      return e;
    };
    for (int i = 0; i < 100; ++i) {
      NetworkView v;
      v.name = std::to_string(i);
      for (int j = 0; j < 6; ++j) v.joints.push_back(r.uniform(-1.2, 1.2) + (j == 4 ? 0.9 : 0));
      const auto T = a.forward(truth, v.joints).disturbed(noise(0.03, rad_from_deg(0.002)));
      v.T_sensor_target = (tracker.inverse() * T * held).disturbed(noise(0.02, rad_from_deg(0.003)));
      v.T_base_flange = a.forward(Eigen::VectorXd::Zero(truth.size()), v.joints);
      (i < 50 ? n.views : judge).push_back(v);
    }
    NetworkRecipe s;
    s.sensor_sd_mm = 0.02, s.sensor_sd_rad = rad_from_deg(0.003), s.robot_sd_mm = 0.05, s.robot_sd_rad = rad_from_deg(0.003);
    NetworkState at;
    at.T_mount_sensor = {tracker.q, tracker.p_mm}, at.T_place_target = {held.q, held.p_mm};
    NetworkRecipe loose = s;
    loose.robot_sd_mm = 0.4, loose.robot_sd_rad = rad_from_deg(0.03);
    const NetworkSolution plain = solve_network(loose, n, at);
    correct_arm(n, a);
    const NetworkSolution fitted = solve_network(s, n, at);
    NetworkRecipe found = s;
    found.robot_sd_mm = fitted.robot_sd_mm, found.robot_sd_rad = fitted.robot_sd_rad;
    for (NetworkView v : judge) {
      before += raw_residuals(n, v, plain.state).head<3>().squaredNorm();
      std::vector<NetworkView> one{v};
      n.relinearise(fitted.state.arm, one);
      after += raw_residuals(n, one[0], fitted.state).head<3>().squaredNorm();
      expected += residual_covariance(found, n, one[0], fitted.state, fitted.covariance).topLeftCorner<3, 3>().trace();
      all += 1;
    }
    const Eigen::Index first = 12 + kSensorConstants;
    for (Eigen::Index i = 0; i < truth.size(); ++i) within += std::abs(fitted.state.arm[i] - truth[i]) < 3 * std::sqrt(fitted.covariance(first + i, first + i));
    if (k == 0) {
      for (const std::string& d : held_directions(a, fitted, recipe.held_ratio)) std::printf("  left to the beliefs: %s\n", d.c_str());
    }
  }
  std::printf("unseen poses: nominal %.3f mm rms, identified %.3f mm, predicted %.3f mm (ratio %.2f); constants within 3 sd of the truth: %.1f %%\n", std::sqrt(before / all), std::sqrt(after / all), std::sqrt(expected / all),
              std::sqrt(after / expected), 100 * within / (static_cast<double>(a.sd.size()) * count));
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const int count = argc > 2 ? std::atoi(argv[2]) : 100;
  const std::uint64_t seed = argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 10000;
  if (what == "hand-eye") hand_eye(count, seed);
  else if (what == "cover") cover(count, seed, argc > 4 ? argv[4] : "");
  else if (what == "check") check(count, seed);
  else if (what == "arm") arm(count, seed);
  else return std::printf("study_calibrate hand-eye|cover|check|arm [COUNT] [SEED]\n"), 2;
  return 0;
}
