// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/page_html.hpp"

#include <fmt/format.h>

#include <cmath>

#include "planner/base/number.hpp"
#include "planner/report/json_text.hpp"
#include "planner/report/page_data.hpp"
#include "planner/report/page_files.hpp"
#include "planner/report/result_json.hpp"

namespace asbuilt {

std::string escaped(std::string_view text) {
  std::string out;
  for (const char c : text) switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      case '\'': out += "&#39;"; break;
      default: out += c;
    }
  return out;
}

std::string escaped_script(std::string text) {
  for (std::size_t at = 0; (at = text.find("</", at)) != std::string::npos; at += 3) text.replace(at, 2, "<\\/");
  for (std::size_t at = 0; (at = text.find("<!--", at)) != std::string::npos; at += 4) text.replace(at, 4, "<\\u0021--");
  return text;
}

std::string shown(double value, int decimals) { return std::isfinite(value) && std::abs(value) < 1e8 ? fixed_number(value, decimals) : "-"; }

std::string shown_short(double value) {
  if (!std::isfinite(value) || std::abs(value) >= 1e8) return "-";
  if (value == 0) return "0";
  if (value == std::round(value) && std::abs(value) < 1e6) return fixed_number(value, 0);
  const int decimals = 3 - static_cast<int>(std::floor(std::log10(std::abs(value))));
  if (decimals > 9) return fmt::format("{:.3e}", value);
  std::string text = fixed_number(value, std::max(0, decimals));
  if (text.find('.') != std::string::npos) text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

namespace {

std::string head_of(const ItemRecord& r) {
  std::string facts;
  const auto add = [&](const std::string& text) {
    if (!text.empty()) facts += (facts.empty() ? "" : " · ") + escaped(text);
  };
  if (r.job) {
    add("part " + r.job->part.id);
    if (!r.job->part.material.empty()) add("material " + r.job->part.material);
    if (!r.job->taken.empty()) add("scanned " + r.job->taken);
    add("robot " + r.job->cell.robot.model);
  }
  if (!r.batch_id.empty()) add("batch " + r.batch_id);
  return fmt::format("<header class=\"top\"><h1>{} <span class=\"badge {}\">{}</span></h1><span class=\"where\">{}</span></header>\n", escaped(r.item_id),
                     name_of(r.status), name_of(r.status), facts);
}

}  // namespace

std::string report_page(const ItemRecord& r) {
  std::string html = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n";
  html += "<title>" + escaped(r.item_id) + " - " + std::string(name_of(r.status)) + "</title>\n<style>\n" + page_style_css + "</style></head>\n<body><main>\n";
  html += head_of(r);
  for (const auto& section : {reasons_section(r), tiles_section(r), view_section(r), edges_section(r), checks_section(r), locate_section(r), programs_section(r),
                              notes_section(r), inputs_section(r), timing_section(r)})
    html += section;
  html += "<footer>asbuilt " + version_text() + " · lengths mm, angles degree, speeds mm/s · the same numbers, for programs: <a href=\"result.json\">result.json</a> · <a href=\"../index.html\">all items</a></footer>\n</main>\n";
  html += "<script type=\"application/json\" id=\"data\">" + escaped_script(compact_json(page_data(r))) + "</script>\n";
  html += std::string("<script>\n") + page_viewer_js + page_charts_js + page_page_js + "</script>\n</body></html>\n";
  return html;
}

}  // namespace asbuilt
