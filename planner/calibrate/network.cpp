// SPDX-License-Identifier: GPL-3.0-or-later
// The joint solve and its statistics.
#include "planner/calibrate/network.hpp"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "planner/calibrate/network_detail.hpp"
#include "planner/calibrate/statistics.hpp"

namespace asbuilt {

using namespace network;

namespace {

struct Sds {
  double sensor = 0.01, sensor_rad = 1e-4, robot_mm = 0.25, robot_rad = 5e-4;
};

Vec6 weights_of_rows(Sight sight, const Sds& s) {
  Vec6 w = Vec6::Constant(1 / s.sensor);
  if (sight == Sight::pose) w.tail<3>().setConstant(1 / s.sensor_rad);
  return w;
}

Vec6 robot_weights(const Sds& s) {
  Vec6 w;
  w << Vec3::Constant(1 / s.robot_mm), Vec3::Constant(1 / s.robot_rad);
  return w;
}

/// A pose as Ceres sees it: t, q (x, y, z, w). The costs give derivatives by the twist in the first six columns.
class TwistManifold final : public ceres::Manifold {
 public:
  explicit TwistManifold(const std::array<bool, 6>& is_free) {
    for (int i = 0; i < 6; ++i)
      if (is_free[i]) free_.push_back(i);
  }
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return static_cast<int>(free_.size()); }
  bool Plus(const double* x, const double* delta, double* out) const override {
    Vec6 xi = Vec6::Zero();
    for (std::size_t i = 0; i < free_.size(); ++i) xi[free_[i]] = delta[i];
    const Eigen::Map<const Eigen::Quaterniond> q(x + 3);
    Eigen::Map<Vec3>{out} = Eigen::Map<const Vec3>(x) + q * xi.head<3>();
    Eigen::Map<Eigen::Quaterniond>{out + 3} = (q * quat_exp(xi.tail<3>())).normalized();
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(jacobian, 7, TangentSize());
    J.setZero();
    for (std::size_t i = 0; i < free_.size(); ++i) J(free_[i], static_cast<int>(i)) = 1;
    return true;
  }
  bool Minus(const double* y, const double* x, double* out) const override {
    const Eigen::Map<const Eigen::Quaterniond> qx(x + 3), qy(y + 3);
    Vec6 xi;
    xi << qx.conjugate() * Vec3(Eigen::Map<const Vec3>(y) - Eigen::Map<const Vec3>(x)), quat_log(qx.conjugate() * qy);
    for (std::size_t i = 0; i < free_.size(); ++i) out[i] = xi[free_[i]];
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> J(jacobian, TangentSize(), 7);
    J.setZero();
    for (std::size_t i = 0; i < free_.size(); ++i) J(static_cast<int>(i), free_[i]) = 1;
    return true;
  }

