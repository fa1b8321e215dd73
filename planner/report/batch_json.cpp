// SPDX-License-Identifier: GPL-3.0-or-later
// batch.json: one row an item, with what a person or a scheduler wants to know without opening the item.
#include "planner/report/json_text.hpp"
#include "planner/report/report.hpp"
#include "planner/report/result_json.hpp"

namespace asbuilt {

std::string batch_json(const std::string& batch_id, const std::vector<BatchLine>& lines) {
  Json j;
  j["asbuilt"] = "batch-result/1";
  j["id"] = batch_id;
  std::map<std::string, int> counts{{"emitted", 0}, {"failed", 0}, {"refused", 0}};
  for (const BatchLine& line : lines) ++counts[std::string(name_of(line.status))];
  j["emitted"] = counts["emitted"];
  j["refused"] = counts["refused"];
  j["failed"] = counts["failed"];
  j["items"] = Json::array();
  for (const BatchLine& line : lines) {
    Json row;
    row["item"] = line.item_id;
    row["status"] = std::string(name_of(line.status));
    row["reasons"] = reasons_json(line.reasons);
    const Json result = Json::parse(line.result_json, nullptr, false);
    if (result.is_object()) {
      row["result"] = line.item_id + "/result.json";
      row["report"] = line.item_id + "/report.html";
      if (result.contains("programs")) row["programs"] = result["programs"];
      if (result.contains("verification")) {
        row["verification"] = result["verification"];
        row["verification"].erase("checks");
      }
    }
    row["timing_s"] = Json::object();
    for (const auto& [stage, time] : line.timing_s) row["timing_s"][stage] = number(time, 3);
    row["peak_memory_mib"] = Json::object();
    for (const auto& [stage, peak] : line.peak_memory_mib) row["peak_memory_mib"][stage] = number(peak, 1);
    j["items"].push_back(std::move(row));
  }
  j["version"] = version_text();
  return readable_json(j);
}

}  // namespace asbuilt
