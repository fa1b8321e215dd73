// SPDX-License-Identifier: GPL-3.0-or-later
// What a user or a program writes around the measuring: calibration, scans, captures; and the batch. Units of the files,
// except covariances, which are in mm and rad as the twist they describe.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "planner/inputs/fields.hpp"
#include "planner/inputs/files_cell.hpp"

namespace asbuilt::inputs {

struct IntrinsicsText {
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  int width_px = 0, height_px = 0;
  std::vector<double> distortion;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("fx", s.fx_px, {.unit = "px", .min = 1, .max = 1e6, .doc = "focal length along x"});
    v("fy", s.fy_px, {.unit = "px", .min = 1, .max = 1e6, .doc = "focal length along y"});
    v("cx", s.cx_px, {.unit = "px", .min = -1e6, .max = 1e6, .doc = "principal point, x"});
    v("cy", s.cy_px, {.unit = "px", .min = -1e6, .max = 1e6, .doc = "principal point, y"});
    v("width", s.width_px, {.unit = "px", .min = 1, .max = 100000, .is_optional = true, .doc = "image width"});
    v("height", s.height_px, {.unit = "px", .min = 1, .max = 100000, .is_optional = true, .doc = "image height"});
    v("distortion", s.distortion, {.is_optional = true, .doc = "k1, k2, p1, p2, k3"});
  }
};
/// What a calibration says of a line scanner's profiles.
struct ProfileMapText {
  bool is_metric = false, is_camera = false;
  std::vector<double> values;
  std::array<double, 2> center{};
  double half = 1;
  int degree_count = 4;
  PoseText sensor_map;
  double form_sd_mm = 0, latency_s = 0, latency_sd_s = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("metric", s.is_metric, {.doc = "profiles are x, z in mm as the device converts them; else u, v in pixels"});
    v("camera", s.is_camera, {.doc = "values are f, dU, dV, cU, cV, k1, k2, p1, p2, L, alpha, theta; else a plane map: two scales, shear, two of keystone, polynomial"});
    v("values", s.values, {.min = -1e9, .max = 1e9, .count_min = 5, .doc = "numbers of the map, in the order of the report"});
    v("center", s.center, {.unit = "px or mm", .min = -1e5, .max = 1e5, .doc = "of a plane map: where u, v are counted from"});
    v("half", s.half, {.unit = "px or mm", .min = 1e-6, .max = 1e5, .doc = "and what they are divided by"});
    v("degree", s.degree_count, {.min = 0, .max = 7, .doc = "of the polynomial"});
    v("sensor_map", s.sensor_map, {.doc = "pose of the map's own frame in the sensor's"});
    v("form_sd", s.form_sd_mm, {.unit = "mm", .min = 0, .max = 100, .is_optional = true, .doc = "of a point, beyond what the pose's covariance says"});
    v("latency", s.latency_s, {.unit = "s", .min = -10, .max = 10, .is_optional = true, .doc = "a profile belongs to where the robot is this much later"});
    v("latency_sd", s.latency_sd_s, {.unit = "s", .min = 0, .max = 10, .is_optional = true, .doc = "its standard deviation"});
  }
};
struct HashedFileText {
  std::string path, sha256;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("path", s.path, {.doc = "as it was named"});
    v("sha256", s.sha256, {.doc = "of its bytes"});
  }
};
struct ReferenceViewText {
  std::string name;
  PoseText base_flange, sensor_target;
  Mat6 covariance = Mat6::Zero();
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("name", s.name, {.doc = "of the capture"});
    v("base_flange", s.base_flange, {.doc = "where the flange was"});
    v("sensor_target", s.sensor_target, {.doc = "where the sensor saw the target"});
    v("covariance", s.covariance, {.unit = "mm, rad", .doc = "6x6 of that, translation first, in the target's frame"});
  }
};
/// How a calibration came about; the same for sensors, fixed sensors and tools.
struct OriginText {
  std::string created;
  std::optional<double> held_out_mm, fit_rms, noise, robot_sd_mm, robot_turn_sd_deg;
  std::optional<int> dof_count;
  std::vector<HashedFileText> files;
  std::vector<ReferenceViewText> references;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("created", s.created, {.form = Form::date, .doc = "day of the captures"});
    v("held_out", s.held_out_mm, {.unit = "mm", .min = 0, .max = 1000, .is_optional = true, .doc = "error of views that the solve had not seen: the accuracy"});
    v("fit_rms", s.fit_rms, {.unit = "mm or px", .min = 0, .max = 1e4, .is_optional = true, .doc = "residual of the views it was made from"});
    v("noise", s.noise, {.unit = "mm or px", .min = 0, .max = 1e4, .is_optional = true, .doc = "standard deviation of the sensor, as found"});
    v("robot_sd", s.robot_sd_mm, {.unit = "mm", .min = 0, .max = 100, .is_optional = true, .doc = "of the robot's poses per axis, as found"});
    v("robot_turn_sd", s.robot_turn_sd_deg, {.unit = "degree", .min = 0, .max = 100, .is_optional = true, .doc = "and of their turns"});
    v("dof", s.dof_count, {.min = 0, .max = 1e9, .is_optional = true, .doc = "observations less unknowns"});
    v("files", s.files, {.is_optional = true, .doc = "what it was made from"});
    v("references", s.references, {.is_optional = true, .doc = "views kept for `asbuilt calibrate --check`"});
  }
};
struct SensorCalibrationText {
  PoseText flange_sensor;
  Mat6 covariance = Mat6::Zero();
  std::optional<double> rms_mm;
  std::optional<int> captures_count;
  std::optional<IntrinsicsText> intrinsics;
  std::optional<ProfileMapText> profile_map;
  std::optional<OriginText> origin;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("flange_sensor", s.flange_sensor, {.doc = "pose of the sensor in flange"});
    v("covariance", s.covariance,
      {.unit = "mm, rad", .doc = "6x6, translation first, in the sensor's frame: true = given * [R(rot), trans]"});
    v("rms", s.rms_mm, {.unit = "mm", .min = 0, .max = 100, .is_optional = true, .doc = "residual of the calibration"});
    v("captures", s.captures_count, {.min = 0, .max = 1e6, .is_optional = true, .doc = "how many captures it was made from"});
    v("intrinsics", s.intrinsics, {.is_optional = true, .doc = "of a camera"});
    v("profile_map", s.profile_map, {.is_optional = true, .doc = "of a line scanner calibrated on a hole plate: applied to its profiles"});
    v("origin", s.origin, {.is_optional = true, .doc = "how it came about"});
  }
};
struct FixedSensorCalibrationText {
  PoseText base_sensor;
  Mat6 covariance = Mat6::Zero();
  std::optional<double> rms_mm;
  std::optional<int> captures_count;
  std::optional<IntrinsicsText> intrinsics;
  std::optional<OriginText> origin;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("base_sensor", s.base_sensor, {.doc = "pose of the sensor in base"});
    v("covariance", s.covariance, {.unit = "mm, rad", .doc = "6x6, translation first, in the sensor's frame"});
    v("rms", s.rms_mm, {.unit = "mm", .min = 0, .max = 100, .is_optional = true, .doc = "residual of the calibration"});
    v("captures", s.captures_count, {.min = 0, .max = 1e6, .is_optional = true, .doc = "how many captures it was made from"});
    v("intrinsics", s.intrinsics, {.is_optional = true, .doc = "of a camera"});
    v("origin", s.origin, {.is_optional = true, .doc = "how it came about"});
  }
};
struct ToolCalibrationText {
  PoseText flange_tool;
  Mat6 covariance = Mat6::Zero();
  std::optional<OriginText> origin;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("flange_tool", s.flange_tool, {.doc = "pose of tool in flange; what the controller holds under the tool's number"});
    v("covariance", s.covariance, {.unit = "mm, rad", .doc = "6x6, translation first, in tool"});
    v("origin", s.origin, {.is_optional = true, .doc = "how it came about"});
  }
};
struct OpwCorrectionText {
  double a1_mm = 0, a2_mm = 0, b_mm = 0, c1_mm = 0, c2_mm = 0, c3_mm = 0, c4_mm = 0;
  std::array<double, 6> offsets_deg{};
  template <class S, class V>
  static void fields(S& s, V& v) {
    for (auto [name, value] : {std::pair{"a1", &s.a1_mm},
                               {"a2", &s.a2_mm},
                               {"b", &s.b_mm},
                               {"c1", &s.c1_mm},
                               {"c2", &s.c2_mm},
                               {"c3", &s.c3_mm},
                               {"c4", &s.c4_mm}})
      v(name, *value, {.unit = "mm", .min = -20, .max = 20, .is_optional = true, .doc = "added to the cell's constant"});
    v("offsets", s.offsets_deg, {.unit = "degree", .min = -5, .max = 5, .is_optional = true, .doc = "added to the cell's offsets"});
  }
};
struct RobotCalibrationText {
  std::optional<OpwCorrectionText> opw;
  std::optional<OriginText> origin;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("opw", s.opw, {.is_optional = true, .doc = "corrections of the arm's constants"});
    v("origin", s.origin, {.is_optional = true, .doc = "how they came about"});
  }
};
struct CalibrationFile {
  static constexpr std::string_view kind = "calibration";
  static constexpr std::string_view title =
      "Where sensors and tools really are on the flange, and how well that is known. Written by `asbuilt calibrate`.";
  std::string cell, created;
  int valid_days = 0;
  std::map<std::string, SensorCalibrationText> sensors;
  std::map<std::string, FixedSensorCalibrationText> fixed_sensors;
  std::map<std::string, ToolCalibrationText> tools;
  std::optional<RobotCalibrationText> robot;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("cell", s.cell, {.form = Form::file, .doc = "the cell it was made for"});
    v("created", s.created, {.form = Form::date, .doc = "day it was made"});
    v("valid_days", s.valid_days, {.unit = "days", .min = 1, .max = 36500, .doc = "how long it holds"});
    v("sensors", s.sensors, {.doc = "by id of the cell's sensor"});
    v("fixed_sensors", s.fixed_sensors, {.is_optional = true, .doc = "sensors that stand in the cell, by name; the planner itself does not use them"});
    v("tools", s.tools, {.is_optional = true, .doc = "by id of the cell's tool"});
    v("robot", s.robot, {.is_optional = true, .doc = "corrections of the arm"});
  }
};

