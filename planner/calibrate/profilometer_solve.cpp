// SPDX-License-Identifier: GPL-3.0-or-later
// The joint problem: residuals and derivatives by hand, the robot's error of every pose marginalised by a low-rank square root, Ceres.
#include "planner/calibrate/profilometer_solve.hpp"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

/// Right Jacobian of the rotation vector: exp(w + dw) = exp(w) exp(Jr dw).
Mat3 right_jacobian(const Vec3& w) {
  const double a = w.norm();
  const Mat3 W = skew(w);
  if (a < 1e-6) return Mat3::Identity() - 0.5 * W + W * W / 6;
  return Mat3::Identity() - (1 - std::cos(a)) / (a * a) * W + (a - std::sin(a)) / (a * a * a) * W * W;
}

/// Turns derivatives by child-frame twists at the moved state into derivatives by delta itself.
void chain_twists(Eigen::MatrixXd& J, const Eigen::VectorXd& delta, int m) {
  for (const int at : {m, m + 6}) {
    const Vec3 w = delta.segment<3>(at + 3);
    if (w.squaredNorm() == 0) continue;
    const Mat3 back = quat_exp(-w).toRotationMatrix();
    J.middleCols(at, 3) = (J.middleCols(at, 3) * back).eval();
    J.middleCols(at + 3, 3) = (J.middleCols(at + 3, 3) * right_jacobian(w)).eval();
  }
}

Eigen::Index rows_of(const PoseGroup& g) {
  std::size_t n = 0;
  for (const HoleView* v : g.passes) n += 3 * v->holes.size();
  return Eigen::Index(n);
}

PassResiduals group_residuals(const HolePlate& plate, const PoseGroup& g, const ProfilometerState& s, bool with_jacobian) {
  if (g.passes.size() == 1) return residuals_of(plate, *g.passes.front(), s, with_jacobian, false);
  PassResiduals all;
  all.r.resize(rows_of(g));
  if (with_jacobian) all.J.resize(rows_of(g), s.intrinsics.values.size() + 13);
  Eigen::Index at = 0;
  for (const HoleView* v : g.passes) {
    const PassResiduals one = residuals_of(plate, *v, s, with_jacobian, false);
    all.r.segment(at, one.r.size()) = one.r;
    if (with_jacobian) all.J.middleRows(at, one.r.size()) = one.J;
    at += one.r.size();
  }
  return all;
}

class GroupCost : public ceres::CostFunction {
 public:
  GroupCost(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& at, const Whitener& whitener, const Eigen::VectorXd& size)
      : problem_(problem), group_(problem.groups[group]), at_(at), whitener_(whitener), size_(size) {
    set_num_residuals(int(rows_of(group_)));
    mutable_parameter_block_sizes()->push_back(int(size.size()));
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::VectorXd delta = Eigen::Map<const Eigen::VectorXd>(parameters[0], size_.size()).cwiseProduct(size_);
    PassResiduals p = group_residuals(*problem_.plate, group_, moved(at_, delta), jacobians && jacobians[0]);
    if (!p.r.allFinite()) return false;
    whitener_.apply(p.r);
    Eigen::Map<Eigen::VectorXd>(residuals, p.r.size()) = p.r;
    if (jacobians && jacobians[0]) {
      chain_twists(p.J, delta, int(problem_.intrinsics.size()));
      whitener_.apply(p.J);
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(jacobians[0], p.J.rows(), p.J.cols()) = p.J * size_.asDiagonal();
    }
    return true;
  }

 private:
  const ProfilometerProblem& problem_;
  const PoseGroup& group_;
  const ProfilometerState& at_;
  const Whitener& whitener_;
  const Eigen::VectorXd& size_;
};

