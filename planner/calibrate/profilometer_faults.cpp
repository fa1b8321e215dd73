// SPDX-License-Identifier: GPL-3.0-or-later
// Named faults by score tests: one more cause is added to the model at its solution; its best value, its covariance and the fall of chi2
// follow from first derivatives, all other parameters adjusting.  Source: [Rao1948]. By orthogonal factors throughout: lens, plane and
// hand-eye are so alike that normal equations would read causes from their own round-off.
#include <Eigen/Dense>
#include <algorithm>

#include "planner/calibrate/profilometer_observe.hpp"

namespace asbuilt {
namespace {

Eigen::MatrixXd triangle(const Eigen::MatrixXd& A) {
  if (A.rows() <= A.cols()) return A;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(A);
  return qr.matrixQR().topRows(A.cols()).triangularView<Eigen::Upper>();
}

/// Triangular factor of the whitened [J | B | r] of a group; J in units of the parameters' sizes, B by `extra` from its passes.
template <class Extra>
Eigen::MatrixXd factor_of(const ProfilometerProblem& problem, std::size_t g, const ProfilometerState& state, Eigen::Index columns, Extra&& extra) {
  const PoseGroup& group = problem.groups[g];
  const Eigen::VectorXd size = parameter_table(problem).size;
  const Eigen::Index n = size.size();
  Eigen::Index rows = 0;
  for (const HoleView* v : group.passes) rows += 3 * Eigen::Index(v->holes.size());
  Eigen::MatrixXd A(rows, n + columns + 1);
  Eigen::Index at = 0;
  const std::vector<HoleView> clean = smoothed(problem, g, state);
  for (std::size_t k = 0; k < group.passes.size(); ++k) {
    const HoleView* v = group.passes[k];
    PassResiduals p = residuals_of(*problem.plate, clean[k], state, true, false);
    p.r = residuals_of(*problem.plate, *v, state, false, false).r;
    A.block(at, 0, p.r.size(), n) = p.J * size.asDiagonal();
    if (columns > 0) A.block(at, n, p.r.size(), columns) = extra(*v, p);
    A.block(at, n + columns, p.r.size(), 1) = p.r;
    at += p.r.size();
  }
  whitener_of(problem, g, state).apply(A);
  return triangle(A);
}

/// The test from stacked rows [J | B | r]; priors of the parameters and of the cause are added here.
ScoreTest score(const ProfilometerProblem& problem, const ProfilometerState& state, const Eigen::MatrixXd& rows, const Eigen::VectorXd& sd) {
  const ParameterTable table = parameter_table(problem);
  const Eigen::Index n = table.size.size(), b = sd.size();
  const Eigen::VectorXd offsets = prior_offsets(problem, state);
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows.rows() + n + b, n + b + 1);
  A.topRows(rows.rows()) = rows;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (std::isfinite(table.prior_sd[i])) A(rows.rows() + i, i) = table.size[i] / table.prior_sd[i];
    A(rows.rows() + i, n + b) = offsets[i];
  }
  for (Eigen::Index i = 0; i < b; ++i) A(rows.rows() + n + i, n + i) = 1 / sd[i];
  const Eigen::MatrixXd R = triangle(A);
  const Eigen::MatrixXd Rb = R.block(n, n, b, b);
  const Eigen::VectorXd rb = R.block(n, n + b, b, 1);
  const Eigen::MatrixXd inverse = Rb.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(b, b));
  return {-inverse * rb, inverse * inverse.transpose(), rb.squaredNorm()};
}

}  // namespace

std::vector<ScoreTest> moved_sensor_tests(const ProfilometerProblem& problem, const ProfilometerState& state) {
  const Eigen::Index m = Eigen::Index(problem.intrinsics.size()), n = m + 13;
  const Eigen::VectorXd size = parameter_table(problem).size;
  std::vector<Eigen::MatrixXd> factors;
  Eigen::Index rows = 0;
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    factors.push_back(factor_of(problem, g, state, 0, [](const HoleView&, const PassResiduals&) { return Eigen::MatrixXd(); }));
    rows += factors.back().rows();
  }
  Vec6 sd;
  sd << Vec3::Constant(1), Vec3::Constant(0.01);
  std::vector<ScoreTest> tests;
  for (std::size_t first = 1; first < factors.size(); ++first) {
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows, n + 7);
    Eigen::Index at = 0;
    for (std::size_t g = 0; g < factors.size(); ++g) {
      const Eigen::MatrixXd& F = factors[g];
      A.block(at, 0, F.rows(), n) = F.leftCols(n);
      if (g >= first) A.block(at, n, F.rows(), 6) = F.middleCols(m, 6) * size.segment<6>(m).cwiseInverse().asDiagonal();
      A.block(at, n + 6, F.rows(), 1) = F.rightCols<1>();
      at += F.rows();
    }
    tests.push_back(score(problem, state, A, sd));
  }
  return tests;
}

ScoreTest plate_scale_test(const ProfilometerProblem& problem, const ProfilometerState& state) {
  std::vector<Eigen::MatrixXd> factors;
  Eigen::Index rows = 0, at = 0;
  for (std::size_t g = 0; g < problem.groups.size(); ++g) {
    factors.push_back(factor_of(problem, g, state, 2, [&](const HoleView& v, const PassResiduals& p) {
      Eigen::MatrixXd B = Eigen::MatrixXd::Zero(p.r.size(), 2);
      for (std::size_t j = 0; j < v.holes.size(); ++j) {
        const Vec3 a = hole_center(*problem.plate, v.holes[j].column, v.holes[j].row);
        B(3 * Eigen::Index(j), 0) = -a.x(), B(3 * Eigen::Index(j) + 1, 1) = -a.y();
      }
      return B;
    }));
    rows += factors.back().rows();
  }
  Eigen::MatrixXd A(rows, factors.front().cols());
  for (const auto& F : factors) A.middleRows(at, F.rows()) = F, at += F.rows();
  return score(problem, state, A, Vec2(0.1, 0.1));
}

}  // namespace asbuilt
