// SPDX-License-Identifier: GPL-3.0-or-later
// calibrate: captures -> calibration file and report; with --check: does the sensor still see the target where it should.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "planner/app/commands.hpp"
#include "planner/base/number.hpp"
#include "planner/calibrate/calibrate.hpp"
#include "planner/calibrate/check.hpp"
#include "planner/calibrate/profilometer_job.hpp"
#include "planner/inputs/dates.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/io/file.hpp"
#include "planner/pipeline/store.hpp"

namespace asbuilt {

namespace {

template <class A, class B>
Json pose_json(const Pose<A, B>& T) {
  return {{"xyz", {rounded(T.p_mm.x(), 6), rounded(T.p_mm.y(), 6), rounded(T.p_mm.z(), 6)}},
          {"quat", {rounded(T.q.w(), 10), rounded(T.q.x(), 10), rounded(T.q.y(), 10), rounded(T.q.z(), 10)}}};
}

Json matrix_json(const Mat6& m) {
  Json rows = Json::array();
  for (int i = 0; i < 6; ++i) {
    Json row = Json::array();
    for (int k = 0; k < 6; ++k) row.push_back(m(i, k));
    rows.push_back(row);
  }
  return rows;
}

Json report_json(const CalibrationRequest& job, const CalibrationResult& r, const std::vector<Note>& notes) {
  const Calibrated& c = r.solved;
  const NetworkSolution& s = c.solution;
  Json j{{"asbuilt", "calibration-report/1"},
         {"subject", job.subject == CalibrationRequest::Subject::tool ? "tool" : job.subject == CalibrationRequest::Subject::robot ? "robot" : job.is_sensor_fixed ? "fixed sensor" : "sensor"},
         {"id", job.id},
         {"pose", pose_json(r.T_flange_sensor)},
         {"covariance", matrix_json(r.covariance)},
         {"unit", c.unit},
         {"held_out", {{"rms_mm", c.held_out_rms_mm}, {"rms", c.held_out_rms}, {"mean", c.held_out_mean}, {"max", c.held_out_max}, {"turn_deg", deg_from_rad(c.held_out_rad)}, {"expected", c.held_out_expected}}},
         {"fit_rms", c.fit_rms},
         {"dof", s.dof},
         {"sensor_sd", s.sensor_sd},
         {"robot_sd_mm", s.robot_sd_mm},
         {"robot_sd_deg", deg_from_rad(s.robot_sd_rad)},
         {"point_sd_mm", c.point_sd_mm},
         {"turn_sd_deg", deg_from_rad(c.turn_sd_rad)}};
  for (const WeakDirection& w : c.weak) j["weak"].push_back({{"text", w.text}, {"sd", w.sd}, {"unit", w.unit}, {"point_mm", w.point_mm}});
  for (const StartLine& l : c.starts)
    j["starts"].push_back({{"method", l.method}, {"off_mm", l.from_best_mm}, {"off_deg", deg_from_rad(l.from_best_rad)}, {"ended_mm", l.end_mm}});
  for (const ViewLine& v : c.views)
    j["views"].push_back({{"name", v.name}, {"held_out_always", v.is_held_out}, {"used", v.is_used}, {"residual", v.residual_rms}, {"held_out", v.held_out_rms}, {"expected", v.expected_rms},
                          {"robot_mm", v.robot_mm}, {"robot_deg", deg_from_rad(v.robot_rad)}, {"leverage", v.leverage_ratio}});
  for (const SeenLine& l : r.seen) j["seen"].push_back({{"name", l.name}, {"seen", l.is_seen}, {"text", l.text}});
  if (r.scale_ratio) j["scale"] = {{"ratio", *r.scale_ratio}, {"sd", *r.scale_sd_ratio}};
  if (r.length_ratio) j["length"] = {{"ratio", *r.length_ratio}, {"sd", *r.length_sd_ratio}};
  if (r.radius_mm) j["radius"] = {{"mm", *r.radius_mm}, {"sd", *r.radius_sd_mm}};
  if (r.camera) j["intrinsics"] = *r.camera;
  for (const ArmLine& l : r.arm) j["arm"].push_back({{"name", l.name}, {"unit", l.unit}, {"value", l.value}, {"sd", l.sd}, {"sd_before", l.sd_before}, {"held", l.is_held}});
  for (const std::string& d : r.arm_held) j["arm_not_told"].push_back(d);
  if (r.drift)
    j["drift"] = {{"file", r.drift->file}, {"created", r.drift->created}, {"shift_mm", r.drift->shift_mm}, {"shift_sd_mm", r.drift->shift_sd_mm}, {"turn_deg", deg_from_rad(r.drift->turn_rad)},
                  {"turn_sd_deg", deg_from_rad(r.drift->turn_sd_rad)}, {"probability", r.drift->probability_ratio}};
  for (const PoseToAdd& p : c.poses_to_add) j["poses_to_add"].push_back({{"base_flange", pose_json(p.T_base_flange)}, {"point_sd_mm", p.point_sd_mm}, {"turn_sd_deg", deg_from_rad(p.turn_sd_rad)}});
  for (const Note& n : notes) j["notes"].push_back({{"level", n.level == Note::Level::warning ? "warning" : "note"}, {"code", n.code}, {"text", n.text}, {"where", n.where}});
  return j;
}

CalibrationEntry entry_of(const CalibrationRequest& job, const CalibrationResult& r) {
  const NetworkSolution& s = r.solved.solution;
  CalibrationEntry e;
  e.subject = job.subject, e.id = job.id, e.is_sensor_fixed = job.is_sensor_fixed;
  e.T_flange_sensor = r.T_flange_sensor, e.covariance = r.covariance;
  e.rms_mm = r.accuracy_mm;
  for (const ViewLine& v : r.solved.views) e.captures_count += v.is_used;
  e.camera = r.camera, e.arm = r.arm_additions;
  e.created = job.taken;
  e.held_out_mm = r.accuracy_mm, e.fit_rms = r.solved.fit_rms, e.noise = s.sensor_sd, e.robot_sd_mm = s.robot_sd_mm, e.robot_sd_rad = s.robot_sd_rad, e.dof = s.dof;
  e.files = job.inputs, e.references = r.references;
  return e;
}

std::string note_text(const std::vector<Note>& notes) {
  std::string t;
  for (const Note& n : notes) t += fmt::format("{}: {} [{}]\n", n.level == Note::Level::warning ? "warning" : "note", n.text, n.code);
  return t;
}

int status_of(const Refusals& refusals) {
  // a capture that is well-formed but does not make a calibration is a refusal; all else is a file to be mended
  return std::all_of(refusals.begin(), refusals.end(), [](const Refusal& r) { return r.code.rfind("calibrate.", 0) == 0; }) ? 3 : 2;
}

int check(const CalibrateArguments& a, const CalibrationRequest& job, Console& console) {
  const auto earlier = load_earlier(a.check, job.subject, job.is_sensor_fixed, job.id);
  if (!earlier) return console.complain(earlier.error()), 2;
  const auto made = inputs::day_number(earlier->created), day = inputs::day_number(job.taken);
  if (made && day && *day - *made > earlier->valid_days) {
    console.complain(Refusals{{.code = "calibrate.expired",
                               .where = a.check,
                               .message = fmt::format("found a calibration of {} that is {} days old on {}, allowed {} days; calibrate again", earlier->created, *day - *made, job.taken, earlier->valid_days),
                               .measured = double(*day - *made),
                               .limit = double(earlier->valid_days),
                               .unit = "days",
                               .stage = "input"}});
    return 3;
  }
  CalibrationRequest seen = job;
  std::vector<Note> notes;
  if (job.target.kind == TargetKind::hole_plate) {
    auto poses = plate_poses(job, *earlier);
    if (!poses) return console.complain(poses.error()), status_of(poses.error());
    seen = std::move(poses->artefact), notes = std::move(poses->notes);
  }
  auto checked = check_calibration(seen, *earlier);
  if (checked) checked->notes.insert(checked->notes.begin(), notes.begin(), notes.end());
  if (!checked) return console.complain(checked.error()), status_of(checked.error());
  const CheckResult& r = checked->artefact;
  Json j{{"asbuilt", "calibration-check/1"}, {"id", job.id}, {"calibration", a.check}, {"age_days", made && day ? *day - *made : 0}, {"probability", r.probability_ratio}, {"captures", Json::array()}};
  for (const CheckLine& l : r.lines)
    j["captures"].push_back({{"name", l.name}, {"reference", l.reference}, {"same_pose", l.is_same_pose}, {"shift_mm", l.shift_mm}, {"shift_sd_mm", l.shift_sd_mm}, {"turn_deg", deg_from_rad(l.turn_rad)},
                             {"turn_sd_deg", deg_from_rad(l.turn_sd_rad)}, {"probability", l.probability_ratio}, {"would_see_mm", l.shift_seen_mm}, {"would_see_deg", deg_from_rad(l.turn_seen_rad)}});
  if (r.length_ratio) j["length"] = {{"ratio", *r.length_ratio}, {"sd", *r.length_sd_ratio}};
  if (r.move_ratio) j["move"] = {{"ratio", *r.move_ratio}, {"sd", *r.move_sd_ratio}};
  console.answer(j, check_report(job, r) + note_text(checked->notes));
  return 0;
}

int write_calibration(const CalibrateArguments& a, const std::string& text, Console& console) {
  if (auto written = write_file(a.out, text); !written) return console.complain(written.error()), 2;
  if (const Refusals faults = check_file("calibration", a.out); !faults.empty()) return console.complain(faults), 1;  // what we write we can read
  console.say("calibration: " + a.out);
  return 0;
}

Json hole_plate_json(const CalibrationRequest& job, const ProfilometerResult& r, const std::vector<Note>& notes) {
  const ProfilometerCalibration& c = r.solved;
  const auto vec = [](const Vec3& v) { return Json{v.x(), v.y(), v.z()}; };
  Json j{{"asbuilt", "calibration-report/1"},
         {"subject", "sensor"},
         {"id", job.id},
         {"pose", pose_json(r.T_flange_sensor)},
         {"covariance", matrix_json(r.covariance)},
         {"unit", "mm"},
         {"held_out", {{"rms_mm", vec(c.held_out_rms_mm)}, {"chi2", c.held_out_chi2_ratio}}},
         {"fit_rms_mm", vec(c.fit_rms_mm)},
         {"field_sd_mm", {{"median", vec(c.field.median_sd_mm)}, {"max", vec(c.field.max_sd_mm)}, {"form", c.field.form_sd_mm}}},
         {"latency_s", {{"value", c.state.latency_s}, {"sd", c.latency_sd_s}}},
         {"robot_scale", c.robot_scale_ratio},
         {"holes", c.hole_count},
         {"outliers", c.outlier_count},
         {"restarts", c.restart_count},
         {"parameters", Json::array()},
         {"parameters_covariance", Json::array()},
         {"not_told", Json::array()},
         {"poses", Json::array()},
         {"notes", Json::array()}};
  const Eigen::VectorXd& values = c.state.intrinsics.values;
  for (std::size_t i = 0; i < c.parameters.size(); ++i) {
    const auto at = Eigen::Index(i);
    Json p{{"name", c.parameters[i]}, {"sd", std::sqrt(std::max(0.0, c.covariance(at, at)))}};
    if (at < values.size()) p["value"] = values[at];
    j["parameters"].push_back(p);
    Json row = Json::array();
    for (Eigen::Index k = 0; k < c.covariance.cols(); ++k) row.push_back(c.covariance(at, k));
    j["parameters_covariance"].push_back(row);
  }
  for (const OpenDirection& d : c.open) j["not_told"].push_back({{"text", d.name}, {"prior_share", d.prior_share_ratio}, {"field_mm", d.field_mm}});
  for (const PoseQuality& p : c.poses)
    j["poses"].push_back({{"name", p.name}, {"held_out", p.is_held_out}, {"left_out", p.is_left_out}, {"holes", p.hole_count}, {"rms_mm", vec(p.rms_target_mm)}, {"robot_mm", p.robot_mm},
                          {"robot_deg", deg_from_rad(p.robot_rad)}});
  for (const Note& n : notes) j["notes"].push_back({{"level", n.level == Note::Level::warning ? "warning" : "note"}, {"code", n.code}, {"text", n.text}, {"where", n.where}});
  return j;
}

int hole_plate(const CalibrateArguments& a, const CalibrationRequest& job, std::vector<Note> notes, Console& console) {
  auto made = calibrate_hole_plate(job);
  if (!made) return console.complain(made.error()), status_of(made.error());
  notes.insert(notes.end(), made->notes.begin(), made->notes.end());
  const ProfilometerResult& r = made->artefact;
  CalibrationEntry e;
  e.subject = job.subject, e.id = job.id, e.T_flange_sensor = r.T_flange_sensor, e.covariance = r.covariance;
  e.rms_mm = r.accuracy_mm, e.captures_count = int(job.captures.size()), e.profile_map = r.map, e.created = job.taken;
  e.held_out_mm = r.accuracy_mm, e.fit_rms = r.solved.fit_rms_mm.norm(), e.noise = r.noise_mm;
  e.robot_sd_mm = job.robot_sd_mm * r.solved.robot_scale_ratio, e.robot_sd_rad = job.robot_sd_rad * r.solved.robot_scale_ratio;
  e.dof = int(3 * r.solved.hole_count) - int(r.solved.parameters.size());
  e.files = job.inputs, e.references = r.references;
  if (const int status = write_calibration(a, calibration_yaml(job.cell_file, job.valid_days, e, job.earlier_others), console)) return status;
  console.answer(hole_plate_json(job, r, notes), hole_plate_report(job, r) + note_text(notes));
  return 0;
}

}  // namespace

int calibrate_command(const CalibrateArguments& a, Console& console) {
  if (a.out.empty() && a.check.empty()) return console.complain("calibrate: found neither --out nor --check, allowed one of them"), 2;
  auto loaded = load_captures(a.captures, {a.allow_outside, today_iso()});
  if (!loaded) return console.complain(loaded.error()), 2;
  const CalibrationRequest& job = loaded->artefact;
  std::vector<Note> notes = loaded->notes;
  if (!a.check.empty()) return check(a, job, console);
  if (job.target.kind == TargetKind::hole_plate) return hole_plate(a, job, std::move(notes), console);
  auto made = calibrate(job);
  if (!made) return console.complain(made.error()), status_of(made.error());
  notes.insert(notes.end(), made->notes.begin(), made->notes.end());
  const CalibrationResult& r = made->artefact;
  const std::string text = calibration_yaml(job.cell_file, job.valid_days, entry_of(job, r), job.earlier_others);
  if (const int status = write_calibration(a, text, console)) return status;
  console.answer(report_json(job, r, notes), calibration_report(job, r) + note_text(notes));
  return 0;
}

}  // namespace asbuilt
