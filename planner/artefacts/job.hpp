// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 1's artefact: one item of a batch with everything it needs, read, checked, in mm, rad and s, by content.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/geom/brep.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt {

struct InputFile {
  std::string path;  // relative to the batch's folder
  std::string sha256;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("path", s.path), a("sha256", s.sha256);
  }
};

// ------------------------------------------------------------------ cell
struct JointSpec {
  double min_rad = 0, max_rad = 0, speed_rad_s = 0, acceleration_rad_s2 = 0, jerk_rad_s3 = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("min", s.min_rad), a("max", s.max_rad), a("speed", s.speed_rad_s), a("acceleration", s.acceleration_rad_s2);
    a("jerk", s.jerk_rad_s3);
  }
};
/// theta_i = signs_i * joint_i - offsets_i; at theta = 0 the arm stands upright (Brandstoetter et al. 2014).
struct OpwParameters {
  double a1_mm = 0, a2_mm = 0, b_mm = 0, c1_mm = 0, c2_mm = 0, c3_mm = 0, c4_mm = 0;
  std::array<double, 6> offsets_rad{};
  std::array<int, 6> signs{1, 1, 1, 1, 1, 1};
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("a1", s.a1_mm), a("a2", s.a2_mm), a("b", s.b_mm), a("c1", s.c1_mm), a("c2", s.c2_mm), a("c3", s.c3_mm), a("c4", s.c4_mm);
    a("offsets", s.offsets_rad), a("signs", s.signs);
  }
};
/// A serial chain out of a URDF: T_parent_joint (joint = 0), axis in the joint's frame; fixed joints are folded in.
struct ChainJoint {
  std::string name;
  Pose<frame::Base, frame::Base> T_parent_joint;
  Vec3 axis = Vec3::UnitZ();
  bool is_prismatic = false;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("T_parent_joint", s.T_parent_joint), a("axis", s.axis), a("is_prismatic", s.is_prismatic);
  }
};
struct ChainKinematics {
  std::string urdf, base_link, tip_link;
  std::vector<ChainJoint> joints;                 // six moving joints, base to tip
  Pose<frame::Base, frame::Base> T_last_tip;      // from the last joint's frame to the tip link
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("urdf", s.urdf), a("base_link", s.base_link), a("tip_link", s.tip_link), a("joints", s.joints), a("T_last_tip", s.T_last_tip);
  }
};
struct MeanSd {
  double mean_mm = 0, sd_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("mean", s.mean_mm), a("sd", s.sd_mm);
  }
};
struct RobotAccuracy {  // lengths of the offset vector of the tool point
  MeanSd absolute, repeatability, short_term;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("absolute", s.absolute), a("repeatability", s.repeatability), a("short_term", s.short_term);
  }
};
struct LinkMesh {
  int joint = 0;   // 0: the base, k: moves with joint k
  Mesh mesh;       // drawn in base with every joint at 0
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("joint", s.joint), a("mesh", s.mesh);
  }
};
struct RobotSpec {
  std::string model;
  std::variant<OpwParameters, ChainKinematics> kinematics;
  std::array<JointSpec, 6> joints{};
  std::vector<LinkMesh> links;
  std::array<double, 6> home_rad{};
  RobotAccuracy accuracy;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("model", s.model), a("kinematics", s.kinematics), a("joints", s.joints), a("links", s.links), a("home", s.home_rad);
    a("accuracy", s.accuracy);
  }
};

enum class Language { krl, inform, beckhoff, nci, ur };
inline constexpr Language kLanguages[] = {Language::krl, Language::inform, Language::beckhoff, Language::nci, Language::ur};
inline std::string_view name_of(Language l) {
  switch (l) {
    case Language::krl: return "krl";
    case Language::inform: return "inform";
    case Language::beckhoff: return "beckhoff";
    case Language::nci: return "nci";
    default: return "ur";
  }
}
enum class BeckhoffOrientation { cba, ypr, euler };  // P-CHAN-00112 = 2 | 0 | 1
inline std::string_view name_of(BeckhoffOrientation o) {
  return o == BeckhoffOrientation::cba ? "cba" : o == BeckhoffOrientation::ypr ? "ypr" : "euler";
}
enum class SpeedUnit { mm_s, cm_min };
inline std::string_view name_of(SpeedUnit u) { return u == SpeedUnit::mm_s ? "mm/s" : "cm/min"; }

