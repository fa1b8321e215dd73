// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/solve.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/calibrate/network_detail.hpp"
#include "planner/calibrate/statistics.hpp"

namespace asbuilt {

namespace {

bool has_data(const Network& n, const NetworkView& v) { return n.sight == Sight::pose ? v.T_sensor_target.has_value() : !v.observations.empty(); }

Vec3 looked_at(const Network& n, const NetworkState& s) {
  Vec3 sum = Vec3::Zero();
  double count = 0;
  for (const NetworkView& v : n.views) {
    if (!has_data(n, v)) continue;
    if (n.sight == Sight::sphere || n.sight == Sight::plane) {
      for (const Observation& o : v.observations) sum += o.z / static_cast<double>(v.observations.size());
    } else {
      Vec3 c = Vec3::Zero();
      for (const Observation& o : v.observations) c += o.p_target / static_cast<double>(v.observations.size());
      sum += target_in_sensor(n, v, s).point(c);
    }
    count += 1;
  }
  return count > 0 ? Vec3(sum / count) : sum;
}

double largest_sd(const Mat3& C) {
  Eigen::SelfAdjointEigenSolver<Mat3> es(0.5 * (C + C.transpose()));
  return std::sqrt(std::max(0.0, es.eigenvalues()[2]));
}

/// Root of the mean squared length of the observations' residuals; of poses the translation only.
double rms_of(const Network& n, const Eigen::VectorXd& r, double* turn = nullptr, double* mean = nullptr, double* most = nullptr) {
  const int rows = network::rows_of(n.sight), used = n.sight == Sight::pose ? 3 : rows;
  double sum = 0, lengths = 0, largest = 0, turns = 0;
  const Eigen::Index count = r.size() / rows;
  for (Eigen::Index i = 0; i < count; ++i) {
    const double l = r.segment(i * rows, used).norm();
    sum += l * l, lengths += l, largest = std::max(largest, l);
    if (n.sight == Sight::pose) turns += r.segment<3>(i * rows + 3).norm();
  }
  const double m = static_cast<double>(std::max<Eigen::Index>(1, count));
  if (turn) *turn = turns / m;
  if (mean) *mean = lengths / m;
  if (most) *most = largest;
  return std::sqrt(sum / m);
}

constexpr double kRobotDoubt_ratio = 3;  // times the stated sd

NetworkRecipe sds_of(const NetworkRecipe& recipe, const NetworkSolution& s) {
  NetworkRecipe out = recipe;
  out.sensor_sd_mm = s.sensor_sd, out.sensor_sd_rad = s.sensor_sd_rad, out.robot_sd_mm = s.robot_sd_mm, out.robot_sd_rad = s.robot_sd_rad;
  return out;
}

std::string axes_text(const MotionSpread& m) {
  const Vec3 a = m.axes.col(0);
  return fmt::format("({}, {}, {})", fixed_number(a.x(), 2), fixed_number(a.y(), 2), fixed_number(a.z(), 2));
}

}  // namespace

Result<Done<Calibrated>> calibrate_network(const CalibrateRecipe& recipe, const Network& network, const std::vector<MotionStart>& starts, const NetworkState& base_state) {
  const bool is_whole = std::all_of(network.is_mount_free.begin(), network.is_mount_free.end(), [](bool b) { return b; });
  std::size_t used = 0;
  std::vector<Pose<frame::Place, frame::Mount>> robot;
  for (const NetworkView& v : network.views)
    if (has_data(network, v) && !v.is_held_out) ++used, robot.push_back(place_mount(v.T_base_flange, network.is_sensor_fixed));
  if (static_cast<int>(used) < recipe.views_min_count)
    return refuse({.code = "calibrate.too_few_views",
                   .where = "captures",
                   .message = fmt::format("found {} views in which the target was seen, {} are needed and 20 or more are good: add captures", used, recipe.views_min_count),
                   .measured = static_cast<double>(used),
                   .limit = static_cast<double>(recipe.views_min_count),
                   .unit = "views",
                   .stage = "input"});
  must(!starts.empty(), "a solve needs a start");
  Calibrated out;
  out.unit = network.sight == Sight::pixel ? "px" : "mm";
  out.spread = motion_spread(robot);

  // every start, quickly; the best one thoroughly
  NetworkRecipe quick = recipe.network;
  quick.rounds_count = 0;
  std::vector<NetworkSolution> tried;
  std::size_t best = 0;
  for (const MotionStart& start : starts) {
    NetworkState s = base_state;
    s.T_mount_sensor = start.T_mount_sensor, s.T_place_target = start.T_place_target;
    tried.push_back(solve_network(quick, network, s));
    if (tried.back().cost < tried[best].cost) best = tried.size() - 1;
  }
  out.solution = solve_network(recipe.network, network, tried[best].state);
  // Few profiles of a small ball leave so much open that the robot's sd may run away with the sensor's pose. Where it came out far above
  // what is stated, the same again from where an exact robot puts everything; the likelier one (smaller sds for the same numbers) stands.
  if (out.solution.robot_sd_mm > kRobotDoubt_ratio * recipe.network.robot_sd_mm) {
    NetworkRecipe exact = recipe.network;
    exact.robot_sd_mm = 1e-4, exact.robot_sd_rad = 1e-7, exact.belief_count = 1e9, exact.rounds_count = 0;
    const auto log_sds = [&](const NetworkSolution& s) {
      double rows = s.dof;
      return rows * std::log(s.sensor_sd) + 3.0 * static_cast<double>(used) * (std::log(s.robot_sd_mm) + std::log(s.robot_sd_rad));
    };
    for (const NetworkSolution& t : tried) {
      const NetworkSolution again = solve_network(recipe.network, network, solve_network(exact, network, t.state).state);
      if (again.is_converged && log_sds(again) < log_sds(out.solution)) out.solution = again;
    }
  }
  NetworkSolution& sol = out.solution;
  out.network = network;
  if (out.network.relinearise) out.network.relinearise(sol.state.arm, out.network.views);
  const Network& n = out.network;
  out.p_look = looked_at(n, sol.state);
  const Mat6 C = sol.mount_covariance();
  Eigen::Matrix<double, 3, 6> J;
  J << Mat3::Identity(), -skew(out.p_look);
  out.point_sd_mm = largest_sd(J * C * J.transpose());
  out.turn_sd_rad = largest_sd(C.bottomRightCorner<3, 3>());
  out.weak = weak_directions(C, out.p_look, 2);
  const NetworkRecipe sds = sds_of(recipe.network, sol);

  const auto add_text = [&]() {
    std::string text;
    for (const PoseToAdd& p : out.poses_to_add) {
      const Vec3 t = p.T_base_flange.p_mm;
      const Eigen::Quaterniond q = p.T_base_flange.q;
      text += fmt::format("{}{{xyz: [{}, {}, {}], quat: [{}, {}, {}, {}]}}", text.empty() ? "" : ", ", fixed_number(t.x(), 1), fixed_number(t.y(), 1), fixed_number(t.z(), 1),
                          fixed_number(q.w(), 4), fixed_number(q.x(), 4), fixed_number(q.y(), 4), fixed_number(q.z(), 4));
    }
    return text;
  };
  if (recipe.poses_to_add_count > 0 && is_whole) out.poses_to_add = poses_to_add(sds, n, sol.state, sol.information, out.p_look, recipe.poses_to_add_count);

  const bool is_spread = out.spread.rms_rad[1] >= recipe.spread_min_rad;
  const bool is_known = out.point_sd_mm <= recipe.point_sd_max_mm && (!is_whole || out.turn_sd_rad <= recipe.turn_sd_max_rad);
  if (!is_spread || !is_known) {
    if (is_whole && out.poses_to_add.empty() && recipe.poses_to_add_count >= 0) out.poses_to_add = poses_to_add(sds, n, sol.state, sol.information, out.p_look, 3);
    const double limit = !is_spread ? deg_from_rad(recipe.spread_min_rad) : recipe.point_sd_max_mm;
    const double found = !is_spread ? deg_from_rad(out.spread.rms_rad[1]) : out.point_sd_mm;
    std::string why = !is_spread ? fmt::format("the views turn about nearly one axis only, {} of the {}: across it they differ by {} deg, {} deg are needed", axes_text(out.spread),
                                               network.is_sensor_fixed ? "base" : "flange", fixed_number(found, 2), fixed_number(limit, 1))
                                 : fmt::format("the views leave the sensor's pose open: {}", out.weak.front().text);
    return refuse({.code = "calibrate.motion_degenerate",
                   .where = "captures",
                   .message = fmt::format("{}; add views that turn by 30 deg about other axes, for instance with the flange at {} (check reach first)", why, add_text()),
                   .measured = found,
                   .limit = limit,
                   .unit = !is_spread ? "deg" : "mm",
                   .stage = "input"});
  }
  if (!sol.is_converged)
    return refuse({.code = "calibrate.not_converged",
                   .where = "captures",
                   .message = "the joint solve did not settle; a wrong angle convention or swapped poses do this: check one pose by hand",
                   .stage = "input"});
  std::size_t poses_out = 0;
  for (std::size_t k = 0; k < n.views.size(); ++k) poses_out += has_data(n, n.views[k]) && !n.views[k].is_held_out && !sol.is_used[k];
  if (static_cast<double>(poses_out) > recipe.outliers_max_ratio * static_cast<double>(used)) {
    std::string names;
    for (std::size_t k = 0; k < n.views.size(); ++k)
      if (has_data(n, n.views[k]) && !n.views[k].is_held_out && !sol.is_used[k]) names += (names.empty() ? "" : ", ") + n.views[k].name;
    return refuse({.code = "calibrate.too_many_outliers",
                   .where = "captures",
                   .message = fmt::format("{} of {} views contradict the others ({}); a pose that belongs to another capture, a moved target or a wrong angle convention do this", poses_out,
                                          used, names),
                   .measured = static_cast<double>(poses_out),
                   .limit = recipe.outliers_max_ratio * static_cast<double>(used),
                   .unit = "views",
                   .stage = "input"});
  }

  // the starts: where they began and where they ended
  for (std::size_t i = 0; i < starts.size(); ++i) {
    StartLine l;
    l.method = starts[i].method;
    l.from_best_mm = (starts[i].T_mount_sensor.point(out.p_look) - sol.state.T_mount_sensor.point(out.p_look)).norm();
    l.from_best_rad = quat_log(starts[i].T_mount_sensor.q.conjugate() * sol.state.T_mount_sensor.q).norm();
    l.cost = tried[i].cost, l.is_converged = tried[i].is_converged;
    l.end_mm = (tried[i].state.T_mount_sensor.point(out.p_look) - tried[best].state.T_mount_sensor.point(out.p_look)).norm();
    const Vec6 d = twist_between(tried[best].state.T_mount_sensor, tried[i].state.T_mount_sensor);
    double z2 = 0;
    Eigen::SelfAdjointEigenSolver<Mat6> es(C);
    for (int k = 0; k < 6; ++k)
      if (es.eigenvalues()[k] > 1e-300) z2 += std::pow(es.eigenvectors().col(k).dot(d), 2) / es.eigenvalues()[k];
    if (z2 > 1 && l.is_converged && l.cost < 1.02 * tried[best].cost + 0.5)
      return refuse({.code = "calibrate.starts_disagree",
                     .where = l.method,
                     .message = fmt::format("two solves at equal cost end {} mm and {} deg apart ({} and {}); the views do not decide between them: add views with other tilts, for instance with "
                                            "the flange at {} (check reach first)",
                                            fixed_number(l.end_mm, 3), fixed_number(deg_from_rad(d.tail<3>().norm()), 3), starts[best].method, l.method, add_text()),
                     .measured = l.end_mm,
                     .limit = out.point_sd_mm,
                     .unit = "mm",
                     .stage = "input"});
    out.starts.push_back(std::move(l));
  }

  // each view predicted by a solve that has not seen it
  const int folds = std::max(0, recipe.folds_count);
  std::vector<NetworkSolution> fold_solution(static_cast<std::size_t>(std::max(1, folds)), sol);
  std::vector<int> fold_of(n.views.size(), -1);
  int next = 0;
  for (std::size_t k = 0; k < n.views.size(); ++k)
    if (has_data(n, n.views[k]) && !n.views[k].is_held_out && folds > 1) fold_of[k] = next++ % folds;
  for (int f = 0; f < folds && folds > 1; ++f) {
    Network part = network;
    for (std::size_t k = 0; k < n.views.size(); ++k)
      if (fold_of[k] == f) part.views[k].is_held_out = true;
    NetworkRecipe short_recipe = sds;
    short_recipe.belief_count = 1e6;  // the sds of all views stand
    short_recipe.rounds_count = 2;
    fold_solution[static_cast<std::size_t>(f)] = solve_network(short_recipe, part, sol.state);
  }
  double fit = 0, held = 0, held_lengths = 0, expected = 0, turn_sum = 0, chi2 = 0, chi2_rows = 0, distance = 0;
  std::size_t fit_count = 0, held_count = 0, held_views = 0;
  const double trace = static_cast<double>((C.diagonal().array() > 0).count());
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    const NetworkView& v = n.views[k];
    if (!has_data(n, v)) continue;
    ViewLine l;
    l.name = v.name, l.is_held_out = v.is_held_out, l.is_used = v.is_held_out || sol.is_used[k];
    const Eigen::VectorXd r = raw_residuals(n, v, sol.state);
    l.residual_rms = rms_of(n, r);
    l.robot_mm = sol.state.robot[k].head<3>().norm(), l.robot_rad = sol.state.robot[k].tail<3>().norm();
    if (!v.is_held_out && sol.is_used[k]) l.leverage_ratio = (sol.covariance * sol.view_information[k]).topLeftCorner<6, 6>().trace() / std::max(1.0, trace);
    const std::size_t rows = static_cast<std::size_t>(network::rows_of(n.sight)), count = static_cast<std::size_t>(r.size()) / rows;
    if (l.is_used && !v.is_held_out) fit += l.residual_rms * l.residual_rms * static_cast<double>(count), fit_count += count;
    if (v.is_held_out || fold_of[k] >= 0) {
      const NetworkSolution& other = v.is_held_out ? sol : fold_solution[static_cast<std::size_t>(fold_of[k])];
      Network shown = network;
      NetworkView seen = v;
      if (network.relinearise) {
        std::vector<NetworkView> one{network.views[k]};
        network.relinearise(other.state.arm, one);
        seen = one.front();
      }
      Eigen::VectorXd h = raw_residuals(n, seen, other.state);
      double mean = 0, most = 0;
      l.held_out_rms = rms_of(n, h, &l.held_out_rad, &mean, &most);
      // at most 60 observations are enough for the statistics of a view
      NetworkView few = seen;
      if (few.observations.size() > 60) {
        std::vector<Observation> some;
        for (std::size_t i = 0; i < 60; ++i) some.push_back(few.observations[i * few.observations.size() / 60]);
        few.observations = std::move(some);
      }
      const Eigen::VectorXd hf = raw_residuals(n, few, other.state);
      const Eigen::MatrixXd S = residual_covariance(sds, n, few, other.state, other.covariance);
      l.held_out_chi2_ratio = hf.dot(S.ldlt().solve(hf)) / static_cast<double>(hf.size());
      double var = 0;
      for (Eigen::Index i = 0; i < S.rows(); ++i)
        if (!(n.sight == Sight::pose && i % 6 >= 3)) var += S(i, i);
      l.expected_rms = std::sqrt(var / (static_cast<double>(S.rows()) / static_cast<double>(rows)));
      if (l.is_used) {
        held += l.held_out_rms * l.held_out_rms * static_cast<double>(count), held_lengths += mean * static_cast<double>(count), held_count += count;
        expected += l.expected_rms * l.expected_rms * static_cast<double>(count);
        turn_sum += l.held_out_rad, ++held_views;
        chi2 += hf.dot(S.ldlt().solve(hf)), chi2_rows += static_cast<double>(hf.size());
        out.held_out_max = std::max(out.held_out_max, most);
        distance += target_in_sensor(n, v, sol.state).p_mm.norm();
      }
    }
    out.views.push_back(std::move(l));
  }
  out.fit_rms = std::sqrt(fit / static_cast<double>(std::max<std::size_t>(1, fit_count)));
  if (held_count) {
    const double m = static_cast<double>(held_count);
    out.held_out_rms = std::sqrt(held / m), out.held_out_mean = held_lengths / m, out.held_out_expected = std::sqrt(expected / m);
    out.held_out_rad = turn_sum / static_cast<double>(held_views);
    out.p_held_out = chi2_tail(chi2, chi2_rows);
    out.held_out_rms_mm = out.held_out_rms;
    if (n.sight == Sight::pixel) out.held_out_rms_mm *= distance / static_cast<double>(held_views) / sol.state.sensor[kFx];
  }
  for (const NetworkOutlier& o : sol.outliers) {
    const NetworkView& v = n.views[o.view];
    if (o.observation < 0)
      out.notes.push_back({.level = Note::Level::warning,
                           .code = "calibrate.view_left_out",
                           .text = fmt::format("the pose of {} is {} sd ({} mm) from what the other views say and was left out", v.name, fixed_number(o.sd_ratio, 1), fixed_number(o.size, 2)),
                           .where = v.name});
    else if (n.sight == Sight::point || n.sight == Sight::pixel)
      out.notes.push_back({.level = Note::Level::warning,
                           .code = "calibrate.observation_left_out",
                           .text = fmt::format("point {} of {} is off by {} {} ({} sd) and was left out", v.observations[static_cast<std::size_t>(o.observation)].id, v.name,
                                               fixed_number(o.size, 3), out.unit, fixed_number(o.sd_ratio, 1)),
                           .where = v.name});
  }
  if (const auto many = std::count_if(sol.outliers.begin(), sol.outliers.end(), [](const NetworkOutlier& o) { return o.observation >= 0; });
      many && (n.sight == Sight::sphere || n.sight == Sight::plane))
    out.notes.push_back({.level = Note::Level::note, .code = "calibrate.observation_left_out", .text = fmt::format("{} points off the surface were left out", many), .where = "captures"});
  for (const ViewLine& l : out.views)
    if (l.leverage_ratio > std::max(0.35, 4.0 / static_cast<double>(used)))
      out.notes.push_back({.level = Note::Level::warning,
                           .code = "calibrate.leverage",
                           .text = fmt::format("the answer hangs on {} for {} %: an error of that one pose would not be seen; add a view near it", l.name, fixed_number(100 * l.leverage_ratio, 0)),
                           .where = l.name});
  if (recipe.network.robot_sd_mm > 0 && sol.robot_sd_mm > 1.5 * recipe.network.robot_sd_mm)
    out.notes.push_back({.level = Note::Level::warning,
                         .code = "calibrate.robot_worse_than_stated",
                         .text = fmt::format("the robot's poses scatter by {} mm and {} deg per axis where {} mm and {} deg are stated: what is left is the robot, not the sensor", fixed_number(sol.robot_sd_mm, 3),
                                             fixed_number(deg_from_rad(sol.robot_sd_rad), 4), fixed_number(recipe.network.robot_sd_mm, 3), fixed_number(deg_from_rad(recipe.network.robot_sd_rad), 4)),
                         .where = "captures"});
  std::vector<Note> notes = out.notes;
  return Done<Calibrated>{std::move(out), std::move(notes)};
}

}  // namespace asbuilt