 private:
  std::vector<int> free_;
};

struct PoseBlock {
  double v[7];
  template <class A, class B>
  static PoseBlock of(const Pose<A, B>& T) {
    return {{T.p_mm.x(), T.p_mm.y(), T.p_mm.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w()}};
  }
  template <class A, class B>
  static Pose<A, B> pose(const double* v) {
    return {Eigen::Quaterniond(v[6], v[3], v[4], v[5]), Vec3(v[0], v[1], v[2])};
  }
};

/// What the observations of one view share, kept while Ceres asks for one after the other at the same parameters (in one thread).
struct BenchOfView {
  std::array<double, 7 + 7 + 6 + kSensorConstants> at{};
  std::optional<Bench> bench;
  const Bench& get(const Network& network, const NetworkView& view, const double* X, const double* Y, const Vec6& e, const double* sensor) {
    std::array<double, 7 + 7 + 6 + kSensorConstants> now;
    std::copy(X, X + 7, now.begin()), std::copy(Y, Y + 7, now.begin() + 7), std::copy(e.data(), e.data() + 6, now.begin() + 14), std::copy(sensor, sensor + kSensorConstants, now.begin() + 20);
    if (!bench || now != at) bench.emplace(network, view, PoseBlock::pose<frame::Mount, frame::Sensor>(X), PoseBlock::pose<frame::Place, frame::Target>(Y), e, sensor), at = now;
    return *bench;
  }
};

class SightCost final : public ceres::CostFunction {
 public:
  SightCost(const Network& network, const NetworkView& view, const Observation& o, const Vec6& weights, const Eigen::VectorXd& arm_at, BenchOfView& shared)
      : network_(network), view_(view), o_(o), weights_(weights), arm_at_(arm_at), shared_(shared), rows_(rows_of(network.sight)) {
    set_num_residuals(rows_);
    auto& sizes = *mutable_parameter_block_sizes();
    sizes = {7, 7, 6, kSensorConstants};
    if (arm_at.size()) sizes.push_back(static_cast<int>(arm_at.size()));
  }
  bool Evaluate(double const* const* p, double* residuals, double** jacobians) const override {
    Vec6 e = Eigen::Map<const Vec6>(p[2]);
    if (arm_at_.size()) e += view_.robot_twist * (Eigen::Map<const Eigen::VectorXd>(p[4], arm_at_.size()) - arm_at_);
    const Bench& bench = shared_.get(network_, view_, p[0], p[1], e, p[3]);
    double r[6];
    Derivatives d;
    residual_of(bench, o_, view_.T_sensor_target, r, jacobians ? &d : nullptr);
    for (int i = 0; i < rows_; ++i) residuals[i] = r[i] * weights_[i];
    if (!jacobians) return true;
    const auto fill = [&](int block, int columns, const auto& J, int used) {
      if (!jacobians[block]) return;
      for (int i = 0; i < rows_; ++i)
        for (int k = 0; k < columns; ++k) jacobians[block][i * columns + k] = k < used ? weights_[i] * J(i, k) : 0;
    };
    fill(0, 7, d.mount, 6), fill(1, 7, d.target, 6), fill(2, 6, d.robot, 6), fill(3, kSensorConstants, d.sensor, kSensorConstants);
    if (arm_at_.size()) fill(4, static_cast<int>(arm_at_.size()), Eigen::MatrixXd(d.robot.topRows(rows_) * view_.robot_twist), static_cast<int>(arm_at_.size()));
    return true;
  }