enum class Clocks { common, separate };
template <>
struct Words<Clocks> {
  static constexpr WordList<Clocks, 2> list{{{"common", Clocks::common}, {"separate", Clocks::separate}}};
};
struct SyncText {
  std::optional<std::string> flash;
  std::optional<Clocks> clocks;
  double offset_s = 0;
  std::optional<double> offset_sd_s;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("flash", s.flash, {.is_optional = true, .doc = "name of the log's channel that shows the flash: FLASH, or Digin.o1 of a packet's tag"});
    v("clocks", s.clocks,
      {.is_optional = true, .doc = "common: both were stamped by one clock; separate: the offset is found from flash and motion. Absent: separate with a flash, else common"});
    v("offset", s.offset_s, {.unit = "s", .min = -1e9, .max = 1e9, .is_optional = true, .doc = "robot's time minus sensor's, with common clocks; 0 where absent"});
    v("offset_sd", s.offset_sd_s, {.unit = "s", .min = 0, .max = 1, .is_optional = true, .doc = "its standard deviation; 0.002 where absent"});
  }
};
struct CaptureText {
  std::string sensor;
  std::optional<std::string> cloud, frames, profiles, intrinsics, robot_log, log_tool, feature;
  std::optional<SyncText> sync;
  std::optional<PoseText> base_flange;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("sensor", s.sensor, {.form = Form::id, .doc = "id of a sensor of the cell"});
    v("cloud", s.cloud, {.is_optional = true, .form = Form::file, .doc = "PLY, PCD or XYZ, in the sensor's frame, mm"});
    v("frames", s.frames, {.is_optional = true, .form = Form::file, .doc = "folder of 16-bit depth images of a moving sensor"});
    v("profiles", s.profiles, {.is_optional = true, .form = Form::file, .doc = "CSV of the profiles of a moving line scanner"});
    v("intrinsics", s.intrinsics, {.is_optional = true, .form = Form::file, .doc = "JSON of the depth camera, or of a line scanner that gives pixels"});
    v("robot_log", s.robot_log, {.is_optional = true, .form = Form::file, .doc = "where the robot was: RSI XML or CSV"});
    v("log_tool", s.log_tool, {.is_optional = true, .form = Form::id, .doc = "tool whose pose the log holds; the flange where absent"});
    v("sync", s.sync, {.is_optional = true, .doc = "how the two clocks are matched"});
    v("base_flange", s.base_flange,
      {.is_optional = true, .allows_joints = true, .doc = "flange in base as commanded, or the joints; required with cloud"});
    v("feature", s.feature, {.is_optional = true, .form = Form::id, .doc = "the feature this capture was taken for"});
    v.exactly_one({"cloud", "frames", "profiles"});
    v.together("cloud", {"base_flange"});
    v.together("frames", {"intrinsics", "robot_log"});
    v.together("profiles", {"robot_log"});
  }
};
struct ScansFile {
  static constexpr std::string_view kind = "scans";
  static constexpr std::string_view title = "What was measured of one item.";
  std::string item;
  std::optional<std::string> taken;
  std::vector<CaptureText> captures;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("item", s.item, {.form = Form::id, .doc = "id of the item"});
    v("taken", s.taken, {.is_optional = true, .form = Form::date, .doc = "day of the scans; today where absent"});
    v("captures", s.captures, {.count_min = 1, .doc = "one after the other as taken"});
  }
};