/// What a dialect must not guess; a value that decides meaning and is missing is a refusal of that dialect's post.
struct ControllerSpec {
  Language language = Language::krl;
  std::optional<std::array<double, 6>> pulses_per_degree;  // inform
  std::optional<SpeedUnit> speed_unit;                     // inform
  std::optional<BeckhoffOrientation> orientation;          // beckhoff
  std::optional<int> kinematic_id;                         // beckhoff
  std::map<std::string, std::string> options;              // further optional keys of the controller block, as text ("krl.version": "KRC4")
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("language", s.language), a("pulses_per_degree", s.pulses_per_degree), a("speed_unit", s.speed_unit);
    a("orientation", s.orientation), a("kinematic_id", s.kinematic_id), a("options", s.options);
  }
};

enum class CutterShape { cone, ball, cylinder };
inline std::string_view name_of(CutterShape c) {
  return c == CutterShape::cone ? "cone" : c == CutterShape::ball ? "ball" : "cylinder";
}
/// Solid of revolution about tool z (from the flange to the work). TCP: the centre of the tip (lowest point).
struct Cutter {
  CutterShape shape = CutterShape::cone;
  double included_angle_rad = kPi / 2, tip_diameter_mm = 0, diameter_mm = 0, length_mm = 0, shank_diameter_mm = 0;
  int teeth_count = 1;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("shape", s.shape), a("included_angle", s.included_angle_rad), a("tip_diameter", s.tip_diameter_mm);
    a("diameter", s.diameter_mm), a("length", s.length_mm), a("shank_diameter", s.shank_diameter_mm), a("teeth", s.teeth_count);
  }
};
struct SpindleSpec {
  double max_rpm = 0;
  int output = 0, analog = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("max_rpm", s.max_rpm), a("output", s.output), a("analog", s.analog);
  }
};
struct ToolSpec {
  std::string id;
  int number = 0;
  Pose<frame::Flange, frame::Tool> T_flange_tool;  // the calibrated one where a calibration names this tool
  Mat6 covariance = Mat6::Zero();                  // of T_flange_tool; zero where unknown
  Cutter cutter;
  SpindleSpec spindle;
  Mesh mesh_flange;                                // without the cutter; may be empty
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("number", s.number), a("T_flange_tool", s.T_flange_tool), a("covariance", s.covariance), a("cutter", s.cutter);
    a("spindle", s.spindle), a("mesh", s.mesh_flange);
  }
};
enum class SensorKind { snapshot, depth_stream, profile };
inline std::string_view name_of(SensorKind k) {
  return k == SensorKind::snapshot ? "snapshot" : k == SensorKind::depth_stream ? "depth_stream" : "profile";
}
struct SensorSpec {
  std::string id;
  SensorKind kind = SensorKind::snapshot;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;  // calibrated where the calibration names this sensor
  Mat6 covariance = Mat6::Zero();                      // of T_flange_sensor
  bool is_calibrated = false;
  std::array<double, 2> range_mm{};
  double working_distance_mm = 0;
  std::array<double, 2> field_of_view_mm{};            // at the working distance
  double noise_mm = 0;                                 // 1 sd along the ray at the working distance
  Mesh mesh_flange;
  std::optional<std::array<double, 2>> pixels_count;   // across the field of view
  std::optional<Vec3> second_ray_mm;                   // projector or second camera, in the sensor's frame: a point is seen when both see it
  std::optional<double> incidence_max_rad;             // steepest ray against the surface's normal that still gives a point
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("kind", s.kind), a("T_flange_sensor", s.T_flange_sensor), a("covariance", s.covariance);
    a("is_calibrated", s.is_calibrated), a("range", s.range_mm), a("working_distance", s.working_distance_mm);
    a("field_of_view", s.field_of_view_mm), a("noise", s.noise_mm), a("mesh", s.mesh_flange), a("pixels", s.pixels_count);
    a("second_ray", s.second_ray_mm), a("incidence", s.incidence_max_rad);
  }
};
struct Obstacle {
  std::string name;
  Mesh mesh_base;  // already placed in base
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("mesh", s.mesh_base);
  }
};
struct CellSpec {
  std::string id;
  RobotSpec robot;
  ControllerSpec controller;
  std::vector<ToolSpec> tools;
  std::vector<SensorSpec> sensors;
  std::vector<Obstacle> obstacles;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("robot", s.robot), a("controller", s.controller), a("tools", s.tools), a("sensors", s.sensors);
    a("obstacles", s.obstacles);
  }
};

