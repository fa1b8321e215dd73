// SPDX-License-Identifier: GPL-3.0-or-later
// Quality as points of the field: how a measured point hangs on the parameters, its sd, the part of it that is a rigid motion, and the
// directions that only priors hold.
#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "planner/calibrate/profilometer_observe.hpp"

namespace asbuilt {
namespace {

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  std::nth_element(v.begin(), v.begin() + std::ptrdiff_t(v.size() / 2), v.end());
  return v[v.size() / 2];
}

}  // namespace

Vec3 flange_point(const ProfilometerState& s, const Vec2& uv, Eigen::Matrix<double, 3, Eigen::Dynamic>* J) {
  const Eigen::Index m = s.intrinsics.values.size();
  MapJacobian Jm;
  const Vec2 xz = plane_point(s.intrinsics, uv, J ? &Jm : nullptr);
  const Vec3 p_sensor(xz.x(), 0, xz.y());
  if (J) {
    const Mat3 R = s.T_flange_sensor.rotation();
    J->setZero(3, m + 13);
    J->leftCols(m) = R.col(0) * Jm.row(0) + R.col(2) * Jm.row(1);
    J->middleCols<3>(m) = R;
    J->middleCols<3>(m + 3) = -R * skew(p_sensor);
  }
  return s.T_flange_sensor.point(p_sensor);
}

std::vector<Vec2> field_points(const ProfilometerProblem& problem, const std::optional<ProfilometerSheet>& sheet) {
  Vec2 lo = Vec2::Constant(1e300), hi = -lo;
  for (const PoseGroup& g : problem.groups)
    for (const HoleView* v : g.passes)
      for (const HoleSighting& h : v->holes) lo = lo.cwiseMin(h.uv), hi = hi.cwiseMax(h.uv);
  if (sheet && sheet->width_px > 1) lo = Vec2::Zero(), hi = Vec2(sheet->width_px - 1, sheet->height_px - 1);
  std::vector<Vec2> all;
  for (int i = 0; i < 7; ++i)
    for (int j = 0; j < 7; ++j) all.push_back(lo + Vec2((i + 0.5) / 7 * (hi - lo).x(), (j + 0.5) / 7 * (hi - lo).y()));
  return all;
}

FieldQuality field_quality(const ProfilometerState& s, const Eigen::MatrixXd& C, const std::vector<Vec2>& field, Mat6* rigid) {
  FieldQuality out;
  const Eigen::Index n = C.rows(), count = Eigen::Index(field.size());
  Eigen::MatrixXd J(3 * count, n), B(3 * count, 6);
  std::vector<double> sd[3];
  const Mat3 R = s.T_flange_sensor.rotation();
  for (Eigen::Index i = 0; i < count; ++i) {
    Eigen::Matrix<double, 3, Eigen::Dynamic> Ji;
    const Vec3 p = s.T_flange_sensor.inverse().point(flange_point(s, field[std::size_t(i)], &Ji));
    J.middleRows(3 * i, 3) = Ji;
    B.block<3, 3>(3 * i, 0) = R, B.block<3, 3>(3 * i, 3) = -R * skew(p);
    const Mat3 c = Ji * C * Ji.transpose();
    for (int a = 0; a < 3; ++a) {
      sd[a].push_back(std::sqrt(std::max(0.0, c(a, a))));
      out.max_sd_mm[a] = std::max(out.max_sd_mm[a], sd[a].back());
    }
  }
  for (int a = 0; a < 3; ++a) out.median_sd_mm[a] = median(sd[a]);
  // the rigid motion that a field of errors looks like, by least squares over its points
  const Eigen::MatrixXd P = (B.transpose() * B).ldlt().solve(B.transpose() * J);
  const Eigen::MatrixXd left = J - B * P;
  std::vector<double> form;
  for (Eigen::Index i = 0; i < count; ++i) {
    const Mat3 c = left.middleRows(3 * i, 3) * C * left.middleRows(3 * i, 3).transpose();
    form.push_back(std::sqrt(std::max(0.0, c.diagonal().maxCoeff())));
  }
  out.form_sd_mm = median(form);
  if (rigid) {
    *rigid = P * C * P.transpose();
    *rigid = (0.5 * (*rigid + rigid->transpose())).eval();
  }
  return out;
}

