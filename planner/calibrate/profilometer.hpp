// SPDX-License-Identifier: GPL-3.0-or-later
// Calibration of a laser profilometer on the flange from passes over a plate with conical holes: lens, plane of light, hand-eye, place of
// the plate and trigger latency in one solve that models the robot's error. Frames: base, flange, sensor, target. mm, rad, s.
//
// What the published 24 parameters (12 + 6 + 6) hide: a profilometer sees one plane only, so camera, plane and hand-eye act through a
// 4 x 3 projective map of 11 degrees of freedom and the lens. The rest is held by priors and named; quality is quoted as the sd of measured
// points over the field, never as the sd of a parameter.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/profiles.hpp"
#include "planner/base/result.hpp"
#include "planner/geom/profilometer_model.hpp"

namespace asbuilt {

using TargetPose = Pose<frame::Base, frame::Target>;
using FlangePose = Pose<frame::Base, frame::Flange>;
using HandEyePose = Pose<frame::Flange, frame::Sensor>;

/// One hole as one pass saw it: where in the profile, and where the flange was at that moment.
struct HoleSighting {
  int column = 0, row = 0;
  Vec2 uv = Vec2::Zero();
  double profile = 0;                      // which, between whole numbers
  FlangePose T_base_flange;                // as commanded, at that profile's time
  Vec3 velocity_base_mm_s = Vec3::Zero();
  Vec3 sd_target_mm = Vec3::Constant(0.015);  // along the plate twice, across it
};

/// All holes of one pass.
struct HoleView {
  std::string name;
  bool is_held_out = false;
  std::vector<HoleSighting> holes;
};

enum class LatencyChoice { estimate, known };

struct ProfilometerRecipe {
  ProfilometerModel model = ProfilometerModel::camera;
  int degree_count = 4;                // of plane_map's polynomial
  double bend_sd_mm = 0.05;            // of its coefficients
  double robot_sd_mm = 0.06;           // of the flange's position, per axis, from pose to pose
  double robot_sd_rad = 1.75e-4;       // of its orientation
  double repeat_sd_mm = 0.01;          // between two passes at the same pose
  double repeat_sd_rad = 2e-5;
  double path_sd_mm = 0.0;             // of one profile within a pass: jitter of trigger and path
  bool is_metric = false;              // profiles in mm as the device converts them; false: pixels
  LatencyChoice latency = LatencyChoice::estimate;
  double latency_s = 0;                // known: this, with its sd
  double latency_sd_s = 0.02;
  int held_out_every_count = 5;        // where no capture is marked as held out, every n-th pose is
  double field_sd_max_mm = 0.2;        // refused above: median over the field of a point's largest axis
  double plate_scale_max_ratio = 1e-3; // refused above, where the captures tell it
  double moved_chi2_ratio = 7.5;             // fall of chi2 per number (6) at which a sensor that moved between captures is believed
  double pose_chi2_ratio = 10;              // of one pose's robot error per number (6) at which the pose is left out
  int left_out_max_count = 2;          // poses that may be left out
  double held_out_chi2_max_ratio = 6;  // refused above: the mean over the held-out poses
  double prior_share_max_ratio = 0.5;  // a direction that owes more than this to the priors is named
  int restarts_max_count = 8;          // random starts, only when the others did not settle
  double restart_ratio = 0.1;
  std::uint64_t seed = 1;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("robot_sd", s.robot_sd_mm), a("robot_sd_angle", s.robot_sd_rad), a("repeat_sd", s.repeat_sd_mm);
    a("repeat_sd_angle", s.repeat_sd_rad), a("path_sd", s.path_sd_mm), a("latency", s.latency_s), a("latency_sd", s.latency_sd_s);
    a("degree", s.degree_count), a("bend_sd", s.bend_sd_mm), a("held_out_every", s.held_out_every_count);
    a("field_sd_max", s.field_sd_max_mm), a("prior_share_max", s.prior_share_max_ratio), a("restarts_max", s.restarts_max_count);
    a("restart", s.restart_ratio);
  }
};

struct ProfilometerState {
  ProfilometerIntrinsics intrinsics;
  HandEyePose T_flange_sensor;
  TargetPose T_base_target;
  double latency_s = 0;
};