 private:
  const Network& network_;
  const NetworkView& view_;
  const Observation& o_;
  Vec6 weights_;
  const Eigen::VectorXd& arm_at_;
  BenchOfView& shared_;
  int rows_;
};

/// (x - mean) / sd of a block, some entries only.
class BeliefCost final : public ceres::CostFunction {
 public:
  BeliefCost(std::vector<double> mean, std::vector<double> weight) : mean_(std::move(mean)), weight_(std::move(weight)) {
    set_num_residuals(static_cast<int>(mean_.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(mean_.size()));
  }
  bool Evaluate(double const* const* p, double* residuals, double** jacobians) const override {
    const std::size_t n = mean_.size();
    for (std::size_t i = 0; i < n; ++i) residuals[i] = weight_[i] * (p[0][i] - mean_[i]);
    if (jacobians && jacobians[0])
      for (std::size_t i = 0; i < n; ++i)
        for (std::size_t k = 0; k < n; ++k) jacobians[0][i * n + k] = i == k ? weight_[i] : 0;
    return true;
  }

 private:
  std::vector<double> mean_, weight_;
};

constexpr double kStandsAsGiven = 1e8;  // belief_count from which the sds are not estimated
const Observation kWhole{};

/// The observations of a view; of a pose: one.
std::size_t observations_count(const Network& n, const NetworkView& v) { return n.sight == Sight::pose ? (v.T_sensor_target ? 1 : 0) : v.observations.size(); }
const Observation& observation(const Network& n, const NetworkView& v, std::size_t i) { return n.sight == Sight::pose ? kWhole : v.observations[i]; }

int common_size(const Network& n) { return 12 + kSensorConstants + static_cast<int>(n.arm_sd.size()); }

std::vector<int> free_of(const Network& n) {
  std::vector<int> f;
  for (int i = 0; i < 6; ++i)
    if (n.is_mount_free[i]) f.push_back(i);
  for (int i = 0; i < 6; ++i)
    if (n.is_target_free[i]) f.push_back(6 + i);
  for (int i = 0; i < kSensorConstants; ++i)
    if (n.sensor_sd[i] > 0) f.push_back(12 + i);
  for (Eigen::Index i = 0; i < n.arm_sd.size(); ++i)
    if (n.arm_sd[i] > 0) f.push_back(12 + kSensorConstants + static_cast<int>(i));
  return f;
}

/// Normal equations of one view about [mount, target, sensor, arm] and its own robot error.
struct ViewNormal {
  Eigen::MatrixXd cc, cr;
  Mat6 rr = Mat6::Zero();  // with the robot's belief
  Eigen::MatrixXd marginal() const { return cc - cr * rr.ldlt().solve(cr.transpose()); }
};

ViewNormal normal_of(const Network& n, const NetworkView& v, const NetworkState& s, const Vec6& robot, const Sds& sds, const std::vector<char>* used) {
  const int size = common_size(n), rows = rows_of(n.sight);
  ViewNormal out;
  out.cc = Eigen::MatrixXd::Zero(size, size), out.cr = Eigen::MatrixXd::Zero(size, 6);
  const Bench bench(n, v, s.T_mount_sensor, s.T_place_target, robot, s.sensor.data());
  const Vec6 w = weights_of_rows(n.sight, sds);
  // fixed sizes: this runs once an observation and dominates where a view has hundreds
  constexpr int kPlain = 12 + kSensorConstants;
  Eigen::Matrix<double, kPlain, kPlain> cc = Eigen::Matrix<double, kPlain, kPlain>::Zero();
  Eigen::Matrix<double, kPlain, 6> cr = Eigen::Matrix<double, kPlain, 6>::Zero();
  for (std::size_t i = 0; i < observations_count(n, v); ++i) {
    if (used && !(*used)[i]) continue;
    double r[6];
    Derivatives d;
    residual_of(bench, observation(n, v, i), v.T_sensor_target, r, &d);
    for (int row = 0; row < rows; ++row) {
      Eigen::Matrix<double, kPlain, 1> j;
      j << d.mount.row(row).transpose(), d.target.row(row).transpose(), d.sensor.row(row).transpose();
      const Vec6 e = w[row] * d.robot.row(row).transpose();
      j *= w[row];
      cc.noalias() += j * j.transpose(), cr.noalias() += j * e.transpose(), out.rr.noalias() += e * e.transpose();
    }
  }
  out.cc.topLeftCorner<kPlain, kPlain>() = cc, out.cr.topRows<kPlain>() = cr;
  if (const Eigen::Index a = n.arm_sd.size(); a > 0) {  // the arm acts through the robot's twist
    out.cr.bottomRows(a) = v.robot_twist.transpose() * out.rr;
    out.cc.bottomRightCorner(a, a) = out.cr.bottomRows(a) * v.robot_twist;
    out.cc.topRightCorner(kPlain, a) = cr * v.robot_twist;
    out.cc.bottomLeftCorner(a, kPlain) = out.cc.topRightCorner(kPlain, a).transpose();
  }
  out.rr.diagonal() += robot_weights(sds).cwiseAbs2();
  return out;
}

/// Inverse on the free parameters through unit-free scaling; directions without information get a huge variance.
Eigen::MatrixXd inverse_on(const Eigen::MatrixXd& H, const std::vector<int>& f) {
  const int n = static_cast<int>(f.size());
  Eigen::MatrixXd A(n, n);
  Eigen::VectorXd scale(n);
  for (int i = 0; i < n; ++i) scale[i] = 1 / std::sqrt(std::max(1e-300, H(f[i], f[i])));
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) A(i, k) = H(f[i], f[k]) * scale[i] * scale[k];
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(0.5 * (A + A.transpose()));
  const Eigen::VectorXd inverse = es.eigenvalues().cwiseMax(1e-13).cwiseInverse();
  const Eigen::MatrixXd C = scale.asDiagonal() * es.eigenvectors() * inverse.asDiagonal() * es.eigenvectors().transpose() * scale.asDiagonal();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(H.rows(), H.cols());
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < n; ++k) out(f[i], f[k]) = 0.5 * (C(i, k) + C(k, i));
  return out;
}

struct Working {
  Network network;  // its views are relinearised
  NetworkState state;
  Sds sds;
  std::vector<char> used;
  std::vector<std::vector<char>> observation_used;
  double cost = 0;
  bool is_converged = false;
};

