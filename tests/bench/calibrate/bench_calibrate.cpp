// SPDX-License-Identifier: GPL-3.0-or-later
// Time and memory of each solve beside a peer on the same data in the same run.
#include <ceres/ceres.h>
#include <sys/resource.h>

#include <Eigen/Dense>
#include <algorithm>
#include <ctime>
#include <cstdio>
#include <functional>
#include <nlopt.hpp>
#include <opencv2/calib3d.hpp>

#include "planner/calibrate/solve.hpp"
#include "tests/support/calibrate_rig.hpp"

namespace {

using namespace asbuilt;
using testing_calibrate::make_rig;
using testing_calibrate::Rig;

/// Median of several runs, ms of processor time: the machine may be busy with other things.
double ms_of(int runs, const std::function<void()>& f) {
  std::vector<double> t;
  for (int i = 0; i < runs; ++i) {
    const std::clock_t a = std::clock();
    f();
    t.push_back(1000.0 * static_cast<double>(std::clock() - a) / CLOCKS_PER_SEC);
  }
  std::sort(t.begin(), t.end());
  return t[t.size() / 2];
}

double memory_mib() {
  rusage u{};
  getrusage(RUSAGE_SELF, &u);
  return static_cast<double>(u.ru_maxrss) / 1024;
}

void row(const char* what, double ms, double error_mm) { std::printf("%-58s %10.2f ms   error at 206 mm %8.4f mm   peak %6.1f MiB\n", what, ms, error_mm, memory_mib()); }

/// The same merit for the peers: residuals of each view, whitened once at the start.
struct Merit {
  const Network* n;
  NetworkState at;
  std::vector<Eigen::MatrixXd> whiten;
  NetworkState moved(const double* x) const {
    NetworkState s = at;
    s.T_mount_sensor = at.T_mount_sensor.disturbed(Eigen::Map<const Vec6>(x)), s.T_place_target = at.T_place_target.disturbed(Eigen::Map<const Vec6>(x + 6));
    return s;
  }
  double operator()(const double* x) const {
    const NetworkState s = moved(x);
    double sum = 0;
    for (std::size_t k = 0; k < n->views.size(); ++k) sum += (whiten[k] * raw_residuals(*n, n->views[k], s)).squaredNorm();
    return sum;
  }
};

struct NumericView {
  const Merit* m;
  std::size_t view;
  bool operator()(double const* const* x, double* r) const {
    const Eigen::VectorXd e = m->whiten[view] * raw_residuals(*m->n, m->n->views[view], m->moved(x[0]));
    std::copy(e.data(), e.data() + e.size(), r);
    return true;
  }
};

/// One point of a target as somebody would write it down who wants the same as the joint solve: the robot's error of the view as six
/// more unknowns.
struct NumericPoint {
  const Merit* m;
  std::size_t view, observation;
  double sensor_sd_mm;
  bool operator()(const double* x, const double* robot, double* r) const {
    const NetworkState s = m->moved(x);
    const NetworkView& v = m->n->views[view];
    const Observation& o = v.observations[observation];
    Eigen::Map<Vec3>{r} = (o.z - target_in_sensor(*m->n, v, s, Eigen::Map<const Vec6>(robot)).point(o.p_target)) / sensor_sd_mm;
    return true;
  }
};
struct NumericRobot {
  double sd_mm, sd_rad;
  bool operator()(const double* e, double* r) const {
    for (int i = 0; i < 6; ++i) r[i] = e[i] / (i < 3 ? sd_mm : sd_rad);
    return true;
  }
};

}  // namespace