std::string direction_name(const std::vector<std::string>& names, const Eigen::VectorXd& v) {
  std::vector<Eigen::Index> order(std::size_t(v.size()));
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) { return std::abs(v[a]) > std::abs(v[b]) || (std::abs(v[a]) == std::abs(v[b]) && a < b); });
  std::string text;
  for (std::size_t i = 0; i < order.size() && i < 5; ++i) {
    if (std::abs(v[order[i]]) < 0.2 * std::abs(v[order[0]])) break;
    text += (i ? ", " : "") + names[std::size_t(order[i])];
  }
  return text;
}

std::vector<OpenDirection> open_directions(const ProfilometerProblem& problem, const Information& information, const ProfilometerState& state,
                                           const std::vector<Vec2>& field, double share_max_ratio) {
  const ParameterTable table = parameter_table(problem);
  const Eigen::Index n = table.size.size();
  std::vector<Eigen::Index> held, free;
  for (Eigen::Index i = 0; i < n; ++i) (std::isfinite(table.prior_sd[i]) ? held : free).push_back(i);
  std::vector<OpenDirection> out;
  if (held.empty()) return out;
  const Eigen::MatrixXd D = table.size.asDiagonal() * information.data * table.size.asDiagonal();
  const Eigen::MatrixXd pp = D(held, held), pq = D(held, free);
  Eigen::MatrixXd qq = D(free, free);
  qq.diagonal().array() += 1e-12 * std::max(1e-300, qq.diagonal().maxCoeff());
  const Eigen::MatrixXd back = qq.ldlt().solve(pq.transpose());  // free = -back * held
  Eigen::VectorXd sd(Eigen::Index(held.size()));
  std::vector<std::string> names;
  for (std::size_t i = 0; i < held.size(); ++i) sd[Eigen::Index(i)] = table.prior_sd[held[i]] / table.size[held[i]], names.push_back(table.names[std::size_t(held[i])]);
  const Eigen::MatrixXd M = sd.asDiagonal() * (pp - pq * back) * sd.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(0.5 * (M + M.transpose()));
  for (Eigen::Index k = 0; k < es.eigenvalues().size(); ++k) {
    const double lambda = std::max(0.0, es.eigenvalues()[k]), share = 1 / (1 + lambda);
    if (share <= share_max_ratio) break;
    OpenDirection d;
    d.prior_share_ratio = share;
    const Eigen::VectorXd v = es.eigenvectors().col(k);
    d.name = direction_name(names, v);
    Eigen::VectorXd whole = Eigen::VectorXd::Zero(n);
    const Eigen::VectorXd step = sd.cwiseProduct(v) / std::sqrt(1 + lambda);
    for (std::size_t i = 0; i < held.size(); ++i) whole[held[i]] = step[Eigen::Index(i)];
    const Eigen::VectorXd moved_free = -back * step;
    for (std::size_t i = 0; i < free.size(); ++i) whole[free[i]] = moved_free[Eigen::Index(i)];
    whole = whole.cwiseProduct(table.size);
    for (const Vec2& uv : field) {
      Eigen::Matrix<double, 3, Eigen::Dynamic> J;
      flange_point(state, uv, &J);
      d.field_mm = std::max(d.field_mm, (J * whole).norm());
    }
    out.push_back(d);
  }
  return out;
}

std::vector<std::string> loose_directions(const ProfilometerProblem& problem, const Information& information) {
  const ParameterTable table = parameter_table(problem);
  Eigen::MatrixXd H = information.data;
  H.diagonal() += information.prior;
  const Eigen::MatrixXd S = table.size.asDiagonal() * H * table.size.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(S);
  std::vector<std::string> out;
  // an sd of twice the size of the number is no knowledge; round-off of the largest eigenvalue is no information
  const double floor = std::max(0.25, 1e-13 * es.eigenvalues().maxCoeff());
  for (Eigen::Index k = 0; k < es.eigenvalues().size() && es.eigenvalues()[k] < floor; ++k) out.push_back(direction_name(table.names, es.eigenvectors().col(k)));
  return out;
}

}  // namespace asbuilt
