// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/inspection_json.hpp"

#include <cmath>

#include "planner/base/archive.hpp"
#include "planner/base/hash.hpp"
#include "planner/base/number.hpp"

namespace asbuilt {

namespace {

Json numbers(const std::vector<double>& values, int decimals) {
  Json a = Json::array();
  for (const double v : values) a.push_back(std::isfinite(v) ? Json(rounded(v, decimals)) : Json(nullptr));
  return a;
}
Json joints(const JointVector& q_rad) {
  Json a = Json::array();
  for (const double q : q_rad) a.push_back(rounded(deg_from_rad(q), 6));
  return a;
}
double degrees(double rad) { return rounded(deg_from_rad(rad), 4); }

}  // namespace

std::string inspection_json(const InspectionView& v) {
  Json j{{"asbuilt", "inspection/1"}, {"batch", v.batch_id}, {"item", v.item_id}, {"status", std::string(name_of(v.status))}};
  j["reasons"] = to_json(v.reasons);
  j["notes"] = to_json(v.notes);
  if (v.location) j["base_part"] = to_json(v.location->T_base_part);
  if (v.inspection && v.job) {
    const Inspection& i = *v.inspection;
    j["assumed"] = i.assumed;
    j["aim_margin"] = rounded(i.aim_margin_mm, 3);
    j["views"] = Json::array();
    for (const ScanView& w : i.views) {
      const SensorSpec& sensor = v.job->cell.sensors[static_cast<std::size_t>(w.sensor)];
      Json row{{"name", w.name}, {"sensor", sensor.id}, {"kind", std::string(name_of(w.kind))}, {"feature", w.feature}, {"edge", w.edge}};
      row["stretch"] = numbers({w.s_from_mm, w.s_to_mm}, 3);
      row["tilt"] = degrees(w.tilt_rad), row["turn"] = degrees(w.turn_rad), row["distance"] = rounded(w.distance_mm, 3);
      row["joints"] = joints(w.q_rad);
      row["base_flange"] = to_json(w.T_base_flange), row["base_sensor"] = to_json(w.T_base_flange * sensor.T_flange_sensor);
      row["clearance"] = rounded(w.clearance_mm, 3), row["joint_margin"] = degrees(w.joint_margin_rad), row["edges"] = w.edges, row["edges_share"] = numbers(w.edges_ratio, 4);
      j["views"].push_back(std::move(row));
    }
    j["edges"] = Json::array();
    for (const EdgeForecast& f : i.edges) {
      Json row{{"id", f.id}, {"feature", f.feature}, {"frame", "part"}};
      row["coverage"] = rounded(f.coverage_ratio, 4), row["coverage_working"] = rounded(f.coverage_working_ratio, 4), row["coverage_normal"] = rounded(f.coverage_normal_ratio, 4);
      row["sd_worst"] = rounded(f.sd_worst_mm, 4), row["sd_limit"] = f.sd_limit_mm > 0 ? Json(rounded(f.sd_limit_mm, 4)) : Json(nullptr), row["share"] = rounded(f.share_ratio, 4);
      row["s"] = numbers(f.s_mm, 3), row["p"] = to_json(f.p_part);
      row["points_1"] = numbers(f.points_1_count, 1), row["points_2"] = numbers(f.points_2_count, 1), row["views"] = f.views_count;
      row["seen_working"] = f.seen_working, row["seen_normal"] = f.seen_normal, row["sd"] = numbers(f.sd_mm, 4);
      j["edges"].push_back(std::move(row));
    }
    j["tried"] = Json::array();
    for (const TriedView& t : i.tried)
      j["tried"].push_back({{"edge", t.edge}, {"sensor", t.sensor}, {"kind", std::string(name_of(t.kind))}, {"stretch", numbers({t.s_from_mm, t.s_to_mm}, 3)}, {"tilt", degrees(t.tilt_rad)},
                            {"distance", rounded(t.distance_mm, 3)}, {"turns", t.turns_count}, {"outcome", t.outcome}, {"measured", rounded(t.measured, 4)}, {"limit", rounded(t.limit, 4)}, {"unit", t.unit}});
    j["tour"] = {{"duration_s", rounded(i.motion.duration_s, 3)}, {"clearance_min", rounded(i.motion.clearance_min_mm, 3)}, {"joint_margin_min", degrees(i.motion.joint_margin_min_rad)}};
  }
  if (!v.programs.empty()) {
    j["programs"] = Json::array();
    for (const ReleasedProgram& p : v.programs) {
      Json files = Json::array();
      for (const ProgramFile& f : p.text.files) files.push_back({{"path", "programs/" + std::string(name_of(p.text.language)) + "/" + f.name}, {"sha256", sha256_hex(f.bytes)}});
      j["programs"].push_back({{"language", std::string(name_of(p.text.language))}, {"files", files}, {"points", p.verdict.points_count}, {"duration_s", rounded(p.verdict.duration_s, 3)},
                               {"clearance_min", rounded(p.verdict.clearance_min_mm, 3)}, {"joint_margin_min", degrees(p.verdict.joint_margin_min_rad)}, {"ok", p.verdict.is_ok()}});
    }
  }
  return j.dump(1) + "\n";
}

std::string scans_text(const Job& job, const Inspection& inspection, const std::vector<JointVector>& stops) {
  std::string t = "asbuilt: scans/1\nitem: " + job.item_id + "\ncaptures:\n";
  for (std::size_t k = 0; k < inspection.views.size() && k < stops.size(); ++k) {
    const ScanView& v = inspection.views[k];
    t += "- sensor: " + job.cell.sensors[static_cast<std::size_t>(v.sensor)].id + "\n  cloud: " + v.name + ".ply\n  base_flange: {joints: [";
    for (std::size_t i = 0; i < 6; ++i) t += (i ? ", " : "") + shortest_number(rounded(deg_from_rad(stops[k][i]), 6));
    t += "]}\n  feature: " + v.feature + "\n";
  }
  return t;
}

}  // namespace asbuilt