void ceres_solve(Working& w, bool is_robust, int iterations) {
  Network& n = w.network;
  PoseBlock X = PoseBlock::of(w.state.T_mount_sensor), Y = PoseBlock::of(w.state.T_place_target);
  const Eigen::VectorXd arm_at = w.state.arm;
  std::vector<BenchOfView> shared(n.views.size());
  ceres::Problem problem;
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  const auto pose_block = [&](double* block, const std::array<bool, 6>& is_free) {
    if (std::none_of(is_free.begin(), is_free.end(), [](bool b) { return b; })) problem.AddParameterBlock(block, 7), problem.SetParameterBlockConstant(block);
    else problem.AddParameterBlock(block, 7, new TwistManifold(is_free));
    ordering->AddElementToGroup(block, 1);
  };
  pose_block(X.v, n.is_mount_free), pose_block(Y.v, n.is_target_free);
  std::vector<int> held;
  std::vector<double> mean(kSensorConstants), weight(kSensorConstants, 0);
  bool has_belief = false;
  for (int i = 0; i < kSensorConstants; ++i) {
    mean[i] = w.state.sensor[i];
    if (n.sensor_sd[i] <= 0) held.push_back(i);
    else if (std::isfinite(n.sensor_sd[i])) weight[i] = 1 / n.sensor_sd[i], has_belief = true;
  }
  double* sensor = w.state.sensor.data();
  if (held.size() == kSensorConstants) problem.AddParameterBlock(sensor, kSensorConstants), problem.SetParameterBlockConstant(sensor);
  else problem.AddParameterBlock(sensor, kSensorConstants, held.empty() ? nullptr : new ceres::SubsetManifold(kSensorConstants, held));
  ordering->AddElementToGroup(sensor, 1);
  if (has_belief) problem.AddResidualBlock(new BeliefCost(mean, weight), nullptr, sensor);
  if (arm_at.size()) {
    std::vector<double> zero(arm_at.size(), 0), arm_weight;
    std::vector<int> fixed;
    for (Eigen::Index i = 0; i < arm_at.size(); ++i) {
      arm_weight.push_back(n.arm_sd[i] > 0 ? 1 / n.arm_sd[i] : 0);
      if (!(n.arm_sd[i] > 0)) fixed.push_back(static_cast<int>(i));
    }
    problem.AddParameterBlock(w.state.arm.data(), static_cast<int>(arm_at.size()), fixed.empty() ? nullptr : new ceres::SubsetManifold(static_cast<int>(arm_at.size()), fixed));
    ordering->AddElementToGroup(w.state.arm.data(), 1);
    problem.AddResidualBlock(new BeliefCost(zero, arm_weight), nullptr, w.state.arm.data());
  }
  const Vec6 rows = weights_of_rows(n.sight, w.sds), robot = robot_weights(w.sds);
  const std::vector<double> robot_weight(robot.data(), robot.data() + 6), none(6, 0.0);
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    if (!w.used[k]) continue;
    const NetworkView& v = n.views[k];
    double* e = w.state.robot[k].data();
    problem.AddParameterBlock(e, 6);
    ordering->AddElementToGroup(e, 0);
    problem.AddResidualBlock(new BeliefCost(none, robot_weight), is_robust ? new ceres::CauchyLoss(3.5) : nullptr, e);
    for (std::size_t i = 0; i < observations_count(n, v); ++i) {
      if (!w.observation_used[k][i]) continue;
      std::vector<double*> blocks{X.v, Y.v, e, sensor};
      if (arm_at.size()) blocks.push_back(w.state.arm.data());
      problem.AddResidualBlock(new SightCost(n, v, observation(n, v, i), rows, arm_at, shared[k]), is_robust ? new ceres::CauchyLoss(3.0) : nullptr, blocks);
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = ordering;
  options.max_num_iterations = iterations;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  options.function_tolerance = 1e-12;
  options.parameter_tolerance = 1e-12;
  options.gradient_tolerance = 1e-14;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  w.cost = summary.final_cost;
  w.is_converged = summary.termination_type == ceres::CONVERGENCE;
  w.state.T_mount_sensor = PoseBlock::pose<frame::Mount, frame::Sensor>(X.v);
  w.state.T_place_target = PoseBlock::pose<frame::Place, frame::Target>(Y.v);
  if (arm_at.size() && n.relinearise) n.relinearise(w.state.arm, n.views);
}

struct Statistics {
  Eigen::MatrixXd information, covariance;
  std::vector<Eigen::MatrixXd> shares;
  std::vector<double> robot_dof_mm, robot_dof_rad;  // of each view
  double observations = 0;                          // rows used
  int common = 0;
};

Statistics statistics_of(const Working& w) {
  const Network& n = w.network;
  const int size = common_size(n);
  Statistics s;
  s.information = Eigen::MatrixXd::Zero(size, size);
  for (int i = 0; i < kSensorConstants; ++i)
    if (n.sensor_sd[i] > 0 && std::isfinite(n.sensor_sd[i])) s.information(12 + i, 12 + i) += 1 / (n.sensor_sd[i] * n.sensor_sd[i]);
  for (Eigen::Index i = 0; i < n.arm_sd.size(); ++i)
    if (n.arm_sd[i] > 0) s.information(12 + kSensorConstants + i, 12 + kSensorConstants + i) += 1 / (n.arm_sd[i] * n.arm_sd[i]);
  std::vector<ViewNormal> normals(n.views.size());
  s.shares.resize(n.views.size(), Eigen::MatrixXd::Zero(size, size));
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    if (!w.used[k]) continue;
    normals[k] = normal_of(n, n.views[k], w.state, w.state.robot[k], w.sds, &w.observation_used[k]);
    s.shares[k] = normals[k].marginal();
    s.information += s.shares[k];
    s.observations += rows_of(n.sight) * static_cast<double>(std::count(w.observation_used[k].begin(), w.observation_used[k].end(), 1));
  }
  const std::vector<int> f = free_of(n);
  s.common = static_cast<int>(f.size());
  s.covariance = inverse_on(s.information, f);
  s.robot_dof_mm.assign(n.views.size(), 0), s.robot_dof_rad.assign(n.views.size(), 0);
  const Vec6 wr = robot_weights(w.sds).cwiseAbs2();
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    if (!w.used[k]) continue;
    const Mat6 inverse = normals[k].rr.ldlt().solve(Mat6::Identity());
    const Eigen::MatrixXd G = inverse * normals[k].cr.transpose();
    const Mat6 C = inverse + G * s.covariance * G.transpose();
    s.robot_dof_mm[k] = std::clamp(3 - C.diagonal().head<3>().dot(wr.head<3>()), 0.0, 3.0);
    s.robot_dof_rad[k] = std::clamp(3 - C.diagonal().tail<3>().dot(wr.tail<3>()), 0.0, 3.0);
  }
  return s;
}

