// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "planner/report/page_data.hpp"
#include "planner/report/page_html.hpp"
#include "planner/report/result_json.hpp"

namespace asbuilt {

namespace {

std::string tile(const std::string& value, const std::string& unit, const std::string& name) {
  return fmt::format("<div class=\"tile\"><b>{} <i>{}</i></b><span>{}</span></div>\n", value, unit, name);
}

double greatest(const std::vector<double>& values) {
  double m = -std::numeric_limits<double>::infinity();
  for (const double v : values)
    if (std::isfinite(v)) m = std::max(m, v);
  return m;
}
double least(const std::vector<double>& values) {
  double m = std::numeric_limits<double>::infinity();
  for (const double v : values)
    if (std::isfinite(v)) m = std::min(m, v);
  return m;
}

/// Share of the stations of an edge that were seen on both faces.
double measured_share(const AdaptedEdge& e) {
  if (e.status.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto n = std::count(e.status.begin(), e.status.end(), StationStatus::measured);
  return static_cast<double>(n) / static_cast<double>(e.status.size());
}

/// What was found beside what is allowed, as a small picture.
std::string gauge(const Refusal& r) {
  if (!std::isfinite(r.measured) || !std::isfinite(r.limit) || (r.measured == 0 && r.limit == 0) || std::max(std::abs(r.measured), std::abs(r.limit)) >= 1e8) return "";
  const double lo = std::min({0.0, r.measured, r.limit}), hi = std::max({0.0, r.measured, r.limit}), size = (hi - lo) * 1.12;
  if (!(size > 0)) return "";
  const auto x = [&](double v) { return 240 * (v - lo) / size + 6; };
  const double from = std::min(x(0), x(r.measured)), to = std::max(x(0), x(r.measured));
  return fmt::format(
      "<div class=\"gauge\"><svg width=\"260\" height=\"22\" role=\"img\" aria-label=\"found beside allowed\"><rect x=\"6\" y=\"8\" width=\"248\" height=\"6\" rx=\"3\" fill=\"#e8ecf0\"/>"
      "<rect x=\"{:.1f}\" y=\"8\" width=\"{:.1f}\" height=\"6\" rx=\"3\" fill=\"#b8742a\"/><line x1=\"{:.1f}\" x2=\"{:.1f}\" y1=\"2\" y2=\"20\" stroke=\"#1b2430\" stroke-width=\"2\"/></svg>"
      "<span>found <b>{}</b> {}, allowed <b>{}</b> {}</span></div>\n",
      from, std::max(2.0, to - from), x(r.limit), x(r.limit), shown_short(r.measured), escaped(r.unit), shown_short(r.limit), escaped(r.unit));
}

std::string language_title(const Language l) {
  switch (l) {
    case Language::krl: return "KUKA KRL";
    case Language::inform: return "Yaskawa INFORM";
    case Language::beckhoff: return "Beckhoff CNC";
    case Language::nci: return "Beckhoff NC I";
    case Language::ur: return "UR script";
    default: return std::string(name_of(l));
  }
}

}  // namespace

std::string reasons_section(const ItemRecord& r) {
  if (r.status == ItemStatus::emitted) return "";
  std::string html = fmt::format("<section class=\"reasons {}\"><h2>{}</h2>\n", name_of(r.status),
                                 r.status == ItemStatus::refused ? "Why no program was made" : "What went wrong");
  if (r.reasons.empty()) html += "<p class=\"none\">No reason was recorded.</p>";
  constexpr std::size_t kMost = 12;
  for (std::size_t k = 0; k < r.reasons.size(); ++k) {
    const Refusal& why = r.reasons[k];
    if (k == kMost) html += fmt::format("<details><summary>{} more</summary>\n", r.reasons.size() - kMost);
    html += fmt::format("<div class=\"reason\"><p>{}</p>\n{}<div class=\"facts\"><span>stage <b>{}</b></span>{}<span class=\"mono\">{}</span></div></div>\n",
                        escaped(why.message.empty() ? why.code : why.message), gauge(why), escaped(why.stage),
                        why.where.empty() ? "" : "<span>at " + escaped(why.where) + "</span>", escaped(why.code));
  }
  if (r.reasons.size() > kMost) html += "</details>";
  return html + "</section>\n";
}

std::string tiles_section(const ItemRecord& r) {
  std::string html;
  if (r.features) {
    double length_mm = 0, deviation = 0, sigma = 0;
    for (const AdaptedEdge& e : r.features->edges) {
      if (!e.s_mm.empty()) length_mm += e.s_mm.back();
      deviation = std::max(deviation, greatest(deviation_mm(e)));
      sigma = std::max(sigma, greatest(e.sigma_mm));
    }
    html += tile(fmt::format("{}", r.features->edges.size()), fmt::format("{} mm", shown(length_mm, 0)), "edges to work");
    html += tile(shown(deviation, 3), "mm", "largest change from the drawing");
    html += tile(shown(sigma, 4), "mm", "largest uncertainty (1 sd)");
  }
  if (r.burrs) {
    double height = -std::numeric_limits<double>::infinity();
    for (const EdgeBurr& b : r.burrs->edges) height = std::max(height, greatest(b.height_mm));
    html += tile(shown(height, 2), "mm", "tallest burr");
  }
  if (r.tool_path) html += tile(shown(100 * least(r.tool_path->edge_probability_ratio), 2), "%", "least chance in tolerance, by edge");
  if (r.motion_verdict) {
    const Verdict w = worst_verdict(r);
    html += tile(shown(w.path_error_max_mm, 4), "mm", "largest path error, replayed");
    html += tile(shown(w.clearance_min_mm, 2), "mm", "least clearance");
    html += tile(shown(w.duration_s, 1), "s", "program time");
  }
  return html.empty() ? "" : "<section class=\"tiles\">" + html + "</section>\n";
}

std::string view_section(const ItemRecord& r) {
  if (!r.job && !r.features) return "";
  const auto key = [](const char* what, const char* name, const char* colour) {
    return fmt::format("<label><input type=\"checkbox\" data-show=\"{}\">{}{}</label>\n", what,
                       *colour ? fmt::format("<span class=\"key\" style=\"background:{}\"></span>", colour) : "", name);
  };
  std::string html = "<section><h2>The part as it is</h2>\n<div class=\"tools\">";
  html += key("part", "part", "") + key("outline", "outline", "#7c8896");
  if (r.features) html += key("nominal", "drawing", "#3b4652") + key("adapted", "adapted edge", "linear-gradient(90deg,#266190,#4aa6a6,#f0be50,#d96224)");
  else html += key("nominal", "edges to work (red: named in the reason)", "#2a6fb0");
  if (r.tool_path) html += key("path", "tool tip", "#7a3fa8");
  if (r.motion) html += key("approach", "approach and transfers", "#2b8a76");
  if (r.cloud) html += key("cloud", "measured points", "#1f7a8a");
  html += "</div>\n<div class=\"tools\">";
  for (const auto& [look, name] : {std::pair{"home", "Home"}, {"top", "Top"}, {"front", "Front"}, {"side", "Side"}, {"below", "Below"}})
    html += fmt::format("<button type=\"button\" data-look=\"{}\">{}</button>", look, name);
  if (r.features)
    html += "<button type=\"button\" data-look=\"edge\">Chosen edge</button><label>deviation enlarged <input type=\"range\" id=\"exaggeration\" min=\"0\" max=\"8\" value=\"0\"> "
            "<span id=\"exaggeration-said\"></span></label>";
  html += "</div>\n<div class=\"view\"><canvas tabindex=\"0\" aria-label=\"three-dimensional view of the part\"></canvas><div class=\"read\"></div>";
  if (r.features) {
    double deviation = 0;
    for (const AdaptedEdge& e : r.features->edges) deviation = std::max(deviation, greatest(deviation_mm(e)));
    html += fmt::format("<div class=\"legend\">deviation from the drawing<div class=\"bar\"></div>0 to {} mm</div>", shown(deviation, 3));
  }
  html += "</div>\n<p class=\"muted\" style=\"margin:8px 0 0\">Drag to turn, shift and drag to move, wheel to zoom, double click for home.</p></section>\n";
  return html;
}

std::string edges_section(const ItemRecord& r) {
  if (!r.features || r.features->edges.empty()) return "";
  std::string html =
      "<section class=\"long\"><h2>Edges</h2>\n<div class=\"wide\"><table class=\"pick\"><thead><tr><th>edge</th><th>feature</th><th class=\"n\">length</th><th class=\"n\">seen</th>"
      "<th class=\"n\">deviation<br>mean</th><th class=\"n\">deviation<br>largest</th><th class=\"n\">1 sd<br>largest</th><th class=\"n\">burr<br>tallest</th><th class=\"n\">burr<br>seen</th>"
      "<th class=\"n\">feed<br>mm/s</th><th class=\"n\">passes</th><th class=\"n\">in tolerance<br>(probability)</th></tr></thead><tbody>\n";
  for (std::size_t k = 0; k < r.features->edges.size(); ++k) {
    const AdaptedEdge& e = r.features->edges[k];
    const std::vector<double> d = deviation_mm(e);
    const double mean = d.empty() ? std::numeric_limits<double>::quiet_NaN() : std::accumulate(d.begin(), d.end(), 0.0) / static_cast<double>(d.size());
    std::string burr = "-", coverage = "-", feed = "-", passes = "-", probability = "-";
    if (r.burrs && k < r.burrs->edges.size()) {
      const EdgeBurr& b = r.burrs->edges[k];
      burr = shown(greatest(b.height_mm), 2);
      const auto seen = std::count_if(b.height_mm.begin(), b.height_mm.end(), [](double h) { return std::isfinite(h); });
      if (!b.height_mm.empty()) coverage = shown(100.0 * static_cast<double>(seen) / static_cast<double>(b.height_mm.size()), 0) + " %";
    }
    if (r.tool_path) {
      if (k < r.tool_path->edge_feed_mm_s.size()) feed = shown(least(r.tool_path->edge_feed_mm_s[k]), 1) + " to " + shown(greatest(r.tool_path->edge_feed_mm_s[k]), 1);
      if (k < r.tool_path->edge_passes_count.size()) passes = fmt::format("{}", r.tool_path->edge_passes_count[k]);
      if (k < r.tool_path->edge_probability_ratio.size()) probability = shown(100 * r.tool_path->edge_probability_ratio[k], 2) + " %";
    }
    html += fmt::format("<tr data-edge=\"{}\"><td class=\"mono\">{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{} %</td><td class=\"n\">{}</td><td class=\"n\">{}</td>"
                        "<td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>\n",
                        k, escaped(e.id), escaped(e.feature), e.s_mm.empty() ? "-" : shown(e.s_mm.back(), 1), shown(100 * measured_share(e), 0), shown(mean, 3),
                        shown(greatest(d), 3), shown(greatest(e.sigma_mm), 4), burr, coverage, feed, passes, probability);
  }
  html += "</tbody></table></div>\n<h3>Along <span id=\"edge-title\">the edge</span></h3><p class=\"muted\" style=\"margin:0 0 8px\">Over arc length in mm; choose an edge in the table. "
          "The strip below the first curve: green measured, amber extrapolated within the fit, grey taken from the drawing.</p><div class=\"charts\"></div></section>\n";
  return html;
}

std::string checks_section(const ItemRecord& r) {
  struct Row {
    std::string name, unit, where;
    std::map<std::string, Check> by_program;
    bool is_passed = true;
  };
  std::vector<std::string> programs;
  std::vector<Row> rows;
  const auto add = [&](const std::string& program, const Verdict& v) {
    programs.push_back(program);
    for (const Check& c : v.checks) {
      auto row = std::find_if(rows.begin(), rows.end(), [&](const Row& x) { return x.name == c.name; });
      if (row == rows.end()) row = rows.insert(rows.end(), Row{c.name, c.unit, c.where, {}, true});
      row->is_passed &= c.is_passed;
      const auto [at, is_new] = row->by_program.emplace(program, c);
      if (!is_new && at->second.is_passed && !c.is_passed) at->second = c;
      if (!c.is_passed || row->where.empty()) row->where = c.where;
    }
  };
  if (r.motion_verdict) add("planned", *r.motion_verdict);
  for (const ReleasedProgram& p : r.programs) add(std::string(name_of(p.text.language)), p.verdict);
  if (rows.empty()) return "";
  std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.is_passed < b.is_passed; });
  const auto table = [&](const auto& wanted) {
    std::string t = "<div class=\"wide\"><table><thead><tr><th>check</th>";
    for (const std::string& p : programs) t += "<th class=\"n\">" + escaped(p) + "</th>";
    t += "<th class=\"n\">limit</th><th>unit</th><th></th><th>where</th></tr></thead><tbody>\n";
    for (const Row& row : rows) {
      if (!wanted(row)) continue;
      t += fmt::format("<tr{}><td>{}</td>", row.is_passed ? "" : " class=\"fail\"", escaped(row.name));
      const Check* one = nullptr;
      for (const std::string& p : programs) {
        const auto c = row.by_program.find(p);
        t += "<td class=\"n\">" + (c == row.by_program.end() ? "" : shown_short(std::abs(c->second.measured) < 1e-9 ? 0 : c->second.measured)) + "</td>";
        if (c != row.by_program.end() && (!one || !c->second.is_passed)) one = &c->second;
      }
      // whether the limit is a least or a most shows in what passed
      const char* side = one->measured == one->limit ? "" : (one->measured > one->limit) == one->is_passed ? "at least " : "at most ";
      t += fmt::format("<td class=\"n\">{}{}</td><td>{}</td><td class=\"{}\">{}</td><td class=\"muted\">{}</td></tr>\n", side, shown_short(one->limit), escaped(row.unit),
                       row.is_passed ? "yes" : "no", row.is_passed ? "pass" : "FAIL", escaped(row.where));
    }
    return t + "</tbody></table></div>\n";
  };
  // Checks of form (order, comparison of texts, language rules) are many and say nothing once they pass.
  const auto is_of_form = [](const Row& row) {
    if (!row.is_passed) return false;
    if (row.name.rfind("lint.", 0) == 0 || row.name.rfind("compare.", 0) == 0) return true;
    return std::all_of(row.by_program.begin(), row.by_program.end(), [](const auto& c) { return c.second.limit == 0 && c.second.measured == 0; });
  };
  const auto form_count = std::count_if(rows.begin(), rows.end(), is_of_form);
  const auto failed_count = std::count_if(rows.begin(), rows.end(), [](const Row& row) { return !row.is_passed; });
  std::string html = fmt::format("<section class=\"long\"><h2>Checks {}</h2><p class=\"muted\" style=\"margin:-8px 0 10px\">The planned program, and each program read back from its own text, "
                                 "replayed by a second, independent robot model.</p>\n",
                                 failed_count ? fmt::format("<span class=\"no\">{} failed</span>", failed_count) : "<span class=\"yes\">all passed</span>");
  html += table([&](const Row& row) { return !is_of_form(row); });
  if (form_count)
    html += fmt::format("<details><summary>{} checks of order, of each text against the plan, and of the languages' own rules, all passed</summary>\n", form_count) + table(is_of_form) + "</details>";
  return html + "</section>\n";
}