/// A direction of the parameters that the captures alone do not fix: what moves together, and what that leaves open.
struct OpenDirection {
  std::string name;            // "f, dU, dV, cU: ..." largest first
  double prior_share_ratio = 0;  // 1: the prior alone decides
  double field_mm = 0;         // what one sd along it moves a point of the field, at most
};

struct FieldQuality {
  Vec3 median_sd_mm = Vec3::Zero(), max_sd_mm = Vec3::Zero();  // of a measured point, flange frame, 7 x 7 points of the field
  double form_sd_mm = 0;       // of that, what no rigid motion of the sensor explains (median)
};

struct PoseQuality {
  std::string name;
  bool is_held_out = false, is_left_out = false;
  std::size_t hole_count = 0;
  Vec3 rms_target_mm = Vec3::Zero();  // residual along the plate's x, y, z
  double robot_mm = 0, robot_rad = 0; // the robot error that explains it best
  double chi2_ratio = 0;              // of that error over its 6 degrees of freedom
};

struct ProfilometerCalibration {
  ProfilometerState state;
  std::vector<std::string> parameters;  // names, the order of covariance: intrinsics, hand-eye, target (t, r child frames), latency
  Eigen::MatrixXd covariance;           // of them all, to be used as a whole
  Mat6 covariance_field = Mat6::Zero(); // of the rigid part of the field's error, child frame of T_flange_sensor, t then r
  FieldQuality field;
  std::vector<OpenDirection> open;
  Vec3 held_out_rms_mm = Vec3::Zero();  // the accuracy to quote: residual in held-out poses, plate's axes
  Vec3 fit_rms_mm = Vec3::Zero();
  double held_out_chi2_ratio = 0;       // about 1: the stated errors of robot and sensor hold there too
  double robot_scale_ratio = 1;         // how much worse the robot is than stated, 1 where it is not
  double latency_sd_s = 0;
  std::vector<PoseQuality> poses;
  std::size_t hole_count = 0, outlier_count = 0;
  int restart_count = 0;                // 0: the first start was enough
};

/// Calibrates from holes already found.
///
/// Frames    in: holes in pixels or mm of the profile, flange in base as commanded.  out: sensor in flange, target in base.
/// Units     mm, rad, s, pixel.
/// Method    e = Y^-1 F(t + tau) exp(delta) X s(u, v) - a; delta (6 per pose, 6 per pass) marginalised by a square root of the covariance,
///           Ceres with analytic derivatives, Huber weights per hole, poses that no robot error explains left out and named.
///           Start: the sheet's, else linear (profilometer_start.hpp), random ones only when neither settles.
/// Refuses   calibrate.too_few_poses, calibrate.no_held_out, calibrate.unobservable, calibrate.latency_unobservable, calibrate.not_converged,
///           calibrate.field_uncertain, calibrate.sensor_moved, calibrate.plate_scale, calibrate.poses_wrong, calibrate.held_out_off.
/// Notes     calibrate.pose_left_out, calibrate.latency, calibrate.robot_worse_than_stated, calibrate.sensor_scale, calibrate.open_direction.
/// Promises  moving base, the plate's frame or the order of captures changes nothing but the frames (tests/unit/calibrate).
Result<Done<ProfilometerCalibration>> calibrate_profilometer(const ProfilometerRecipe& recipe, const HolePlate& plate, const std::vector<HoleView>& views,
                                                             const std::optional<ProfilometerSheet>& sheet,
                                                             const std::optional<ProfilometerState>& start = {});

/// Calibrates from raw passes: finds and numbers the holes, solves, fits the cones with that solution, solves again.
/// Refuses   as above, and calibrate.holes_not_found, calibrate.holes_off_raster, calibrate.plate_ambiguous, calibrate.plate_mismatch.
Result<Done<ProfilometerCalibration>> calibrate_profilometer(const ProfilometerRecipe& recipe, const HolePlate& plate, const std::vector<ProfileScan>& scans,
                                                             const std::optional<ProfilometerSheet>& sheet);

/// A measured point in the frame of the flange, and its derivative by all parameters (3 x parameters).
Vec3 flange_point(const ProfilometerState& state, const Vec2& uv, Eigen::Matrix<double, 3, Eigen::Dynamic>* J = nullptr);

}  // namespace asbuilt