int main() {
  const Rig g = make_rig({.seed = 5, .views_count = 27, .robot_mm = 0.2, .robot_rad = 3e-4, .noise_mm = 0.01, .drop_ball_every = 0});
  NetworkRecipe recipe;
  recipe.robot_sd_mm = 0.2, recipe.robot_sd_rad = 3e-4, recipe.sensor_sd_mm = 0.01;
  const auto motions = g.motions();
  const auto error = [&](const Pose<frame::Mount, frame::Sensor>& X) { return (X.point(Vec3(0, 0, 206)) - g.truth.T_mount_sensor.point(Vec3(0, 0, 206))).norm(); };
  std::vector<MotionStart> starts;
  const double t_closed = ms_of(21, [&] { starts = motion_starts(motions, 0.26); });
  row("four closed forms (park shown)", t_closed, error(starts[0].T_mount_sensor));

  std::vector<cv::Mat> Rg, tg, Rt, tt, Rw, tw;
  const auto push = [](const Mat3& R, const Vec3& t, std::vector<cv::Mat>& rs, std::vector<cv::Mat>& ts) {
    cv::Mat r(3, 3, CV_64F), v(3, 1, CV_64F);
    for (int i = 0; i < 3; ++i) {
      v.at<double>(i) = t[i];
      for (int k = 0; k < 3; ++k) r.at<double>(i, k) = R(i, k);
    }
    rs.push_back(r), ts.push_back(v);
  };
  for (const MotionView& m : motions) {
    push(m.T_place_mount.rotation(), m.T_place_mount.p_mm, Rg, tg), push(m.T_sensor_target.rotation(), m.T_sensor_target.p_mm, Rt, tt);
    const auto back = m.T_place_mount.inverse();
    push(back.rotation(), back.p_mm, Rw, tw);
  }
  const auto pose_of = [](const cv::Mat& R, const cv::Mat& t) {
    Mat3 M;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) M(i, k) = R.at<double>(i, k);
    return Pose<frame::Mount, frame::Sensor>(Eigen::Quaterniond(M).normalized(), Vec3(t.at<double>(0), t.at<double>(1), t.at<double>(2)));
  };
  cv::Mat R, t, R2, t2;
  const double t_cv = ms_of(21, [&] { cv::calibrateHandEye(Rg, tg, Rt, tt, R, t, cv::CALIB_HAND_EYE_PARK); });
  row("  peer: OpenCV calibrateHandEye, Park", t_cv, error(pose_of(R, t)));
  try {
    // their X: target in sensor times .. ; base to gripper poses in, world to camera poses in
    const double t_shah = ms_of(21, [&] { cv::calibrateRobotWorldHandEye(Rt, tt, Rw, tw, R2, t2, R, t, cv::CALIB_ROBOT_WORLD_HAND_EYE_SHAH); });
    const auto X = pose_of(R, t);
    row("  peer: OpenCV calibrateRobotWorldHandEye, Shah", t_shah, std::min(error(X), error([&] {
          const auto b = X.inverse();
          return Pose<frame::Mount, frame::Sensor>(b.q, b.p_mm);
        }())));
  } catch (const cv::Exception& e) {
    std::printf("  peer: OpenCV calibrateRobotWorldHandEye failed: %s\n", e.what());
  }

  NetworkState at = g.truth;
  at.T_mount_sensor = starts[0].T_mount_sensor, at.T_place_target = starts[0].T_place_target;
  NetworkSolution s;
  const double t_joint = ms_of(11, [&] { s = solve_network(recipe, g.network, at); });
  row("joint solve with outliers, sds and covariance", t_joint, error(s.state.T_mount_sensor));
  NetworkRecipe quick = recipe;
  quick.rounds_count = 0;
  const double t_quick = ms_of(11, [&] { s = solve_network(quick, g.network, at); });
  row("joint solve, once through", t_quick, error(s.state.T_mount_sensor));

  NetworkRecipe given = quick;
  given.belief_count = 1e9;
  const double t_given = ms_of(11, [&] { s = solve_network(given, g.network, at); });
  row("  of this with sds given: one robust, one plain, covariance", t_given, error(s.state.T_mount_sensor));

  Merit merit{&g.network, at, {}};
  const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(12 + kSensorConstants, 12 + kSensorConstants);
  for (const NetworkView& v : g.network.views) {
    const Eigen::LLT<Eigen::MatrixXd> llt(residual_covariance(recipe, g.network, v, at, none));
    merit.whiten.push_back(llt.matrixL().solve(Eigen::MatrixXd::Identity(llt.rows(), llt.rows())));
  }
  double x[12];
  const double t_numeric = ms_of(5, [&] {
    std::fill(x, x + 12, 0.0);
    ceres::Problem problem;
    for (std::size_t k = 0; k < g.network.views.size(); ++k) {
      auto* cost = new ceres::DynamicNumericDiffCostFunction<NumericView>(new NumericView{&merit, k});
      cost->AddParameterBlock(12);
      cost->SetNumResiduals(static_cast<int>(merit.whiten[k].rows()));
      problem.AddResidualBlock(cost, nullptr, x);
    }
    ceres::Solver::Options options;
    options.logging_type = ceres::SILENT;
    options.num_threads = 1;
    options.function_tolerance = 1e-12;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
  });
  row("  peer: Ceres, numeric, marginalised, no loss, no covariance", t_numeric, error(merit.moved(x).T_mount_sensor));

  const auto explicit_solve = [&](bool is_robust) {
    std::fill(x, x + 12, 0.0);
    std::vector<Vec6> robot(g.network.views.size(), Vec6::Zero());
    ceres::Problem problem;
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    problem.AddParameterBlock(x, 12);
    ordering->AddElementToGroup(x, 1);
    for (std::size_t k = 0; k < robot.size(); ++k) {
      problem.AddResidualBlock(new ceres::NumericDiffCostFunction<NumericRobot, ceres::CENTRAL, 6, 6>(new NumericRobot{recipe.robot_sd_mm, recipe.robot_sd_rad}), is_robust ? new ceres::CauchyLoss(3.5) : nullptr, robot[k].data());
      ordering->AddElementToGroup(robot[k].data(), 0);
      for (std::size_t i = 0; i < g.network.views[k].observations.size(); ++i)
        problem.AddResidualBlock(new ceres::NumericDiffCostFunction<NumericPoint, ceres::CENTRAL, 3, 12, 6>(new NumericPoint{&merit, k, i, recipe.sensor_sd_mm}), is_robust ? new ceres::CauchyLoss(3.0) : nullptr, x, robot[k].data());
    }
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.linear_solver_ordering = ordering;
    options.logging_type = ceres::SILENT;
    options.num_threads = 1;
    options.function_tolerance = 1e-12;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
  };
  const double t_robust = ms_of(5, [&] { explicit_solve(true), explicit_solve(false); });
  row("  peer: Ceres, numeric derivatives, one robust, one plain", t_robust, error(merit.moved(x).T_mount_sensor));

  std::vector<double> y(12, 0.0);
  double value = 0;
  const double t_nlopt = ms_of(1, [&] {
    nlopt::opt opt(nlopt::LN_BOBYQA, 12);
    const auto f = [](const std::vector<double>& p, std::vector<double>&, void* data) {
      std::vector<double> q = p;
      for (int i = 0; i < 12; ++i)
        if (i % 6 >= 3) q[static_cast<std::size_t>(i)] /= 200;  // turns in parts of 200 mm
      return (*static_cast<const Merit*>(data))(q.data());
    };
    opt.set_min_objective(f, &merit);
    opt.set_initial_step(0.1);
    opt.set_ftol_rel(1e-10);
    opt.set_maxeval(5000);
    std::fill(y.begin(), y.end(), 0.0);
    opt.optimize(y, value);
  });
  for (int i = 0; i < 12; ++i)
    if (i % 6 >= 3) y[static_cast<std::size_t>(i)] /= 200;
  row("  peer: NLopt BOBYQA, same merit", t_nlopt, error(merit.moved(y.data()).T_mount_sensor));

  const Rig board = make_rig({.seed = 6, .views_count = 20, .robot_mm = 0.1, .robot_rad = 2e-4, .noise_mm = 0.1, .sight = Sight::pixel});
  NetworkRecipe px;
  px.sensor_sd_mm = 0.1, px.robot_sd_mm = 0.1, px.robot_sd_rad = 2e-4;
  const double t_board = ms_of(3, [&] { s = solve_network(px, board.network, board.truth); });
  row("board of 48 points, 20 images: joint solve", t_board, (s.state.T_mount_sensor.point(Vec3(0, 0, 206)) - board.truth.T_mount_sensor.point(Vec3(0, 0, 206))).norm());
  const Rig line = make_rig({.seed = 7, .views_count = 20, .tilt_deg = 45, .robot_mm = 0.1, .robot_rad = 1e-4, .noise_mm = 0.02, .sight = Sight::sphere});
  NetworkRecipe mm;
  mm.sensor_sd_mm = 0.02, mm.robot_sd_mm = 0.1, mm.robot_sd_rad = 1e-4;
  const double t_line = ms_of(3, [&] { s = solve_network(mm, line.network, line.truth); });
  row("laser lines on a ball, 20 x 80 points: joint solve", t_line, (s.state.T_mount_sensor.point(Vec3(0, 0, 206)) - line.truth.T_mount_sensor.point(Vec3(0, 0, 206))).norm());
  return 0;
}
