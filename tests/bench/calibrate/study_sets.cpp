// SPDX-License-Identifier: GPL-3.0-or-later
// The public calibration sets, every one through its captures file: residuals and held-out errors of the calibration as it is, of plain
// least squares on the same observations, and of the published answer on the same observations where it was published as numbers.
//   study_sets DIR        writes DIR/SET/captures.yaml for `asbuilt calibrate`, then the table (run from the source folder)
// Held out: five folds, each view predicted by a solve that has not seen it; the same folds for both.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "planner/calibrate/calibrate.hpp"
#include "planner/inputs/inputs.hpp"
#include "tests/support/calibration_sets.hpp"

namespace {

using namespace asbuilt;
namespace sets = calibration_sets;

struct Numbers {
  std::vector<double> length;  // of each observation's residual; of poses the place
  double turn_deg = 0;         // mean, of poses
  double rms() const {
    double sum = 0;
    for (double l : length) sum += l * l;
    return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, length.size())));
  }
  double mean() const {
    double sum = 0;
    for (double l : length) sum += l;
    return sum / static_cast<double>(std::max<std::size_t>(1, length.size()));
  }
  double quantile(double q) const {
    std::vector<double> s = length;
    std::sort(s.begin(), s.end());
    return s.empty() ? 0 : s[std::min(s.size() - 1, static_cast<std::size_t>(q * static_cast<double>(s.size())))];
  }
};

void add(Numbers& n, const Network& network, const NetworkView& v, const NetworkState& s) {
  const Eigen::VectorXd r = raw_residuals(network, v, s);
  const Eigen::Index rows = network.sight == Sight::point ? 3 : network.sight == Sight::pixel ? 2 : network.sight == Sight::pose ? 6 : 1, used = std::min<Eigen::Index>(rows, 3);
  for (Eigen::Index i = 0; i + rows <= r.size(); i += rows) {
    n.length.push_back(r.segment(i, used).norm());
    if (network.sight == Sight::pose) n.turn_deg += deg_from_rad(r.tail<3>().norm()) / static_cast<double>(network.views.size());
  }
}

/// A network whose arm is corrected stands at the arm of the state.
NetworkView at_arm(const Network& n, const NetworkView& v, const NetworkState& s) {
  std::vector<NetworkView> one{v};
  if (n.relinearise && s.arm.size()) n.relinearise(s.arm, one);
  return one.front();
}

Numbers fitted(const Network& n, const NetworkState& s) {
  Numbers out;
  for (const NetworkView& v : n.views) add(out, n, at_arm(n, v, s), s);
  return out;
}

Numbers held_out(const NetworkRecipe& r, const Network& n, const NetworkState& start) {
  Numbers out;
  constexpr int kFolds = 5;
  for (int f = 0; f < kFolds; ++f) {
    Network part = n;
    int at = 0;
    std::vector<std::size_t> unseen;
    for (std::size_t k = 0; k < n.views.size(); ++k) {
      if (n.views[k].observations.empty() && !n.views[k].T_sensor_target) continue;
      if (at++ % kFolds == f) part.views[k].is_held_out = true, unseen.push_back(k);
    }
    const NetworkState s = solve_network(r, part, start).state;
    for (std::size_t k : unseen) add(out, n, at_arm(n, n.views[k], s), s);
  }
  return out;
}

/// What the published fits minimise: squares of the observations, the robot taken for exact.
NetworkRecipe least_squares(double turn_weight_mm) {
  NetworkRecipe r;
  r.sensor_sd_mm = 1, r.sensor_sd_rad = 1 / turn_weight_mm, r.robot_sd_mm = 1e-5, r.robot_sd_rad = 1e-8, r.belief_count = 1e9, r.rounds_count = 0;
  return r;
}

void row(const char* name, const char* metric, const std::string& published, double squares, double modelled, double held, double held_squares, double expected) {
  std::printf("%-34s %-30s %-34s %9.4f %9.4f %9.4f %9.4f", name, metric, published.c_str(), squares, modelled, held, held_squares);
  expected > 0 ? std::printf(" %9.4f\n", expected) : std::printf("\n");
  std::fflush(stdout);
}