double median_of(std::vector<double> v) {
  if (v.empty()) return 0;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

/// Squared whitened residual of each observation of a view at its robot error.
std::vector<double> squares_of(const Working& w, std::size_t k, bool is_rotation = false) {
  const Network& n = w.network;
  const NetworkView& v = n.views[k];
  const Bench bench(n, v, w.state.T_mount_sensor, w.state.T_place_target, w.state.robot[k], w.state.sensor.data());
  const Vec6 weights = weights_of_rows(n.sight, w.sds);
  std::vector<double> out;
  const int rows = rows_of(n.sight), first = is_rotation ? 3 : 0, last = n.sight == Sight::pose ? first + 3 : rows;
  for (std::size_t i = 0; i < observations_count(n, v); ++i) {
    double r[6], sum = 0;
    residual_of(bench, observation(n, v, i), v.T_sensor_target, r, nullptr);
    for (int j = first; j < last; ++j) sum += r[j] * r[j] * weights[j] * weights[j];
    out.push_back(sum);
  }
  return out;
}

/// New sds from belief and redundancy. `is_robust`: by medians, while outliers are still inside.
void update_sds(Working& w, const NetworkRecipe& recipe, const Statistics& s, bool is_robust) {
  const Network& n = w.network;
  const int rows = n.sight == Sight::pose ? 3 : rows_of(n.sight);
  double q_mm = 0, q_rad = 0, r_mm = 0, r_rad = 0;
  std::vector<double> each_mm, each_rad, each_sensor, each_sensor_rad;
  double q_sensor = 0, q_sensor_rad = 0;
  std::size_t sensor_count = 0;
  for (std::size_t k = 0; k < n.views.size(); ++k) {
    if (!w.used[k]) continue;
    const Vec6& e = w.state.robot[k];
    const double a = e.head<3>().squaredNorm(), b = e.tail<3>().squaredNorm();
    q_mm += a, q_rad += b, r_mm += s.robot_dof_mm[k], r_rad += s.robot_dof_rad[k];
    if (s.robot_dof_mm[k] > 0.3) each_mm.push_back(a / s.robot_dof_mm[k]);
    if (s.robot_dof_rad[k] > 0.3) each_rad.push_back(b / s.robot_dof_rad[k]);
    const auto square = squares_of(w, k), turn = n.sight == Sight::pose ? squares_of(w, k, true) : std::vector<double>();
    for (std::size_t i = 0; i < square.size(); ++i) {
      if (!w.observation_used[k][i]) continue;
      q_sensor += square[i], ++sensor_count, each_sensor.push_back(square[i]);
      if (!turn.empty()) q_sensor_rad += turn[i], each_sensor_rad.push_back(turn[i]);
    }
  }
  const double belief = recipe.belief_count;
  // the median of chi-squared over its mean, of 3 and of `rows` degrees of freedom
  const double m3 = chi2_limit(0.5, 3) / 3, mr = chi2_limit(0.5, rows) / rows;
  const auto mixed = [&](double sd0, double sum, double dof, const std::vector<double>& each, double median_ratio) {
    const double var = is_robust ? (each.size() > 2 ? median_of(each) / median_ratio : sd0 * sd0) : (dof > 0 ? sum / dof : 0);
    return std::sqrt((belief * sd0 * sd0 + dof * var) / (belief + dof));
  };
  const double sensor_rows = static_cast<double>(sensor_count) * rows;
  const double r_all = std::max(0.0, s.observations - s.common);
  const double r_sensor = std::max(0.0, r_all - r_mm - r_rad);
  const double before = w.sds.sensor;
  Sds next = w.sds;
  next.robot_mm = mixed(recipe.robot_sd_mm, q_mm, r_mm, each_mm, m3);
  next.robot_rad = mixed(recipe.robot_sd_rad, q_rad, r_rad, each_rad, m3);
  if (n.sight != Sight::pose) {
    // squares are whitened by `before`; spread the redundancy evenly over the rows
    const double per_row = sensor_rows > 0 ? std::max(0.05, r_sensor / sensor_rows) : 1;
    for (double& x : each_sensor) x *= before * before / rows / per_row;
    next.sensor = mixed(recipe.sensor_sd_mm, q_sensor * before * before, r_sensor, each_sensor, mr);
  }
  // of whole poses the sensor's share and the robot's cannot be told apart: the given sd of the sensor stands
  w.sds = next;
}

Working working_of(const NetworkRecipe& recipe, const Network& network, const NetworkState& start) {
  Working w;
  w.network = network, w.state = start;
  w.sds = {recipe.sensor_sd_mm, recipe.sensor_sd_rad, recipe.robot_sd_mm, recipe.robot_sd_rad};
  w.state.robot.assign(network.views.size(), Vec6::Zero());
  if (w.state.arm.size() != network.arm_sd.size()) w.state.arm = Eigen::VectorXd::Zero(network.arm_sd.size());
  for (const NetworkView& v : network.views) {
    w.observation_used.emplace_back(observations_count(network, v), 1);
    w.used.push_back(!v.is_held_out && observations_count(network, v) > 0);
  }
  if (w.state.arm.size() && w.network.relinearise) w.network.relinearise(w.state.arm, w.network.views);
  return w;
}

/// How much the covariance grows because its sds are themselves estimated from a limited number of observations: the variance of
/// Student's distribution, nu / (nu - 2), nu after Satterthwaite from the share of each variance in the mount's covariance.
double student_ratio(const Working& w, const NetworkRecipe& recipe, const Statistics& s) {
  const auto& is_free = w.network.is_mount_free;
  std::vector<int> mount;
  for (int i = 0; i < 6; ++i)
    if (is_free[static_cast<std::size_t>(i)]) mount.push_back(i);
  if (mount.empty() || recipe.belief_count > 1e5) return 1;
  double r_mm = 0, r_rad = 0;
  for (std::size_t k = 0; k < s.robot_dof_mm.size(); ++k) r_mm += s.robot_dof_mm[k], r_rad += s.robot_dof_rad[k];
  const double r_sensor = std::max(0.0, s.observations - s.common - r_mm - r_rad);
  const Eigen::MatrixXd inverse = Eigen::MatrixXd(s.covariance(mount, mount)).ldlt().solve(Eigen::MatrixXd::Identity(static_cast<Eigen::Index>(mount.size()), static_cast<Eigen::Index>(mount.size())));
  constexpr double kStep = 1e-3;
  double one_by_nu = 0;
  const auto add = [&](double Sds::* sd, double dof) {
    Working other = w;
    other.sds.*sd *= 1 + 0.5 * kStep;  // the variance by kStep
    const Eigen::MatrixXd change = statistics_of(other).covariance(mount, mount) - s.covariance(mount, mount);
    const double share = std::clamp((inverse * change).trace() / static_cast<double>(mount.size()) / kStep, 0.0, 1.0);
    one_by_nu += share * share / (recipe.belief_count + dof);
  };
  add(&Sds::robot_mm, r_mm), add(&Sds::robot_rad, r_rad);
  if (w.network.sight != Sight::pose) add(&Sds::sensor, r_sensor);
  const double nu = std::max(4.0, 1 / std::max(1e-9, one_by_nu));
  return nu / (nu - 2);
}

}  // namespace

