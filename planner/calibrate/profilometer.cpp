// SPDX-License-Identifier: GPL-3.0-or-later
// From holes to a calibration: starts, robust rounds, faults by name, what the captures leave open, accuracy in held-out poses.
#include "planner/calibrate/profilometer.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/base/random.hpp"
#include "planner/calibrate/profilometer_observe.hpp"
#include "planner/calibrate/profilometer_start.hpp"

namespace asbuilt {
namespace {

Refusal said(std::string code, std::string where, std::string message, double measured, double limit, std::string unit) {
  return {.code = std::move(code), .where = std::move(where), .message = std::move(message), .measured = measured, .limit = limit, .unit = std::move(unit), .stage = "input"};
}

double cost_per_residual(const ProfilometerProblem& problem, const SolveReport& s) {
  double n = 0;
  for (const PoseGroup& g : problem.groups)
    for (const HoleView* v : g.passes) n += 3.0 * double(v->holes.size());
  return s.is_converged ? 2 * s.cost / n : 1e300;
}

/// Weights of all holes by what is left of their residual once the pose's robot error is out: Huber from 3.4 sd, none beyond 8.
std::size_t weigh(ProfilometerProblem& problem, const ProfilometerState& state) {
  std::size_t outliers = 0;
  std::vector<std::vector<float>> weights(problem.groups.size());
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    const GroupError e = group_error(problem, g, state);
    std::size_t at = 0;
    for (const HoleView* v : problem.groups[g].passes)
      for (const HoleSighting& h : v->holes) {
        Vec3 var = h.sd_target_mm.cwiseAbs2();
        var.array() += problem.recipe->path_sd_mm * problem.recipe->path_sd_mm;
        var.head<2>().array() += problem.plate->sd_mm * problem.plate->sd_mm;
        const double z = std::sqrt(e.left.segment<3>(3 * Eigen::Index(at)).cwiseAbs2().cwiseQuotient(var).sum());
        weights[g].push_back(z < 3.4 ? 1.0f : z < 8 ? float(3.4 / z) : 1e-6f);
        outliers += z >= 8;
        ++at;
      }
  }
  problem.weights = std::move(weights);
  return outliers;
}

/// The robot's errors against their stated size: one factor for all poses from the median, one for a pose that stands out.
void scale_robot(ProfilometerProblem& problem, const ProfilometerState& state) {
  std::vector<double> chi2;
  for (std::size_t g = 0; g < problem.groups.size(); ++g) chi2.push_back(group_error(problem, g, state).chi2);
  auto sorted = chi2;
  std::sort(sorted.begin(), sorted.end());
  // 5.35: median of chi2 with 6 degrees of freedom; the test's own spread needs a margin before the stated errors are doubted
  const double ratio = std::sqrt(sorted[sorted.size() / 2] / 5.35);
  if (ratio > 1.35) problem.robot_scale_ratio *= ratio;
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    const double mine = chi2[g] / (ratio > 1.35 ? ratio * ratio : 1);
    problem.groups[g].robot_scale_ratio = mine > 22.5 ? std::sqrt(mine / 6) : 1;
  }
}

PoseQuality quality_of(const ProfilometerProblem& problem, std::size_t g, const ProfilometerState& state) {
  PoseQuality q;
  const GroupError e = group_error(problem, g, state);
  q.name = problem.groups[g].name, q.is_held_out = problem.groups[g].is_held_out;
  q.robot_mm = e.twist.head<3>().norm(), q.robot_rad = e.twist.tail<3>().norm(), q.chi2_ratio = e.chi2 / 6;
  Vec3 sum = Vec3::Zero();
  for (const HoleView* v : problem.groups[g].passes) {
    const PassResiduals p = residuals_of(*problem.plate, *v, state, false, false);
    for (std::size_t j = 0; j < v->holes.size(); ++j) sum += p.r.segment<3>(3 * Eigen::Index(j)).cwiseAbs2();
    q.hole_count += v->holes.size();
  }
  q.rms_target_mm = (sum / std::max<double>(1, double(q.hole_count))).cwiseSqrt();
  return q;
}

Vec3 rms_over(const std::vector<PoseQuality>& all, bool is_held_out) {
  Vec3 sum = Vec3::Zero();
  double n = 0;
  for (const PoseQuality& q : all)
    if (q.is_held_out == is_held_out && !q.is_left_out) sum += q.rms_target_mm.cwiseAbs2() * double(q.hole_count), n += double(q.hole_count);
  return (sum / std::max(1.0, n)).cwiseSqrt();
}

