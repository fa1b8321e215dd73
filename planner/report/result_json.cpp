// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/result_json.hpp"

#include <algorithm>
#include <cmath>

#include "planner/report/burr_statistics.hpp"
#include "planner/report/json_text.hpp"

namespace asbuilt {

std::string version_text() { return ASBUILT_VERSION; }

std::string program_path(const ProgramText& text, const ProgramFile& file) { return "programs/" + std::string(name_of(text.language)) + "/" + file.name; }

namespace {

constexpr double kUnknown = 1e8;  // a minimum that nothing was measured for

Json least(double value, int decimals) { return value > kUnknown ? Json(nullptr) : number(value, decimals); }

template <class A, class B>
Json pose(const Pose<A, B>& T) {
  const double sign = T.q.w() < 0 ? -1 : 1;
  Json j;
  j["xyz"] = point(T.p_mm, 5);
  j["quat"] = Json::array({number(sign * T.q.w(), 9), number(sign * T.q.x(), 9), number(sign * T.q.y(), 9), number(sign * T.q.z(), 9)});
  return j;
}

Json matrix(const Mat6& m) {
  Json rows = Json::array();
  for (int i = 0; i < 6; ++i) {
    Json row = Json::array();
    for (int k = 0; k < 6; ++k) row.push_back(significant(m(i, k), 6));
    rows.push_back(std::move(row));
  }
  return rows;
}

Json locate_json(const Location& l) {
  Json j;
  j["base_part"] = pose(l.T_base_part);
  j["covariance"] = matrix(l.covariance);
  j["rms"] = number(l.rms_mm, 5);
  j["inlier_ratio"] = number(l.inlier_ratio, 5);
  Json values = Json::array();
  for (const double v : l.singular_values) values.push_back(significant(v, 6));
  j["observability"] = {{"singular_values", values}, {"weak_directions", l.weak_directions}};
  // the tool poses for which base_part and adapted edges are commands, by feature
  j["tool_reference"] = Json::object();
  for (const auto& [feature, T] : l.T_base_tool_reference) j["tool_reference"][feature] = pose(T);
  j["hypotheses"] = Json::array();
  for (const Hypothesis& h : l.hypotheses)
    j["hypotheses"].push_back({{"base_part", pose(h.T_base_part)},
                               {"log_likelihood_ratio", significant(h.log_likelihood_ratio, 6)},
                               {"inlier_ratio", number(h.inlier_ratio, 5)},
                               {"note", h.note}});
  return j;
}

Json parameters(const std::map<std::string, double>& named) {
  Json j = Json::object();
  for (const auto& [name, value] : named) j[name] = number(value, 6);
  return j;
}

Json surface_json(const SurfaceFit& f) {
  Json j;
  j["face"] = f.face_id;
  j["type"] = f.type;
  j["nominal"] = parameters(f.nominal);
  j["fitted"] = parameters(f.fitted);
  j["rms"] = number(f.rms_mm, 5);
  j["points"] = f.points_count;
  return j;
}

Json burr_json(const EdgeBurr& b) {
  Json j;
  j["height"] = numbers(b.height_mm, 4);
  j["width"] = numbers(b.width_mm, 4);
  j["coverage"] = numbers(b.coverage_ratio, 3);
  j["height_sd"] = numbers(b.height_sd_mm, 4);
  j["height_upper"] = numbers(b.height_upper_mm, 4);
  j["area"] = numbers(b.area_mm2, 5);
  j["detection_limit"] = number(b.detection_limit_mm, 4);
  return j;
}

Json edge_json(const ItemRecord& r, std::size_t k) {
  const AdaptedEdge& e = r.features->edges[k];
  Json j;
  j["id"] = e.id;
  j["feature"] = e.feature;
  j["frame"] = "part";
  j["closed"] = e.is_closed;
  j["s"] = numbers(e.s_mm, 4);
  j["nominal"] = points(e.nominal, 5);
  j["adapted"] = points(e.adapted, 5);
  j["sigma"] = numbers(e.sigma_mm, 5);
  Json status = Json::array();
  for (const StationStatus s : e.status) status.push_back(std::string(name_of(s)));
  j["status"] = std::move(status);
  j["change"] = {{"rigid", numbers(e.rigid_mm, 5)}, {"feature", numbers(e.feature_mm, 5)}, {"local", numbers(e.local_mm, 5)}};
  j["surfaces"] = Json::array({surface_json(e.surface_1), surface_json(e.surface_2)});
  if (r.burrs && k < r.burrs->edges.size()) j["burr"] = burr_json(r.burrs->edges[k]);
  if (r.tool_path) {
    if (k < r.tool_path->edge_feed_mm_s.size()) j["feed"] = numbers(r.tool_path->edge_feed_mm_s[k], 3);
    if (k < r.tool_path->edge_passes_count.size()) j["passes"] = r.tool_path->edge_passes_count[k];
    if (k < r.tool_path->edge_probability_ratio.size()) j["probability_in_tolerance"] = number(r.tool_path->edge_probability_ratio[k], 5);
  }
  return j;
}

Json checks_json(const std::string& program, const Verdict& verdict) {
  Json rows = Json::array();
  for (const Check& c : verdict.checks)
    rows.push_back({{"program", program},
                    {"name", c.name},
                    {"measured", significant(c.measured, 6)},
                    {"limit", significant(c.limit, 6)},
                    {"unit", c.unit},
                    {"where", c.where},
                    {"pass", c.is_passed}});
  return rows;
}

Json verification_json(const ItemRecord& r) {
  const Verdict w = worst_verdict(r);
  Json j;
  j["path_error_max"] = number(w.path_error_max_mm, 5);
  j["clearance_min"] = least(w.clearance_min_mm, 4);
  j["joint_margin_min"] = w.joint_margin_min_rad > kUnknown ? Json(nullptr) : number(deg_from_rad(w.joint_margin_min_rad), 4);
  j["singularity_min"] = least(w.singularity_min_ratio, 6);
  j["speed_ratio_max"] = number(w.speed_ratio_max, 5);
  j["ok"] = w.is_ok();
  Json checks = Json::array();
  if (r.motion_verdict)
    for (Json& c : checks_json("planned", *r.motion_verdict)) checks.push_back(std::move(c));
  for (const ReleasedProgram& p : r.programs)
    for (Json& c : checks_json(std::string(name_of(p.text.language)), p.verdict)) checks.push_back(std::move(c));
  j["checks"] = std::move(checks);
  return j;
}

}  // namespace

Verdict worst_verdict(const ItemRecord& record) {
  Verdict w;
  const auto add = [&](const Verdict& v) {
    w.checks.insert(w.checks.end(), v.checks.begin(), v.checks.end());
    w.path_error_max_mm = std::max(w.path_error_max_mm, v.path_error_max_mm);
    w.clearance_min_mm = std::min(w.clearance_min_mm, v.clearance_min_mm);
    w.joint_margin_min_rad = std::min(w.joint_margin_min_rad, v.joint_margin_min_rad);
    w.singularity_min_ratio = std::min(w.singularity_min_ratio, v.singularity_min_ratio);
    w.speed_ratio_max = std::max(w.speed_ratio_max, v.speed_ratio_max);
    w.duration_s = std::max(w.duration_s, v.duration_s);
    w.points_count = std::max(w.points_count, v.points_count);
  };
  if (record.motion_verdict) add(*record.motion_verdict);
  for (const ReleasedProgram& p : record.programs) add(p.verdict);
  return w;
}

Json reasons_json(const std::vector<Refusal>& reasons) {
  Json rows = Json::array();
  for (const Refusal& r : reasons)
    rows.push_back({{"stage", r.stage},
                    {"code", r.code},
                    {"message", r.message},
                    {"value", significant(r.measured, 6)},
                    {"limit", significant(r.limit, 6)},
                    {"unit", r.unit},
                    {"where", r.where}});
  return rows;
}

Json result_document(const ItemRecord& r) {
  Json j;
  j["asbuilt"] = "result/1";
  j["item"] = r.item_id;
  j["batch"] = r.batch_id;
  j["status"] = std::string(name_of(r.status));
  j["reasons"] = reasons_json(r.reasons);
  j["notes"] = Json::array();
  for (const Note& n : r.notes)
    j["notes"].push_back({{"level", n.level == Note::Level::warning ? "warning" : "note"}, {"code", n.code}, {"text", n.text}, {"where", n.where}});
  if (r.location) j["locate"] = locate_json(*r.location);
  j["edges"] = Json::array();
  if (r.features)
    for (std::size_t k = 0; k < r.features->edges.size(); ++k) j["edges"].push_back(edge_json(r, k));
  if (r.features && r.burrs) {
    j["burr_by_feature"] = Json::array();
    for (const FeatureBurr& f : burr_by_feature(*r.features, *r.burrs))
      j["burr_by_feature"].push_back({{"feature", f.feature}, {"mean", number(f.mean_mm, 5)}, {"max", number(f.max_mm, 5)}, {"seen", number(f.seen_ratio, 4)}, {"bare", number(f.bare_ratio, 4)},
                                      {"stations", f.to_none.count}, {"independent_stations", number(f.to_none.count_effective, 1)}, {"standard_error", number(f.to_none.standard_error, 5)},
                                      {"equivalence", {{"to", "no burr"}, {"margin", number(f.to_none.margin, 3)}, {"p", number(f.to_none.p, 6)}, {"shown", f.to_none.is_equivalent}}}});
  }
  j["programs"] = Json::array();
  if (r.status == ItemStatus::emitted)
    for (const ReleasedProgram& p : r.programs) {
      Json files = Json::array();
      for (const ProgramFile& f : p.text.files) files.push_back({{"path", program_path(p.text, f)}, {"sha256", sha256_hex(f.bytes)}});
      j["programs"].push_back({{"language", std::string(name_of(p.text.language))},
                               {"files", std::move(files)},
                               {"points", p.verdict.points_count},
                               {"duration_s", number(p.verdict.duration_s, 3)}});
    }
  if (r.motion_verdict) j["verification"] = verification_json(r);
  j["inputs"] = Json::array();
  if (r.job)
    for (const InputFile& f : r.job->inputs) j["inputs"].push_back({{"path", f.path}, {"sha256", f.sha256}});
  j["version"] = version_text();
  j["timing_s"] = Json::object();
  for (const auto& [stage, time] : r.timing_s) j["timing_s"][stage] = number(time, 3);
  return j;
}

}  // namespace asbuilt
