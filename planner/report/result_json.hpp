// SPDX-License-Identifier: GPL-3.0-or-later
// result.json of one item, field by field as the contract names them. Files: mm, degree, s. Arrays are parallel to `s`.
#pragma once

#include "planner/artefacts/report.hpp"
#include "planner/base/archive.hpp"

namespace asbuilt {

/// The whole document; `timing_s` is its last field and the only one that differs between two runs of the same inputs.
Json result_document(const ItemRecord& record);
/// The worst of all verdicts of the item's programs; the planned program's where no text was written.
Verdict worst_verdict(const ItemRecord& record);
/// Where a program file of a released item lies, relative to the item's folder.
std::string program_path(const ProgramText& text, const ProgramFile& file);
Json reasons_json(const std::vector<Refusal>& reasons);
std::string version_text();

}  // namespace asbuilt
