// SPDX-License-Identifier: GPL-3.0-or-later
// What a user writes about the part, the process and where the part is held: part, recipe, fixture. Units of the files.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "planner/inputs/fields.hpp"

namespace asbuilt::inputs {

struct AxisText {
  Vec3 point_mm = Vec3::Zero(), direction = Vec3::UnitZ();
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("point", s.point_mm, {.unit = "mm", .min = -1e5, .max = 1e5, .doc = "a point on the axis, in part"});
    v("direction", s.direction, {.is_direction = true, .doc = "direction of the axis, in part; any length"});
  }
};
struct SymmetryText {
  AxisText axis;
  NumberOrWord order;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("axis", s.axis, {.doc = "the axis the rough shape repeats about"});
    v("order", s.order, {.min = 2, .max = 1000, .word = "continuous", .doc = "how often the shape repeats in a full turn"});
  }
};
struct PlaneText {
  Vec3 point_mm = Vec3::Zero(), normal = Vec3::UnitZ();
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("point", s.point_mm, {.unit = "mm", .min = -1e5, .max = 1e5, .doc = "a point of the plane, in part"});
    v("normal", s.normal, {.is_direction = true, .doc = "normal of the plane, in part; any length"});
  }
};
struct BurrZoneText {
  PlaneText parting_plane;
  double width_mm = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("parting_plane", s.parting_plane, {.doc = "the plane in which the halves of the mould meet"});
    v("width", s.width_mm, {.unit = "mm", .min = 0.01, .max = 1000, .doc = "width of the zone, half on each side of the plane"});
  }
};
struct SharpConvexText {
  std::optional<std::array<Vec3, 2>> box_mm;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("box", s.box_mm,
      {.unit = "mm",
       .min = -1e5,
       .max = 1e5,
       .is_optional = true,
       .doc = "two opposite corners in part; edges that lie wholly inside. Absent: the whole part"});
  }
};
struct EdgeChoiceText {
  std::optional<std::vector<Vec3>> near_mm;
  std::optional<std::vector<std::string>> step, chain, faces;
  std::optional<SharpConvexText> sharp_convex;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("near", s.near_mm,
      {.unit = "mm",
       .min = -1e5,
       .max = 1e5,
       .is_optional = true,
       .count_min = 1,
       .doc = "points in part; of each the nearest sharp edge"});
    v("step", s.step,
      {.is_optional = true, .form = Form::edge, .count_min = 1, .doc = "ids of edges, as `asbuilt cad --edges` prints them"});
    v("chain", s.chain,
      {.is_optional = true,
       .form = Form::edge,
       .count_min = 1,
       .doc = "ids of edges: each with all the edges it runs on as, over ends that turn by at most 30 degree"});
    v("faces", s.faces, {.is_optional = true, .form = Form::edge, .count_min = 1, .doc = "ids of faces: all their sharp convex edges"});
    v("sharp_convex", s.sharp_convex, {.is_optional = true, .empty_means_present = true, .doc = "all sharp convex edges"});
    v.exactly_one({"near", "step", "chain", "faces", "sharp_convex"});
  }
};
struct FeatureText {
  std::string id, recipe;
  EdgeChoiceText edges;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the feature"});
    v("recipe", s.recipe, {.form = Form::id, .doc = "id of the recipe it is worked by"});
    v("edges", s.edges, {.doc = "which edges"});
  }
};
struct PartFile {
  static constexpr std::string_view kind = "part";
  static constexpr std::string_view title = "What is made: its CAD and the edges to be worked. Points are in the frame of the CAD.";
  std::string id, cad, material;
  std::optional<LengthUnit> units;
  std::optional<SymmetryText> symmetry;
  std::optional<BurrZoneText> burr_zone;
  std::vector<FeatureText> features;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the part"});
    v("cad", s.cad, {.form = Form::file, .doc = "STEP (AP203, AP214, AP242) or a mesh (STL, PLY, OBJ, 3MF, ...)"});
    v("units", s.units,
      {.is_optional = true,
       .doc = "unit of the numbers in the CAD file; required for formats that carry none (STL, PLY, OBJ), refused where it contradicts the "
              "file"});
    v("material", s.material, {.is_optional = true, .doc = "free text for the report"});
    v("symmetry", s.symmetry, {.is_optional = true, .doc = "how the rough shape repeats: a hint for the search"});
    v("burr_zone", s.burr_zone, {.is_optional = true, .doc = "castings: where flash may be"});
    v("features", s.features, {.count_min = 1, .doc = "what is worked, in this order"});
  }
};

