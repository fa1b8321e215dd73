// SPDX-License-Identifier: GPL-3.0-or-later
// What an inspection plan looks like on disk: inspection.json, and the captures as a scans file into which the clouds only have to be put.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/inspection.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/report.hpp"

namespace asbuilt {

struct InspectionView {
  const std::string& batch_id;
  const std::string& item_id;
  ItemStatus status;
  const std::vector<Refusal>& reasons;
  const std::vector<Note>& notes;
  const std::optional<Job>& job;
  const std::optional<Location>& location;
  const std::optional<Inspection>& inspection;
  const std::vector<ReleasedProgram>& programs;
};

/// "asbuilt": "inspection/1"; docs/formats.md lists it. mm, degree, s.
std::string inspection_json(const InspectionView& view);

/// "asbuilt: scans/1": one capture a view, with the joints as the program says them (degree).
std::string scans_text(const Job& job, const Inspection& inspection, const std::vector<JointVector>& stops_rad);

}  // namespace asbuilt