std::string locate_section(const ItemRecord& r) {
  if (!r.location) return "";
  const Location& l = *r.location;
  const Eigen::Matrix3d R = l.T_base_part.rotation();
  const double b = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0))), a = std::atan2(R(1, 0), R(0, 0)), c = std::atan2(R(2, 1), R(2, 2));
  const double mm[6] = {l.T_base_part.p_mm.x(), l.T_base_part.p_mm.y(), l.T_base_part.p_mm.z(), deg_from_rad(c), deg_from_rad(b), deg_from_rad(a)};
  const char* names[6] = {"x", "y", "z", "about x (C)", "about y (B)", "about z (A)"};
  std::string html = "<section><h2>Where the part sits</h2><div class=\"two\"><div><table><thead><tr><th>part in base</th><th class=\"n\">value</th><th class=\"n\">1 sd (part axes)</th></tr></thead><tbody>";
  for (int i = 0; i < 6; ++i) {
    const double sd = std::sqrt(std::max(0.0, l.covariance(i, i)));
    html += fmt::format("<tr><td>{}</td><td class=\"n\">{} {}</td><td class=\"n\">{} {}</td></tr>", names[i], shown(mm[i], i < 3 ? 3 : 4), i < 3 ? "mm" : "°",
                        shown(i < 3 ? sd : deg_from_rad(sd), 4), i < 3 ? "mm" : "°");
  }
  html += fmt::format("</tbody></table><p>rms <b>{}</b> mm, inliers <b>{} %</b></p></div><div>", shown(l.rms_mm, 4), shown(100 * l.inlier_ratio, 1));
  html += "<h3 style=\"margin-top:0\">How well the scan holds it</h3>";
  if (!l.singular_values.empty()) {
    html += "<table><tbody>";
    for (std::size_t i = 0; i < l.singular_values.size(); ++i) {
      const double width = std::clamp(20 + 30 * std::log10(std::max(1e-6, l.singular_values[i])), 2.0, 180.0);
      html += fmt::format("<tr><td class=\"muted\">{}</td><td class=\"n\">{}</td><td style=\"width:200px\"><span class=\"hb\" style=\"width:{:.0f}px\"></span></td></tr>", i + 1,
                          shown_short(l.singular_values[i]), width);
    }
    html += "</tbody></table><p class=\"muted\" style=\"margin:6px 0\">Information of the data against what was known before, by direction; 1: the data say no more than that.</p>";
  }
  if (l.weak_directions.empty()) html += "<p>No weak direction.</p>";
  else {
    html += "<ul>";
    for (const std::string& w : l.weak_directions) html += "<li>" + escaped(w) + "</li>";
    html += "</ul>";
  }
  html += "</div></div>";
  if (!l.hypotheses.empty()) {
    html += "<h3>Other places it could have been</h3><div class=\"wide\"><table><thead><tr><th></th><th class=\"n\">log likelihood below the best</th><th class=\"n\">inliers</th><th>x, y, z (mm)</th><th></th></tr></thead><tbody>";
    for (std::size_t i = 0; i < std::min<std::size_t>(8, l.hypotheses.size()); ++i) {
      const Hypothesis& h = l.hypotheses[i];
      html += fmt::format("<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{} %</td><td>{}, {}, {}</td><td class=\"muted\">{}</td></tr>", i == 0 ? "<b>taken</b>" : fmt::format("{}", i + 1),
                          i == 0 ? "" : shown_short(h.log_likelihood_ratio), shown(100 * h.inlier_ratio, 1), shown(h.T_base_part.p_mm.x(), 2), shown(h.T_base_part.p_mm.y(), 2),
                          shown(h.T_base_part.p_mm.z(), 2), escaped(h.note));
    }
    html += "</tbody></table></div>";
  }
  return html + "</section>\n";
}

