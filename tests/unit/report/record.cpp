// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/unit/report/record.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "planner/base/random.hpp"

namespace asbuilt::test {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInner = 120, kOuter = 150, kLug = 166, kHeight = 40;
constexpr int kLugs = 8, kSteps = 576;

bool is_lug(int step) {
  const double a = std::fmod(360.0 * step / kSteps + 360, 360.0 / kLugs);
  return a > 12 && a < 33;
}

Vec3 at(double radius, int step, double z) {
  const double a = 2 * kPi * step / kSteps;
  return {radius * std::cos(a), radius * std::sin(a), z};
}

Brep ring_brep() {
  Brep b;
  b.units = "mm";
  b.solids_count = 1;
  Mesh& m = b.mesh;
  for (int i = 0; i < kSteps; ++i)
    for (const auto& [inner, z] : {std::pair{true, 0.0}, {true, kHeight}, {false, 0.0}, {false, kHeight}})
      m.vertices.push_back(at(inner ? kInner : is_lug(i) ? kLug : kOuter, i, z));
  for (int i = 0; i < kSteps; ++i) {
    const int a = 4 * i, c = 4 * ((i + 1) % kSteps);
    const auto quad = [&](int p, int q, int r, int s) { m.triangles.push_back({p, q, r}), m.triangles.push_back({p, r, s}); };
    quad(a + 1, a + 3, c + 3, c + 1);  // top
    quad(a, c, c + 2, a + 2);          // bottom
    quad(a + 2, c + 2, c + 3, a + 3);  // outside
    quad(a, a + 1, c + 1, c);          // inside
  }
  for (const double z : {0.0, kHeight})
    for (const bool inner : {true, false}) {
      BrepEdge e;
      e.id = fmt::format("#{}", 100 + b.edges.size());
      e.kind = EdgeKind::sharp_convex;
      e.is_closed = true;
      for (int i = 0; i <= kSteps; ++i) e.p.push_back(at(inner ? kInner : is_lug(i % kSteps) ? kLug : kOuter, i, z));
      b.edges.push_back(e);
    }
  for (const Vec3& v : m.vertices) b.box.extend(v);
  return b;
}

}  // namespace