class PriorCost : public ceres::CostFunction {
 public:
  PriorCost(const ProfilometerProblem& problem, const ParameterTable& table, const ProfilometerState& at) : problem_(problem), table_(table), at_(at) {
    set_num_residuals(problem.parameter_count());
    mutable_parameter_block_sizes()->push_back(problem.parameter_count());
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const Eigen::Index n = table_.size.size();
    const Eigen::VectorXd delta = Eigen::Map<const Eigen::VectorXd>(parameters[0], n).cwiseProduct(table_.size);
    Eigen::Map<Eigen::VectorXd>(residuals, n) = prior_offsets(problem_, moved(at_, delta));
    if (jacobians && jacobians[0]) {
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(jacobians[0], n, n);
      J.setZero();
      for (Eigen::Index i = 0; i < n; ++i)
        if (std::isfinite(table_.prior_sd[i])) J(i, i) = table_.size[i] / table_.prior_sd[i];
    }
    return true;
  }

 private:
  const ProfilometerProblem& problem_;
  const ParameterTable& table_;
  const ProfilometerState& at_;
};

}  // namespace

std::vector<PoseGroup> grouped(const std::vector<HoleView>& views) {
  std::vector<PoseGroup> groups;
  for (const HoleView& v : views) {
    if (v.holes.empty()) continue;
    auto middle = [](const HoleView& w) {
      Vec3 lo = w.holes.front().T_base_flange.p_mm, hi = lo;
      for (const HoleSighting& h : w.holes) lo = lo.cwiseMin(h.T_base_flange.p_mm), hi = hi.cwiseMax(h.T_base_flange.p_mm);
      return FlangePose(w.holes.front().T_base_flange.q, 0.5 * (lo + hi));
    };
    const FlangePose m = middle(v);
    PoseGroup* mine = nullptr;
    for (PoseGroup& g : groups) {
      const Vec6 d = twist_between(middle(*g.passes.front()), m);
      if (g.is_held_out == v.is_held_out && d.head<3>().norm() < 2 && d.tail<3>().norm() < rad_from_deg(0.2)) mine = &g;
    }
    if (!mine) groups.push_back({v.name, {}, v.is_held_out}), mine = &groups.back();
    mine->passes.push_back(&v);
  }
  return groups;
}

ParameterTable parameter_table(const ProfilometerProblem& problem) {
  ParameterTable t;
  const int m = int(problem.intrinsics.size()), n = m + 13;
  t.prior_sd = Eigen::VectorXd::Constant(n, std::numeric_limits<double>::infinity());
  t.size = Eigen::VectorXd::Ones(n);
  for (int i = 0; i < m; ++i) {
    const ModelParameter& p = problem.intrinsics[std::size_t(i)];
    t.names.push_back(p.name), t.prior_sd[i] = p.prior_sd, t.size[i] = p.size;
  }
  for (const char* which : {"hand-eye", "target"})
    for (const char* axis : {"x", "y", "z", "rx", "ry", "rz"}) t.names.push_back(fmt::format("{} {}", which, axis));
  for (const int at : {m, m + 6}) t.size.segment<3>(at).setConstant(10), t.size.segment<3>(at + 3).setConstant(0.1);
  t.names.push_back("latency");
  t.prior_sd[n - 1] = std::max(1e-9, problem.recipe->latency_sd_s);
  t.size[n - 1] = t.prior_sd[n - 1];
  return t;
}

Eigen::VectorXd prior_offsets(const ProfilometerProblem& problem, const ProfilometerState& s) {
  const ParameterTable table = parameter_table(problem);
  Eigen::VectorXd r = Eigen::VectorXd::Zero(problem.parameter_count());
  for (Eigen::Index i = 0; i < r.size(); ++i) {
    if (!std::isfinite(table.prior_sd[i])) continue;
    if (i < Eigen::Index(problem.intrinsics.size())) r[i] = (s.intrinsics.values[i] - problem.intrinsics[std::size_t(i)].prior) / table.prior_sd[i];
    if (i == r.size() - 1) r[i] = (s.latency_s - problem.recipe->latency_s) / table.prior_sd[i];
  }
  return r;
}