NetworkSolution solve_network(const NetworkRecipe& recipe, const Network& network, const NetworkState& start) {
  Working w = working_of(recipe, network, start);
  const std::vector<char> wanted = w.used;
  Statistics s;
  for (int round = 0; round < 3; ++round) {
    ceres_solve(w, true, round == 0 ? 100 : 30);
    s = statistics_of(w);
    const Sds before = w.sds;
    update_sds(w, recipe, s, true);
    if (recipe.belief_count > kStandsAsGiven) {  // nothing to find: the first solve was the last
      w.sds = before;
      break;
    }
  }
  double cost = w.cost;
  std::vector<NetworkOutlier> outliers;
  for (int round = 0; round < recipe.rounds_count; ++round) {
    // who is an outlier, at the sds of now
    s = statistics_of(w);
    outliers.clear();
    const auto used_before = w.used;
    const auto observations_before = w.observation_used;
    std::size_t poses = 0, all = 0;
    for (std::size_t k = 0; k < wanted.size(); ++k) poses += wanted[k], all += wanted[k] ? w.observation_used[k].size() : 0;
    const Vec6 wr = robot_weights(w.sds);
    const int rows = rows_of(network.sight);
    const double limit = chi2_limit(recipe.outlier_probability_ratio / std::max<std::size_t>(1, all), rows);
    for (std::size_t k = 0; k < wanted.size(); ++k) {
      if (!wanted[k]) continue;
      if (w.used[k]) {
        const double q = w.state.robot[k].cwiseProduct(wr).squaredNorm(), dof = std::max(1.0, s.robot_dof_mm[k] + s.robot_dof_rad[k]);
        if (chi2_tail(q, dof) < recipe.outlier_probability_ratio / static_cast<double>(poses)) {
          w.used[k] = 0;
          outliers.push_back({k, -1, w.state.robot[k].head<3>().norm(), std::sqrt(q)});
          continue;
        }
        const auto square = squares_of(w, k), turn = network.sight == Sight::pose ? squares_of(w, k, true) : std::vector<double>(square.size(), 0.0);
        for (std::size_t i = 0; i < square.size(); ++i) {
          w.observation_used[k][i] = square[i] + turn[i] <= limit;
          if (!w.observation_used[k][i]) outliers.push_back({k, static_cast<int>(i), std::sqrt(square[i]) * w.sds.sensor, std::sqrt(square[i] + turn[i])});
        }
        if (std::count(w.observation_used[k].begin(), w.observation_used[k].end(), 1) == 0) w.used[k] = 0;
      } else {
        outliers.push_back({k, -1, w.state.robot[k].head<3>().norm(), std::sqrt(w.state.robot[k].cwiseProduct(wr).squaredNorm())});
      }
    }
    const Sds before = w.sds;
    ceres_solve(w, false, recipe.iterations_max_count);
    s = statistics_of(w);
    update_sds(w, recipe, s, false);
    const auto near = [](double a, double b) { return std::abs(a - b) < 2e-3 * b; };
    const bool is_same = used_before == w.used && observations_before == w.observation_used;
    if (round > 0 && is_same && near(w.sds.sensor, before.sensor) && near(w.sds.robot_mm, before.robot_mm) && near(w.sds.robot_rad, before.robot_rad)) break;
    // an outlier stays one: taking views in and out again need not end
  }
  ceres_solve(w, false, recipe.iterations_max_count);
  s = statistics_of(w);
  NetworkSolution out;
  out.state = w.state;
  out.is_converged = w.is_converged;
  out.cost = cost;
  out.dof = static_cast<int>(s.observations) - s.common;
  out.covariance = student_ratio(w, recipe, s) * s.covariance, out.information = s.information, out.view_information = std::move(s.shares);
  out.sensor_sd = w.sds.sensor, out.sensor_sd_rad = w.sds.sensor_rad, out.robot_sd_mm = w.sds.robot_mm, out.robot_sd_rad = w.sds.robot_rad;
  for (std::size_t k = 0; k < wanted.size(); ++k) out.robot_dof += s.robot_dof_mm[k] + s.robot_dof_rad[k];
  out.outliers = std::move(outliers);
  out.is_used = w.used, out.is_observation_used = w.observation_used;
  return out;
}