// ------------------------------------------------------------------ fixture, part, recipe
struct FixtureSpec {
  Pose<frame::Base, frame::Fixture> T_base_fixture;
  Pose<frame::Fixture, frame::Part> T_fixture_part;  // nominal
  Mesh mesh_fixture;                                 // in fixture; may be empty
  Vec3 play_mm = Vec3::Zero();                       // half ranges
  std::array<std::optional<double>, 3> play_rad;     // about x, y, z; none: a free angle
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("T_base_fixture", s.T_base_fixture), a("T_fixture_part", s.T_fixture_part), a("mesh", s.mesh_fixture);
    a("play_mm", s.play_mm), a("play_rad", s.play_rad);
  }
};
struct Symmetry {
  Vec3 point_part = Vec3::Zero(), axis_part = Vec3::UnitZ();
  int order_count = 0;  // 0: continuous
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("point", s.point_part), a("axis", s.axis_part), a("order", s.order_count);
  }
};
struct BurrZone {
  Vec3 point_part = Vec3::Zero(), normal_part = Vec3::UnitZ();
  double width_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("point", s.point_part), a("normal", s.normal_part), a("width", s.width_mm);
  }
};
enum class Process { deburr, weld, scan };
inline std::string_view name_of(Process p) { return p == Process::deburr ? "deburr" : p == Process::weld ? "weld" : "scan"; }
enum class OrientationMode { fixed, tilt };
inline std::string_view name_of(OrientationMode m) { return m == OrientationMode::fixed ? "fixed" : "tilt"; }
struct Recipe {
  std::string id;
  Process process = Process::deburr;
  std::string tool;
  double spindle_rpm = 0;
  double width_mm = 0, tolerance_mm = 0;       // chamfer leg on each face
  double feed_min_mm_s = 0, feed_max_mm_s = 0;
  double removal_max_mm3_s = 0;
  std::optional<double> chip_load_mm;          // feed per tooth
  double burr_max_height_mm = 0;
  int burr_max_passes_count = 1;
  OrientationMode orientation = OrientationMode::fixed;
  Vec3 axis_base = -Vec3::UnitZ();             // wanted tool z in base
  double cone_rad = 0;                         // how far tool z may leave axis_base in tilt mode
  double approach_mm = 0, lead_mm = 0, path_tolerance_mm = 0.01;
  double gate_probability_ratio = 0.80;        // an edge is emitted only when the expected share of it in tolerance is at least this
  std::map<std::string, double> weld;          // further numbers of a weld recipe
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("process", s.process), a("tool", s.tool), a("spindle_rpm", s.spindle_rpm), a("width", s.width_mm);
    a("tolerance", s.tolerance_mm), a("feed_min", s.feed_min_mm_s), a("feed_max", s.feed_max_mm_s);
    a("removal_max", s.removal_max_mm3_s), a("chip_load", s.chip_load_mm), a("burr_max_height", s.burr_max_height_mm);
    a("burr_max_passes", s.burr_max_passes_count), a("orientation", s.orientation), a("axis", s.axis_base), a("cone", s.cone_rad);
    a("approach", s.approach_mm), a("lead", s.lead_mm), a("path_tolerance", s.path_tolerance_mm);
    a("gate_probability", s.gate_probability_ratio), a("weld", s.weld);
  }
};
struct FeatureSpec {
  std::string id, recipe;
  std::vector<int> edges;  // indices into PartSpec::brep.edges, ascending, without repeats
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("recipe", s.recipe), a("edges", s.edges);
  }
};
struct PartSpec {
  std::string id, material, cad_file;
  Brep brep;
  std::optional<Symmetry> symmetry;
  std::optional<BurrZone> burr_zone;
  std::vector<FeatureSpec> features;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("id", s.id), a("material", s.material), a("cad", s.cad_file), a("brep", s.brep), a("symmetry", s.symmetry);
    a("burr_zone", s.burr_zone), a("features", s.features);
  }
};