NetworkRecipe as_found(const NetworkSolution& s) {
  NetworkRecipe r;
  r.sensor_sd_mm = s.sensor_sd, r.sensor_sd_rad = s.sensor_sd_rad > 0 ? s.sensor_sd_rad : 1e-4, r.robot_sd_mm = s.robot_sd_mm, r.robot_sd_rad = s.robot_sd_rad, r.belief_count = 1e6, r.rounds_count = 2;
  return r;
}

std::string text(const char* format, double a, double b = 0) {
  char out[80];
  std::snprintf(out, sizeof out, format, a, b);
  return out;
}

/// Points of the captures within `gate` of the ball as the state sees it: no thinning, none left out.
Network all_points(const CalibrationRequest& job, const Network& like, const NetworkState& s, double radius, double gate) {
  Network n = like;
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    n.views[k].observations.clear();
    for (const Vec3& p : job.captures[k].points_mm)
      if (std::abs((n.views[k].T_base_flange.point(s.T_mount_sensor.point(p)) - s.T_place_target.p_mm).norm() - radius) < gate) n.views[k].observations.push_back({Vec3::Zero(), p, 0});
  }
  return n;
}

void balls(const char* set, const CalibrationRequest& job, const Calibrated& c, double radius) {
  const auto json = nlohmann::json::parse(sets::whole(sets::kData / set / "expected.json"));
  const auto state_of = [&](const nlohmann::json& X, const nlohmann::json& center) {
    NetworkState s = c.solution.state;
    Mat3 R;
    for (int i = 0; i < 3; ++i) {
      for (int k = 0; k < 3; ++k) R(i, k) = X[i][k];
      s.T_mount_sensor.p_mm[i] = X[i][3], s.T_place_target.p_mm[i] = center[i];
    }
    s.T_mount_sensor.q = Eigen::Quaterniond(R).normalized();
    return s;
  };
  const NetworkState theirs = state_of(json["fixed_R"]["X_flange_sensor"], json["fixed_R"]["sphere_centre_base_mm"]);
  NetworkState plain = c.solution.state;
  Network n = all_points(job, c.network, plain, radius, 1.5);
  for (int round = 0; round < 6; ++round) plain = solve_network(least_squares(1), n, plain).state, n = all_points(job, c.network, plain, radius, 1.5);
  const NetworkSolution ours = solve_network(as_found(c.solution), n, c.solution.state);
  row(set, "mm rms from the ball", text("%.4f; its answer here %.4f", json["fixed_R"]["surface_rms_mm"], fitted(n, theirs).rms()), fitted(n, plain).rms(), fitted(n, ours.state).rms(),
      held_out(as_found(c.solution), n, c.solution.state).rms(), held_out(least_squares(1), n, plain).rms(), c.held_out_expected);
}

/// Poses: mean distance of places.
void poses(const char* name, const std::string& published, const Calibrated& c, double turn_weight_mm, bool is_median = false) {
  const NetworkSolution plain = solve_network(least_squares(turn_weight_mm), c.network, c.solution.state);
  const auto shown = [&](const Numbers& n) { return is_median ? n.quantile(0.5) : n.mean(); };
  const Numbers f = fitted(c.network, plain.state), m = fitted(c.network, c.solution.state);
  row(name, is_median ? "mm median of places" : "mm mean of places", published, shown(f), shown(m), shown(held_out(as_found(c.solution), c.network, c.solution.state)),
      shown(held_out(least_squares(turn_weight_mm), c.network, plain.state)), 0);
  std::printf("%-34s   largest %.3f mm, 95 %% %.3f mm, rms %.4f mm, turn %.4f deg by least squares; robot's sd %.3f mm, %.4f deg as found\n", "", f.quantile(1), f.quantile(0.95), f.rms(), f.turn_deg, c.solution.robot_sd_mm,
              deg_from_rad(c.solution.robot_sd_rad));
}

void pixels(const char* name, const std::string& published, const Calibrated& c, const Network& n, const NetworkState& start) {
  const NetworkSolution plain = solve_network(least_squares(1), n, start), ours = solve_network(as_found(c.solution), n, start);
  row(name, "px rms", published, fitted(n, plain.state).rms(), fitted(n, ours.state).rms(), held_out(as_found(c.solution), n, start).rms(), held_out(least_squares(1), n, plain.state).rms(), c.held_out_expected);
}

}  // namespace