Eigen::VectorXd raw_residuals(const Network& n, const NetworkView& v, const NetworkState& s) {
  const int rows = rows_of(n.sight);
  const std::size_t count = observations_count(n, v);
  Eigen::VectorXd r(static_cast<Eigen::Index>(count) * rows);
  const Bench bench(n, v, s.T_mount_sensor, s.T_place_target, Vec6::Zero(), s.sensor.data());
  for (std::size_t i = 0; i < count; ++i) residual_of(bench, observation(n, v, i), v.T_sensor_target, r.data() + static_cast<Eigen::Index>(i) * rows, nullptr);
  return r;
}

Pose<frame::Sensor, frame::Target> target_in_sensor(const Network& n, const NetworkView& v, const NetworkState& s, const Vec6& robot) {
  const auto T = v.T_base_flange.disturbed(robot);
  if (n.is_sensor_fixed) {
    const Pose<frame::Mount, frame::Place> M(T.q, T.p_mm);
    return s.T_mount_sensor.inverse() * M * s.T_place_target;
  }
  const Pose<frame::Place, frame::Mount> M(T.q, T.p_mm);
  return s.T_mount_sensor.inverse() * M.inverse() * s.T_place_target;
}

Eigen::MatrixXd information_of_view(const NetworkRecipe& recipe, const Network& n, const NetworkView& v, const NetworkState& s) {
  const Sds sds{recipe.sensor_sd_mm, recipe.sensor_sd_rad, recipe.robot_sd_mm, recipe.robot_sd_rad};
  return normal_of(n, v, s, Vec6::Zero(), sds, nullptr).marginal();
}