std::string programs_section(const ItemRecord& r) {
  if (r.status != ItemStatus::emitted || r.programs.empty()) return "";
  std::string html = "<section><h2>Programs</h2><div class=\"wide\"><table><thead><tr><th>language</th><th>file</th><th class=\"n\">points</th><th class=\"n\">time</th><th>SHA-256</th></tr></thead><tbody>\n";
  for (const ReleasedProgram& p : r.programs)
    for (std::size_t k = 0; k < p.text.files.size(); ++k) {
      const ProgramFile& f = p.text.files[k];
      const std::string path = program_path(p.text, f);
      html += fmt::format("<tr><td>{}</td><td><a href=\"{}\">{}</a></td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"mono hash\" title=\"{}\">{}</td></tr>\n",
                          k ? "" : language_title(p.text.language), escaped(path), escaped(f.name), k ? "" : fmt::format("{}", p.verdict.points_count),
                          k ? "" : shown(p.verdict.duration_s, 1) + " s", sha256_hex(f.bytes), sha256_hex(f.bytes));
    }
  return html + "</tbody></table></div></section>\n";
}

std::string notes_section(const ItemRecord& r) {
  if (r.notes.empty()) return "";
  std::string html = "<section><h2>Notes</h2><ul>";
  for (const bool warnings : {true, false})
    for (const Note& n : r.notes)
      if ((n.level == Note::Level::warning) == warnings)
        html += fmt::format("<li>{}{}{} <span class=\"muted mono\">{}</span></li>\n", warnings ? "<b>Warning:</b> " : "", n.where.empty() ? "" : escaped(n.where) + ": ", escaped(n.text), escaped(n.code));
  return html + "</ul></section>\n";
}

