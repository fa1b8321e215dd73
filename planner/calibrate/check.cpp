// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/check.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/calibrate/measured_covariance.hpp"
#include "planner/calibrate/observe.hpp"
#include "planner/calibrate/statistics.hpp"

namespace asbuilt {

namespace {

template <class A, class B>
Mat6 adjoint(const Pose<A, B>& T) {  // twist of B's frame (t, r) -> of A's
  Mat6 m = Mat6::Zero();
  const Mat3 R = T.rotation();
  m.topLeftCorner<3, 3>() = R, m.bottomRightCorner<3, 3>() = R;
  m.topRightCorner<3, 3>() = skew(T.p_mm) * R;
  return m;
}

/// The value that a chi-squared variable of `dof`, shifted by it, exceeds nine times of ten when its mean is limit: a plain bound.
double seen_at(double limit_chi2) { return std::sqrt(limit_chi2) + 1.2816; }

}  // namespace

Result<Done<CheckResult>> check_calibration(const CalibrationRequest& given, const EarlierCalibration& calibration, const CheckRecipe& recipe) {
  CalibrationRequest job = given;
  if (!job.camera && calibration.camera) job.camera = calibration.camera;
  job.is_camera_free = false;
  if (!job.nominal) job.nominal = calibration.T_flange_sensor;
  if (calibration.references.empty())
    return refuse({.code = "calibrate.no_reference",
                   .where = calibration.file,
                   .message = "found no reference views in the calibration, allowed one written by `asbuilt calibrate` with a target that gives whole poses or a ball's place",
                   .limit = 1,
                   .unit = "views",
                   .stage = "input"});
  auto observed = observe(job);
  if (!observed) return refuse_all(std::move(observed.error()));
  const Observed& o = *observed;
  const bool is_place_only = job.target.kind == TargetKind::ball;
  CheckResult out;
  std::vector<Note> notes = o.notes;
  double chi2 = 0, dof_all = 0;
  std::vector<Vec3> predicted, measured;
  double place_var = 0;
  const double sensor_sd = calibration.sensor_sd > 0 ? calibration.sensor_sd : o.sensor_sd;
  std::string worst;
  double worst_p = 2, worst_mm = 0, worst_limit = 0;
  for (std::size_t k = 0; k < o.network.views.size(); ++k) {
    const NetworkView& v = o.network.views[k];
    const auto m = std::find(o.motion_view.begin(), o.motion_view.end(), k);
    Pose<frame::Sensor, frame::Target> now;
    if (m != o.motion_view.end()) now = o.motions[static_cast<std::size_t>(m - o.motion_view.begin())].T_sensor_target;
    else if (is_place_only && !v.observations.empty()) now = {Eigen::Quaterniond::Identity(), v.observations[0].z};
    else continue;
    // the nearest reference: the turn counts through a lever of half a metre
    std::size_t best = 0;
    double least = 1e300;
    for (std::size_t i = 0; i < calibration.references.size(); ++i) {
      const Vec6 d = twist_between(calibration.references[i].T_base_flange, v.T_base_flange);
      const double size = d.head<3>().norm() + 500 * d.tail<3>().norm();
      if (size < least) least = size, best = i;
    }
    const ReferenceView& ref = calibration.references[best];
    const Vec6 away = twist_between(ref.T_base_flange, v.T_base_flange);
    CheckLine l;
    l.name = v.name, l.reference = ref.name;
    l.is_same_pose = away.head<3>().norm() <= recipe.near_mm && away.tail<3>().norm() <= recipe.near_rad;
    const auto& X = calibration.T_flange_sensor;
    Pose<frame::Sensor, frame::Target> expected;
    Mat6 from_flange;  // twist of the flange -> how the target moves in the sensor's frame, as a twist of the sensor the other way
    if (job.is_sensor_fixed) {
      const Pose<frame::Base, frame::Sensor> Z(X.q, X.p_mm);
      expected = Z.inverse() * v.T_base_flange * ref.T_base_flange.inverse() * Z * ref.T_sensor_target;
      from_flange = adjoint(Z.inverse() * v.T_base_flange);
    } else {
      expected = X.inverse() * v.T_base_flange.inverse() * ref.T_base_flange * X * ref.T_sensor_target;
      from_flange = adjoint(X.inverse());
    }
    if (is_place_only) expected.q = now.q;
    const Pose<frame::Sensor, frame::Sensor> M = expected * now.inverse();
    Vec6 xi;
    xi << M.p_mm, quat_log(M.q);
    // covariance, as twists of the sensor at its own origin
    const double sd_mm = l.is_same_pose ? job.repeat_sd_mm : job.robot_sd_mm, sd_rad = l.is_same_pose ? job.repeat_sd_rad : job.robot_sd_rad;
    Vec6 robot;
    robot << Vec3::Constant(2 * sd_mm * sd_mm), Vec3::Constant(2 * sd_rad * sd_rad);
    Mat6 S = from_flange * robot.asDiagonal() * from_flange.transpose();
    Network n = o.network;
    const Mat6 C_now = measured_covariance(n, v, o.base, now, sensor_sd, job.sensor_sd_rad > 0 ? job.sensor_sd_rad : 1e-4);
    const Mat6 A = adjoint(now);
    S += A * (C_now + ref.covariance) * A.transpose();
    // at the target: what the sensor looks at
    const Vec3 p = now.p_mm;
    Eigen::Matrix<double, 3, 6> J;
    J << Mat3::Identity(), -skew(p);
    const Vec3 shift = is_place_only ? Vec3(expected.p_mm - now.p_mm) : Vec3(J * xi);
    const Mat3 S_p = J * S * J.transpose();
    l.shift_mm = shift.norm(), l.shift_sd_mm = std::sqrt(S_p.trace() / 3);
    double q, dof;
    if (is_place_only) {
      q = shift.dot(S_p.ldlt().solve(shift)), dof = 3;
    } else {
      l.turn_rad = xi.tail<3>().norm(), l.turn_sd_rad = std::sqrt(S.bottomRightCorner<3, 3>().trace() / 3);
      q = xi.dot(S.ldlt().solve(xi)), dof = 6;
      l.turn_seen_rad = seen_at(chi2_limit(recipe.alarm_probability_ratio, dof)) * l.turn_sd_rad;
    }
    l.probability_ratio = chi2_tail(q, dof);
    l.shift_seen_mm = seen_at(chi2_limit(recipe.alarm_probability_ratio, dof)) * l.shift_sd_mm;
    if (l.probability_ratio < worst_p) worst_p = l.probability_ratio, worst = l.name, worst_mm = l.shift_mm, worst_limit = std::sqrt(chi2_limit(recipe.alarm_probability_ratio, dof)) * l.shift_sd_mm;
    chi2 += q, dof_all += dof;
    predicted.push_back(expected.p_mm), measured.push_back(now.p_mm);
    place_var += S_p.trace() / 3;
    out.lines.push_back(std::move(l));
  }
  if (out.lines.empty())
    return refuse({.code = "calibrate.target_not_seen",
                   .where = "captures",
                   .message = fmt::format("the target was not seen: {}", o.seen.empty() ? std::string("no capture") : o.seen.front().name + ": " + o.seen.front().text),
                   .limit = 1,
                   .unit = "captures",
                   .stage = "input"});
  out.probability_ratio = chi2_tail(chi2, dof_all);
  out.length_ratio = o.length_ratio, out.length_sd_ratio = o.length_sd_ratio;
  if (predicted.size() >= 2) {
    // measured = (1 + m) predicted + shift
    Vec3 mp = Vec3::Zero(), mm = Vec3::Zero();
    for (std::size_t i = 0; i < predicted.size(); ++i) mp += predicted[i] / static_cast<double>(predicted.size()), mm += measured[i] / static_cast<double>(predicted.size());
    double num = 0, den = 0;
    for (std::size_t i = 0; i < predicted.size(); ++i) num += (predicted[i] - mp).dot(measured[i] - mm), den += (predicted[i] - mp).squaredNorm();
    if (den > 100 * 100) {  // moves of 100 mm and more tell it
      out.move_ratio = num / den;
      out.move_sd_ratio = std::sqrt(place_var / static_cast<double>(predicted.size()) / den);
    }
  }
  const auto scale = [&](double ratio, double sd, const char* by) {
    return refuse({.code = "calibrate.scale_wrong",
                   .where = "captures",
                   .message = fmt::format("by {} the sensor's lengths are {} % of the true ones, sd {} %: its depth scale has changed; have it set right, then calibrate again", by,
                                          fixed_number(100 * ratio, 2), fixed_number(100 * sd, 3)),
                   .measured = 100 * ratio,
                   .limit = 100 * (1 + recipe.scale_max_ratio),
                   .unit = "%",
                   .stage = "input"});
  };
  if (out.length_ratio && std::abs(*out.length_ratio - 1) > recipe.scale_max_ratio && std::abs(*out.length_ratio - 1) > 4 * *out.length_sd_ratio)
    return scale(*out.length_ratio, *out.length_sd_ratio, "the target's known lengths");
  if (out.move_ratio && std::abs(*out.move_ratio - 1) > recipe.scale_max_ratio && std::abs(*out.move_ratio - 1) > 4 * *out.move_sd_ratio)
    return scale(*out.move_ratio, *out.move_sd_ratio, "the robot's known moves");
  const double limit = recipe.alarm_probability_ratio / static_cast<double>(out.lines.size());
  if (worst_p < limit || out.probability_ratio < recipe.alarm_probability_ratio) {
    const CheckLine& l = *std::find_if(out.lines.begin(), out.lines.end(), [&](const CheckLine& x) { return x.name == worst; });
    return refuse({.code = "calibrate.sensor_moved",
                   .where = l.name,
                   .message = fmt::format("the sensor sees the target {} mm (sd {}) and {} deg (sd {}) from where its calibration says; that this is chance has probability {:.1e}; find out what moved (sensor, "
                                          "target, robot zero), then calibrate again",
                                          fixed_number(l.shift_mm, 3), fixed_number(l.shift_sd_mm, 3), fixed_number(deg_from_rad(l.turn_rad), 3), fixed_number(deg_from_rad(l.turn_sd_rad), 4),
                                          l.probability_ratio),
                   .measured = worst_mm,
                   .limit = worst_limit,
                   .unit = "mm",
                   .stage = "input"});
  }
  return Done<CheckResult>{std::move(out), std::move(notes)};
}

std::string check_report(const CalibrationRequest& job, const CheckResult& r) {
  std::string t = fmt::format("{}: the sensor is where its calibration says (by chance more than this with probability {:.2g})\n", job.id, r.probability_ratio);
  for (const CheckLine& l : r.lines)
    t += fmt::format("  {} against {}{}: {} mm (sd {}), {} deg (sd {}); would see {} mm or {} deg\n", l.name, l.reference, l.is_same_pose ? "" : " (other pose: the robot's absolute accuracy counts)",
                     fixed_number(l.shift_mm, 3), fixed_number(l.shift_sd_mm, 3), fixed_number(deg_from_rad(l.turn_rad), 4), fixed_number(deg_from_rad(l.turn_sd_rad), 4),
                     fixed_number(l.shift_seen_mm, 3), fixed_number(deg_from_rad(l.turn_seen_rad), 3));
  if (r.length_ratio) t += fmt::format("  lengths by the target: {} % (sd {})\n", fixed_number(100 * *r.length_ratio, 3), fixed_number(100 * *r.length_sd_ratio, 3));
  if (r.move_ratio) t += fmt::format("  lengths by the robot's moves: {} % (sd {})\n", fixed_number(100 * *r.move_ratio, 3), fixed_number(100 * *r.move_sd_ratio, 3));
  return t;
}

}  // namespace asbuilt