/// Best of the starts that settles: the caller's, the linear one, and random ones around the best so far while none does.
SolveReport best_solve(ProfilometerProblem& problem, const std::vector<ProfilometerState>& starts, int& restart_count) {
  // squared residuals per number: surely the lowest valley where they are no more than chance makes them (a side valley may stand at 1.29),
  // and settled where outliers may still be among them
  double numbers = 0;
  for (const PoseGroup& g : problem.groups)
    for (const HoleView* v : g.passes) numbers += 3.0 * double(v->holes.size());
  const double sure_ratio = 1 + 5 * std::sqrt(2 / std::max(1.0, numbers));
  constexpr double kSettled = 4;
  SolveReport best;
  best.cost = 1e300;
  double best_cost = 1e300;
  for (const ProfilometerState& s : starts) {
    const SolveReport r = solve_joint(problem, s);
    const double c = cost_per_residual(problem, r);
    if (c < best_cost || (best_cost == 1e300 && r.cost < best.cost)) best = r, best_cost = c;
    if (best_cost < sure_ratio) return best;
  }
  if (best_cost < kSettled) return best;
  Random random = Random::stream(problem.recipe->seed, "restarts");
  const ParameterTable table = parameter_table(problem);
  const ProfilometerState around = best.state;
  for (restart_count = 1; restart_count <= problem.recipe->restarts_max_count; ++restart_count) {
    Eigen::VectorXd d(table.size.size());
    for (double& x : d) x = random.uniform(-1, 1) * problem.recipe->restart_ratio;
    const SolveReport r = solve_joint(problem, moved(around, d.cwiseProduct(table.size)));
    const double c = cost_per_residual(problem, r);
    if (c < best_cost) best = r, best_cost = c;
    if (best_cost < kSettled) return best;
  }
  --restart_count;
  return best;
}

}  // namespace