int main(int argc, char** argv) {
  const std::filesystem::path folder = argc > 1 ? argv[1] : "sets";
  const std::string only = argc > 2 ? argv[2] : "";
  std::printf("%-34s %-30s %-34s %9s %9s %9s %9s %9s\n", "set", "metric", "published", "squares", "modelled", "held out", "h.o. sq.", "expected");
  for (const std::string& set : sets::kSets) {
    if (set.find(only) == std::string::npos) continue;
    if (!sets::write_set(set, folder / set)) {
      std::printf("%-34s not beside the project\n", set.c_str());
      continue;
    }
    const auto job = load_captures(folder / set / "captures.yaml", {false, "2026-11-20"});
    if (!job) {
      std::printf("%-34s %s: %s\n", set.c_str(), job.error().front().where.c_str(), job.error().front().message.c_str());
      continue;
    }
    const auto made = calibrate(job->artefact);
    if (!made) {
      std::printf("%-34s %s: %s\n", set.c_str(), made.error().front().code.c_str(), made.error().front().message.c_str());
      continue;
    }
    const Calibrated& c = made->artefact.solved;
    if (set == "line_laser_sphere80_a") balls(set.c_str(), job->artefact, c, 40);
    if (set == "line_laser_sphere25") balls(set.c_str(), job->artefact, c, 12.7);
    if (set == "tracker_ur10_B" || set == "tracker_ur10_C") poses(set.c_str(), "0.793, closed form 0.798", c, 500);
    if (set == "eth_handeye") poses(set.c_str(), "6.9, 95 % 21.1", c, 500, true);
    if (set == "zivid_eye_to_hand_a") pixels(set.c_str(), "none in px", c, c.network, c.solution.state);
    if (set == "charuco_static_camera") {
      pixels(set.c_str(), "1.064", c, c.network, c.solution.state);
      Network given = c.network;
      NetworkState s = c.solution.state;
      given.sensor_sd.fill(0);
      s.sensor = {0, 0, 1352.02747, 1356.14287, 789.67065, 627.2995, 0, 0, 0, 0, 0};
      pixels("  intrinsics as given", "2.478", c, given, s);
    }
    if (set == "positioner_2axis") {
      poses("positioner_2axis, nominal", "0.420 +- 0.195: rms 0.463", c, 20);
      Network corrected = c.network;
      const auto views = sets::positioner_views();
      for (std::size_t k = 0; k < views.size(); ++k) corrected.views[k].joints = views[k].joints;
      const ArmParameters arm = sets::positioner({.length_sd_mm = 2, .angle_sd_rad = 5e-3});
      correct_arm(corrected, arm);
      NetworkState start = c.solution.state;
      start.arm = Eigen::VectorXd::Zero(arm.sd.size());
      Calibrated with = c;
      with.network = corrected;
      NetworkRecipe found = as_found(c.solution);
      found.belief_count = 3, found.rounds_count = 6;
      with.solution = solve_network(found, corrected, start);
      poses("  its axes corrected (library)", "0.381 +- 0.153: rms 0.4106", with, 20);
    }
    if (set == "ur10_B_arm" || set == "ur10_C_arm") {
      poses((set + ", nominal").c_str(), set == "ur10_B_arm" ? "1.04, 95 % 1.65" : "0.92, 95 % 1.65", c, 500);
      Network corrected = c.network;
      const auto all = sets::ur10_views(sets::kData / (set == "ur10_B_arm" ? "tracker_ur10_B/measurements_joint_configurations.csv" : "tracker_ur10_C/measurements_random_poses.csv"));
      for (std::size_t k = 0; k < corrected.views.size(); ++k) corrected.views[k].joints = all[k * all.size() / 120].joints;
      const ArmParameters arm = dh_parameters({}, sets::ur10());
      correct_arm(corrected, arm);
      Calibrated with = c;
      with.network = corrected;
      NetworkState start = c.solution.state;
      start.arm = Eigen::VectorXd::Zero(arm.sd.size());
      NetworkRecipe found = as_found(c.solution);
      found.robot_sd_mm = 0.2, found.robot_sd_rad = 3e-4, found.belief_count = 3, found.rounds_count = 6;
      with.solution = solve_network(found, corrected, start);
      poses("  its arm identified (library)", "none", with, 500);
    }
  }
  return 0;
}
