// SPDX-License-Identifier: GPL-3.0-or-later
// What `asbuilt calibrate` reads: captures of a known target, for one sensor or one tool. Units of the files.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/inputs/fields.hpp"
#include "planner/inputs/files_batch.hpp"

namespace asbuilt::inputs {

template <>
struct Words<TargetKind> {
  static constexpr WordList<TargetKind, 10> list{{{"balls", TargetKind::balls},
                                                  {"ball", TargetKind::ball},
                                                  {"checkerboard", TargetKind::checkerboard},
                                                  {"charuco", TargetKind::charuco},
                                                  {"circle_grid", TargetKind::circle_grid},
                                                  {"hole_plate", TargetKind::hole_plate},
                                                  {"plane", TargetKind::plane},
                                                  {"corner", TargetKind::corner},
                                                  {"tip", TargetKind::tip},
                                                  {"pose", TargetKind::pose}}};
};
enum class Mount { flange, base };
template <>
struct Words<Mount> {
  static constexpr WordList<Mount, 2> list{{{"flange", Mount::flange}, {"base", Mount::base}}};
};

struct TargetText {
  TargetKind kind = TargetKind::balls;
  double diameter_mm = 0, pitch_mm = 0, marker_mm = 0;
  int columns_count = 0, rows_count = 0, dictionary = 10;
  std::vector<Vec3> centers_mm;
  double large_diameter_mm = 0, cone_deg = 0, hole_sd_mm = 0.002;
  std::array<int, 2> origin{}, along_x{}, along_y{};
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("kind", s.kind, {.doc = "what was looked at; tip: the tool's tip on one fixed point; pose: whatever gives whole poses, a tracker for instance"});
    v("diameter", s.diameter_mm,
      {.unit = "mm",
       .min = 0.1,
       .max = 1000,
       .when_key = "kind",
       .when_values = "balls|ball|circle_grid|hole_plate",
       .doc = "of a ball, a circle or a hole"});
    v("pitch", s.pitch_mm,
      {.unit = "mm",
       .min = 0.1,
       .max = 1000,
       .when_key = "kind",
       .when_values = "checkerboard|charuco|circle_grid|hole_plate",
       .doc = "from one to the next"});
    v("columns", s.columns_count,
      {.min = 2,
       .max = 1000,
       .when_key = "kind",
       .when_values = "checkerboard|charuco|circle_grid|hole_plate",
       .doc = "inner corners, circles or holes along x"});
    v("rows", s.rows_count,
      {.min = 2, .max = 1000, .when_key = "kind", .when_values = "checkerboard|charuco|circle_grid|hole_plate", .doc = "and along y"});
    v("centers", s.centers_mm,
      {.unit = "mm",
       .min = -1e5,
       .max = 1e5,
       .when_key = "kind",
       .when_values = "balls",
       .count_min = 3,
       .doc = "centres of the balls in the target's own frame"});
    v("marker", s.marker_mm, {.unit = "mm", .min = 0.1, .max = 1000, .when_key = "kind", .when_values = "charuco", .doc = "side of a marker"});
    v("large_diameter", s.large_diameter_mm, {.unit = "mm", .min = 0.1, .max = 1000, .when_key = "kind", .when_values = "hole_plate", .doc = "of the rim of the three large holes"});
    v("cone", s.cone_deg, {.unit = "degree", .min = 10, .max = 170, .when_key = "kind", .when_values = "hole_plate", .doc = "full angle of the holes' cones"});
    v("origin", s.origin, {.min = 0, .max = 1000, .when_key = "kind", .when_values = "hole_plate", .doc = "column and row (from 0) of the large hole that is the origin"});
    v("along_x", s.along_x, {.min = 0, .max = 1000, .when_key = "kind", .when_values = "hole_plate", .doc = "of the large hole in the direction of x"});
    v("along_y", s.along_y, {.min = 0, .max = 1000, .when_key = "kind", .when_values = "hole_plate", .doc = "of the large hole on the side of y"});
    v("hole_sd", s.hole_sd_mm, {.unit = "mm", .min = 0, .max = 1, .is_optional = true, .doc = "hole_plate: standard deviation of one hole's place, as made"});
    v("dictionary", s.dictionary, {.min = 0, .max = 20, .is_optional = true, .doc = "of the markers, OpenCV's number; 10: 6x6, 250 of them"});
  }
};
/// Data sheet of a line scanner that delivers pixels.
struct SheetText {
  double focal_mm = 0, pixel_mm = 0, baseline_mm = 0, triangulation_deg = 0;
  int width_px = 0, height_px = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("focal", s.focal_mm, {.unit = "mm", .min = 0.5, .max = 1000, .doc = "focal length of the lens"});
    v("pixel", s.pixel_mm, {.unit = "mm", .min = 1e-4, .max = 1, .doc = "edge of a pixel"});
    v("width", s.width_px, {.unit = "px", .min = 16, .max = 100000, .doc = "along the line of light"});
    v("height", s.height_px, {.unit = "px", .min = 16, .max = 100000, .doc = "across it"});
    v("baseline", s.baseline_mm, {.unit = "mm", .min = 1, .max = 10000, .doc = "from the camera to the source of light"});
    v("triangulation", s.triangulation_deg, {.unit = "degree", .min = 1, .max = 89, .doc = "between the optical axis and the plane of light"});
  }
};
struct LatencyText {
  double value_s = 0, sd_s = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("value", s.value_s, {.unit = "s", .min = -1, .max = 1, .doc = "a profile belongs to where the robot is this much later"});
    v("sd", s.sd_s, {.unit = "s", .min = 1e-7, .max = 1, .doc = "its standard deviation"});
  }
};
struct TargetCaptureText {
  std::optional<std::string> name;
  std::optional<PoseText> base_flange;
  std::optional<std::string> cloud, image, profiles, points, robot_log;
  std::optional<Vec3> velocity_mm_s;
  std::optional<PoseText> sensor_target;
  bool is_held_out = false;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("name", s.name, {.is_optional = true, .doc = "for reports; the file's name where absent"});
    v("base_flange", s.base_flange, {.is_optional = true, .allows_joints = true, .doc = "flange in base as commanded, or the joints; required but for a pass with robot_log"});
    v("cloud", s.cloud, {.is_optional = true, .form = Form::file, .doc = "PLY, PCD or XYZ, in the sensor's frame, mm; target hole_plate: y is the way gone since base_flange"});
    v("image", s.image, {.is_optional = true, .form = Form::file, .doc = "of a camera"});
    v("profiles", s.profiles, {.is_optional = true, .form = Form::file, .doc = "CSV of a line scanner standing still: x, z or x, y, z in the sensor's frame, mm; target hole_plate: of a pass, t and u, v or x, z"});
    v("robot_log", s.robot_log, {.is_optional = true, .form = Form::file, .doc = "target hole_plate: where the flange was during the pass, by the profiles' clock"});
    v("velocity", s.velocity_mm_s, {.unit = "mm/s", .min = -5000, .max = 5000, .is_optional = true, .is_direction = true, .doc = "or the flange's even velocity in base; base_flange is where it was at the first profile"});
    v("points", s.points, {.is_optional = true, .form = Form::file, .doc = "CSV of a board's points in the image, found by other software: id, u, v"});
    v("sensor_target", s.sensor_target, {.is_optional = true, .doc = "target: pose; where the sensor sees the target"});
    v("held_out", s.is_held_out, {.is_optional = true, .doc = "not used by the solver; what the accuracy is measured with"});
  }
};
struct PoseTableText {
  std::string file;
  std::optional<std::string> name, cloud, image, profiles, points;
  std::optional<LengthUnit> units, sensor_units;
  std::vector<std::string> xyz, quat, zyx, rpy, joints, sensor_xyz, sensor_quat, sensor_zyx, sensor_rpy, sensor_xyz_turns;
  int every = 1;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("file", s.file, {.form = Form::file, .doc = "one capture a row; columns by header, or by number from 1"});
    v("name", s.name, {.is_optional = true, .doc = "column whose text stands for {} in the names below; the row's number from 1 where absent"});
    v("units", s.units, {.is_optional = true, .doc = "of xyz; mm where absent"});
    v("xyz", s.xyz, {.is_optional = true, .doc = "three columns: flange in base"});
    v("quat", s.quat, {.is_optional = true, .doc = "four columns: w, x, y, z"});
    v("zyx", s.zyx, {.is_optional = true, .doc = "or three, degree: KUKA A, B, C"});
    v("rpy", s.rpy, {.is_optional = true, .doc = "or three, degree: Yaskawa Rx, Ry, Rz; FANUC W, P, R"});
    v("joints", s.joints, {.is_optional = true, .doc = "or six, degree, in place of all these"});
    v("sensor_units", s.sensor_units, {.is_optional = true, .doc = "of sensor_xyz; mm where absent"});
    v("sensor_xyz", s.sensor_xyz, {.is_optional = true, .doc = "target: pose; three columns: target in sensor"});
    v("sensor_quat", s.sensor_quat, {.is_optional = true, .doc = "four columns: w, x, y, z"});
    v("sensor_zyx", s.sensor_zyx, {.is_optional = true, .doc = "or three, degree: Rz Ry Rx of the first, second, third"});
    v("sensor_rpy", s.sensor_rpy, {.is_optional = true, .doc = "or three, degree: Rz(third) Ry(second) Rx(first)"});
    v("sensor_xyz_turns", s.sensor_xyz_turns, {.is_optional = true, .doc = "or three, degree: Rx(first) Ry(second) Rz(third), as trackers write them"});
    v("cloud", s.cloud, {.is_optional = true, .doc = "files by name, {} filled in: clouds/{}.ply"});
    v("image", s.image, {.is_optional = true, .doc = "images/{}.png"});
    v("profiles", s.profiles, {.is_optional = true, .doc = "profiles/{}.csv"});
    v("points", s.points, {.is_optional = true, .doc = "one CSV for all, with a column image, or corners/{}.csv"});
    v("every", s.every, {.min = 1, .max = 100000, .is_optional = true, .doc = "take every n-th row"});
  }
};
struct RobotSdText {
  double position_mm = 0, turn_deg = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("position", s.position_mm, {.unit = "mm", .min = 0.001, .max = 20, .doc = "standard deviation of the flange's place, per axis"});
    v("turn", s.turn_deg, {.unit = "degree", .min = 0.0001, .max = 5, .doc = "and of its turn, per axis"});
  }
};
struct CapturesFile {
  static constexpr std::string_view kind = "captures";
  static constexpr std::string_view title = "Captures of a known target, from which `asbuilt calibrate` makes a calibration.";
  std::string cell;
  std::optional<std::string> sensor, tool, robot, taken, previous;
  std::optional<Mount> mount;
  int valid_days = 30;
  TargetText target;
  std::optional<IntrinsicsText> intrinsics;
  bool is_camera_free = false;
  std::optional<double> noise_mm, noise_turn_deg, tool_turn_deg;
  std::optional<RobotSdText> robot_sd, repeat_sd;
  std::optional<SheetText> sheet;
  std::optional<LatencyText> latency;
  std::optional<PoseTableText> poses;
  std::vector<TargetCaptureText> captures;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("cell", s.cell, {.form = Form::file, .doc = "the cell"});
    v("sensor", s.sensor, {.is_optional = true, .form = Form::id, .doc = "the sensor to be calibrated"});
    v("tool", s.tool, {.is_optional = true, .form = Form::id, .doc = "or the tool"});
    v("robot", s.robot, {.is_optional = true, .doc = "or the arm itself, by the cell's name of its model; the captures then give joints"});
    v("mount", s.mount, {.is_optional = true, .doc = "what carries the sensor: flange where absent; base: a fixed sensor, the target is on the flange"});
    v("taken", s.taken, {.is_optional = true, .form = Form::date, .doc = "day of the captures; today where absent"});
    v("valid_days", s.valid_days,
      {.unit = "days", .min = 1, .max = 36500, .is_optional = true, .doc = "how long the calibration shall hold"});
    v("previous", s.previous,
      {.is_optional = true, .form = Form::file, .doc = "the calibration until now: drift is told against it, and what it says of other sensors and tools is carried on"});
    v("target", s.target, {.doc = "what was looked at"});
    v("intrinsics", s.intrinsics, {.is_optional = true, .doc = "of a camera; absent: found from the captures"});
    v("intrinsics_free", s.is_camera_free, {.is_optional = true, .doc = "find them anew although they are given"});
    v("noise", s.noise_mm, {.unit = "mm or px", .min = 1e-5, .max = 100, .is_optional = true, .doc = "standard deviation of one coordinate as measured; the cell's noise where absent, 0.15 px of a camera"});
    v("noise_turn", s.noise_turn_deg, {.unit = "degree", .min = 1e-6, .max = 10, .is_optional = true, .doc = "target: pose; of its turn"});
    v("tool_turn", s.tool_turn_deg, {.unit = "degree", .min = 1e-4, .max = 10, .is_optional = true, .doc = "target: tip; how well the tool's nominal direction is known (a point tells nothing of it); 0.3 where absent"});
    v("robot_sd", s.robot_sd, {.is_optional = true, .doc = "absolute accuracy of the robot's poses; from the cell's accuracy where absent"});
    v("repeat_sd", s.repeat_sd, {.is_optional = true, .doc = "of coming back to one pose; from the cell's repeatability where absent"});
    v("sheet", s.sheet, {.is_optional = true, .doc = "target hole_plate: data sheet of a device that delivers pixels; without it a map without lens is fitted"});
    v("latency", s.latency, {.is_optional = true, .doc = "target hole_plate: of the trigger, where it is known; absent: found from passes both ways"});
    v("poses", s.poses, {.is_optional = true, .doc = "the captures as a table of poses with names of files"});
    v("captures", s.captures, {.is_optional = true, .count_min = 1, .doc = "one after the other as taken"});
    v.exactly_one({"sensor", "tool", "robot"});
  }
};

}  // namespace asbuilt::inputs
