// SPDX-License-Identifier: GPL-3.0-or-later
// One item while it is read: its YAML files, the checks between them, and the parts of the Job made from them.
#pragma once

#include <vector>

#include "planner/inputs/files_batch.hpp"
#include "planner/inputs/files_cell.hpp"
#include "planner/inputs/files_part.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/inputs/sources.hpp"

namespace asbuilt::inputs {

/// How far files are read: only their bytes (for the hash), or wholly.
enum class Depth { bytes, all };

struct Item {
  Depth depth = Depth::all;
  Sources sources;
  Readout batch;
  std::filesystem::path batch_file;
  YamlSource<CellFile> cell;
  YamlSource<CalibrationFile> calibration;
  std::vector<YamlSource<RecipeFile>> recipes;
  YamlSource<PartFile> part;
  YamlSource<FixtureFile> fixture;
  YamlSource<ScansFile> scans;
  bool has_kinematics = false;  // the arm's model was read without a fault
  std::vector<Note> notes;
  Refusals faults;  // of files that are no YAML: each names its file itself

  explicit Item(Sources s) : sources(std::move(s)) {}
  void note(std::string code, std::string text, std::string where, Note::Level level = Note::Level::warning) {
    notes.push_back({.level = level, .code = std::move(code), .text = std::move(text), .where = std::move(where)});
  }
};

/// Smallest and largest plausible diagonal of a shape, mm: outside, the unit is wrong.
struct SizeGate {
  double min_mm, max_mm;
  const char* what;
};

/// A mesh of the cell or the fixture, mm. Empty after a fault, or at Depth::bytes.
Mesh mesh_at(Item& item, Readout& naming, const std::string& field, const std::filesystem::path& naming_file, const std::string& text,
             std::optional<LengthUnit> units, const SizeGate& gate, const Vec3& scale = Vec3::Ones(), double mm_per_unit = 0);

// cell.cpp
CellSpec cell_of(Item& item, YamlSource<CellFile>& source);
void apply_calibration(Item& item, CellSpec& cell, const std::string& taken);
// part.cpp
std::vector<Recipe> recipes_of(Item& item);
FixtureSpec fixture_of(Item& item);
PartSpec part_of(Item& item, const std::vector<Recipe>& recipes);
// edges.cpp: indices into brep.edges, ascending; faults in item.part.out
std::vector<int> choose_edges(Item& item, const Brep& brep, const FeatureText& feature, const std::string& field, bool needs_convex);
// streams.cpp: files of a stream -> Capture::stream (and its points, for profiles); faults in item.scans.out and item.faults
void read_stream(Item& item, const CaptureText& text, const std::string& at, const CellSpec& cell, const SensorSpec* sensor, Capture& capture);
/// Clouds are mm by contract. Metres, or a cloud that is no view of anything in range, are told by the distances.
void check_unit(Item& item, const std::vector<Eigen::Vector3f>& points, const SensorSpec& sensor, const std::string& field);
// calibration_text.cpp
ProfileMap profile_map_of(const ProfileMapText& text);
/// As many numbers as the map's model and degree need.
bool is_whole(const ProfileMapText& text);
// captures.cpp
std::vector<Capture> captures_of(Item& item, const CellSpec& cell);

}  // namespace asbuilt::inputs
