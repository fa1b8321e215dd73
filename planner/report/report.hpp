// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 11: everything -> what a person reads. result.json by the contract, a self-contained report.html, batch.json, index.html.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/report.hpp"

namespace asbuilt {

ItemReport make_report(const ItemRecord& record);

struct BatchLine {  // one row of batch.json and index.html
  std::string item_id;
  ItemStatus status = ItemStatus::failed;
  std::vector<Refusal> reasons;
  std::map<std::string, double> timing_s;
  std::map<std::string, double> peak_memory_mib;
  std::string result_json;  // the item's own, "" when it has none
};
std::string batch_json(const std::string& batch_id, const std::vector<BatchLine>& lines);
std::string index_html(const std::string& batch_id, const std::vector<BatchLine>& lines);

}  // namespace asbuilt