Eigen::MatrixXd residual_covariance(const NetworkRecipe& recipe, const Network& n, const NetworkView& v, const NetworkState& s, const Eigen::MatrixXd& covariance) {
  const int rows = rows_of(n.sight), size = common_size(n);
  const std::size_t count = observations_count(n, v);
  const Bench bench(n, v, s.T_mount_sensor, s.T_place_target, Vec6::Zero(), s.sensor.data());
  Eigen::MatrixXd J(static_cast<Eigen::Index>(count) * rows, size), E(J.rows(), 6);
  for (std::size_t i = 0; i < count; ++i) {
    double r[6];
    Derivatives d;
    residual_of(bench, observation(n, v, i), v.T_sensor_target, r, &d);
    const Eigen::Index at = static_cast<Eigen::Index>(i) * rows;
    J.block(at, 0, rows, 6) = d.mount.topRows(rows), J.block(at, 6, rows, 6) = d.target.topRows(rows);
    J.block(at, 12, rows, kSensorConstants) = d.sensor.topRows(rows);
    if (n.arm_sd.size()) J.block(at, 12 + kSensorConstants, rows, n.arm_sd.size()) = d.robot.topRows(rows) * v.robot_twist;
    E.block(at, 0, rows, 6) = d.robot.topRows(rows);
  }
  Vec6 var;
  var << Vec3::Constant(recipe.robot_sd_mm * recipe.robot_sd_mm), Vec3::Constant(recipe.robot_sd_rad * recipe.robot_sd_rad);
  Eigen::MatrixXd S = J * covariance * J.transpose() + E * var.asDiagonal() * E.transpose();
  for (Eigen::Index i = 0; i < S.rows(); ++i) {
    const bool is_angle = n.sight == Sight::pose && i % 6 >= 3;
    const double sd = is_angle ? recipe.sensor_sd_rad : recipe.sensor_sd_mm;
    S(i, i) += sd * sd;
  }
  return S;
}

}  // namespace asbuilt