struct EdgeBreakText {
  double width_mm = 0, tolerance_mm = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("width", s.width_mm, {.unit = "mm", .min = 0.01, .max = 20, .doc = "leg of the chamfer on each face; the mean of both legs"});
    v("tolerance", s.tolerance_mm, {.unit = "mm", .min = 0.001, .max = 10, .doc = "each leg stays within width +- tolerance"});
  }
};
struct FeedText {
  double min_mm_s = 0, max_mm_s = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("min", s.min_mm_s, {.unit = "mm/s", .min = 0.1, .max = 2000, .doc = "slowest feed along the edge"});
    v("max", s.max_mm_s, {.unit = "mm/s", .min = 0.1, .max = 2000, .doc = "fastest feed along the edge"});
  }
};
struct RemovalText {
  double max_mm3_s = 0;
  std::optional<double> chip_load_mm;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("max_mm3_s", s.max_mm3_s,
      {.unit = "mm3/s", .min = 1e-4, .max = 1e5, .doc = "largest cut cross-section of chamfer and burr times feed"});
    v("chip_load_mm", s.chip_load_mm, {.unit = "mm", .min = 1e-4, .max = 2, .is_optional = true, .doc = "largest feed per tooth"});
  }
};
struct BurrText {
  double max_height_mm = 0;
  int max_passes_count = 1;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("max_height", s.max_height_mm, {.unit = "mm", .min = 0, .max = 100, .doc = "a higher burr is refused"});
    v("max_passes", s.max_passes_count, {.min = 1, .max = 50, .doc = "most passes over one edge"});
  }
};
struct OrientationText {
  OrientationMode mode = OrientationMode::fixed;
  Vec3 axis_base = -Vec3::UnitZ();
  double cone_deg = 0;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("mode", s.mode, {.doc = "fixed: tool z stays on axis; tilt: tool z may leave it by cone"});
    v("axis", s.axis_base, {.is_direction = true, .doc = "wanted tool z in base, from the spindle to the work"});
    v("cone", s.cone_deg,
      {.unit = "degree", .min = 0, .max = 180, .when_key = "mode", .when_values = "tilt", .doc = "how far tool z may leave axis"});
  }
};
struct WeldText {
  std::optional<double> speed_mm_s, current_A, voltage_V, wire_mm_s, weave_width_mm, weave_frequency_Hz, work_angle_deg, travel_angle_deg,
      stickout_mm;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("speed", s.speed_mm_s, {.unit = "mm/s", .min = 0.1, .max = 500, .doc = "travel speed along the seam"});
    v("current", s.current_A, {.unit = "A", .min = 0, .max = 2000, .is_optional = true, .doc = "welding current"});
    v("voltage", s.voltage_V, {.unit = "V", .min = 0, .max = 200, .is_optional = true, .doc = "arc voltage"});
    v("wire_feed", s.wire_mm_s, {.unit = "mm/s", .min = 0, .max = 1000, .is_optional = true, .doc = "wire feed"});
    v("weave_width", s.weave_width_mm, {.unit = "mm", .min = 0, .max = 100, .is_optional = true, .doc = "weave, side to side"});
    v("weave_frequency", s.weave_frequency_Hz, {.unit = "Hz", .min = 0, .max = 50, .is_optional = true, .doc = "weave frequency"});
    v("work_angle", s.work_angle_deg,
      {.unit = "degree", .min = -90, .max = 90, .is_optional = true, .doc = "torch from the bisector of the faces, across the seam"});
    v("travel_angle", s.travel_angle_deg,
      {.unit = "degree", .min = -90, .max = 90, .is_optional = true, .doc = "torch along the seam; positive pushes"});
    v("stickout", s.stickout_mm, {.unit = "mm", .min = 0, .max = 200, .is_optional = true, .doc = "contact tip to work"});
  }
};
struct RecipeFile {
  static constexpr std::string_view kind = "recipe";
  static constexpr std::string_view title = "How an edge is worked.";
  std::string id, tool;
  Process process = Process::deburr;
  double spindle_rpm = 0;
  EdgeBreakText edge_break;
  FeedText feed;
  RemovalText removal;
  BurrText burr;
  OrientationText orientation;
  double approach_mm = 0, lead_mm = 0, path_tolerance_mm = 0.01, gate_probability_ratio = 0.90;
  std::optional<WeldText> weld;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("id", s.id, {.form = Form::id, .doc = "name of the recipe"});
    v("process", s.process, {.doc = "what is done"});
    v("tool", s.tool, {.form = Form::id, .doc = "id of a tool of the cell"});
    v("spindle_rpm", s.spindle_rpm,
      {.unit = "rpm", .min = 1, .max = 500000, .when_key = "process", .when_values = "deburr", .doc = "spindle speed"});
    v("edge_break", s.edge_break, {.when_key = "process", .when_values = "deburr", .doc = "the chamfer"});
    v("feed", s.feed, {.when_key = "process", .when_values = "deburr", .doc = "speed of the tool centre point along the edge"});
    v("removal", s.removal, {.when_key = "process", .when_values = "deburr", .doc = "how much may be cut at once"});
    v("burr", s.burr, {.when_key = "process", .when_values = "deburr", .doc = "which burrs may be removed"});
    v("orientation", s.orientation, {.doc = "how the tool is held"});
    v("approach", s.approach_mm,
      {.unit = "mm", .min = 0.1, .max = 2000, .doc = "distance from which the tool comes to the edge, and to which it leaves"});
    v("lead", s.lead_mm, {.unit = "mm", .min = 0, .max = 500, .doc = "length of lead in and lead out"});
    v("path_tolerance", s.path_tolerance_mm, {.unit = "mm", .min = 1e-4, .max = 5, .doc = "chord error of the programmed path"});
    v("gate_probability", s.gate_probability_ratio,
      {.min = 0.5,
       .max = 0.99999,
       .is_optional = true,
       .doc = "an edge is emitted only when the expected share of it in tolerance is at least this"});
    v("weld", s.weld, {.when_key = "process", .when_values = "weld", .doc = "what a seam needs"});
  }
};

struct PlayText {
  Vec3 xyz_mm = Vec3::Zero();
  std::array<NumberOrWord, 3> rpy_deg{};
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("xyz", s.xyz_mm, {.unit = "mm", .min = 0, .max = 1e4, .doc = "half ranges along x, y, z of part"});
    v("rpy", s.rpy_deg, {.unit = "degree", .min = 0, .max = 180, .word = "free", .doc = "half ranges about x, y, z"});
  }
};
struct FixtureFile {
  static constexpr std::string_view kind = "fixture";
  static constexpr std::string_view title = "Where the part is held.";
  PoseText base_fixture, fixture_part;
  std::optional<std::string> mesh;
  std::optional<LengthUnit> units;
  PlayText play;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("base_fixture", s.base_fixture, {.doc = "pose of fixture in base"});
    v("mesh", s.mesh, {.is_optional = true, .form = Form::file, .doc = "the fixture's shape, drawn in fixture"});
    v("units", s.units, {.is_optional = true, .doc = "unit of the mesh; mm where absent"});
    v("fixture_part", s.fixture_part, {.doc = "nominal pose of part in fixture"});
    v("play", s.play, {.doc = "how far the part may sit from its nominal pose"});
  }
};

}  // namespace asbuilt::inputs