// ------------------------------------------------------------------ scans
/// A depth camera as its calibration or its own file gives it. Pixel (0, 0) is the centre of the first pixel.
struct DepthCamera {
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  int width_px = 0, height_px = 0;
  std::array<double, 5> distortion_ratio{};        // k1, k2, p1, p2, k3
  double depth_unit_mm = 1;                        // one count of a depth image
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("fx", s.fx_px), a("fy", s.fy_px), a("cx", s.cx_px), a("cy", s.cy_px), a("width", s.width_px), a("height", s.height_px);
    a("distortion", s.distortion_ratio), a("depth_unit", s.depth_unit_mm);
  }
};
struct RobotSample {
  double t_s = 0;                                 // the log's clock
  Pose<frame::Base, frame::Flange> T_base_flange; // actual
  std::vector<double> q_rad;                      // six, or none where the log has no joints
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("t", s.t_s), a("T_base_flange", s.T_base_flange), a("q", s.q_rad);
  }
};
/// What a robot log said, in order of time, and what was wrong with it.
struct RobotTrack {
  std::vector<RobotSample> samples;
  double cycle_s = 0;                             // median step of the clock
  std::vector<std::array<double, 2>> flash_s;     // the flash came on between these two times of the log
  int repeated_count = 0, late_count = 0, reset_count = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("samples", s.samples), a("cycle", s.cycle_s), a("flash", s.flash_s), a("repeated", s.repeated_count), a("late", s.late_count);
    a("reset", s.reset_count);
  }
};
/// One image or one profile of a stream.
struct StreamFrame {
  std::string file, sha256;                       // of a depth image, relative to the batch; empty for a profile
  double t_s = 0;                                 // middle of the exposure, the sensor's clock
  double exposure_s = 0;
  double brightness_ratio = -1;                   // mean grey value 0..1 of the image; negative: not known
  std::size_t begin = 0, end = 0;                 // a profile's points in Capture::points_sensor
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("file", s.file), a("sha256", s.sha256), a("t", s.t_s), a("exposure", s.exposure_s), a("brightness", s.brightness_ratio);
    a("begin", s.begin), a("end", s.end);
  }
};
/// How the clocks of sensor and robot belong together: t_robot = t_sensor + offset.
struct ClockSpec {
  bool is_common = true;                          // both were stamped by one clock, but for offset_s
  double offset_s = 0, sigma_s = 0;               // as stated
  bool uses_flash = false;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("is_common", s.is_common), a("offset", s.offset_s), a("sigma", s.sigma_s), a("uses_flash", s.uses_flash);
  }
};
/// A sensor that measured while the robot moved.
struct SensorStream {
  std::optional<DepthCamera> camera;              // none: profiles
  std::vector<StreamFrame> frames;                // in order of time
  RobotTrack robot;
  ClockSpec clock;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("camera", s.camera), a("frames", s.frames), a("robot", s.robot), a("clock", s.clock);
  }
};

struct Capture {
  std::string name;                               // of the cloud file
  int sensor = -1;                                // index into CellSpec::sensors
  std::optional<std::string> feature;
  Pose<frame::Base, frame::Flange> T_base_flange; // as commanded
  std::optional<std::array<double, 6>> q_rad;     // where the file gives joints
  std::vector<Eigen::Vector3f> points_sensor;     // mm, finite points only
  std::size_t dropped_count = 0;                  // points with a NaN or infinite coordinate
  std::optional<SensorStream> stream;             // of a moving sensor; T_base_flange is then the middle of its log
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("sensor", s.sensor), a("feature", s.feature), a("T_base_flange", s.T_base_flange), a("q", s.q_rad);
    a("points", s.points_sensor), a("dropped", s.dropped_count), a("stream", s.stream);
  }
};

struct Override {  // a named person lets one edge pass the gate
  std::string edge, name, reason, expires;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edge", s.edge), a("name", s.name), a("reason", s.reason), a("expires", s.expires);
  }
};

struct Job {
  std::string batch_id, item_id;
  std::string taken;                    // the scan's date, ISO; the stamp of everything that needs a date
  CellSpec cell;
  std::string calibration_created;
  int calibration_valid_days = 0;
  FixtureSpec fixture;
  PartSpec part;
  std::vector<Recipe> recipes;
  std::vector<Capture> captures;
  std::vector<Override> overrides;
  std::vector<InputFile> inputs;        // sorted by path
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("batch", s.batch_id), a("item", s.item_id), a("taken", s.taken), a("cell", s.cell), a("calibration_created", s.calibration_created);
    a("calibration_valid_days", s.calibration_valid_days), a("fixture", s.fixture), a("part", s.part), a("recipes", s.recipes);
    a("captures", s.captures), a("overrides", s.overrides), a("inputs", s.inputs);
  }
  const Recipe* recipe(const std::string& id) const {
    for (const Recipe& r : recipes)
      if (r.id == id) return &r;
    return nullptr;
  }
  const ToolSpec* tool(const std::string& id) const {
    for (const ToolSpec& t : cell.tools)
      if (t.id == id) return &t;
    return nullptr;
  }
};

}  // namespace asbuilt