ProfilometerState moved(const ProfilometerState& s, const Eigen::VectorXd& delta) {
  const Eigen::Index m = s.intrinsics.values.size();
  ProfilometerState out = s;
  out.intrinsics.values += delta.head(m);
  out.T_flange_sensor = s.T_flange_sensor.disturbed(delta.segment<6>(m));
  out.T_base_target = s.T_base_target.disturbed(delta.segment<6>(m + 6));
  out.latency_s += delta[m + 12];
  return out;
}

PassResiduals residuals_of(const HolePlate& plate, const HoleView& pass, const ProfilometerState& s, bool with_jacobian, bool with_robot) {
  const Eigen::Index n = Eigen::Index(pass.holes.size()), m = s.intrinsics.values.size();
  PassResiduals out;
  out.r.resize(3 * n);
  if (with_jacobian) out.J.resize(3 * n, m + 13);
  if (with_robot) out.robot.resize(3 * n, 6);
  const Mat3 R_target_base = s.T_base_target.rotation().transpose(), R_flange_sensor = s.T_flange_sensor.rotation();
  Eigen::Quaterniond q_last(0, 0, 0, 0);
  Mat3 R_target_flange = Mat3::Zero(), R_target_sensor = Mat3::Zero();
  MapJacobian Jm(2, m);
  for (Eigen::Index j = 0; j < n; ++j) {
    const HoleSighting& h = pass.holes[std::size_t(j)];
    if (h.T_base_flange.q.coeffs() != q_last.coeffs()) {
      q_last = h.T_base_flange.q;
      R_target_flange = R_target_base * q_last.toRotationMatrix();
      R_target_sensor = R_target_flange * R_flange_sensor;
    }
    const Vec2 xz = plane_point(s.intrinsics, h.uv, with_jacobian ? &Jm : nullptr);
    const Vec3 p_sensor(xz.x(), 0, xz.y()), p_flange = R_flange_sensor * p_sensor + s.T_flange_sensor.p_mm;
    const Vec3 p_target = R_target_flange * p_flange + R_target_base * (h.T_base_flange.p_mm + h.velocity_base_mm_s * s.latency_s - s.T_base_target.p_mm);
    const Eigen::Index i = 3 * j;
    out.r.segment<3>(i) = p_target - hole_center(plate, h.column, h.row);
    if (with_jacobian) {
      out.J.block(i, 0, 3, m).noalias() = R_target_sensor.col(0) * Jm.row(0) + R_target_sensor.col(2) * Jm.row(1);
      out.J.block<3, 3>(i, m) = R_target_sensor;
      // -R [p]x, p = (x, 0, z)
      out.J.col(m + 3).segment<3>(i) = -R_target_sensor.col(1) * p_sensor.z();
      out.J.col(m + 4).segment<3>(i) = R_target_sensor.col(0) * p_sensor.z() - R_target_sensor.col(2) * p_sensor.x();
      out.J.col(m + 5).segment<3>(i) = R_target_sensor.col(1) * p_sensor.x();
      out.J.block<3, 3>(i, m + 6) = -Mat3::Identity();
      out.J.block<3, 3>(i, m + 9) = skew(p_target);
      out.J.col(m + 12).segment<3>(i) = R_target_base * h.velocity_base_mm_s;
    }
    if (with_robot) {
      out.robot.block<3, 3>(i, 0) = R_target_flange;
      out.robot.block<3, 3>(i, 3) = -R_target_flange * skew(p_flange);
    }
  }
  return out;
}

void Whitener::apply(Eigen::Ref<Eigen::MatrixXd> m) const {
  m.array().colwise() *= w.array();
  if (Q.cols() > 0) m.noalias() -= Q * (c.asDiagonal() * (Q.transpose() * m));
}

