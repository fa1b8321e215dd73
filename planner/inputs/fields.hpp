// SPDX-License-Identifier: GPL-3.0-or-later
// The words in which a kind of file lists its fields. Every kind has one list, a static `fields(self, visitor)`; reading,
// faults, the JSON Schema and the tables of docs/formats.md all come from it. Units here are those of the files: mm, degree, s.
#pragma once

#include <array>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "planner/artefacts/job.hpp"
#include "planner/base/frames.hpp"

namespace asbuilt::inputs {

/// What a text has to look like.
enum class Form { text, id, file, date, edge };

/// Everything there is to say about one field besides its name and type. Limits hold for every number of a list.
struct Field {
  std::string_view unit = "";
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  bool is_optional = false;
  std::string_view when_key = "", when_values = "";  // required only where that sister key has one of these values ("cone|ball")
  std::string_view word = "";                        // a word that may stand in a number's place
  Form form = Form::text;
  std::size_t count_min = 0;         // of a list
  bool is_direction = false;         // three numbers that may not all be zero
  bool allows_joints = false;        // a robot pose: `joints` is one more form
  bool empty_means_present = false;  // a key without a value is the field with nothing in it
  std::string_view doc = "";
};

/// A pose as written. Where it was given as joints, q and p_mm are not set.
struct PoseText {
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Vec3 p_mm = Vec3::Zero();
  std::optional<std::array<double, 6>> joints_deg;
  template <class A, class B>
  Pose<A, B> pose() const {
    return {q, p_mm};
  }
};

struct NumberOrWord {
  double value = 0;
  bool is_word = false;
};

enum class LengthUnit { mm, cm, m, inch };
inline double mm_of(LengthUnit u) { return u == LengthUnit::mm ? 1.0 : u == LengthUnit::cm ? 10.0 : u == LengthUnit::m ? 1000.0 : 25.4; }

template <class E>
struct Words;  // list: the words of an enum, in order
template <class E, std::size_t N>
using WordList = std::array<std::pair<std::string_view, E>, N>;
template <>
struct Words<LengthUnit> {
  static constexpr WordList<LengthUnit, 4> list{
      {{"mm", LengthUnit::mm}, {"cm", LengthUnit::cm}, {"m", LengthUnit::m}, {"inch", LengthUnit::inch}}};
};
template <>
struct Words<Process> {
  static constexpr WordList<Process, 3> list{{{"deburr", Process::deburr}, {"weld", Process::weld}, {"scan", Process::scan}}};
};
template <>
struct Words<OrientationMode> {
  static constexpr WordList<OrientationMode, 2> list{{{"fixed", OrientationMode::fixed}, {"tilt", OrientationMode::tilt}}};
};
template <>
struct Words<Language> {
  static constexpr WordList<Language, 5> list{
      {{"krl", Language::krl}, {"inform", Language::inform}, {"beckhoff", Language::beckhoff}, {"nci", Language::nci}, {"ur", Language::ur}}};
};
template <>
struct Words<SpeedUnit> {
  static constexpr WordList<SpeedUnit, 2> list{{{"mm/s", SpeedUnit::mm_s}, {"cm/min", SpeedUnit::cm_min}}};
};
template <>
struct Words<BeckhoffOrientation> {
  static constexpr WordList<BeckhoffOrientation, 3> list{
      {{"cba", BeckhoffOrientation::cba}, {"ypr", BeckhoffOrientation::ypr}, {"euler", BeckhoffOrientation::euler}}};
};
template <>
struct Words<CutterShape> {
  static constexpr WordList<CutterShape, 3> list{
      {{"cone", CutterShape::cone}, {"ball", CutterShape::ball}, {"cylinder", CutterShape::cylinder}}};
};
template <>
struct Words<SensorKind> {
  static constexpr WordList<SensorKind, 3> list{
      {{"snapshot", SensorKind::snapshot}, {"depth_stream", SensorKind::depth_stream}, {"profile", SensorKind::profile}}};
};

}  // namespace asbuilt::inputs
