// SPDX-License-Identifier: GPL-3.0-or-later
// What a user writes about the cell: robot, controller, tools, sensors, obstacles. Units of the files.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "planner/inputs/fields.hpp"

namespace asbuilt::inputs {

struct OpwText {
  double a1_mm = 0, a2_mm = 0, b_mm = 0, c1_mm = 0, c2_mm = 0, c3_mm = 0, c4_mm = 0;
  std::array<double, 6> offsets_deg{};
  std::array<int, 6> signs{1, 1, 1, 1, 1, 1};
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("a1", s.a1_mm, {.unit = "mm", .min = -1e4, .max = 1e4, .doc = "axis 1 to axis 2, forward"});
    v("a2", s.a2_mm, {.unit = "mm", .min = -1e4, .max = 1e4, .doc = "axis 3 to axis 4, across the forearm"});
    v("b", s.b_mm, {.unit = "mm", .min = -1e4, .max = 1e4, .doc = "sideways offset of the arm"});
    v("c1", s.c1_mm, {.unit = "mm", .min = -1e4, .max = 1e4, .doc = "base to axis 2, upward"});
    v("c2", s.c2_mm, {.unit = "mm", .min = 1, .max = 1e4, .doc = "axis 2 to axis 3"});
    v("c3", s.c3_mm, {.unit = "mm", .min = 1, .max = 1e4, .doc = "axis 3 to the wrist centre, along the forearm"});
    v("c4", s.c4_mm, {.unit = "mm", .min = -1e4, .max = 1e4, .doc = "wrist centre to flange"});
    v("offsets", s.offsets_deg, {.unit = "degree", .min = -360, .max = 360, .doc = "theta_i = signs_i * joint_i - offsets_i"});
    v("signs", s.signs, {.min = -1, .max = 1, .doc = "1 or -1 for each joint"});
  }
};
struct KinematicsText {
  std::optional<OpwText> opw;
  std::optional<std::string> urdf, base, tip;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("opw", s.opw,
      {.is_optional = true, .doc = "constants of an arm with a spherical wrist; at theta = 0 it stands upright (Brandstoetter)"});
    v("urdf", s.urdf, {.is_optional = true, .form = Form::file, .doc = "URDF file; its metres become mm"});
    v("base", s.base, {.is_optional = true, .doc = "link that is the frame base; required with urdf"});
    v("tip", s.tip, {.is_optional = true, .doc = "link that is the frame flange; required with urdf"});
    v.exactly_one({"opw", "urdf"});
    v.together("urdf", {"base", "tip"});
  }
};
struct JointText {
  double min_deg = 0, max_deg = 0, speed_deg_s = 0, acceleration_deg_s2 = 0, jerk_deg_s3 = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("min", s.min_deg, {.unit = "degree", .min = -3600, .max = 3600, .doc = "lower limit"});
    v("max", s.max_deg, {.unit = "degree", .min = -3600, .max = 3600, .doc = "upper limit"});
    v("speed", s.speed_deg_s, {.unit = "degree/s", .min = 0.1, .max = 5000, .doc = "greatest speed"});
    v("acceleration", s.acceleration_deg_s2, {.unit = "degree/s2", .min = 1, .max = 1e6, .doc = "greatest acceleration"});
    v("jerk", s.jerk_deg_s3, {.unit = "degree/s3", .min = 1, .max = 1e9, .doc = "greatest jerk"});
  }
};
struct LinkText {
  std::string mesh;
  int joint = 0;
  std::optional<LengthUnit> units;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("mesh", s.mesh, {.form = Form::file, .doc = "the link's shape, drawn in base with every joint at 0"});
    v("joint", s.joint, {.min = 0, .max = 6, .doc = "0: the base; k: moves with joint k"});
    v("units", s.units, {.is_optional = true, .doc = "unit of the mesh; mm where absent"});
  }
};
struct HomeText {
  std::array<double, 6> joints_deg{};
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("joints", s.joints_deg, {.unit = "degree", .min = -3600, .max = 3600, .doc = "where every program starts and ends"});
  }
};
struct MeanSdText {
  double mean_mm = 0, sd_mm = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("mean", s.mean_mm, {.unit = "mm", .min = 0, .max = 50, .doc = "mean length of the offset"});
    v("sd", s.sd_mm, {.unit = "mm", .min = 0, .max = 50, .doc = "its standard deviation"});
  }
};
struct AccuracyText {
  MeanSdText absolute, repeatability;
  std::optional<MeanSdText> short_term;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("absolute", s.absolute, {.doc = "commanded against real position"});
    v("repeatability", s.repeatability, {.doc = "the same command over days"});
    v("short_term", s.short_term, {.is_optional = true, .doc = "between the motions of one batch; as repeatability where absent"});
  }
};
struct RobotText {
  std::string model;
  KinematicsText kinematics;
  std::vector<JointText> joints;
  std::vector<LinkText> links;
  HomeText home;
  AccuracyText accuracy;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("model", s.model, {.doc = "name of the robot"});
    v("kinematics", s.kinematics, {.doc = "opw constants, or a URDF"});
    v("joints", s.joints, {.count_min = 6, .doc = "limits of the six joints, from the base outwards"});
    v("links", s.links,
      {.is_optional = true, .doc = "one shape for the base and one for each moving link; with a URDF its own where absent"});
    v("home", s.home, {.doc = "a posture clear of everything"});
    v("accuracy", s.accuracy, {.doc = "lengths of the tool point's offset"});
  }
};
struct KrlText {
  std::map<std::string, std::string> rest;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v.rest(s.rest, "further values of the dialect, as text");
  }
};
struct InformText {
  std::optional<std::array<double, 6>> pulses_per_degree;
  std::optional<SpeedUnit> speed_unit;
  std::map<std::string, std::string> rest;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("pulses_per_degree", s.pulses_per_degree,
      {.min = -1e6, .max = 1e6, .is_optional = true, .doc = "of the six joints; needed by this dialect"});
    v("speed_unit", s.speed_unit, {.is_optional = true, .doc = "what `V=` counts in; needed by this dialect"});
    v.rest(s.rest, "further values of the dialect, as text");
  }
};
struct BeckhoffText {
  std::optional<BeckhoffOrientation> orientation;
  std::optional<int> kinematic_id;
  std::map<std::string, std::string> rest;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("orientation", s.orientation, {.is_optional = true, .doc = "P-CHAN-00112: cba 2, ypr 0, euler 1; needed by this dialect"});
    v("kinematic_id", s.kinematic_id,
      {.min = 0, .max = 100000, .is_optional = true, .doc = "number of the kinematic transformation; needed by this dialect"});
    v.rest(s.rest, "further values of the dialect, as text");
  }
};
struct FurtherDialectText {  // a dialect of which every value is kept as text
  std::map<std::string, std::string> rest;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v.rest(s.rest, "values of the dialect, as text");
  }
};
struct ControllerText {
  Language language = Language::krl;
  std::optional<KrlText> krl;
  std::optional<InformText> inform;
  std::optional<BeckhoffText> beckhoff;
  std::optional<FurtherDialectText> nci, ur;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("language", s.language, {.doc = "the controller's language; --post asks for others"});
    v("krl", s.krl, {.is_optional = true, .doc = "what KRL must not guess"});
    v("inform", s.inform, {.is_optional = true, .doc = "what INFORM must not guess"});
    v("beckhoff", s.beckhoff, {.is_optional = true, .doc = "what Beckhoff CNC must not guess"});
    v("nci", s.nci, {.is_optional = true, .doc = "what Beckhoff NC I must not guess"});
    v("ur", s.ur, {.is_optional = true, .doc = "what UR script must not guess"});
  }
};
struct CutterText {
  CutterShape shape = CutterShape::cone;
  double included_angle_deg = 90, tip_diameter_mm = 0, diameter_mm = 0, length_mm = 0;
  std::optional<double> shank_diameter_mm;
  int teeth_count = 1;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("shape", s.shape, {.doc = "form of the cutting end"});
    v("included_angle", s.included_angle_deg,
      {.unit = "degree", .min = 5, .max = 175, .when_key = "shape", .when_values = "cone", .doc = "full angle of the cone"});
    v("tip_diameter", s.tip_diameter_mm,
      {.unit = "mm",
       .min = 0,
       .max = 200,
       .when_key = "shape",
       .when_values = "cone",
       .doc = "diameter of the flat tip; its centre is the TCP"});
    v("diameter", s.diameter_mm, {.unit = "mm", .min = 0.05, .max = 500, .doc = "greatest diameter"});
    v("length", s.length_mm, {.unit = "mm", .min = 0.1, .max = 1000, .doc = "tip to collet"});
    v("shank_diameter", s.shank_diameter_mm,
      {.unit = "mm", .min = 0.05, .max = 500, .is_optional = true, .doc = "as diameter where absent"});
    v("teeth", s.teeth_count, {.min = 1, .max = 200, .doc = "cutting edges"});
  }
};
struct SpindleText {
  double max_rpm = 0;
  int output = 0, analog = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("max_rpm", s.max_rpm, {.unit = "rpm", .min = 1, .max = 500000, .doc = "speed at full output"});
    v("output", s.output,
      {.min = 0, .max = 100000, .is_optional = true, .doc = "digital output that switches it on; needed by KRL and INFORM"});
    v("analog", s.analog, {.min = 0, .max = 100000, .is_optional = true, .doc = "analogue output of its speed; needed by KRL and INFORM"});
  }
};
struct ToolText {
  std::string id;
  int number = 0;
  PoseText flange_tool;
  CutterText cutter;
  std::optional<std::string> mesh;
  std::optional<LengthUnit> units;
  SpindleText spindle;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the tool"});
    v("number", s.number, {.min = 0, .max = 1000, .doc = "the controller's number of it"});
    v("flange_tool", s.flange_tool, {.doc = "nominal pose of tool in flange; a calibration replaces it"});
    v("cutter", s.cutter, {.doc = "the turning body that cuts"});
    v("mesh", s.mesh, {.is_optional = true, .form = Form::file, .doc = "spindle and holder, drawn in flange, without the cutter"});
    v("units", s.units, {.is_optional = true, .doc = "unit of the mesh; mm where absent"});
    v("spindle", s.spindle, {.doc = "how it is switched"});
  }
};
struct SensorText {
  std::string id;
  SensorKind kind = SensorKind::snapshot;
  PoseText flange_sensor;
  std::array<double, 2> range_mm{}, field_of_view_mm{};
  std::optional<double> working_distance_mm, incidence_deg;
  std::optional<std::array<double, 2>> pixels_count;
  std::optional<Vec3> second_ray_mm;
  double noise_mm = 0;
  std::optional<std::string> mesh;
  std::optional<LengthUnit> units;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the sensor and of its frame"});
    v("kind", s.kind, {.doc = "what it gives"});
    v("flange_sensor", s.flange_sensor, {.doc = "nominal pose of the sensor in flange; a calibration replaces it"});
    v("range", s.range_mm, {.unit = "mm", .min = 0, .max = 1e5, .doc = "nearest and farthest distance along z"});
    v("working_distance", s.working_distance_mm,
      {.unit = "mm", .min = 0, .max = 1e5, .is_optional = true, .doc = "the middle of range where absent"});
    v("field_of_view", s.field_of_view_mm, {.unit = "mm", .min = 0, .max = 1e5, .doc = "width and height at the working distance"});
    v("noise", s.noise_mm, {.unit = "mm", .min = 1e-5, .max = 100, .doc = "standard deviation along the ray at the working distance"});
    v("pixels", s.pixels_count,
      {.min = 2, .max = 1e5, .is_optional = true, .doc = "points across the width and the height; what `asbuilt inspect` counts on"});
    v("second_ray", s.second_ray_mm,
      {.unit = "mm", .min = -1e4, .max = 1e4, .is_optional = true, .doc = "the projector or second camera in the sensor's frame: what only one of the two sees gives no point"});
    v("incidence", s.incidence_deg,
      {.unit = "degree", .min = 10, .max = 89, .is_optional = true, .doc = "greatest angle of a ray to the surface's normal that still gives points"});
    v("mesh", s.mesh, {.is_optional = true, .form = Form::file, .doc = "the sensor's shape, drawn in flange"});
    v("units", s.units, {.is_optional = true, .doc = "unit of the mesh; mm where absent"});
  }
};
struct ObstacleText {
  std::optional<std::string> name;
  std::string mesh;
  std::optional<LengthUnit> units;
  PoseText base_obstacle;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("name", s.name, {.is_optional = true, .doc = "name for reports; the mesh's file name where absent"});
    v("mesh", s.mesh, {.form = Form::file, .doc = "shape of the obstacle"});
    v("units", s.units, {.is_optional = true, .doc = "unit of the mesh; mm where absent"});
    v("base_obstacle", s.base_obstacle, {.doc = "pose of the mesh's frame in base"});
  }
};
struct CellFile {
  static constexpr std::string_view kind = "cell";
  static constexpr std::string_view title = "The robot, its controller, tools and sensors, and what stands around.";
  std::string id;
  RobotText robot;
  ControllerText controller;
  std::vector<ToolText> tools;
  std::vector<SensorText> sensors;
  std::vector<ObstacleText> obstacles;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.is_optional = true, .form = Form::id, .doc = "name of the cell"});
    v("robot", s.robot, {.doc = "the arm"});
    v("controller", s.controller, {.doc = "what the programs are written for"});
    v("tools", s.tools, {.count_min = 1, .doc = "what the flange can carry"});
    v("sensors", s.sensors, {.count_min = 1, .doc = "what measures"});
    v("obstacles", s.obstacles, {.is_optional = true, .doc = "what stands around"});
  }
};

}  // namespace asbuilt::inputs
