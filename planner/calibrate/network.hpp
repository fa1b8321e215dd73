// SPDX-License-Identifier: GPL-3.0-or-later
// One residual family for every calibration of this room: where the sensor sits on what carries it (mount), where the target
// sits on what carries that (place), the sensor's own constants and the arm's, with the robot's error of every pose.
//
// Sensor on the flange: mount = flange, place = base. Fixed sensor, target on the flange: mount = base, place = flange.
// Twists and covariances: translation mm first, then rotation rad, child frame. Images are in px.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

namespace frame {
struct Mount {};  // carries the sensor
struct Place {};  // carries the target
}  // namespace frame

/// What one observation is.
enum class Sight {
  point,   // a point of the target, measured in the sensor's frame (mm)
  pixel,   // a point of the target in an image (px)
  pose,    // the target's whole pose in the sensor's frame
  sphere,  // a point of the sensor that lies on a ball about the target's origin
  plane    // a point of the sensor that lies on the plane of the target across its axis x, y or z
};

struct Observation {
  Vec3 p_target = Vec3::Zero();  // point, pixel: where on the target
  Vec3 z = Vec3::Zero();         // as measured: mm in the sensor's frame, or u, v in px
  int id = 0;                    // for people: ball 2, corner 17; plane: the axis 0, 1, 2
};

struct NetworkView {
  std::string name;
  Pose<frame::Base, frame::Flange> T_base_flange;  // as commanded
  std::vector<Observation> observations;
  std::optional<Pose<frame::Sensor, frame::Target>> T_sensor_target;  // Sight::pose
  bool is_held_out = false;
  std::vector<double> joints;     // rad, where the arm is corrected
  Eigen::MatrixXd robot_twist;  // 6 x size(eta): twist of the flange per unit of each parameter of the arm; may be empty
};

/// Constants of the sensor: scale - 1 (of its lengths, or of the target's where it is a camera), the ball's radius (mm), fx, fy,
/// cx, cy (px), k1, k2, p1, p2, k3.
enum SensorConstant { kScale, kRadius, kFx, kFy, kCx, kCy, kK1, kK2, kP1, kP2, kK3, kSensorConstants };
const char* name_of(SensorConstant c);

struct NetworkState {
  Pose<frame::Mount, frame::Sensor> T_mount_sensor;
  Pose<frame::Place, frame::Target> T_place_target;
  std::array<double, kSensorConstants> sensor{};
  Eigen::VectorXd arm;         // parameters of the arm, 0 = nominal
  std::vector<Vec6> robot;     // of each view: true flange = commanded.disturbed(robot)
};

struct Network {
  Sight sight = Sight::point;
  bool is_sensor_fixed = false;
  std::vector<NetworkView> views;
  std::array<bool, 6> is_mount_free{true, true, true, true, true, true};
  std::array<bool, 6> is_target_free{true, true, true, true, true, true};
  /// 0: held; infinite: free; else the sd of a prior at the start's value.
  std::array<double, kSensorConstants> sensor_sd{};
  Eigen::VectorXd arm_sd;  // priors of the arm's parameters about 0; empty: the arm is not corrected
  /// Recomputes T_base_flange and robot_twist of the views at new parameters of the arm.
  std::function<void(const Eigen::VectorXd&, std::vector<NetworkView>&)> relinearise;
};

/// Standard deviations as they are believed before the data speak, and how many observations that belief is worth.
struct NetworkRecipe {
  double sensor_sd_mm = 0.01;       // of one coordinate of an observation; px where the sight is a pixel
  double sensor_sd_rad = 1e-4;      // Sight::pose only
  double robot_sd_mm = 0.25;        // of the flange's position, per axis, per pose
  double robot_sd_rad = 5.2e-4;     // of the flange's orientation, per axis, per pose
  double belief_count = 10;         // the given sds count as much as this many observations; large: they stand as given
  double outlier_probability_ratio = 1e-4;  // an observation or a pose less probable than this, among all, is an outlier
  int rounds_count = 12;
  int iterations_max_count = 50;    // of every solve after the robust ones; one that needs more has not settled
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("sensor_sd", s.sensor_sd_mm), a("sensor_sd_angle", s.sensor_sd_rad), a("robot_sd", s.robot_sd_mm), a("robot_sd_angle", s.robot_sd_rad);
    a("belief", s.belief_count), a("outlier_probability", s.outlier_probability_ratio), a("rounds", s.rounds_count), a("iterations_max", s.iterations_max_count);
  }
};

struct NetworkOutlier {
  std::size_t view = 0;
  int observation = -1;  // -1: the pose as a whole
  double size = 0;       // mm, px; of a pose: mm
  double sd_ratio = 0;   // in standard deviations
};

struct NetworkSolution {
  NetworkState state;
  bool is_converged = false;
  double cost = 0;              // half the sum of squared whitened residuals
  int dof = 0;
  // of the free parameters in the order mount (6), target (6), sensor, arm; zero rows where held; widened for sds that are
  // themselves estimated (Student)
  Eigen::MatrixXd covariance;
  Eigen::MatrixXd information;  // the inverse before held parameters were taken out; robot errors marginalised
  std::vector<Eigen::MatrixXd> view_information;  // each view's part of it
  double sensor_sd = 0, sensor_sd_rad = 0, robot_sd_mm = 0, robot_sd_rad = 0;  // belief and data together
  double robot_dof = 0;         // how many observations spoke about the robot
  std::vector<NetworkOutlier> outliers;
  std::vector<char> is_used;                    // per view
  std::vector<std::vector<char>> is_observation_used;

  Mat6 mount_covariance() const { return covariance.topLeftCorner<6, 6>(); }
};

/// Method  Ceres (Schur complement over the robot's errors), Cauchy loss first, then outliers named and left out and plain least
///         squares with the sds of sensor and robot estimated from redundancy [Foerstner1979]; views marked held out do not enter.
/// Frames  twists in child frames.
NetworkSolution solve_network(const NetworkRecipe& recipe, const Network& network, const NetworkState& start);

/// The residuals of one view without any error of the robot: mm per axis (point, pose: translation), px, or mm from the surface.
Eigen::VectorXd raw_residuals(const Network& network, const NetworkView& view, const NetworkState& state);

/// Where the target is seen from the sensor.
Pose<frame::Sensor, frame::Target> target_in_sensor(const Network& network, const NetworkView& view, const NetworkState& state,
                                                    const Vec6& robot = Vec6::Zero());

/// Information that one view adds about [mount, target, sensor, arm], its own robot error marginalised.
Eigen::MatrixXd information_of_view(const NetworkRecipe& recipe, const Network& network, const NetworkView& view, const NetworkState& state);

/// What one view would be expected to show of a state this uncertain: covariance of its raw residuals.
Eigen::MatrixXd residual_covariance(const NetworkRecipe& sds, const Network& network, const NetworkView& view, const NetworkState& state,
                                    const Eigen::MatrixXd& covariance);

}  // namespace asbuilt
