// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 1: files -> Job. The only stage that opens files (through planner/io). All faults of all files at once.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct InputsRecipe {
  bool allow_outside = false;  // paths that leave the batch's folder
  std::string today;           // ISO date, used where a scans file names no date for the calibration's age
  bool without_scans = false;  // the item's scans are not read: there are none yet
};

struct BatchItem {
  std::string id, part, fixture, scans;  // files as written in the batch file
  std::vector<Override> overrides;
};
struct Batch {
  std::string id;
  std::filesystem::path file;  // of the batch file
  std::string cell, calibration;
  std::vector<std::string> recipes;
  std::vector<BatchItem> items;
  std::map<std::string, int> lines;  // where each field stands in the batch file, for messages
};

/// Reads and checks the batch file itself: keys, ids unique, the files that all items share present. What one item names is
/// checked by load_job, so that one bad item does not stop the others. Refuses input.*.
Result<Done<Batch>> load_batch(const std::filesystem::path& file, const InputsRecipe& recipe);

/// Reads and checks everything one item needs. A fault of a shared file (cell, calibration, recipe) is reported for every item.
///
/// Frames    out: as the artefact names them; link meshes in base with every joint at 0, tool and sensor meshes in flange,
///           obstacles placed in base, clouds in their sensor's frame.
/// Units     in: mm, degree, s. out: mm, rad, s.
/// Refuses   input.* (docs/formats.md lists them), step.* of the CAD reader; all that are found, each with file, line, field.
/// Promises  same bytes for same bytes; the order of keys does not matter (Inputs.order_of_keys_does_not_matter).
Result<Done<Job>> load_job(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe);

/// SHA-256 over the bytes of every file the item reads, in order of path, and its entry in the batch file, without parsing
/// clouds or CAD: the item's cache key.
std::string job_inputs_hash(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe);

/// Reads one cell file by itself, for commands that need no batch. Its folder is the root. With a calibration file its poses
/// stand in place of the nominal ones; its age is not judged here.
Result<Done<CellSpec>> load_cell(const std::filesystem::path& file, const InputsRecipe& recipe,
                                 const std::filesystem::path& calibration = {});

/// Reads and checks a captures file, the cell it names (without its meshes), every file of its captures and the calibration
/// until now. Its folder is the root.
/// Units     in: as declared; out: mm, rad, px.
/// Refuses   input.*, each with file, line, field.
Result<Done<CalibrationRequest>> load_captures(const std::filesystem::path& file, const InputsRecipe& recipe);

/// Reads the calibration of one subject out of a calibration file; refuses input.*, input.not_in_calibration.
Result<EarlierCalibration> load_earlier(const std::filesystem::path& file, CalibrationRequest::Subject subject, bool is_sensor_fixed, const std::string& id);

/// What a calibration file says of one sensor, fixed sensor or tool, and how it came about; written as YAML by calibration_yaml.
struct CalibrationEntry {
  CalibrationRequest::Subject subject = CalibrationRequest::Subject::sensor;
  std::string id;
  bool is_sensor_fixed = false;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;  // of a tool: flange, tool; of a fixed sensor: base, sensor
  Mat6 covariance = Mat6::Zero();
  double rms_mm = 0;
  int captures_count = 0;
  std::optional<CameraConstants> camera;
  std::optional<ProfileMap> profile_map;
  std::optional<OpwParameters> arm;  // Subject::robot: added to the cell's constants
  std::string created;
  double held_out_mm = 0, fit_rms = 0, noise = 0, robot_sd_mm = 0, robot_sd_rad = 0;
  int dof = 0;
  std::vector<InputFile> files;
  std::vector<ReferenceView> references;
};
/// The text of a calibration file: this entry, and of the earlier file what is about other things. The day of the file is the
/// oldest of its entries. The same entry gives the same bytes.
std::string calibration_yaml(const std::string& cell_file, int valid_days, const CalibrationEntry& entry, const std::string& earlier_yaml);

/// Every fault of one file of a kind, by itself; empty when there is none. Other files it names are not opened.
Refusals check_file(const std::string& kind, const std::filesystem::path& file);

/// The kinds of YAML files, in the order of the documentation.
std::vector<std::string> file_kinds();

/// JSON Schema of a kind of file ("part", "recipe", "cell", "fixture", "calibration", "scans", "batch", "captures"), from the
/// same field list that the loader checks against. Empty for an unknown kind.
std::string schema_json(const std::string& kind);

/// The table of docs/formats.md for a kind of file, from the same list, as Markdown. Empty for an unknown kind.
std::string schema_table(const std::string& kind);

}  // namespace asbuilt
