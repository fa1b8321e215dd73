// SPDX-License-Identifier: GPL-3.0-or-later
// Residuals and exact derivatives of the network's observations. Internal to the room.
//
// Poses change by twists in their child frame, T -> T [R(w), t]. The robot's error e is a twist of the flange from zero:
// T_base_flange_true = T_base_flange [R(e_w), e_t], e = robot + robot_twist * arm.
#pragma once

#include <Eigen/Dense>

#include "planner/calibrate/network.hpp"

namespace asbuilt::network {

constexpr int kBlockMount = 0, kBlockTarget = 1, kBlockRobot = 2, kBlockSensor = 3;
using Jac36 = Eigen::Matrix<double, 3, 6>;

/// d R(w) = R(w) skew(right_jacobian(w) dw).
Mat3 right_jacobian(const Vec3& w);
/// Its inverse for the logarithm: log(R(w) exp(u)) = w + right_jacobian_inverse(w) u.
Mat3 right_jacobian_inverse(const Vec3& w);

/// All that the residuals of one view need.
struct Bench {
  Sight sight;
  bool is_sensor_fixed;
  Mat3 R_x, R_y, R_f, R_e, J_e;  // mount-sensor, place-target, base-flange, robot error and its right jacobian
  Vec3 t_x, t_y, t_f, t_e;
  std::array<double, kSensorConstants> k;

  Bench(const Network& network, const NetworkView& view, const Pose<frame::Mount, frame::Sensor>& X, const Pose<frame::Place, frame::Target>& Y,
        const Vec6& e, const double* sensor);
  /// Base to flange or back, with derivatives by the point (3x3) and by e (3x6).
  Vec3 place_to_mount(const Vec3& b, Mat3& d_point, Jac36& d_robot) const { return is_sensor_fixed ? out_of_flange(b, d_point, d_robot) : into_flange(b, d_point, d_robot); }
  Vec3 mount_to_place(const Vec3& m, Mat3& d_point, Jac36& d_robot) const { return is_sensor_fixed ? into_flange(m, d_point, d_robot) : out_of_flange(m, d_point, d_robot); }

 private:
  Vec3 out_of_flange(const Vec3& p, Mat3& d_point, Jac36& d_robot) const;
  Vec3 into_flange(const Vec3& p, Mat3& d_point, Jac36& d_robot) const;
};

/// Rows of one observation: 3 (point), 2 (pixel), 6 (pose), 1 (sphere, plane).
int rows_of(Sight sight);

struct Derivatives {
  Eigen::Matrix<double, 6, 6> mount, target, robot;  // only the first rows count
  Eigen::Matrix<double, 6, kSensorConstants> sensor;
};
/// Residual of one observation (measured minus predicted, unwhitened) and its derivatives where asked for.
void residual_of(const Bench& bench, const Observation& o, const std::optional<Pose<frame::Sensor, frame::Target>>& T_sensor_target, double* r,
                 Derivatives* d);

}  // namespace asbuilt::network
