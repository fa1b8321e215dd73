// SPDX-License-Identifier: GPL-3.0-or-later
// Everything about one item that is written for people: what the report stage is given and what it gives.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/motion.hpp"
#include "planner/artefacts/program.hpp"
#include "planner/artefacts/program_text.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/artefacts/verdict.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

enum class ItemStatus { emitted, refused, failed };
inline std::string_view name_of(ItemStatus s) {
  return s == ItemStatus::emitted ? "emitted" : s == ItemStatus::refused ? "refused" : "failed";
}

struct ReleasedProgram {
  ProgramText text;
  Verdict verdict;  // of this very text
};

/// All of an item as far as it came; absent artefacts were not reached.
struct ItemRecord {
  std::string batch_id, item_id;
  ItemStatus status = ItemStatus::failed;
  std::vector<Refusal> reasons;                 // each with its stage
  std::vector<Note> notes;
  std::optional<Job> job;
  std::optional<MeasuredCloud> cloud;
  std::optional<Location> location;
  std::optional<Features> features;
  std::optional<Burrs> burrs;
  std::optional<ToolPath> tool_path;
  std::optional<Motion> motion;
  std::optional<Program> program;
  std::optional<Verdict> motion_verdict;
  std::vector<ReleasedProgram> programs;
  std::map<std::string, double> timing_s;       // by stage; the only thing that differs between two runs
  std::map<std::string, double> peak_memory_mib;
};

struct ItemReport {
  std::string result_json;  // contract: result/1
  std::string report_html;  // self-contained
};

}  // namespace asbuilt
