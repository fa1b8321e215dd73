// SPDX-License-Identifier: GPL-3.0-or-later
// The joint solve: hand-eye and target pose together, the robot's error of every pose marginalised.
#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>

#include "planner/base/number.hpp"
#include "planner/calibrate/hand_eye.hpp"

namespace asbuilt {
namespace {

using Twist = Eigen::Matrix<double, 12, 1>;  // hand-eye, then target; child frames, t then r
using State = std::pair<Pose<frame::Flange, frame::Sensor>, Pose<frame::Base, frame::Target>>;

State moved(const State& s, const Twist& xi) { return {s.first.disturbed(xi.head<6>()), s.second.disturbed(xi.tail<6>())}; }

/// Residuals of one view in the sensor's frame: measured minus predicted.
Eigen::VectorXd residual_of(const TargetView& v, const State& s) {
  Eigen::VectorXd r(3 * v.p_target.size());
  const auto T_sensor_target = (v.T_base_flange * s.first).inverse() * s.second;
  for (std::size_t j = 0; j < v.p_target.size(); ++j) r.segment<3>(3 * j) = v.p_sensor[j] - T_sensor_target.point(v.p_target[j]);
  return r;
}

/// How a twist of the flange (its own frame) moves the predicted points, sensor frame.
Eigen::MatrixXd robot_jacobian(const TargetView& v, const State& s) {
  Eigen::MatrixXd J(3 * v.p_target.size(), 6);
  const auto T_flange_target = v.T_base_flange.inverse() * s.second;
  const Mat3 R = s.first.rotation().transpose();
  for (std::size_t j = 0; j < v.p_target.size(); ++j) {
    const Vec3 p_flange = T_flange_target.point(v.p_target[j]);
    // a point fixed in base, seen from a flange moved by [t, w], moves by -(t + w x p) in the flange's frame
    J.block<3, 3>(3 * j, 0) = -R;
    J.block<3, 3>(3 * j, 3) = R * skew(p_flange);
  }
  return J;
}

Eigen::MatrixXd state_jacobian(const TargetView& v, const State& s) {
  Eigen::MatrixXd J(3 * v.p_target.size(), 12);
  const auto T_sensor_base = (v.T_base_flange * s.first).inverse();
  const Mat3 R = (T_sensor_base.q * s.second.q).toRotationMatrix();
  for (std::size_t j = 0; j < v.p_target.size(); ++j) {
    const Vec3 p_sensor = T_sensor_base.point(s.second.point(v.p_target[j]));
    J.block<3, 3>(3 * j, 0) = -Mat3::Identity();
    J.block<3, 3>(3 * j, 3) = skew(p_sensor);
    J.block<3, 3>(3 * j, 6) = R;
    J.block<3, 3>(3 * j, 9) = -R * skew(v.p_target[j]);
  }
  return J;
}

/// L^-1 of the covariance of one view's residuals: sensor noise and the robot's error together.
Eigen::MatrixXd whitener(const HandEyeRecipe& recipe, const TargetView& v, const State& s) {
  const Eigen::MatrixXd A = robot_jacobian(v, s);
  Vec6 d;
  d << Vec3::Constant(recipe.robot_sd_mm * recipe.robot_sd_mm), Vec3::Constant(recipe.robot_sd_rad * recipe.robot_sd_rad);
  Eigen::MatrixXd S = A * d.asDiagonal() * A.transpose();
  S.diagonal().array() += recipe.sensor_sd_mm * recipe.sensor_sd_mm;
  const Eigen::LLT<Eigen::MatrixXd> llt(S);
  must(llt.info() == Eigen::Success, "the covariance of a view is not positive definite");
  return llt.matrixL().solve(Eigen::MatrixXd::Identity(S.rows(), S.cols()));
}

class ViewCost : public ceres::CostFunction {
 public:
  ViewCost(const TargetView& view, const State& linear_point, Eigen::MatrixXd whiten)
      : view_(view), state_(linear_point), whiten_(std::move(whiten)) {
    set_num_residuals(static_cast<int>(whiten_.rows()));
    mutable_parameter_block_sizes()->push_back(12);
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Map<const Twist> xi(parameters[0]);
    const State s = moved(state_, xi);
    Eigen::Map<Eigen::VectorXd>(residuals, whiten_.rows()) = whiten_ * residual_of(view_, s);
    if (jacobians && jacobians[0]) {
      // the derivative by the twist at xi; for the small twists of one round the twist at zero serves
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 12, Eigen::RowMajor>>(jacobians[0], whiten_.rows(), 12) = -whiten_ * state_jacobian(view_, s);
    }
    return true;
  }

