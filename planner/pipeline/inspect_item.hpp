// SPDX-License-Identifier: GPL-3.0-or-later
// One item before it is scanned in detail: where its part sits, from where to look at its edges, and the checked program of the tour.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/inspection.hpp"
#include "planner/pipeline/pipeline.hpp"

namespace asbuilt {

struct InspectOptions {
  ItemOptions item;                 // last_stage is not used
  bool is_from_fixture = false;     // the part where the fixture holds it; else where the item's scans find it
};

struct InspectRecord {
  std::string batch_id, item_id;
  ItemStatus status = ItemStatus::failed;
  std::vector<Refusal> reasons;
  std::vector<Note> notes;
  std::optional<Job> job;
  std::optional<Location> location;
  std::optional<Inspection> inspection;
  std::vector<ReleasedProgram> programs;
  std::vector<std::vector<JointVector>> stops;  // parallel to programs: the joints of every view as that program says them
};

/// Locates the item (or takes the fixture's word), plans the inspection, writes and reads back every language, verifies each.
/// Never throws.
InspectRecord inspect_item(const Batch& batch, const std::string& item_id, const InspectOptions& options, const Watch& watch = {});

/// Writes DIR/ITEM: inspection.json, and where nothing was refused programs/LANGUAGE and scans.yaml (scans-LANGUAGE.yaml beside it for
/// further languages: their printed digits differ). Throws where the disk fails.
void write_inspection(const std::filesystem::path& out, const InspectRecord& record);

}  // namespace asbuilt