struct OverrideText {
  std::string edge, name, reason, expires;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("edge", s.edge, {.form = Form::edge, .doc = "id of the edge that may pass the gate"});
    v("name", s.name, {.doc = "who answers for it"});
    v("reason", s.reason, {.doc = "why"});
    v("expires", s.expires, {.form = Form::date, .doc = "last day it holds"});
  }
};
struct ItemText {
  std::string id, part, fixture, scans;
  std::vector<OverrideText> overrides;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the item and of its folder of results"});
    v("part", s.part, {.form = Form::file, .doc = "a part file"});
    v("fixture", s.fixture, {.form = Form::file, .doc = "a fixture file"});
    v("scans", s.scans, {.form = Form::file, .doc = "a scans file"});
    v("overrides", s.overrides, {.is_optional = true, .doc = "edges that a named person lets pass the gate"});
  }
};
struct BatchFile {
  static constexpr std::string_view kind = "batch";
  static constexpr std::string_view title = "One night's work. The folder of this file is the batch's root.";
  std::string id, cell, calibration;
  std::vector<std::string> recipes;
  std::vector<ItemText> items;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the batch"});
    v("cell", s.cell, {.form = Form::file, .doc = "a cell file"});
    v("calibration", s.calibration, {.form = Form::file, .doc = "a calibration file"});
    v("recipes", s.recipes, {.form = Form::file, .count_min = 1, .doc = "recipe files"});
    v("items", s.items, {.count_min = 1, .doc = "the parts to be worked"});
  }
};

}  // namespace asbuilt::inputs
