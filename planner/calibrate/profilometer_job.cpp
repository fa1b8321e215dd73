// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/profilometer_job.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/calibrate/profilometer_holes.hpp"
#include "planner/calibrate/profilometer_observe.hpp"
#include "planner/calibrate/profilometer_start.hpp"

namespace asbuilt {

namespace {

std::optional<Refusal> unfit(const CalibrationRequest& job) {
  if (job.subject == CalibrationRequest::Subject::sensor && !job.is_sensor_fixed && job.is_profile_sensor && job.target.plate) return std::nullopt;
  return Refusal{.code = "calibrate.target_not_supported",
                 .where = "target.kind",
                 .message = "found a plate with holes for something that is no line scanner on the flange, allowed: a sensor of kind profile; take another target, or correct the cell",
                 .stage = "input"};
}

HolePlate plate_of(const CalibrationRequest& job) {
  HolePlate plate = *job.target.plate;
  plate.name = "target";
  return plate;
}

/// The plate's pose from one pass alone, and how well the pass tells it.
struct PlateSeen {
  TargetPose T_base_target;
  Mat6 covariance = Mat6::Zero();  // child frame, t then r
  std::size_t hole_count = 0;
};
PlateSeen plate_seen(const HolePlate& plate, const HoleView& view, const ProfilometerState& state) {
  PlateSeen out;
  const std::vector<PoseGroup> group{{view.name, {&view}, view.is_held_out}};
  out.T_base_target = plate_pose(plate, group, state), out.hole_count = view.holes.size();
  // plain point-to-point: each hole's scatter, as it is seen
  ProfilometerState at = state;
  at.T_base_target = out.T_base_target;
  const PassResiduals r = residuals_of(plate, view, at, false, false);
  Vec3 square = Vec3::Zero();
  for (std::size_t j = 0; j < view.holes.size(); ++j) square += r.r.segment<3>(3 * Eigen::Index(j)).cwiseAbs2();
  const double n = double(view.holes.size());
  const double var = square.sum() / std::max(1.0, 3 * n - 6);
  Mat6 H = Mat6::Zero();
  for (const HoleSighting& h : view.holes) {
    Eigen::Matrix<double, 3, 6> J;
    J << Mat3::Identity(), -skew(hole_center(plate, h.column, h.row));
    H += J.transpose() * J;
  }
  out.covariance = var * H.ldlt().solve(Mat6::Identity());
  return out;
}

FlangePose middle_of(const ProfileScan& scan) { return scan.T_base_flange[scan.T_base_flange.size() / 2]; }

/// A pass with a calibration given -> its holes, placed by cones.
Result<HoleView> holes_of(const ProfileScan& scan, const HolePlate& plate, ProfilometerState state) {
  const auto blobs = find_holes(scan);
  if (!blobs) return tl::unexpected(blobs.error());
  const auto numbers = number_holes(plate, *blobs, scan.name);
  if (!numbers) return tl::unexpected(numbers.error());
  const HoleView rough = rough_view(scan, plate, *blobs, *numbers);
  state.T_base_target = plate_pose(plate, {{rough.name, {&rough}, false}}, state);
  return fit_cones(scan, plate, *blobs, *numbers, state).view;
}

std::vector<Vec2> box_of(const std::vector<const ProfileScan*>& scans) {
  Vec2 lo = Vec2::Constant(1e300), hi = Vec2::Constant(-1e300);
  for (const ProfileScan* s : scans)
    for (std::size_t i = 0; i < s->uv.size(); i += 1 + s->uv.size() / 5000) {
      const Vec2 uv = s->uv[i].cast<double>();
      if (uv.allFinite()) lo = lo.cwiseMin(uv), hi = hi.cwiseMax(uv);
    }
  std::vector<Vec2> out;
  for (int i = 0; i < 7; ++i)
    for (int k = 0; k < 7; ++k) out.push_back({lo.x() + (hi.x() - lo.x()) * (i + 0.5) / 7, lo.y() + (hi.y() - lo.y()) * (k + 0.5) / 7});
  return out;
}

Mat6 adjoint(const Pose<frame::Sensor, frame::Sensor>& T) {
  Mat6 m = Mat6::Zero();
  const Mat3 R = T.rotation();
  m.topLeftCorner<3, 3>() = R, m.bottomRightCorner<3, 3>() = R, m.topRightCorner<3, 3>() = skew(T.p_mm) * R;
  return m;
}

ProfilometerState state_of(const EarlierCalibration& e) {
  ProfilometerState s;
  s.intrinsics = e.profile_map->map, s.latency_s = e.profile_map->latency_s;
  const Pose<frame::Flange, frame::Sensor> T = e.T_flange_sensor * e.profile_map->T_sensor_map;
  s.T_flange_sensor = T;
  return s;
}

}  // namespace

Result<Done<ProfilometerResult>> calibrate_hole_plate(const CalibrationRequest& job) {
  if (auto r = unfit(job)) return refuse(std::move(*r));
  const HolePlate plate = plate_of(job);
  ProfilometerRecipe recipe;
  recipe.robot_sd_mm = job.robot_sd_mm, recipe.robot_sd_rad = job.robot_sd_rad, recipe.repeat_sd_mm = job.repeat_sd_mm, recipe.repeat_sd_rad = job.repeat_sd_rad;
  recipe.is_metric = job.is_profile_metric;
  recipe.model = job.is_profile_metric || !job.sheet ? ProfilometerModel::plane_map : ProfilometerModel::camera;
  if (job.latency_s) recipe.latency = LatencyChoice::known, recipe.latency_s = *job.latency_s, recipe.latency_sd_s = job.latency_sd_s.value_or(1e-3);
  std::vector<ProfileScan> scans;
  for (const TargetCapture& c : job.captures)
    if (c.scan) scans.push_back(*c.scan);
  auto made = calibrate_profilometer(recipe, plate, scans, recipe.model == ProfilometerModel::camera ? job.sheet : std::nullopt);
  if (!made) return refuse_all(std::move(made.error()));
  Done<ProfilometerResult> done;
  done.notes = std::move(made->notes);
  ProfilometerResult& out = done.artefact;
  out.solved = std::move(made->artefact);
  const ProfilometerState& s = out.solved.state;
  ProfileMap& m = out.map;
  m.is_metric = job.is_profile_metric, m.map = s.intrinsics, m.form_sd_mm = out.solved.field.form_sd_mm;
  m.latency_s = s.latency_s, m.latency_sd_s = out.solved.latency_sd_s;
  std::vector<const ProfileScan*> all;
  for (const ProfileScan& scan : scans) all.push_back(&scan);
  if (m.is_metric) {  // the sensor's frame is the device's own, as well as its x, z tell
    const std::vector<Vec2> field = box_of(all);
    Eigen::Matrix3Xd from(3, Eigen::Index(field.size())), to(3, Eigen::Index(field.size()));
    for (std::size_t i = 0; i < field.size(); ++i) {
      const Vec2 xz = plane_point(m.map, field[i]);
      from.col(Eigen::Index(i)) = Vec3(xz.x(), 0, xz.y()), to.col(Eigen::Index(i)) = Vec3(field[i].x(), 0, field[i].y());
    }
    m.T_sensor_map = Pose<frame::Sensor, frame::Sensor>(Eigen::Isometry3d(Eigen::umeyama(from, to, false)));
  }
  out.T_flange_sensor = s.T_flange_sensor * m.T_sensor_map.inverse();
  const Mat6 A = adjoint(m.T_sensor_map);
  out.covariance = A * out.solved.covariance_field * A.transpose();
  out.accuracy_mm = out.solved.held_out_rms_mm.norm();
  double var = 0, n = 0;
  for (const ProfileScan& scan : scans) {
    const auto view = holes_of(scan, plate, s);
    if (!view || view->holes.size() < 8) continue;
    const PlateSeen seen = plate_seen(plate, *view, s);
    ReferenceView r;
    r.name = scan.name, r.T_base_flange = middle_of(scan);
    r.T_sensor_target = (r.T_base_flange * out.T_flange_sensor).inverse() * seen.T_base_target;
    r.covariance = seen.covariance;
    // the mean of both ways: where a pass stands is known by the robot's repeatability, which the check adds
    out.references.push_back(r);
    var += seen.covariance.topLeftCorner<3, 3>().trace() / 3, ++n;
  }
  out.noise_mm = std::sqrt(var / std::max(1.0, n));
  return done;
}

Result<Done<CalibrationRequest>> plate_poses(const CalibrationRequest& job, const EarlierCalibration& calibration) {
  if (auto r = unfit(job)) return refuse(std::move(*r));
  if (!calibration.profile_map)
    return refuse({.code = "calibrate.no_reference", .where = calibration.file, .message = "found no profile_map in the calibration of this sensor, allowed one that `asbuilt calibrate` made from a hole plate", .limit = 1,
                   .unit = "maps", .stage = "input"});
  if (calibration.profile_map->is_metric != job.is_profile_metric)
    return refuse({.code = "calibrate.target_not_supported", .where = "captures", .message = "found passes in another unit than the calibration's map takes (mm or pixels); deliver them as they were for the calibration", .stage = "input"});
  const HolePlate plate = plate_of(job);
  const ProfilometerState state = state_of(calibration);
  Done<CalibrationRequest> done;
  done.artefact = job;
  CalibrationRequest& out = done.artefact;
  out.target.kind = TargetKind::pose;
  double worst_rad = 1e-5, worst_mm = 1e-3;
  for (TargetCapture& c : out.captures) {
    if (!c.scan) continue;
    const auto view = holes_of(*c.scan, plate, state);
    if (!view || view->holes.size() < 8) {
      done.notes.push_back({Note::Level::warning, "calibrate.pass_left_out", view ? fmt::format("found {} holes, 8 are needed", view->holes.size()) : view.error().front().message, c.name});
      continue;
    }
    const PlateSeen seen = plate_seen(plate, *view, state);
    c.T_base_flange = middle_of(*c.scan);
    c.T_sensor_target = (c.T_base_flange * calibration.T_flange_sensor).inverse() * seen.T_base_target;
    worst_mm = std::max(worst_mm, std::sqrt(seen.covariance.topLeftCorner<3, 3>().diagonal().maxCoeff()));
    worst_rad = std::max(worst_rad, std::sqrt(seen.covariance.bottomRightCorner<3, 3>().diagonal().maxCoeff()));
  }
  out.sensor_sd = worst_mm, out.sensor_sd_rad = worst_rad;
  return done;
}

std::string hole_plate_report(const CalibrationRequest& job, const ProfilometerResult& r) {
  const auto n = [](double v, int digits = 4) { return fixed_number(v, digits); };
  const ProfilometerCalibration& c = r.solved;
  std::string t = fmt::format("sensor {}: line scanner on a plate with {} x {} holes, {}\n", job.id, job.target.plate->columns_count, job.target.plate->rows_count,
                              r.map.is_metric ? "profiles in mm" : r.map.map.model == ProfilometerModel::camera ? "profiles in pixels, camera of its sheet" : "profiles in pixels, no sheet");
  t += fmt::format("accuracy (holes of the poses held out, along the plate's x, y, z): {}, {}, {} mm rms; {} of what the fit expects\n", n(c.held_out_rms_mm.x()), n(c.held_out_rms_mm.y()), n(c.held_out_rms_mm.z()),
                   n(std::sqrt(c.held_out_chi2_ratio), 2));
  t += fmt::format("fit: {}, {}, {} mm rms, {} holes, {} weighed out\n", n(c.fit_rms_mm.x()), n(c.fit_rms_mm.y()), n(c.fit_rms_mm.z()), c.hole_count, c.outlier_count);
  t += fmt::format("a measured point in the flange's frame is known to {}, {}, {} mm (sd, middle of the field; corners {}, {}, {}); {} mm of it is form\n", n(c.field.median_sd_mm.x()), n(c.field.median_sd_mm.y()),
                   n(c.field.median_sd_mm.z()), n(c.field.max_sd_mm.x()), n(c.field.max_sd_mm.y()), n(c.field.max_sd_mm.z()), n(c.field.form_sd_mm));
  t += fmt::format("latency of the trigger: {} ms (sd {})\n", n(1000 * c.state.latency_s, 3), n(1000 * c.latency_sd_s, 3));
  if (c.robot_scale_ratio != 1) t += fmt::format("from pose to pose the robot is {} times as far off as stated\n", n(c.robot_scale_ratio, 2));
  if (c.open.empty()) t += "nothing is left to the priors\n";
  for (const OpenDirection& d : c.open) t += fmt::format("not told by the captures: {}: {} % from the data sheet, {} mm of the field at most\n", d.name, n(100 * d.prior_share_ratio, 0), n(d.field_mm));
  t += "poses:\n";
  for (const PoseQuality& p : c.poses)
    t += fmt::format("  {}{}: {} holes, {}, {}, {} mm rms, robot {} mm {} deg\n", p.name, p.is_left_out ? " [LEFT OUT]" : p.is_held_out ? " [held out]" : "", p.hole_count, n(p.rms_target_mm.x(), 3), n(p.rms_target_mm.y(), 3),
                     n(p.rms_target_mm.z(), 3), n(p.robot_mm, 3), n(deg_from_rad(p.robot_rad)));
  return t;
}

}  // namespace asbuilt
