// SPDX-License-Identifier: GPL-3.0-or-later
// fuse, locate, fit, burr, path, motion: one item up to that stage, and what it gave.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/app/commands.hpp"
#include "planner/base/number.hpp"

namespace asbuilt {

namespace {

double greatest(const std::vector<double>& values) {
  double m = 0;
  for (const double v : values)
    if (std::isfinite(v)) m = std::max(m, v);
  return m;
}

std::string fuse_text(const MeasuredCloud& cloud) {
  std::vector<std::vector<std::string>> rows{{"capture", "points", "noise mm", "spacing mm", "dropped", "outliers"}};
  for (const CloudCapture& c : cloud.captures)
    rows.push_back({c.name, fmt::format("{}", c.end - c.begin), fmt::format("{:.4f}", c.noise_mm), fmt::format("{:.3f}", c.spacing_mm), fmt::format("{}", c.dropped_count),
                    fmt::format("{}", c.outlier_count)});
  return text_table(rows) + fmt::format("{} points in base\n", cloud.p_base.size());
}

std::string locate_text(const Location& l) {
  const auto& T = l.T_base_part;
  std::string text = fmt::format("part in base: xyz {:.4f} {:.4f} {:.4f} mm, quat {:.7f} {:.7f} {:.7f} {:.7f}\n", T.p_mm.x(), T.p_mm.y(), T.p_mm.z(), T.q.w(), T.q.x(), T.q.y(), T.q.z());
  text += "1 sd (part axes):";
  for (int i = 0; i < 6; ++i) text += fmt::format(" {:.4f}{}", i < 3 ? std::sqrt(l.covariance(i, i)) : deg_from_rad(std::sqrt(l.covariance(i, i))), i < 3 ? " mm" : " deg");
  text += fmt::format("\nrms {:.4f} mm, inliers {:.1f} %\n", l.rms_mm, 100 * l.inlier_ratio);
  for (const std::string& w : l.weak_directions) text += "weak: " + w + "\n";
  for (std::size_t k = 1; k < l.hypotheses.size(); ++k)
    text += fmt::format("hypothesis {}: log likelihood {:.1f} below the best, inliers {:.1f} % {}\n", k + 1, l.hypotheses[k].log_likelihood_ratio, 100 * l.hypotheses[k].inlier_ratio, l.hypotheses[k].note);
  return text;
}

std::string fit_text(const Features& f) {
  std::vector<std::vector<std::string>> rows{{"edge", "feature", "length mm", "deviation max mm", "sigma max mm", "seen %", "rms mm"}};
  for (const AdaptedEdge& e : f.edges) {
    double deviation = 0;
    for (std::size_t i = 0; i < e.adapted.size(); ++i) deviation = std::max(deviation, (e.adapted[i] - e.nominal[i]).norm());
    const auto seen = std::count(e.status.begin(), e.status.end(), StationStatus::measured);
    rows.push_back({e.id, e.feature, fmt::format("{:.1f}", e.s_mm.empty() ? 0.0 : e.s_mm.back()), fmt::format("{:.3f}", deviation), fmt::format("{:.4f}", greatest(e.sigma_mm)),
                    fmt::format("{:.0f}", e.status.empty() ? 0.0 : 100.0 * static_cast<double>(seen) / static_cast<double>(e.status.size())),
                    fmt::format("{:.4f} {:.4f}", e.surface_1.rms_mm, e.surface_2.rms_mm)});
  }
  return text_table(rows);
}

std::string burr_text(const Burrs& burrs) {
  std::vector<std::vector<std::string>> rows{{"edge", "tallest mm", "widest mm", "seen %", "detection limit mm"}};
  for (const EdgeBurr& b : burrs.edges) {
    const auto seen = std::count_if(b.height_mm.begin(), b.height_mm.end(), [](double h) { return std::isfinite(h); });
    rows.push_back({b.edge_id, fmt::format("{:.3f}", greatest(b.height_mm)), fmt::format("{:.3f}", greatest(b.width_mm)),
                    fmt::format("{:.0f}", b.height_mm.empty() ? 0.0 : 100.0 * static_cast<double>(seen) / static_cast<double>(b.height_mm.size())), fmt::format("{:.3f}", b.detection_limit_mm)});
  }
  return text_table(rows);
}

std::string path_text(const ToolPath& path) {
  std::vector<std::vector<std::string>> rows{{"pass", "feature", "of", "points", "feed mm/s", "probability %"}};
  for (std::size_t k = 0; k < path.passes.size(); ++k) {
    const CutPass& p = path.passes[k];
    double lo = 1e9, hi = 0, least = 1;
    for (const PathPoint& q : p.points)
      if (q.kind == PathPointKind::cut) lo = std::min(lo, q.feed_mm_s), hi = std::max(hi, q.feed_mm_s), least = std::min(least, q.probability_ratio);
    rows.push_back({fmt::format("{}", k + 1), p.feature, fmt::format("{}/{}", p.pass, p.passes), fmt::format("{}", p.points.size()), fmt::format("{:.1f} to {:.1f}", lo, hi), fmt::format("{:.2f}", 100 * least)});
  }
  return text_table(rows);
}

std::string motion_text(const Motion& m) {
  std::vector<std::vector<std::string>> rows{{"segment", "pass", "points", "clearance mm"}};
  for (const MotionSegment& s : m.segments)
    rows.push_back({std::string(name_of(s.kind)), s.pass < 0 ? "" : fmt::format("{}", s.pass + 1), fmt::format("{}", s.q_rad.size()), s.clearance_mm < 1e8 ? fmt::format("{:.2f}", s.clearance_mm) : ""});
  return text_table(rows) + fmt::format("least clearance {:.2f} mm, joint margin {:.2f} deg, singularity {:.4f}, {:.1f} s\n", m.clearance_min_mm, deg_from_rad(m.joint_margin_min_rad),
                                        m.singularity_min_ratio, m.duration_s);
}

template <class T>
void put(const std::optional<T>& artefact, Json& json, std::string& text, std::string (*as_text)(const T&)) {
  if (!artefact) return;
  json = to_json(*artefact);
  text = as_text(*artefact);
}

}  // namespace

int stage_command(const StageArguments& a, Console& console) {
  InputsRecipe inputs{a.allow_outside, today_iso()};
  const auto batch = load_batch(a.batch, inputs);
  if (!batch) return console.complain(batch.error()), 2;
  const auto& items = batch->artefact.items;
  if (std::none_of(items.begin(), items.end(), [&](const BatchItem& i) { return i.id == a.item; })) {
    std::string all;
    for (const BatchItem& i : items) all += (all.empty() ? "" : ", ") + i.id;
    return console.complain("--item " + a.item + ": the batch has no such item; it has " + all), 2;
  }
  ItemOptions options{a.out, inputs, {}, own_code_tag(), a.stage};
  const ItemRecord r = run_item(batch->artefact, a.item, options, [&](const StageEvent& e) {
    if (e.what != StageEvent::What::begun)
      console.say(fmt::format("{}: {} in {:.2f} s, {:.0f} MiB", e.stage, name_of(e.what), e.time_s, e.peak_memory_mib));
    console.log({{"event", "stage"}, {"item", e.item}, {"stage", e.stage}, {"what", std::string(name_of(e.what))}, {"took_s", rounded(e.time_s, 3)}});
  });

  Json result;
  std::string text;
  if (a.stage == "fuse" && r.cloud) {
    result = {{"captures", to_json(r.cloud->captures)}, {"points", r.cloud->p_base.size()}};
    text = fuse_text(*r.cloud);
  }
  if (a.stage == "locate") put(r.location, result, text, locate_text);
  if (a.stage == "fit") put(r.features, result, text, fit_text);
  if (a.stage == "burr") put(r.burrs, result, text, burr_text);
  if (a.stage == "path") put(r.tool_path, result, text, path_text);
  if (a.stage == "motion") put(r.motion, result, text, motion_text);
  const bool is_done = r.reasons.empty();
  Json json{{"asbuilt", "stage/1"}, {"item", a.item}, {"stage", a.stage}, {"status", is_done ? "done" : std::string(name_of(r.status))}};
  json["reasons"] = to_json(r.reasons);
  json["notes"] = to_json(r.notes);
  json["result"] = result;
  for (const Note& n : r.notes) console.say((n.where.empty() ? "" : n.where + ": ") + n.text);
  for (const Refusal& why : r.reasons) console.complain(why.stage + ": " + refusal_text(why));
  console.answer(json, text);
  if (is_done) return 0;
  BatchLine line;
  line.status = r.status;
  line.reasons = r.reasons;
  return exit_status_of(line);
}

}  // namespace asbuilt
