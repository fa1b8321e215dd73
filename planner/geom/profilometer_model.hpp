// SPDX-License-Identifier: GPL-3.0-or-later
// The map of a laser profilometer from a profile's (u, v) to the plane of its light: frame `sensor`, x along the line, z away from the
// sensor, y = 0. Two models behind one interface.
//   camera     the published one: lens and camera (f, dU, dV, cU, cV, k1, k2, p1, p2) and the plane of light (L, alpha, theta), re-derived:
//              camera frame: Z the optical axis, X along u, Y along v. The light's source lies L from the camera along Y, its plane meets
//              the optical axis at depth L / tan(alpha):  R_camera_sensor = Rz(theta) Rx(alpha),  t = (0, 0, L / tan(alpha)).
//   plane_map  a plane projectivity (5 numbers; the other 3 are the hand-eye's) and a polynomial of what the lens adds. Nothing in it is
//              unobservable by construction; needs no data sheet. For devices that deliver mm and for unknown cameras.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

enum class ProfilometerModel { camera, plane_map };

struct ProfilometerIntrinsics {
  ProfilometerModel model = ProfilometerModel::camera;
  Eigen::VectorXd values;  // in the order of profilometer_parameters
  // plane_map: where u' = (u - center) / half is counted from; fixed numbers, no parameters
  Vec2 uv_center = Vec2::Zero();
  double uv_half = 1;
  int degree_count = 4;    // of the polynomial
};

/// One number of a model: how it is called, in which unit, how well it is known before any capture (1 sd; infinite: not at all), and the
/// size that a disturbance of it has.
struct ModelParameter {
  std::string name, unit;
  double prior = 0, prior_sd = 0, size = 1;
};

/// Data sheet of a camera profilometer. sd: how far the device may be from it.
struct ProfilometerSheet {
  double focal_mm = 0, pixel_mm = 0;
  int width_px = 0, height_px = 0;
  double baseline_mm = 0, triangulation_rad = 0;
  double focal_sd_ratio = 0.02, center_sd_px = 15, radial_sd = 0.5, tangential_sd = 0.2, baseline_sd_ratio = 0.1, triangulation_sd_rad = 0.1,
         theta_sd_rad = 0.1;
  double pixel_sd_ratio = 1e-6;  // the pixel's size is taken from the sheet: it, the other one and f have one common scale
};

std::vector<ModelParameter> camera_parameters(const ProfilometerSheet& sheet);
/// bend_sd: prior of a polynomial coefficient, mm at the field's edge.
std::vector<ModelParameter> plane_map_parameters(int degree_count, double bend_sd_mm);

ProfilometerIntrinsics camera_of(const ProfilometerSheet& sheet);

using MapJacobian = Eigen::Matrix<double, 2, Eigen::Dynamic>;

/// (x, z) in the plane of light. J (optional) by the model's values.
Vec2 plane_point(const ProfilometerIntrinsics& map, const Vec2& uv, MapJacobian* J = nullptr);

/// The pixel of a point of the plane of light: Newton on plane_point from `start`. False where it does not settle.
bool pixel_of(const ProfilometerIntrinsics& map, const Vec2& xz, const Vec2& start, Vec2& uv);

/// What a calibration says of a device's profiles: a delivered pair (pixels, or mm as the device converts them) to a point of the sensor's
/// plane y = 0. The model's own frame is fixed by its gauge; T_sensor_map takes it to the frame that the calibration calls the sensor.
struct ProfileMap {
  bool is_metric = false;  // pairs are x, z in mm; else u, v in pixels
  ProfilometerIntrinsics map;
  Pose<frame::Sensor, frame::Sensor> T_sensor_map;
  double form_sd_mm = 0;   // of a point, beyond what the covariance of the sensor's pose says
  double latency_s = 0, latency_sd_s = 0;  // profiles belong to where the robot is this much later
};
Vec3 profile_point(const ProfileMap& map, const Vec2& pair);

/// Rz(theta) Rx(alpha): turns coordinates of the sensor into coordinates of the camera.
Mat3 rotation_camera_sensor(double alpha_rad, double theta_rad);

}  // namespace asbuilt