ItemRecord ring_record() {
  ItemRecord r;
  Random random(7);
  r.batch_id = "night-2026-11-22";
  r.item_id = "ring-0001";
  r.status = ItemStatus::emitted;
  Job job;
  job.batch_id = r.batch_id;
  job.item_id = r.item_id;
  job.taken = "2026-11-22";
  job.cell.robot.model = "six-axis 2.1 m";
  job.cell.controller.language = Language::krl;
  job.part.id = "bearing-ring";
  job.part.material = "1.4545";
  job.part.brep = ring_brep();
  Recipe recipe;
  recipe.id = "deburr-0.4";
  recipe.width_mm = 0.4, recipe.tolerance_mm = 0.1, recipe.feed_min_mm_s = 4, recipe.feed_max_mm_s = 25, recipe.burr_max_height_mm = 1.5;
  job.recipes = {recipe};
  job.inputs = {{"bearing_ring.step", std::string(64, 'a')}, {"part.yaml", std::string(64, 'b')}, {"ring-0001/wide_00.ply", std::string(64, 'c')}};
  Features features;
  Burrs burrs;
  ToolPath path;
  Motion motion;
  for (int lug = 0; lug < kLugs; ++lug) {
    job.part.features.push_back({fmt::format("lug{}", lug + 1), recipe.id, {}});
    AdaptedEdge e;
    e.id = fmt::format("#{}", 417 + lug);
    e.feature = job.part.features.back().id;
    EdgeBurr burr;
    burr.edge_id = e.id;
    burr.detection_limit_mm = 0.06;
    CutPass pass;
    pass.feature = e.feature, pass.recipe = recipe.id, pass.tool = "cone", pass.edges = {lug};
    std::vector<double> feed;
    const double start = (45.0 * lug + 12.5) * kPi / 180, length = 20 * kPi / 180 * kLug;
    const double blob = random.uniform(0.2, 0.8), tall = random.uniform(0.3, 1.2);
    const int stations = static_cast<int>(length / 0.5) + 1;
    for (int k = 0; k < stations; ++k) {
      const double s = length * k / (stations - 1), a = start + s / kLug, x = s / length;
      const Vec3 out(std::cos(a), std::sin(a), 0), up(0, 0, 1);
      e.s_mm.push_back(s);
      e.nominal.push_back(kLug * out + kHeight * up);
      e.tangent.push_back(Vec3(-std::sin(a), std::cos(a), 0));
      e.n_1.push_back(up), e.n_2.push_back(out);
      const double feature = 0.09 + 0.02 * lug, local = 0.05 * std::sin(9 * x + lug) + 0.01 * std::sin(40 * x);
      e.adapted.push_back(e.nominal.back() + (feature + local) * out + 0.06 * std::cos(3 * x) * up);
      e.rigid_mm.push_back(0.03 * std::cos(2 * x)), e.feature_mm.push_back(feature), e.local_mm.push_back(std::abs(local));
      e.sigma_mm.push_back(0.008 + 0.01 * std::pow(2 * x - 1, 4));
      e.covariance.push_back(Mat3::Identity() * 1e-4);
      e.status.push_back(x > 0.97 ? StationStatus::extrapolated : StationStatus::measured);
      const double h = tall * std::exp(-50 * (x - blob) * (x - blob)) + 0.12 * (1 + std::sin(14 * x + lug)) + 0.01 * random.normal();
      const bool is_seen = !(lug == 2 && x > 0.55 && x < 0.68);
      burr.height_mm.push_back(is_seen ? std::max(0.0, h) : kNaN);
      burr.height_sd_mm.push_back(is_seen ? 0.02 : kNaN);
      burr.width_mm.push_back(is_seen ? 0.05 + 0.12 * std::max(0.0, h) : kNaN);
      burr.area_mm2.push_back(is_seen ? 0.05 * h : kNaN);
      burr.height_upper_mm.push_back(is_seen ? h + 0.04 : 1.5);
      burr.coverage_ratio.push_back(is_seen ? 0.95 : 0);
      feed.push_back(std::max(4.0, 25 / (1 + 2.5 * (is_seen ? h : 1.5))));
      PathPoint p;
      p.tip_part = e.adapted.back() - 2 * up + 1.2 * out;
      p.feed_mm_s = feed.back(), p.s_mm = s, p.leg_1_mm = p.leg_2_mm = 0.4, p.probability_ratio = 0.9995 - 0.002 * std::pow(2 * x - 1, 8);
      pass.points.push_back(p);
    }
    MotionSegment down{SegmentKind::approach, lug, {}, {}, {}, 0, 11.0}, cut{SegmentKind::cut, lug, {}, {}, {}, 0, 7.5 + lug};
    for (double z : {80.0, 20.0, 0.0}) down.T_base_tool.push_back({Eigen::Quaterniond::Identity(), Vec3(1200, -300, 800) + pass.points.front().tip_part + Vec3(0, 0, z)});
    motion.segments.push_back(down), motion.segments.push_back(cut);
    e.surface_1 = {1, "#12", "plane", {{"nx", 0}, {"ny", 0}, {"nz", 1}, {"d", 40}}, {{"nx", 0.0004}, {"ny", -0.0002}, {"nz", 1}, {"d", 40.061}}, {}, true, 0.021, 4180};
    e.surface_2 = {2, "#13", "cylinder", {{"radius", 166}}, {{"radius", 166.093}}, {}, true, 0.024, 2210};
    features.edges.push_back(e), burrs.edges.push_back(burr), path.passes.push_back(pass);
    path.edge_feed_mm_s.push_back(feed), path.edge_passes_count.push_back(lug % 3 == 1 ? 2 : 1), path.edge_probability_ratio.push_back(0.9991 - 0.0003 * lug);
  }
  Location location;
  location.T_base_part = {quat_from_zyx(0.61, 0.01, -0.004), Vec3(1200, -300, 800)};
  location.covariance.diagonal() << 4e-4, 4e-4, 2e-4, 1e-8, 1e-8, 4e-8;
  location.rms_mm = 0.0312, location.inlier_ratio = 0.943;
  location.singular_values = {812.2, 640.1, 255.8, 98.4, 44.2, 6.31};
  location.weak_directions = {"rotation about the part's z axis: 0.011 deg (1 sd)"};
  location.hypotheses = {{location.T_base_part, 0, 0.943, ""}, {location.T_base_part, 418.2, 0.871, "rotated 45.0 deg about the symmetry axis"}};
  motion.clearance_min_mm = 7.5;
  Verdict verdict;
  verdict.path_error_max_mm = 0.0021, verdict.clearance_min_mm = 7.41, verdict.joint_margin_min_rad = 0.31, verdict.singularity_min_ratio = 0.082;
  verdict.speed_ratio_max = 0.63, verdict.duration_s = 148.2, verdict.points_count = 1284;
  verdict.checks = {{"path_error", 0.0021, 0.01, "mm", "pass 3 at 12.5 mm", true}, {"clearance.tool", 7.41, 3, "mm", "approach of lug5", true},
                    {"chamfer.leg", 0.0431, 0.1, "mm", "#419 at 44.0 mm", true}, {"joint.margin", 17.8, 1.15, "deg", "axis 5", true}};
  r.motion_verdict = verdict;
  for (const auto& [language, name] : {std::pair{Language::krl, "ring_0001.src"}, {Language::inform, "RING0001.JBI"}, {Language::beckhoff, "ring_0001.nc"}}) {
    Verdict v = verdict;
    for (int k = 1; k < 9; ++k) v.checks.push_back({fmt::format("lint.{}-0{}", language == Language::krl ? "K" : language == Language::inform ? "I" : "B", k), 0, 0, "lines", "", true});
    r.programs.push_back({{language, {{name, std::string("program ") + name + "\r\n"}}}, v});
  }
  r.job = job, r.features = features, r.burrs = burrs, r.tool_path = path, r.motion = motion, r.location = location;
  r.notes = {{Note::Level::note, "input.points_dropped", "23 points without finite coordinates were dropped", "wide_01.ply"},
             {Note::Level::warning, "burr.not_seen", "the burr was not seen from 32.0 to 39.5 mm; feed and clearance assume the tallest the recipe allows", "edge #419"}};
  r.timing_s = {{"input", 0.41}, {"fuse", 1.9}, {"locate", 3.2}, {"fit", 0.8}, {"burr", 0.6}, {"path", 0.4}, {"motion", 5.1}, {"program", 0.01}, {"verify", 4.4}, {"post", 0.2}};
  r.peak_memory_mib = {{"input", 210}, {"fuse", 480}, {"locate", 505}, {"motion", 320}};
  return r;
}

ItemRecord refused_record() {
  ItemRecord r = ring_record();
  r.status = ItemStatus::refused;
  r.reasons = {{.code = "fit.edge_not_seen",
                .where = "edge #419 of lug3, 12.0 to 31.5 mm",
                .message = "Edge #419 of lug3 was not scanned over 19.5 mm (34 % of it; 5 % may be missing): add a detail scan of lug3 from outside, about 30 degrees from above, and run the batch again.",
                .measured = 34,
                .limit = 5,
                .unit = "%",
                .stage = "fit"}};
  r.programs.clear();
  r.features.reset(), r.burrs.reset(), r.tool_path.reset(), r.motion.reset(), r.motion_verdict.reset();
  return r;
}

}  // namespace asbuilt::test
