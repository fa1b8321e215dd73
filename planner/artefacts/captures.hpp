// SPDX-License-Identifier: GPL-3.0-or-later
// What `asbuilt calibrate` works on: captures of a known target, read and checked, in mm, rad and px, by content.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/profiles.hpp"
#include "planner/base/frames.hpp"
#include "planner/geom/profilometer_model.hpp"

namespace asbuilt {

enum class TargetKind { balls, ball, checkerboard, charuco, circle_grid, hole_plate, plane, corner, tip, pose };

struct TargetSpec {
  TargetKind kind = TargetKind::balls;
  double diameter_mm = 0, pitch_mm = 0, marker_mm = 0;
  int columns_count = 0, rows_count = 0, dictionary = 0;
  std::vector<Vec3> centers_mm;
  std::optional<HolePlate> plate;
};

struct ImagePoint {
  int id = 0;
  Vec2 at_px = Vec2::Zero();
};

struct TargetCapture {
  std::string name;
  Pose<frame::Base, frame::Flange> T_base_flange;  // as commanded
  std::optional<std::array<double, 6>> q_rad;      // where the file gives joints
  bool is_held_out = false;
  std::vector<Vec3> points_mm;                     // cloud or profile, sensor frame
  std::size_t dropped_count = 0;
  std::string image;                               // bytes of the file
  std::vector<ImagePoint> corners;                 // found by other software
  std::optional<Pose<frame::Sensor, frame::Target>> T_sensor_target;
  std::optional<ProfileScan> scan;                 // hole plate: one pass over it
};

/// fx, fy, cx, cy (px), k1, k2, p1, p2, k3.
using CameraConstants = std::array<double, 9>;

/// One view of the target kept in a calibration, so that a later capture from there can be compared.
struct ReferenceView {
  std::string name;
  Pose<frame::Base, frame::Flange> T_base_flange;
  Pose<frame::Sensor, frame::Target> T_sensor_target;  // as measured; of a single ball only the place counts
  Mat6 covariance = Mat6::Zero();                      // of the measurement, in the target's frame
};

/// A calibration of the same sensor or tool made before.
struct EarlierCalibration {
  std::string file, created;
  int valid_days = 0;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;  // of a fixed sensor: base, sensor
  Mat6 covariance = Mat6::Zero();
  std::optional<CameraConstants> camera;
  std::vector<ReferenceView> references;
  double sensor_sd = 0;
  std::optional<ProfileMap> profile_map;
};

struct CalibrationRequest {
  enum class Subject { sensor, tool, robot };
  Subject subject = Subject::sensor;
  std::string id;
  bool is_sensor_fixed = false;  // mounted on base, the target on the flange
  std::string cell_file;         // as the calibration shall name it
  CellSpec cell;
  std::string taken;             // ISO day
  int valid_days = 30;
  TargetSpec target;
  std::optional<CameraConstants> camera;  // as given
  bool is_camera_free = false;            // solve for them
  double sensor_sd = 0;                   // mm, or px of a camera
  double sensor_sd_rad = 0;               // of whole poses
  double robot_sd_mm = 0, robot_sd_rad = 0;              // absolute: of any pose, per axis
  double repeat_sd_mm = 0, repeat_sd_rad = 0;            // of coming back to one pose
  std::optional<Pose<frame::Flange, frame::Sensor>> nominal;  // from the cell, where it knows the sensor or tool
  double tool_turn_sd_rad = 0;            // TargetKind::tip: how well the nominal orientation is known
  bool is_profile_sensor = false;                 // kind profile in the cell
  bool is_profile_metric = false;                 // hole plate: the passes are in mm
  std::optional<ProfilometerSheet> sheet;         // hole plate: of a device that delivers pixels
  std::optional<double> latency_s, latency_sd_s;  // of the trigger, where it is known
  std::vector<TargetCapture> captures;
  std::optional<EarlierCalibration> earlier;  // of this subject
  std::string earlier_others;                 // YAML of what the earlier file holds besides, to be carried on
  std::string earlier_created;                // its day
  std::vector<InputFile> inputs;
};

}  // namespace asbuilt
