// SPDX-License-Identifier: GPL-3.0-or-later
// One function a command: takes what the command line said, says its answer, returns the exit status of the contract.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "planner/app/console.hpp"

namespace asbuilt {

struct BatchArguments {
  std::string batch, out;
  int jobs_count = 1;
  std::vector<std::string> only, post;
  std::string executor = "local";
  bool allow_outside = false;
  double timeout_s = 0;
};
int batch_command(const BatchArguments& arguments, Console& console);

struct DemoArguments {
  std::string out = "out/demo";
  std::uint64_t seed = 1;
  int jobs_count = 2;
};
int demo_command(const DemoArguments& arguments, Console& console);

struct StageArguments {  // fuse, locate, fit, burr, path, motion
  std::string stage, batch, item, out = "out";
  bool allow_outside = false;
};
int stage_command(const StageArguments& arguments, Console& console);

struct CadArguments {
  std::string file, units, mesh_out;
  bool wants_edges = false;
  double chord_mm = 0, angle_deg = 0;
};
int cad_command(const CadArguments& arguments, Console& console);

struct InspectArguments {
  std::string batch, item, out = "out", at = "scans";
  std::vector<std::string> post;
  bool allow_outside = false;
};
int inspect_command(const InspectArguments& arguments, Console& console);

struct VerifyArguments {
  std::vector<std::string> programs;
  std::string cell, calibration, result;
};
int verify_command(const VerifyArguments& arguments, Console& console);

struct CompareArguments {
  std::string a, b, cell, calibration;
};
int compare_command(const CompareArguments& arguments, Console& console);

int simulate_command(const std::string& scenario, const std::string& out, Console& console);
struct CalibrateArguments {
  std::string captures, out, check;
  bool allow_outside = false;
};
int calibrate_command(const CalibrateArguments& arguments, Console& console);
int schema_command(const std::string& kind, Console& console);
int show_command(const std::string& file, Console& console);
int why_command(const std::string& item, const std::string& out, Console& console);

/// The languages of "krl,inform"; `fault` says which word is none.
std::vector<Language> languages_of(const std::vector<std::string>& words, std::string& fault);
/// The command that answers an order of run_batch: this program.
std::vector<std::string> own_worker_command();
/// The cell with its calibration: the one named, else the calibration.yaml beside the cell where there is one, else none.
Result<CellSpec> calibrated_cell(const std::string& cell, const std::string& calibration, Console& console);
/// Options that batch and demo share: code tag, date, worker, progress on the console.
BatchOptions batch_options(const std::string& out, Console& console);
/// One row an item: status, seconds, first reason.
std::string batch_table(const BatchOutcome& outcome, const std::string& out);

}  // namespace asbuilt