Whitener whitener_of(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& s) {
  const PoseGroup& g = problem.groups[group];
  const ProfilometerRecipe& recipe = *problem.recipe;
  Whitener out;
  out.w.resize(rows_of(g));
  Eigen::Index at = 0;
  std::size_t hole = 0;
  const double extra = recipe.path_sd_mm * recipe.path_sd_mm;
  for (const HoleView* v : g.passes)
    for (const HoleSighting& h : v->holes) {
      Vec3 var = h.sd_target_mm.cwiseAbs2();
      var.array() += extra;
      var.head<2>().array() += problem.plate->sd_mm * problem.plate->sd_mm;
      const double weight = problem.weights.empty() ? 1.0 : problem.weights[group][hole];
      out.w.segment<3>(at) = (weight / var.array()).sqrt();
      at += 3, ++hole;
    }
  if (!problem.has_robot_error) return out;
  const Eigen::Index passes = Eigen::Index(g.passes.size());
  const bool has_repeat = passes > 1;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows_of(g), has_repeat ? 6 * (1 + passes) : 6);
  at = 0;
  const double scale = problem.robot_scale_ratio * g.robot_scale_ratio;
  for (Eigen::Index k = 0; k < passes; ++k) {
    const PassResiduals p = residuals_of(*problem.plate, *g.passes[std::size_t(k)], s, false, true);
    const Eigen::Index n = p.r.size();
    A.block(at, 0, n, 3) = p.robot.leftCols<3>() * (scale * recipe.robot_sd_mm);
    A.block(at, 3, n, 3) = p.robot.rightCols<3>() * (scale * recipe.robot_sd_rad);
    if (has_repeat) {
      A.block(at, 6 + 6 * k, n, 3) = p.robot.leftCols<3>() * (problem.robot_scale_ratio * recipe.repeat_sd_mm);
      A.block(at, 9 + 6 * k, n, 3) = p.robot.rightCols<3>() * (problem.robot_scale_ratio * recipe.repeat_sd_rad);
    }
    at += n;
  }
  A.array().colwise() *= out.w.array();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(A.transpose() * A);
  const Eigen::Index all = A.cols();
  const double floor = 1e-12 * std::max(1.0, es.eigenvalues()[all - 1]);
  Eigen::Index first = 0;
  while (first < all && es.eigenvalues()[first] <= floor) ++first;
  const Eigen::VectorXd lambda = es.eigenvalues().tail(all - first);
  out.Q = A * es.eigenvectors().rightCols(all - first) * lambda.cwiseSqrt().cwiseInverse().asDiagonal();
  out.c = 1 - (1 + lambda.array()).rsqrt();
  return out;
}

SolveReport solve_joint(const ProfilometerProblem& problem, const ProfilometerState& start, int rounds_max_count) {
  const ParameterTable table = parameter_table(problem);
  const Eigen::Index n = problem.parameter_count();
  SolveReport out;
  out.state = start;
  for (int round = 0; round < rounds_max_count; ++round) {
    const ProfilometerState at = out.state;
    std::vector<Whitener> whiteners;
    for (std::size_t g = 0; g < problem.groups.size(); ++g) whiteners.push_back(whitener_of(problem, g, at));
    Eigen::VectorXd x = Eigen::VectorXd::Zero(n);
    ceres::Problem ceres_problem;
    for (std::size_t g = 0; g < problem.groups.size(); ++g)
      ceres_problem.AddResidualBlock(new GroupCost(problem, g, at, whiteners[g], table.size), nullptr, x.data());
    ceres_problem.AddResidualBlock(new PriorCost(problem, table, at), nullptr, x.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = round == 0 ? 80 : 30;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    options.function_tolerance = 1e-9;
    options.gradient_tolerance = 1e-12;
    options.parameter_tolerance = 1e-10;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &ceres_problem, &summary);
    out.iteration_count += int(summary.iterations.size());
    out.cost = summary.final_cost;
    if (summary.termination_type == ceres::FAILURE || !std::isfinite(summary.final_cost)) break;
    out.state = moved(at, x.cwiseProduct(table.size));
    // the whitening hangs on the state; it stands when the poses hardly move any more
    const Vec3 t = x.segment<3>(problem.intrinsics.size()) * table.size[Eigen::Index(problem.intrinsics.size())];
    const Vec3 r = x.segment<3>(Eigen::Index(problem.intrinsics.size()) + 3) * 0.1;
    const bool is_settled = summary.termination_type == ceres::CONVERGENCE;
    if (is_settled && t.norm() < 0.5 && r.norm() < 0.005) {
      out.is_converged = true;
      break;
    }
  }
  return out;
}