std::string inputs_section(const ItemRecord& r) {
  if (!r.job || r.job->inputs.empty()) return "";
  std::string html = fmt::format("<section class=\"long\"><h2>Made from</h2><details{}><summary>{} files, by content</summary><table><thead><tr><th>file</th><th>SHA-256</th></tr></thead><tbody>",
                                 r.job->inputs.size() <= 12 ? " open" : "", r.job->inputs.size());
  for (const InputFile& f : r.job->inputs) html += "<tr><td>" + escaped(f.path) + "</td><td class=\"mono\">" + escaped(f.sha256) + "</td></tr>\n";
  return html + "</tbody></table></details></section>\n";
}

std::string timing_section(const ItemRecord& r) {
  if (r.timing_s.empty()) return "";
  double total = 0, most = 1e-9;
  for (const auto& [stage, t] : r.timing_s) total += t, most = std::max(most, t);
  std::string html = fmt::format("<section><h2>Time and memory</h2><table><thead><tr><th>stage</th><th class=\"n\">s</th><th></th><th class=\"n\">peak MiB</th></tr></thead><tbody>");
  for (const char* stage : {"input", "fuse", "locate", "fit", "burr", "path", "motion", "program", "verify", "post"}) {
    const auto t = r.timing_s.find(stage);
    if (t == r.timing_s.end()) continue;
    const auto m = r.peak_memory_mib.find(stage);
    html += fmt::format("<tr><td>{}</td><td class=\"n\">{}</td><td style=\"width:50%\"><span class=\"hb\" style=\"width:{:.0f}%\"></span></td><td class=\"n\">{}</td></tr>\n", stage, shown(t->second, 3),
                        100 * t->second / most, m == r.peak_memory_mib.end() ? "" : shown(m->second, 0));
  }
  return html + fmt::format("<tr><td><b>all</b></td><td class=\"n\"><b>{}</b></td><td></td><td></td></tr></tbody></table></section>\n", shown(total, 3));
}

}  // namespace asbuilt
