// SPDX-License-Identifier: GPL-3.0-or-later
// What `asbuilt calibrate` reads: captures of a known target, for one sensor or one tool. Units of the files.
#pragma once

#include <string>
#include <vector>

#include "planner/inputs/fields.hpp"

namespace asbuilt::inputs {

enum class TargetKind { balls, ball, checkerboard, circle_grid, hole_plate, plane, corner, tip };
template <>
struct Words<TargetKind> {
  static constexpr WordList<TargetKind, 8> list{{{"balls", TargetKind::balls},
                                                 {"ball", TargetKind::ball},
                                                 {"checkerboard", TargetKind::checkerboard},
                                                 {"circle_grid", TargetKind::circle_grid},
                                                 {"hole_plate", TargetKind::hole_plate},
                                                 {"plane", TargetKind::plane},
                                                 {"corner", TargetKind::corner},
                                                 {"tip", TargetKind::tip}}};
};

struct TargetText {
  TargetKind kind = TargetKind::balls;
  double diameter_mm = 0, pitch_mm = 0;
  int columns_count = 0, rows_count = 0;
  std::vector<Vec3> centers_mm;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("kind", s.kind, {.doc = "what was looked at; tip: the tool's tip on one fixed point"});
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
       .when_values = "checkerboard|circle_grid|hole_plate",
       .doc = "from one to the next"});
    v("columns", s.columns_count,
      {.min = 2,
       .max = 1000,
       .when_key = "kind",
       .when_values = "checkerboard|circle_grid|hole_plate",
       .doc = "inner corners, circles or holes along x"});
    v("rows", s.rows_count,
      {.min = 2, .max = 1000, .when_key = "kind", .when_values = "checkerboard|circle_grid|hole_plate", .doc = "and along y"});
    v("centers", s.centers_mm,
      {.unit = "mm",
       .min = -1e5,
       .max = 1e5,
       .when_key = "kind",
       .when_values = "balls",
       .count_min = 3,
       .doc = "centres of the balls in the target's own frame"});
  }
};
struct TargetCaptureText {
  PoseText base_flange;
  std::optional<std::string> cloud, image, profiles;
  bool is_held_out = false;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("base_flange", s.base_flange, {.allows_joints = true, .doc = "flange in base as commanded, or the joints"});
    v("cloud", s.cloud, {.is_optional = true, .form = Form::file, .doc = "PLY, PCD or XYZ, in the sensor's frame, mm"});
    v("image", s.image, {.is_optional = true, .form = Form::file, .doc = "of a camera"});
    v("profiles", s.profiles, {.is_optional = true, .form = Form::file, .doc = "CSV of a line scanner"});
    v("held_out", s.is_held_out, {.is_optional = true, .doc = "not used by the solver; what the accuracy is measured with"});
  }
};
struct CapturesFile {
  static constexpr std::string_view kind = "captures";
  static constexpr std::string_view title = "Captures of a known target, from which `asbuilt calibrate` makes a calibration.";
  std::string cell;
  std::optional<std::string> sensor, tool, taken;
  int valid_days = 30;
  TargetText target;
  std::vector<TargetCaptureText> captures;
  template <class S, class V>
  static void fields(S& s, V& v) {
    v("cell", s.cell, {.form = Form::file, .doc = "the cell"});
    v("sensor", s.sensor, {.is_optional = true, .form = Form::id, .doc = "the sensor to be calibrated"});
    v("tool", s.tool, {.is_optional = true, .form = Form::id, .doc = "or the tool"});
    v("taken", s.taken, {.is_optional = true, .form = Form::date, .doc = "day of the captures; today where absent"});
    v("valid_days", s.valid_days,
      {.unit = "days", .min = 1, .max = 36500, .is_optional = true, .doc = "how long the calibration shall hold"});
    v("target", s.target, {.doc = "what was looked at"});
    v("captures", s.captures, {.count_min = 3, .doc = "one after the other as taken"});
    v.exactly_one({"sensor", "tool"});
  }
};

}  // namespace asbuilt::inputs