ProfilometerMerit::ProfilometerMerit(const ProfilometerProblem& problem, const ProfilometerState& whitened_at) : problem_(problem) {
  for (std::size_t g = 0; g < problem.groups.size(); ++g) whiteners_.push_back(whitener_of(problem, g, whitened_at));
}

double ProfilometerMerit::operator()(const ProfilometerState& s) const {
  double sum = 0;
  for (std::size_t g = 0; g < problem_.groups.size(); ++g) {
    PassResiduals p = group_residuals(*problem_.plate, problem_.groups[g], s, false);
    whiteners_[g].apply(p.r);
    sum += p.r.squaredNorm();
  }
  sum += prior_offsets(problem_, s).squaredNorm();
  return std::isfinite(sum) ? sum : 1e300;
}

std::vector<HoleView> smoothed(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& s) {
  const Vec6 error = problem.has_robot_error ? group_error(problem, group, s).twist : Vec6::Zero();
  std::vector<HoleView> out;
  for (const HoleView* v : problem.groups[group].passes) {
    out.push_back(*v);
    for (HoleSighting& h : out.back().holes) {
      FlangePose at = h.T_base_flange;
      at.p_mm += h.velocity_base_mm_s * s.latency_s;
      const Vec3 p = (at.disturbed(error) * s.T_flange_sensor).inverse().point(s.T_base_target.point(hole_center(*problem.plate, h.column, h.row)));
      Vec2 uv;
      if (pixel_of(s.intrinsics, {p.x(), p.z()}, h.uv, uv)) h.uv = uv;
    }
  }
  return out;
}

Information information_of(const ProfilometerProblem& problem, const ProfilometerState& s) {
  const Eigen::Index n = problem.parameter_count();
  Information out{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    const std::vector<HoleView> passes = smoothed(problem, g, s);
    PoseGroup clean = problem.groups[g];
    for (std::size_t k = 0; k < passes.size(); ++k) clean.passes[k] = &passes[k];
    PassResiduals p = group_residuals(*problem.plate, clean, s, true);
    whitener_of(problem, g, s).apply(p.J);
    out.data.selfadjointView<Eigen::Lower>().rankUpdate(p.J.transpose());
  }
  out.data = out.data.selfadjointView<Eigen::Lower>();
  const Eigen::VectorXd sd = parameter_table(problem).prior_sd;
  for (Eigen::Index i = 0; i < n; ++i)
    if (std::isfinite(sd[i])) out.prior[i] = 1 / (sd[i] * sd[i]);
  return out;
}

ProfilometerState polished(const ProfilometerProblem& problem, ProfilometerState s) {
  const ParameterTable table = parameter_table(problem);
  const Eigen::Index n = problem.parameter_count();
  for (int round = 0; round < 4; ++round) {
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd gradient = Eigen::VectorXd::Zero(n);
    for (std::size_t g = 0; g < problem.groups.size(); ++g) {
      const std::vector<HoleView> passes = smoothed(problem, g, s);
      PoseGroup clean = problem.groups[g];
      for (std::size_t k = 0; k < passes.size(); ++k) clean.passes[k] = &passes[k];
      Eigen::MatrixXd J = group_residuals(*problem.plate, clean, s, true).J;
      Eigen::VectorXd r = group_residuals(*problem.plate, problem.groups[g], s, false).r;
      const Whitener w = whitener_of(problem, g, s);
      w.apply(J), w.apply(r);
      H.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
      gradient += J.transpose() * r;
    }
    H = H.selfadjointView<Eigen::Lower>();
    const Eigen::VectorXd offsets = prior_offsets(problem, s);
    for (Eigen::Index i = 0; i < n; ++i)
      if (std::isfinite(table.prior_sd[i])) H(i, i) += 1 / (table.prior_sd[i] * table.prior_sd[i]), gradient[i] += offsets[i] / table.prior_sd[i];
    const Eigen::VectorXd d = H.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::VectorXd step = -(d.asDiagonal() * (d.asDiagonal() * H * d.asDiagonal()).ldlt().solve(d.asDiagonal() * gradient));
    if (!step.allFinite()) break;
    s = moved(s, step);
    if (step.cwiseAbs2().dot(H.diagonal()) < 1e-4) break;
  }
  return s;
}

