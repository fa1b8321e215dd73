// SPDX-License-Identifier: GPL-3.0-or-later
// A laser profilometer on a robot that passes over a plate with conical holes: where the holes appear in its profiles, or the raw
// profiles themselves with the device's noise. Written apart from the calibration: projects into the camera instead of back from it.
// Frames: base, flange, sensor (x along the line, z away from the sensor, y = 0 the light), target (the plate). mm, rad, s.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "planner/artefacts/profiles.hpp"
#include "planner/base/random.hpp"

namespace asbuilt::simulate {

/// The two plates of the published set-up: 437 holes of 2.5 mm at 4 mm (120 degrees), 143 holes of 8 mm at 15 mm (90 degrees).
HolePlate plate_437();
HolePlate plate_143();

/// The device as it is. Distances as in the published model: the light's plane meets the optical axis baseline / tan(triangulation) away.
struct ProfilometerDevice {
  double focal_mm = 8, pixel_u_mm = 0.0053, pixel_v_mm = 0.0053, center_u_px = 639.5, center_v_px = 511.5;
  int width_px = 1280, height_px = 1024;
  double k1 = -0.12, k2 = 0.05, p1 = 1e-3, p2 = -5e-4;
  bool is_lens_forward = false;  // the lens numbers take ideal to measured points, or (false) measured to ideal
  double baseline_mm = 69.946, triangulation_rad = 0.4363323129985824, theta_rad = 0;
  double noise_px = 0.1, correlation_px = 0.85, blur_px = 2, outlier_ratio = 0.01, missing_ratio = 0.02;
  // a device that converts by itself: delivers (x, z) in mm, with these errors of its own conversion
  bool is_metric = false;
  double scale_x_ratio = 1, scale_z_ratio = 1, form_mm = 0;
};

/// One pass as it was programmed.
struct ProfilometerPass {
  std::string name;
  int pose = 0;  // passes of one number share the robot's error
  bool is_held_out = false;
  Pose<frame::Base, frame::Flange> T_base_flange;  // at the first profile, as commanded
  Vec3 velocity_base_mm_s = Vec3::Zero();
  double duration_s = 0, profiles_per_s = 200;
};

struct ProfilometerCell {
  HolePlate plate;
  ProfilometerDevice device;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;
  Pose<frame::Base, frame::Target> T_base_target;
  double latency_s = 0;                                // the profile of time t was taken where the robot is commanded at t + latency
  double robot_sd_mm = 0.06, robot_sd_rad = 1.75e-4;   // per pose
  double repeat_sd_mm = 0.01, repeat_sd_rad = 2e-5;    // per pass
  double path_sd_mm = 0;                               // per hole (or per profile, smoothed) along the way
  double hole_sd_mm = 0.008;                           // of a hole's centre as found, along the plate; across: half of it
  double plate_scale_ratio = 1;                        // the real plate against its file
  int moved_from = -1;                                 // from this pass on the sensor sits elsewhere by
  Vec6 moved_by = Vec6::Zero();                        //   this twist (sensor frame, t then r)
  int wrong_pose = -1;                                 // this pose's commanded place is off by
  Vec6 wrong_by = Vec6::Zero();                        //   this twist (flange frame)
};

/// How the sensor stands over the middle of the plate, half way through a pass.
struct ProfilometerStand {
  double offset_mm = 0;            // of the plate along the sensor's z, from where optical axis and light meet
  double tilt_x_rad = 0, tilt_y_rad = 0, roll_rad = 0;
  bool is_backward = false;
};
/// The published 15: three distances (-60, 0, 60), level and tilted by `tilt_rad` either way about both axes.
std::vector<ProfilometerStand> published_stands(double tilt_rad, bool with_roll, bool both_directions);

/// A pass of `length_mm` across the plate, at right angles to the line of light.
ProfilometerPass pass_of(const ProfilometerCell& cell, const ProfilometerStand& stand, int pose, double length_mm, double speed_mm_s);

struct SeenHole {
  int column = 0, row = 0;
  Vec2 uv = Vec2::Zero();
  double t_s = 0;
};
/// Errors of the robot for all passes: one draw per pose and one per pass, flange frame, t then r.
std::vector<Vec6> robot_errors(const ProfilometerCell& cell, const std::vector<ProfilometerPass>& passes, Random& random);

/// Where the holes appear, with noise of their centres. Those outside the image are not seen.
std::vector<SeenHole> seen_holes(const ProfilometerCell& cell, const ProfilometerPass& pass, int index, const Vec6& error, Random& random);

/// The raw pass.
ProfileScan scanned(const ProfilometerCell& cell, const ProfilometerPass& pass, int index, const Vec6& error, Random& random);

/// Pixel (or the device's own x, z) of a point of the plane of light, without noise; false outside the image.
bool project(const ProfilometerDevice& device, const Vec2& xz_sensor, Vec2& uv);

}  // namespace asbuilt::simulate