Result<Done<ProfilometerCalibration>> calibrate_profilometer(const ProfilometerRecipe& recipe, const HolePlate& plate, const std::vector<HoleView>& all_views,
                                                             const std::optional<ProfilometerSheet>& sheet, const std::optional<ProfilometerState>& start) {
  Done<ProfilometerCalibration> done;
  ProfilometerCalibration& out = done.artefact;
  auto note = [&](Note::Level level, std::string code, std::string text, std::string where) { done.notes.push_back({level, std::move(code), std::move(text), std::move(where)}); };

  std::vector<HoleView> views;
  for (const HoleView& v : all_views) {
    if (v.holes.size() >= 8) views.push_back(v);
    else note(Note::Level::warning, "calibrate.pass_left_out", fmt::format("found {} holes, 8 are needed; the pass is not used", v.holes.size()), v.name);
  }
  std::vector<PoseGroup> groups = grouped(views);
  if (std::none_of(groups.begin(), groups.end(), [](const PoseGroup& g) { return g.is_held_out; }) && recipe.held_out_every_count > 1)
    for (std::size_t g = 0; g < groups.size(); ++g) groups[g].is_held_out = int(g) % recipe.held_out_every_count == recipe.held_out_every_count - 1;
  ProfilometerProblem problem{&recipe, &plate, {}, {}}, held{&recipe, &plate, {}, {}};
  for (PoseGroup& g : groups) (g.is_held_out ? held : problem).groups.push_back(g);
  if (problem.groups.size() < 4)
    return refuse(said("calibrate.too_few_poses", "captures",
                       fmt::format("found {} poses to solve with, 4 are the least and 15 or more are good: add passes over the plate at other distances and tilts", problem.groups.size()),
                       double(problem.groups.size()), 4, "poses"));
  if (held.groups.empty())
    return refuse(said("calibrate.no_held_out", "captures", "no pose is held out; at least one is needed to measure the accuracy with: mark one or more captures held_out", 0, 1, "poses"));

  const bool is_camera = recipe.model == ProfilometerModel::camera && sheet;
  problem.intrinsics = is_camera ? camera_parameters(*sheet) : plane_map_parameters(recipe.degree_count, recipe.bend_sd_mm);
  held.intrinsics = problem.intrinsics;

  // the raster against the robot's own length: a wrong plate file shows before any solve
  const auto linear = linear_start(plate, problem.groups, recipe.degree_count);
  const auto size_of_plate = linear ? linear_plate_scale(plate, problem.groups) : Vec2(1, 1);
  for (const double scale : {size_of_plate.x(), size_of_plate.y()})
    if (std::abs(scale - 1) > 0.05)
      return refuse(said("calibrate.plate_scale", plate.name,
                         fmt::format("the holes lie {} times as far apart as the plate's file says (pitch {} mm): another plate, or the file's pitch or unit is wrong", fixed_number(scale, 3),
                                     shortest_number(plate.pitch_mm)),
                         scale, 1.05, "ratio"));

  std::vector<ProfilometerState> starts;
  if (start && start->intrinsics.model == (is_camera ? ProfilometerModel::camera : ProfilometerModel::plane_map)) starts.push_back(*start);
  if (linear) starts.push_back(is_camera ? camera_from_plane_map(*linear, *sheet) : *linear);
  for (ProfilometerState& s : starts) s.latency_s = recipe.latency_s;
  if (starts.empty())
    return refuse(said("calibrate.not_converged", "captures", "no start can be found: poses or holes are not numbers, or all alike; check the poses of the captures", 0, 1, "starts"));

  SolveReport solved = best_solve(problem, starts, out.restart_count);
  for (int round = 0; round < 5 && solved.is_converged; ++round) {
    const auto weights_before = problem.weights;
    const double robot_before = problem.robot_scale_ratio;
    scale_robot(problem, solved.state);
    out.outlier_count = weigh(problem, solved.state);
    bool is_any_weight = false;
    double change = std::abs(problem.robot_scale_ratio - robot_before);
    for (std::size_t g = 0; g < problem.weights.size(); ++g) {
      is_any_weight = is_any_weight || problem.groups[g].robot_scale_ratio != 1;
      for (std::size_t j = 0; j < problem.weights[g].size(); ++j)
        change = std::max<double>(change, std::abs(problem.weights[g][j] - (weights_before.empty() ? 1.0f : weights_before[g][j])));
    }
    if (change < 0.05 && (round > 0 || !is_any_weight)) break;
    solved = solve_joint(problem, solved.state, 3);
  }
  if (!solved.is_converged)
    return refuse(said("calibrate.not_converged", "captures",
                       fmt::format("the joint solve did not settle from {} starts; a wrong angle convention of the poses or a wrong plate file does this: check one pose by hand",
                                   starts.size() + std::size_t(out.restart_count)),
                       double(starts.size()) + out.restart_count, 0, "starts"));

  // what nothing holds
  const ParameterTable table = parameter_table(problem);
  Information information = information_of(problem, solved.state);
  if (const auto loose = loose_directions(problem, information); !loose.empty()) {
    std::string names;
    for (const auto& l : loose) names += (names.empty() ? "" : "; ") + l;
    return refuse(said("calibrate.unobservable", "captures",
                       fmt::format("the captures say nothing about: {}. Add poses that tilt the flange by 20 to 30 deg about two axes and turn it by 90 deg about the sensor's z", names),
                       double(loose.size()), 0, "directions"));
  }
  Eigen::MatrixXd C = covariance_of(information, table.size);
  const Eigen::Index last = C.rows() - 1;
  const double latency_share = C(last, last) / (table.prior_sd[last] * table.prior_sd[last]);
  if (recipe.latency == LatencyChoice::estimate && latency_share > recipe.prior_share_max_ratio)
    return refuse(said("calibrate.latency_unobservable", "captures",
                       fmt::format("all passes go one way at one speed, where a late trigger looks like a shifted plate; the latency keeps {} of its prior sd. Pass over the plate in both "
                                   "directions, or state the latency with its sd",
                                   fixed_number(std::sqrt(latency_share), 2)),
                       std::sqrt(latency_share), std::sqrt(recipe.prior_share_max_ratio), "ratio"));

  // faults that have a name
  const auto moves = moved_sensor_tests(problem, solved.state);
  std::size_t worst = 0, moved_at = 0;
  std::vector<double> pose_chi2;
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    pose_chi2.push_back(group_error(problem, g, solved.state).chi2);
    if (pose_chi2[g] > pose_chi2[worst]) worst = g;
  }
  for (std::size_t k = 1; k + 2 < moves.size(); ++k)  // at least two poses on either side: one alone is a wrong pose
    if (moves[k].chi2 > moves[moved_at].chi2 || moved_at == 0) moved_at = k;
  const double strongest = moved_at > 0 ? moves[moved_at].chi2 : 0;
  const ScoreTest scale = plate_scale_test(problem, solved.state);
  for (int axis = 0; axis < 2; ++axis)
    if (scale.chi2 > strongest && std::abs(scale.value[axis]) > recipe.plate_scale_max_ratio && std::abs(scale.value[axis]) > 5 * std::sqrt(scale.covariance(axis, axis)))
      return refuse(said("calibrate.plate_scale", plate.name,
                         fmt::format("along its {} the plate is {} times as large as its file says, measured by the robot's own way: wrong file, wrong unit, or the robot's lengths are off",
                                     axis ? "y" : "x", fixed_number(1 + scale.value[axis], 5)),
                         1 + scale.value[axis], 1 + recipe.plate_scale_max_ratio, "ratio"));
  if (moved_at > 0 && moves[moved_at].chi2 > 6 * recipe.moved_chi2_ratio && moves[moved_at].chi2 > 0.8 * pose_chi2[worst]) {
    const Eigen::VectorXd& by = moves[moved_at].value;
    // as a shift of what is seen in the middle of the field
    const Vec2 xz = plane_point(solved.state.intrinsics, field_points(problem, {})[24]);
    const Vec3 shift = by.head<3>() + Vec3(by.tail<3>()).cross(Vec3(xz.x(), 0, xz.y()));
    return refuse(said("calibrate.sensor_moved", fmt::format("between {} and {}", problem.groups[moved_at].name, problem.groups[moved_at + 1].name),
                       fmt::format("the sensor sits elsewhere from {} on: by {} mm in the middle of its field and {} deg. Tighten its mount and take all captures again",
                                   problem.groups[moved_at + 1].name, fixed_number(shift.norm(), 3), fixed_number(deg_from_rad(by.tail<3>().norm()), 3)),
                       shift.norm(), 0, "mm"));
  }
  std::vector<PoseQuality> left_out;
  for (int round = 0; round < 3; ++round) {
    std::vector<PoseGroup> kept;
    for (std::size_t g = 0; g < problem.groups.size(); ++g) {
      if (group_error(problem, g, solved.state).chi2 <= 6 * recipe.pose_chi2_ratio) {
        kept.push_back(problem.groups[g]);
        continue;
      }
      PoseQuality q = quality_of(problem, g, solved.state);
      q.is_left_out = true;
      left_out.push_back(q);
      note(Note::Level::warning, "calibrate.pose_left_out",
           fmt::format("the flange was {} mm and {} deg from where it is said to have been, {} times what the robot's stated errors allow; the pose is not used: check its entry",
                       fixed_number(q.robot_mm, 2), fixed_number(deg_from_rad(q.robot_rad), 3), fixed_number(std::sqrt(q.chi2_ratio), 1)),
           q.name);
    }
    if (kept.size() == problem.groups.size()) break;
    if (int(left_out.size()) > recipe.left_out_max_count || kept.size() < 4) {
      std::string names;
      for (const auto& q : left_out) names += (names.empty() ? "" : ", ") + q.name;
      return refuse(said("calibrate.poses_wrong", names,
                         fmt::format("{} poses do not fit the others by more than the robot's stated errors ({}): wrong entries, a plate that slipped, or a robot worse than stated", left_out.size(), names),
                         double(left_out.size()), recipe.left_out_max_count, "poses"));
    }
    problem.groups = kept, problem.weights.clear(), problem.robot_scale_ratio = 1;
    for (PoseGroup& g : problem.groups) g.robot_scale_ratio = 1;
    solved = solve_joint(problem, solved.state);
    scale_robot(problem, solved.state), out.outlier_count = weigh(problem, solved.state);
    solved = solve_joint(problem, solved.state, 3);
    information = information_of(problem, solved.state), C = covariance_of(information, table.size);
  }

  solved.state = polished(problem, solved.state);
  information = information_of(problem, solved.state), C = covariance_of(information, table.size);
  out.state = solved.state;
  out.parameters = table.names;
  out.covariance = C;
  out.robot_scale_ratio = problem.robot_scale_ratio;
  out.latency_sd_s = std::sqrt(C(last, last));
  const auto field = field_points(problem, {});
  out.field = field_quality(out.state, C, field, &out.covariance_field);
  if (out.field.median_sd_mm.maxCoeff() > recipe.field_sd_max_mm) {
    std::vector<double> offsets;
    for (const Vec2& uv : {field[21], field[24], field[27]}) offsets.push_back(plane_point(out.state.intrinsics, uv).y());
    double speed = 0;
    for (const PoseGroup& g : problem.groups) speed = std::max(speed, g.passes.front()->holes.front().velocity_base_mm_s.norm());
    const auto add = poses_to_add(problem, out.state, field, pose_candidates(plate, offsets), recipe.field_sd_max_mm, 6, speed);
    std::string text;
    for (const auto& p : add) text += fmt::format("{}{} (then {} mm)", text.empty() ? "" : "; ", p.candidate.name, fixed_number(p.field_sd_mm, 3));
    return refuse(said("calibrate.field_uncertain", "captures",
                       fmt::format("a measured point would be known to {} mm (1 sd, middle of the field), {} are allowed. Add: {}", fixed_number(out.field.median_sd_mm.maxCoeff(), 3),
                                   shortest_number(recipe.field_sd_max_mm), text.empty() ? "poses with larger tilts" : text),
                       out.field.median_sd_mm.maxCoeff(), recipe.field_sd_max_mm, "mm"));
  }
  out.open = open_directions(problem, information, out.state, field, recipe.prior_share_max_ratio);
  for (const OpenDirection& d : out.open)
    note(Note::Level::note, "calibrate.open_direction",
         fmt::format("{}: {} % from the data sheet; it moves a point of the field by {} mm at most", d.name, fixed_number(100 * d.prior_share_ratio, 0), fixed_number(d.field_mm, 4)), "parameters");

  for (std::size_t g = 0; g < problem.groups.size(); ++g) out.poses.push_back(quality_of(problem, g, out.state)), out.hole_count += out.poses.back().hole_count;
  out.poses.insert(out.poses.end(), left_out.begin(), left_out.end());
  held.robot_scale_ratio = problem.robot_scale_ratio;
  double chi2 = 0;
  const PoseQuality* off = nullptr;
  std::vector<PoseQuality> checks;
  for (std::size_t g = 0; g < held.groups.size(); ++g) checks.push_back(quality_of(held, g, out.state));
  for (const PoseQuality& q : checks) {
    chi2 += q.chi2_ratio / double(checks.size());
    if (!off || q.chi2_ratio > off->chi2_ratio) off = &q;
  }
  out.poses.insert(out.poses.end(), checks.begin(), checks.end());
  out.held_out_chi2_ratio = chi2;
  out.held_out_rms_mm = rms_over(out.poses, true), out.fit_rms_mm = rms_over(out.poses, false);
  if (chi2 > recipe.held_out_chi2_max_ratio)
    return refuse(said("calibrate.held_out_off", off->name,
                       fmt::format("in the held-out poses the residual is {} mm, {} times what the fit promises; the worst is {}. The calibration does not hold where it was not fitted: add poses, check that "
                                   "one's entry",
                                   fixed_number(out.held_out_rms_mm.norm(), 3), fixed_number(std::sqrt(chi2), 1), off->name),
                       chi2, recipe.held_out_chi2_max_ratio, "ratio"));
  if (out.robot_scale_ratio > 1)
    note(Note::Level::warning, "calibrate.robot_worse_than_stated",
         fmt::format("from pose to pose the robot is {} times as far off as stated; the covariance says so", fixed_number(out.robot_scale_ratio, 2)), "robot");
  if (recipe.latency == LatencyChoice::estimate && std::abs(out.state.latency_s) > 3 * out.latency_sd_s)
    note(Note::Level::note, "calibrate.latency",
         fmt::format("profiles belong to where the robot is {} ms later (sd {} ms); corrected", fixed_number(1000 * out.state.latency_s, 2), fixed_number(1000 * out.latency_sd_s, 3)), "trigger");
  if (recipe.is_metric) {
    const auto& k = out.state.intrinsics.values;
    for (const auto& [index, axis] : {std::pair{0, "width"}, {2, "depth"}}) {
      const double ratio = std::abs(k[index]) / out.state.intrinsics.uv_half, sd = std::sqrt(C(index, index)) / out.state.intrinsics.uv_half;
      if (std::abs(ratio - 1) > 0.002 && std::abs(ratio - 1) > 4 * sd)
        note(Note::Level::warning, "calibrate.sensor_scale",
             fmt::format("the device's {} is to be multiplied by {} (sd {}); corrected by the intrinsics", axis, fixed_number(ratio, 4), fixed_number(sd, 4)), "sensor");
    }
  }
  return done;
}

}  // namespace asbuilt
