// SPDX-License-Identifier: GPL-3.0-or-later
// index.html: the batch at a glance, refusals and failures first.
#include <fmt/format.h>

#include <algorithm>

#include "planner/report/json_text.hpp"
#include "planner/report/page_files.hpp"
#include "planner/report/page_html.hpp"
#include "planner/report/report.hpp"
#include "planner/report/result_json.hpp"

namespace asbuilt {

namespace {

double number_at(const Json& j, const char* block, const char* field) {
  if (!j.is_object() || !j.contains(block) || !j[block].contains(field) || !j[block][field].is_number()) return 1e300;
  return j[block][field].get<double>();
}

std::string shown_or_blank(double value, int decimals) { return value < 1e8 ? shown(value, decimals) : std::string(); }

std::string row_of(const BatchLine& line) {
  const Json result = Json::parse(line.result_json, nullptr, false);
  double time_s = 0, deviation = -1, burr = -1;
  for (const auto& [stage, t] : line.timing_s) time_s += t;
  std::size_t edges = 0;
  if (result.is_object() && result.contains("edges"))
    for (const Json& e : result["edges"]) {
      ++edges;
      const Json &a = e["adapted"], &n = e["nominal"];
      for (std::size_t i = 0; i < std::min(a.size(), n.size()); ++i) {
        double d2 = 0;
        for (std::size_t k = 0; k < 3; ++k)
          if (a[i][k].is_number() && n[i][k].is_number()) d2 += std::pow(a[i][k].get<double>() - n[i][k].get<double>(), 2);
        deviation = std::max(deviation, std::sqrt(d2));
      }
      if (e.contains("burr"))
        for (const Json& h : e["burr"]["height"])
          if (h.is_number()) burr = std::max(burr, h.get<double>());
    }
  std::string programs;
  if (result.is_object() && result.contains("programs"))
    for (const Json& p : result["programs"])
      for (const Json& f : p["files"]) {
        const std::string path = f["path"];
        programs += fmt::format("<a href=\"{}/{}\">{}</a> ", escaped(line.item_id), escaped(path), escaped(path.substr(path.rfind('/') + 1)));
      }
  std::string said;
  if (!line.reasons.empty()) {
    const Refusal& r = line.reasons.front();
    const bool is_place_said = r.where.empty() || r.message.find(r.where) != std::string::npos;
    said = fmt::format("<b>{}</b>: {}{}", escaped(r.stage), is_place_said ? "" : escaped(r.where) + ": ", escaped(r.message.empty() ? r.code : r.message));
    if (line.reasons.size() > 1) said += fmt::format(" <span class=\"muted\">and {} more</span>", line.reasons.size() - 1);
  } else {
    said = programs;
  }
  return fmt::format("<tr><td style=\"white-space:nowrap\"><a href=\"{0}/report.html\">{0}</a></td><td><span class=\"badge {1}\">{1}</span></td><td>{2}</td><td class=\"n\">{3}</td><td class=\"n\">{4}</td><td class=\"n\">{5}</td>"
                     "<td class=\"n\">{6}</td><td class=\"n\">{7}</td><td class=\"n\">{8}</td></tr>\n",
                     escaped(line.item_id), name_of(line.status), said, edges ? fmt::format("{}", edges) : "", deviation < 0 ? "" : shown(deviation, 3), burr < 0 ? "" : shown(burr, 2),
                     shown_or_blank(number_at(result, "verification", "path_error_max"), 4), shown_or_blank(number_at(result, "verification", "clearance_min"), 2), shown(time_s, 1));
}

}  // namespace

std::string index_html(const std::string& batch_id, const std::vector<BatchLine>& lines) {
  std::map<ItemStatus, int> counts;
  for (const BatchLine& line : lines) ++counts[line.status];
  std::string html = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>" + escaped(batch_id) +
                     "</title>\n<style>\n" + page_style_css + "</style></head>\n<body><main>\n";
  html += fmt::format("<header class=\"top\"><h1>{}</h1><span class=\"where\">{} items</span></header>\n", escaped(batch_id), lines.size());
  html += "<section class=\"tiles\">";
  for (const auto& [status, name] : {std::pair{ItemStatus::emitted, "emitted: every check passed"}, {ItemStatus::refused, "refused: no program, with a reason"}, {ItemStatus::failed, "failed: a fault of the run"}})
    html += fmt::format("<div class=\"tile\"><b>{}</b><span>{}</span></div>", counts[status], name);
  html += "</section>\n<section class=\"long\"><div class=\"wide\"><table><thead><tr><th>item</th><th></th><th>reason, or programs</th><th class=\"n\">edges</th><th class=\"n\">largest<br>change mm</th>"
          "<th class=\"n\">tallest<br>burr mm</th><th class=\"n\">path error<br>mm</th><th class=\"n\">clearance<br>mm</th><th class=\"n\">s</th></tr></thead><tbody>\n";
  for (const ItemStatus wanted : {ItemStatus::failed, ItemStatus::refused, ItemStatus::emitted})
    for (const BatchLine& line : lines)
      if (line.status == wanted) html += row_of(line);
  html += "</tbody></table></div></section>\n<footer>asbuilt " + version_text() + " · <a href=\"batch.json\">batch.json</a></footer>\n</main></body></html>\n";
  return html;
}

}  // namespace asbuilt
