// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/calibrate.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/number.hpp"
#include "planner/calibrate/image_targets.hpp"
#include "planner/calibrate/measured_covariance.hpp"
#include "planner/calibrate/observe.hpp"
#include "planner/calibrate/statistics.hpp"

namespace asbuilt {

namespace {

constexpr double kFree = std::numeric_limits<double>::infinity();
constexpr double kScaleLimit_ratio = 0.005;
constexpr double kTold_ratio = 0.05;  // lengths known worse than this are not told at all

bool is_board(TargetKind k) { return k == TargetKind::checkerboard || k == TargetKind::charuco || k == TargetKind::circle_grid; }

/// Turns of robot and sensor must be equal; which view's are not.
tl::expected<void, Refusals> check_motions(const CalibrateRecipe& recipe, const std::vector<MotionView>& motions, std::vector<Note>& notes) {
  if (motions.size() < 3) return {};
  const std::vector<double> gap = motion_disagreement_rad(motions);
  std::vector<double> sorted = gap;
  std::sort(sorted.begin(), sorted.end());
  const double middle = sorted[sorted.size() / 2];
  if (middle > recipe.motion_gap_max_rad)
    return tl::unexpected(Refusals{{.code = "calibrate.motions_incongruent",
                                    .where = "captures",
                                    .message = fmt::format("between two views robot and sensor turn by angles that differ by {} deg in the median, allowed {} deg: the robot's angles are read in the "
                                                           "wrong convention (zyx, rpy, order of the quaternion), or the poses belong to other captures",
                                                           fixed_number(deg_from_rad(middle), 2), fixed_number(deg_from_rad(recipe.motion_gap_max_rad), 1)),
                                    .measured = deg_from_rad(middle),
                                    .limit = deg_from_rad(recipe.motion_gap_max_rad),
                                    .unit = "deg",
                                    .stage = "input"}});
  for (std::size_t i = 0; i < gap.size(); ++i)
    if (gap[i] > recipe.motion_gap_max_rad && gap[i] > 6 * middle)
      notes.push_back({.level = Note::Level::warning,
                       .code = "calibrate.view_incongruent",
                       .text = fmt::format("{} is turned against the others by {} deg differently by robot and sensor: its pose or its capture is another one's", motions[i].name,
                                           fixed_number(deg_from_rad(gap[i]), 2)),
                       .where = motions[i].name});
  return {};
}

struct FreeConstant {
  double value = 0, sd = 0;
  double cost = 0, sensor_sd = 0;
  NetworkState state;
};

/// The same solve with one more constant of the sensor free.
/// `are_sds_held`: at those of the solve, so that nothing but the constant can take up what it explains.
FreeConstant with_free(const NetworkRecipe& recipe, Network n, const NetworkState& state, const std::vector<SensorConstant>& free, bool are_sds_held = false) {
  for (const SensorConstant c : free) n.sensor_sd[c] = kFree;
  NetworkRecipe quick = recipe;
  quick.rounds_count = 2;
  if (are_sds_held) quick.belief_count = 1e6;
  const NetworkSolution s = solve_network(quick, n, state);
  return {s.state.sensor[free.front()], std::sqrt(std::max(0.0, s.covariance(12 + free.front(), 12 + free.front()))), s.cost, s.sensor_sd, s.state};
}

double rms_px(const Network& n, const NetworkState& s) {
  double sum = 0, count = 0;
  for (const NetworkView& v : n.views) {
    if (v.observations.empty() || v.is_held_out) continue;
    const Eigen::VectorXd r = raw_residuals(n, v, s);
    sum += r.squaredNorm(), count += static_cast<double>(r.size()) / 2;
  }
  return std::sqrt(sum / std::max(1.0, count));
}

}  // namespace

Result<Done<CalibrationResult>> calibrate(const CalibrationRequest& job, const CalibrateRecipe& given) {
  auto observed = observe(job);
  if (!observed) return refuse_all(std::move(observed.error()));
  Observed& o = *observed;
  CalibrationResult out;
  std::vector<Note> notes = std::move(o.notes);
  out.seen = o.seen;
  CalibrateRecipe recipe = given;
  recipe.network.sensor_sd_mm = o.sensor_sd, recipe.network.sensor_sd_rad = job.sensor_sd_rad > 0 ? job.sensor_sd_rad : 1e-4;
  recipe.network.robot_sd_mm = job.robot_sd_mm, recipe.network.robot_sd_rad = job.robot_sd_rad;
  if (job.target.kind == TargetKind::tip) recipe.views_min_count = std::min(recipe.views_min_count, 4);
  const ArmRecipe arm_recipe;
  std::optional<ArmParameters> arm;
  if (job.subject == CalibrationRequest::Subject::robot) {
    auto made = opw_parameters(arm_recipe, job.cell.robot);
    if (!made) return refuse_all(std::move(made.error()));
    arm = std::move(*made);
    for (std::size_t k = 0; k < o.network.views.size(); ++k)
      if (job.captures[k].q_rad) o.network.views[k].joints.assign(job.captures[k].q_rad->begin(), job.captures[k].q_rad->end());
    correct_arm(o.network, *arm);
    recipe.poses_to_add_count = 0;
    // sensor and target take up what the arm's own frame and flange share with them: only the chain as a whole must be known
    recipe.point_sd_max_mm = std::max(recipe.point_sd_max_mm, 10.0);
    recipe.network.robot_sd_mm = job.repeat_sd_mm, recipe.network.robot_sd_rad = job.repeat_sd_rad;
    recipe.network.belief_count = 3;
  }
  const std::size_t seen = static_cast<std::size_t>(std::count_if(o.seen.begin(), o.seen.end(), [](const SeenLine& l) { return l.is_seen; }));
  if (seen == 0)
    return refuse({.code = "calibrate.target_not_seen",
                   .where = "captures",
                   .message = fmt::format("the target was seen in none of {} captures; first: {}: {}", o.seen.size(), o.seen.empty() ? "" : o.seen.front().name, o.seen.empty() ? "" : o.seen.front().text),
                   .measured = 0,
                   .limit = static_cast<double>(recipe.views_min_count),
                   .unit = "captures",
                   .stage = "input"});
  if (auto ok = check_motions(recipe, o.motions, notes); !ok) return refuse_all(std::move(ok.error()));
  std::vector<MotionView> solve_motions;
  for (std::size_t i = 0; i < o.motions.size(); ++i)
    if (!o.network.views[o.motion_view[i]].is_held_out) solve_motions.push_back(o.motions[i]);
  std::vector<MotionStart> starts = motion_starts(solve_motions, recipe.min_motion_rad);
  starts.insert(starts.end(), o.starts.begin(), o.starts.end());
  if (job.nominal && !solve_motions.empty()) {  // where there are no turns at all, this says so
    MotionStart s;
    s.method = "cell";
    s.T_mount_sensor = {job.nominal->q, job.nominal->p_mm};
    s.T_place_target = solve_motions[0].T_place_mount * s.T_mount_sensor * solve_motions[0].T_sensor_target;
    starts.push_back(s);
  }
  if (starts.empty())
    return refuse({.code = "calibrate.no_start",
                   .where = "captures",
                   .message = fmt::format("no two views differ by {} deg or more and the cell gives no nominal pose to start from; add views that turn the flange, or write the nominal pose into the cell",
                                          fixed_number(deg_from_rad(recipe.min_motion_rad), 0)),
                   .limit = deg_from_rad(recipe.min_motion_rad),
                   .unit = "deg",
                   .stage = "input"});
  // a wide covariance is carried on and judged where it is used; what is refused here is as good as unknown
  recipe.point_sd_max_mm = std::max(recipe.point_sd_max_mm, 5.0);
  const auto stale = [&](double before, double after, const NetworkState& free, const NetworkState& given_state) {
    std::string what;
    for (const SensorConstant k : {kFx, kFy, kCx, kCy}) what += fmt::format("{}{} {} px", what.empty() ? "" : ", ", name_of(k), fixed_number(free.sensor[k] - given_state.sensor[k], 1));
    return refuse({.code = "calibrate.intrinsics_stale",
                   .where = "intrinsics",
                   .message = fmt::format("the given intrinsics are stale: with them the points are off by {} px, with free ones by {} px (changes: {}); calibrate the camera again, or set "
                                          "intrinsics_free: true",
                                          fixed_number(before, 2), fixed_number(after, 2), what),
                   .measured = before,
                   .limit = 1.15 * after,
                   .unit = "px",
                   .stage = "input"});
  };
  auto solved = calibrate_network(recipe, o.network, starts, o.base);
  if (!solved) {
    if (is_board(job.target.kind) && !job.is_camera_free) {  // is it the camera that contradicts everything
      Network loose = o.network;
      for (int i = kFx; i <= kP2; ++i) loose.sensor_sd[i] = kFree;
      CalibrateRecipe short_recipe = recipe;
      short_recipe.folds_count = 0, short_recipe.poses_to_add_count = 0;
      if (const auto free = calibrate_network(short_recipe, loose, starts, o.base)) {
        const NetworkState& f = free->artefact.solution.state;
        NetworkState at = f;
        at.sensor = o.base.sensor;
        NetworkRecipe quick = recipe.network;
        quick.rounds_count = 0;
        const NetworkState g = solve_network(quick, o.network, at).state;
        const double before = rms_px(o.network, g), after = rms_px(o.network, f);
        if (before > 1.15 * after) return stale(before, after, f, g);
      }
    }
    return refuse_all(std::move(solved.error()));
  }
  notes.insert(notes.end(), solved->notes.begin(), solved->notes.end());
  out.solved = std::move(solved->artefact);
  const Calibrated& c = out.solved;
  const NetworkState& state = c.solution.state;
  NetworkRecipe sds = recipe.network;
  sds.sensor_sd_mm = c.solution.sensor_sd, sds.robot_sd_mm = c.solution.robot_sd_mm, sds.robot_sd_rad = c.solution.robot_sd_rad;

  // given constants of a camera against free ones
  if (is_board(job.target.kind) && !job.is_camera_free) {
    const FreeConstant f = with_free(sds, o.network, state, {kFx, kFy, kCx, kCy, kK1, kK2, kP1, kP2});
    const double before = rms_px(c.network, state), after = rms_px(c.network, f.state);
    if (c.solution.sensor_sd > 1.3 * f.sensor_sd && before > 1.15 * after) {
      return stale(before, after, f.state, state);
    }
  }
  if (is_board(job.target.kind)) {
    CameraConstants k{};
    for (int i = 0; i < 9; ++i) k[static_cast<std::size_t>(i)] = state.sensor[kFx + i];
    out.camera = k;
  }
  if (arm) {
    out.arm = arm_lines(arm_recipe, *arm, c.solution), out.arm_held = held_directions(*arm, c.solution, arm_recipe.held_ratio);
    const Eigen::VectorXd& a = state.arm;
    out.arm_additions = OpwParameters{a[0], a[1], a[2], a[3], a[4], a[5], a[6], {a[7], a[8], a[9], a[10], a[11], a[12]}, {}};
  }
  // lengths by the robot's own moves
  if (!arm && job.target.kind != TargetKind::tip && c.network.sight != Sight::plane) {
    const FreeConstant f = with_free(sds, o.network, state, {kScale}, true);
    if (f.sd < kTold_ratio) out.scale_ratio = 1 + f.value, out.scale_sd_ratio = f.sd;  // else the captures do not tell it
    const bool is_camera = c.network.sight == Sight::pixel;
    if (out.scale_ratio && std::abs(f.value) > kScaleLimit_ratio && std::abs(f.value) > 4 * f.sd) {
      const std::string message =
          is_camera ? fmt::format("by the robot's moves the board's pitch is {} % of what is given ({} mm instead of {}), sd {} %; measure the board", fixed_number(100 * (1 + f.value), 2),
                                  fixed_number(job.target.pitch_mm * (1 + f.value), 4), fixed_number(job.target.pitch_mm, 4), fixed_number(100 * f.sd, 2))
                    : fmt::format("by the robot's moves the sensor's lengths are {} % of the true ones, sd {} %{}; have the sensor's depth scale set right", fixed_number(100 * (1 + f.value), 2),
                                  fixed_number(100 * f.sd, 2),
                                  o.length_ratio ? fmt::format(" (by the target's own lengths {} %)", fixed_number(100 * *o.length_ratio, 2)) : std::string());
      return refuse({.code = "calibrate.scale_wrong", .where = "captures", .message = message, .measured = 100 * (1 + f.value), .limit = 100 * (1 + kScaleLimit_ratio), .unit = "%", .stage = "input"});
    }
    if (out.scale_ratio && std::abs(f.value) > 3 * f.sd && std::abs(f.value) > 5e-4)
      notes.push_back({.level = Note::Level::warning,
                       .code = "calibrate.scale",
                       .text = fmt::format("{} {} % of the given, sd {} %, by the robot's moves", is_camera ? "the board's pitch is" : "the sensor's lengths are", fixed_number(100 * (1 + f.value), 3),
                                           fixed_number(100 * f.sd, 3)),
                       .where = "captures"});
  }
  out.length_ratio = o.length_ratio, out.length_sd_ratio = o.length_sd_ratio;
  if (out.length_ratio && std::abs(*out.length_ratio - 1) > kScaleLimit_ratio && std::abs(*out.length_ratio - 1) > 4 * *out.length_sd_ratio)
    return refuse({.code = "calibrate.scale_wrong",
                   .where = "captures",
                   .message = fmt::format("by the target's known lengths the sensor's lengths are {} % of the true ones, sd {} %; have the sensor's depth scale set right, or check the target's file",
                                          fixed_number(100 * *out.length_ratio, 2), fixed_number(100 * *out.length_sd_ratio, 3)),
                   .measured = 100 * *out.length_ratio,
                   .limit = 100 * (1 + kScaleLimit_ratio),
                   .unit = "%",
                   .stage = "input"});
  if (c.network.sight == Sight::sphere) {
    const FreeConstant f = with_free(sds, o.network, state, {kRadius}, true);
    if (f.sd < kTold_ratio * job.target.diameter_mm) out.radius_mm = f.value, out.radius_sd_mm = f.sd;
    const double bias = f.value - job.target.diameter_mm / 2;
    if (out.radius_mm && std::abs(bias) > 3 * f.sd && std::abs(bias) > 0.02)
      notes.push_back({.level = Note::Level::warning,
                       .code = "calibrate.radius_bias",
                       .text = fmt::format("with its radius free the ball comes out at {} mm, certified {} mm: the sensor sees its surface {} mm too {}", fixed_number(f.value, 3),
                                           fixed_number(job.target.diameter_mm / 2, 3), fixed_number(std::abs(bias), 3), bias < 0 ? "deep" : "high"),
                       .where = "captures"});
  }

  out.T_flange_sensor = {state.T_mount_sensor.q, state.T_mount_sensor.p_mm};
  out.covariance = c.solution.mount_covariance();
  if (job.target.kind == TargetKind::tip) {
    // the direction is the nominal one
    out.covariance.bottomRightCorner<3, 3>() += Mat3::Identity() * job.tool_turn_sd_rad * job.tool_turn_sd_rad;
    notes.push_back({.level = Note::Level::note,
                     .code = "calibrate.direction_not_measured",
                     .text = fmt::format("a tip on a point tells nothing of the tool's direction: the nominal one stands, with sd {} deg", fixed_number(deg_from_rad(job.tool_turn_sd_rad), 2)),
                     .where = "target.kind"});
  }
  out.accuracy_mm = c.held_out_rms_mm;
  for (std::size_t k = 0; k < c.network.views.size(); ++k) {
    const NetworkView& v = c.network.views[k];
    const bool has_pose = c.network.sight == Sight::pose ? v.T_sensor_target.has_value() : !v.observations.empty();
    if (!has_pose || arm || job.target.kind == TargetKind::tip || (!v.is_held_out && !c.solution.is_used[k])) continue;
    ReferenceView r;
    r.name = v.name, r.T_base_flange = v.T_base_flange;
    const auto m = std::find(o.motion_view.begin(), o.motion_view.end(), k);
    if (m != o.motion_view.end()) r.T_sensor_target = o.motions[static_cast<std::size_t>(m - o.motion_view.begin())].T_sensor_target;
    else if (c.network.sight == Sight::point) r.T_sensor_target = {Eigen::Quaterniond::Identity(), v.observations[0].z};
    else continue;
    if (out.camera && m != o.motion_view.end()) {  // by the camera as it came out, which is what a check will see it with
      std::vector<Vec3> board;
      std::vector<ImagePoint> points;
      for (const Observation& b : v.observations) points.push_back({static_cast<int>(board.size()), b.z.head<2>()}), board.push_back(b.p_target);
      if (const auto pose = board_pose(board, points, *out.camera)) r.T_sensor_target = pose->T_sensor_target;
    }
    r.covariance = measured_covariance(c.network, v, state, r.T_sensor_target, c.solution.sensor_sd, recipe.network.sensor_sd_rad);
    out.references.push_back(std::move(r));
  }
  if (job.earlier) {
    DriftLine d;
    d.file = job.earlier->file, d.created = job.earlier->created;
    const Vec6 xi = twist_between(job.earlier->T_flange_sensor, out.T_flange_sensor);
    const Mat6 S = out.covariance + job.earlier->covariance;
    Eigen::Matrix<double, 3, 6> J;
    J << Mat3::Identity(), -skew(c.p_look);
    d.shift_mm = (J * xi).norm(), d.turn_rad = xi.tail<3>().norm();
    d.shift_sd_mm = std::sqrt((J * S * J.transpose()).trace()), d.turn_sd_rad = std::sqrt(S.bottomRightCorner<3, 3>().trace());
    Eigen::SelfAdjointEigenSolver<Mat6> es(S);
    double q = 0, dof = 0;
    for (int i = 0; i < 6; ++i)
      if (es.eigenvalues()[i] > 1e-16) q += std::pow(es.eigenvectors().col(i).dot(xi), 2) / es.eigenvalues()[i], dof += 1;
    d.probability_ratio = chi2_tail(q, std::max(1.0, dof));
    if (d.probability_ratio < 1e-3)
      notes.push_back({.level = Note::Level::warning,
                       .code = "calibrate.drift",
                       .text = fmt::format("since {} ({}) it has moved by {} mm (sd {}) at what it looks at and turned by {} deg (sd {}); that this is chance has probability {:.1e}", d.created, d.file,
                                           fixed_number(d.shift_mm, 3), fixed_number(d.shift_sd_mm, 3), fixed_number(deg_from_rad(d.turn_rad), 4), fixed_number(deg_from_rad(d.turn_sd_rad), 4),
                                           d.probability_ratio),
                       .where = d.file});
    out.drift = d;
  }
  return Done<CalibrationResult>{std::move(out), std::move(notes)};
}

}  // namespace asbuilt