 private:
  const TargetView& view_;
  State state_;
  Eigen::MatrixXd whiten_;
};

struct Solved {
  State state;
  double cost = 0;
  bool is_converged = false;
};

Solved solve(const HandEyeRecipe& recipe, const std::vector<const TargetView*>& views, State s) {
  Solved out{s};
  for (int round = 0; round < 12; ++round) {
    Twist xi = Twist::Zero();
    ceres::Problem problem;
    for (const TargetView* v : views)
      problem.AddResidualBlock(new ViewCost(*v, s, whitener(recipe, *v, s)), new ceres::CauchyLoss(3.0 * std::sqrt(3.0 * v->p_target.size())), xi.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.max_num_iterations = 12;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    options.function_tolerance = 1e-14;
    options.parameter_tolerance = 1e-14;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    s = moved(s, xi);
    out.cost = summary.final_cost;
    if (xi.segment<3>(0).norm() < 1e-7 && xi.segment<3>(3).norm() < 1e-10 && xi.segment<3>(6).norm() < 1e-7) {
      out.is_converged = true;
      break;
    }
  }
  out.state = s;
  return out;
}

/// Second-largest independent rotation between the views: the square root of the middle eigenvalue of the log-rotations.
double rotation_spread(const std::vector<TargetView>& views) {
  Mat3 M = Mat3::Zero();
  std::size_t n = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j, ++n) {
      const Vec3 w = quat_log(views[i].T_base_flange.q.conjugate() * views[j].T_base_flange.q);
      M += w * w.transpose();
    }
  Eigen::SelfAdjointEigenSolver<Mat3> es(M / std::max<std::size_t>(1, n));
  return std::sqrt(std::max(0.0, es.eigenvalues()[1]));
}

}  // namespace

Result<Done<HandEye>> calibrate_hand_eye(const HandEyeRecipe& recipe, const std::vector<TargetView>& views) {
  std::vector<const TargetView*> used, held;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].p_target.size() < 3 || views[i].p_target.size() != views[i].p_sensor.size()) continue;
    (recipe.held_out_every_count > 1 && i % recipe.held_out_every_count == recipe.held_out_every_count - 1u ? held : used).push_back(&views[i]);
  }
  if (used.size() < 3 || held.empty())
    return refuse({.code = "calibrate.too_few_views", .where = "captures",
                   .message = fmt::format("found {} views to solve and {} to check; at least 3 and 1 are needed, 20 or more are good: add views", used.size(), held.size()),
                   .measured = static_cast<double>(used.size()), .limit = 3, .unit = "views", .stage = "input"});
  HandEye out;
  out.spread_rad = rotation_spread(views);
  if (out.spread_rad < recipe.spread_min_rad)
    return refuse({.code = "calibrate.motion_degenerate", .where = "captures",
                   .message = fmt::format("the views turn the flange about nearly one axis only: the second independent rotation is {} deg, {} deg are needed; "
                                          "add views tilted by 30 deg about the other axis",
                                          fixed_number(deg_from_rad(out.spread_rad), 1), fixed_number(deg_from_rad(recipe.spread_min_rad), 1)),
                   .measured = deg_from_rad(out.spread_rad), .limit = deg_from_rad(recipe.spread_min_rad), .unit = "deg", .stage = "input"});
  std::vector<TargetView> solve_views;
  for (const TargetView* v : used) solve_views.push_back(*v);
  out.starts = hand_eye_starts(solve_views, recipe.min_motion_rad);
  if (out.starts.empty())
    return refuse({.code = "calibrate.motion_degenerate", .where = "captures",
                   .message = fmt::format("no two views differ by {} deg or more; add views that turn the flange", fixed_number(deg_from_rad(recipe.min_motion_rad), 0)),
                   .limit = deg_from_rad(recipe.min_motion_rad), .unit = "deg", .stage = "input"});

  std::vector<Solved> solved;
  for (const HandEyeStart& start : out.starts) {
    State s{start.T_flange_sensor, {}};
    // the target's pose by the mean over the views: the first view's, refined by the solve
    s.second = used.front()->T_base_flange * start.T_flange_sensor * target_pose(*used.front());
    solved.push_back(solve(recipe, used, s));
  }
  std::size_t best = 0;
  for (std::size_t i = 1; i < solved.size(); ++i)
    if (solved[i].cost < solved[best].cost) best = i;
  if (!solved[best].is_converged)
    return refuse({.code = "calibrate.not_converged", .where = "captures",
                   .message = "the joint solve did not settle; a wrong angle convention or swapped poses do this: check one pose by hand", .stage = "input"});
  const State s = solved[best].state;

  // covariance from the whitened normal equations, inflated where the residuals are larger than the model says
  Eigen::Matrix<double, 12, 12> H = Eigen::Matrix<double, 12, 12>::Zero();
  double chi2 = 0;
  int dof = -12;
  std::vector<Eigen::Matrix<double, 12, 12>> share;
  for (const TargetView* v : used) {
    const Eigen::MatrixXd W = whitener(recipe, *v, s), J = W * state_jacobian(*v, s);
    share.push_back(J.transpose() * J);
    H += share.back();
    chi2 += (W * residual_of(*v, s)).squaredNorm();
    dof += static_cast<int>(3 * v->p_target.size());
  }
  const Eigen::Matrix<double, 12, 12> C = H.ldlt().solve(Eigen::Matrix<double, 12, 12>::Identity());
  const double inflation = std::max(1.0, dof > 0 ? chi2 / dof : 1.0);
  out.covariance = inflation * C.topLeftCorner<6, 6>();
  out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();
  for (std::size_t i = 0; i < solved.size(); ++i) {
    const Vec6 d = twist_between(s.first, solved[i].state.first);
    const double z2 = d.dot(out.covariance.ldlt().solve(d));
    if (z2 > 0.25 && solved[i].is_converged && solved[i].cost < 1.5 * solved[best].cost + 1)
      return refuse({.code = "calibrate.starts_disagree", .where = out.starts[i].method,
                     .message = fmt::format("the solve started from {} ends {} mm away from the best one at equal cost; the views do not determine the sensor's pose: add views with other tilts",
                                            out.starts[i].method, fixed_number(d.head<3>().norm(), 3)),
                     .measured = d.head<3>().norm(), .limit = 0, .unit = "mm", .stage = "input"});
  }
  out.T_flange_sensor = s.first;
  out.T_base_target = s.second;

  double sum = 0, held_sum = 0;
  std::size_t n = 0, held_n = 0, k = 0;
  Vec6 prior;
  prior << Vec3::Constant(1 / (recipe.robot_sd_mm * recipe.robot_sd_mm)), Vec3::Constant(1 / (recipe.robot_sd_rad * recipe.robot_sd_rad));
  for (const TargetView& v : views) {
    if (v.p_target.size() < 3 || v.p_target.size() != v.p_sensor.size()) continue;
    const bool is_held = std::find(held.begin(), held.end(), &v) != held.end();
    const Eigen::VectorXd r = residual_of(v, s);
    (is_held ? held_sum : sum) += r.squaredNorm();
    (is_held ? held_n : n) += v.p_target.size();
    const Eigen::MatrixXd A = robot_jacobian(v, s);
    Mat6 N = A.transpose() * A / (recipe.sensor_sd_mm * recipe.sensor_sd_mm);
    N.diagonal() += prior;
    const Vec6 delta = N.ldlt().solve(A.transpose() * r / (recipe.sensor_sd_mm * recipe.sensor_sd_mm));
    ViewQuality q;
    q.name = v.name, q.is_held_out = is_held;
    q.residual_rms_mm = std::sqrt(r.squaredNorm() / static_cast<double>(v.p_target.size()));
    q.robot_mm = delta.head<3>().norm(), q.robot_rad = delta.tail<3>().norm();
    q.chi2_ratio = (whitener(recipe, v, s) * r).squaredNorm() / static_cast<double>(r.size());
    if (!is_held) q.leverage_ratio = (C * share[k++]).trace() / 12;
    out.views.push_back(q);
  }
  out.fit_rms_mm = std::sqrt(sum / static_cast<double>(n));
  out.held_out_rms_mm = std::sqrt(held_sum / static_cast<double>(held_n));
  return Done<HandEye>{std::move(out), {}};
}

}  // namespace asbuilt