Eigen::MatrixXd covariance_of(const Information& information, const Eigen::VectorXd& size) {
  Eigen::MatrixXd H = information.data;
  H.diagonal() += information.prior;
  // to a unit diagonal, so that mm, rad and lens numbers weigh alike
  Eigen::VectorXd d = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd S = d.asDiagonal() * H * d.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(S);
  const Eigen::VectorXd l = es.eigenvalues().cwiseMax(1e-14 * es.eigenvalues().maxCoeff()).cwiseInverse();
  Eigen::MatrixXd C = d.asDiagonal() * (es.eigenvectors() * l.asDiagonal() * es.eigenvectors().transpose()) * d.asDiagonal();
  return 0.5 * (C + C.transpose());
}

GroupError group_error(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& s) {
  const PoseGroup& g = problem.groups[group];
  const ProfilometerRecipe& recipe = *problem.recipe;
  // explicit: common twist and one per pass, MAP
  const Eigen::Index passes = Eigen::Index(g.passes.size()), n = passes > 1 ? 6 * (1 + passes) : 6;
  ProfilometerProblem plain = problem;
  plain.has_robot_error = false;
  const Eigen::VectorXd w = whitener_of(plain, group, s).w;
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(w.size(), n);
  Eigen::VectorXd r(w.size());
  Eigen::Index at = 0;
  for (Eigen::Index k = 0; k < passes; ++k) {
    const PassResiduals p = residuals_of(*problem.plate, *g.passes[std::size_t(k)], s, false, true);
    r.segment(at, p.r.size()) = p.r;
    A.block(at, 0, p.r.size(), 6) = p.robot;
    if (passes > 1) A.block(at, 6 + 6 * k, p.r.size(), 6) = p.robot;
    at += p.r.size();
  }
  Eigen::VectorXd prior(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const bool is_common = i < 6, is_shift = i % 6 < 3;
    const double sd = is_common ? (is_shift ? recipe.robot_sd_mm : recipe.robot_sd_rad) : (is_shift ? recipe.repeat_sd_mm : recipe.repeat_sd_rad);
    prior[i] = 1 / (sd * sd * problem.robot_scale_ratio * problem.robot_scale_ratio * (is_common ? g.robot_scale_ratio * g.robot_scale_ratio : 1.0));
  }
  const Eigen::MatrixXd WA = w.asDiagonal() * A;
  Eigen::MatrixXd N = WA.transpose() * WA;
  N.diagonal() += prior;
  // r = -A delta: the flange was elsewhere by delta
  const Eigen::VectorXd delta = -N.ldlt().solve(WA.transpose() * (w.asDiagonal() * r));
  GroupError out;
  out.twist = delta.head<6>();
  for (int i = 0; i < 6; ++i) {
    const double sd = i < 3 ? recipe.robot_sd_mm : recipe.robot_sd_rad;
    out.chi2 += out.twist[i] * out.twist[i] / (sd * sd * problem.robot_scale_ratio * problem.robot_scale_ratio);
  }
  out.left = r + A * delta;
  return out;
}

}  // namespace asbuilt
