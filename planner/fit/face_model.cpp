// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/face_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace asbuilt::fitting {

namespace {

double matern52(double r_over_l) {
  const double a = std::sqrt(5.0) * r_over_l;
  return (1 + a + a * a / 3) * std::exp(-a);
}

}  // namespace

double surface_distance(const FaceModel& face, const Vec3& p, Vec3& n) {
  return face.seeds ? face.seeds->distance(face.surface, p, n) : signed_distance(face.surface, p, n);
}
double nominal_distance(const FaceModel& face, const Vec3& p, Vec3& n) {
  return face.seeds ? face.seeds->distance(face.nominal, p, n) : signed_distance(face.nominal, p, n);
}

OffsetField make_field(const std::vector<Vec3>& points, double amplitude_mm, double length_mm, int count_max) {
  OffsetField field;
  if (amplitude_mm <= 0 || points.empty()) return field;
  field.amplitude_mm = amplitude_mm, field.length_mm = length_mm;
  // Farthest-point sampling from the point nearest to the mean: the same whatever the order of equal distances.
  Vec3 mean = Vec3::Zero();
  for (const Vec3& p : points) mean += p / static_cast<double>(points.size());
  std::size_t next = 0;
  for (std::size_t i = 1; i < points.size(); ++i)
    if ((points[i] - mean).squaredNorm() < (points[next] - mean).squaredNorm()) next = i;
  std::vector<double> gap(points.size(), 1e300);
  while (field.size() < count_max) {
    field.inducing.push_back(points[next]);
    double largest = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      gap[i] = std::min(gap[i], (points[i] - points[next]).norm());
      if (gap[i] > largest) largest = gap[i];
    }
    if (largest < std::min(0.3 * length_mm, 8.0)) break;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (gap[i] == largest) {
        next = i;
        break;
      }
  }
  const int m = field.size();
  Eigen::MatrixXd k(m, m);
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) k(i, j) = matern52((field.inducing[i] - field.inducing[j]).norm() / length_mm);
  k.diagonal().array() += 1e-8;
  const Eigen::LLT<Eigen::MatrixXd> llt(k);
  field.whitening = llt.matrixL().solve(Eigen::MatrixXd::Identity(m, m));
  return field;
}

Eigen::VectorXd field_basis(const OffsetField& field, const Vec3& q) {
  Eigen::VectorXd k(field.size());
  for (int i = 0; i < field.size(); ++i) k(i) = matern52((q - field.inducing[i]).norm() / field.length_mm);
  const Eigen::VectorXd basis = field.whitening.triangularView<Eigen::Lower>() * k;
  return field.amplitude_mm * basis;
}

double field_rest_variance(const OffsetField& field, const Eigen::VectorXd& basis) {
  return std::max(0.0, field.amplitude_mm * field.amplitude_mm - basis.squaredNorm());
}

double face_distance(const FaceModel& face, const Vec3& p, Vec3& n) {
  const double d = surface_distance(face, p, n);
  if (face.field.size() == 0) return d;
  return d - field_basis(face.field, p - d * n).dot(face.coefficients);
}

Vec3 face_normal(const FaceModel& face, const Vec3& p) {
  Vec3 n;
  const double d = surface_distance(face, p, n);
  if (face.field.size() == 0) return n;
  const Vec3 q = p - d * n;
  const Vec3 x = (std::abs(n.x()) < 0.8 ? Vec3::UnitX() : Vec3::UnitY()).cross(n).normalized(), y = n.cross(x);
  constexpr double kStep = 0.25;
  const auto height = [&](const Vec3& at) { return field_basis(face.field, at).dot(face.coefficients); };
  const double gx = (height(q + kStep * x) - height(q - kStep * x)) / (2 * kStep);
  const double gy = (height(q + kStep * y) - height(q - kStep * y)) / (2 * kStep);
  return (n - gx * x - gy * y).normalized();
}

FieldChoice choose_field(const FaceModel& face, const std::vector<Vec3>& q, const Eigen::VectorXd& heights, const Eigen::VectorXd& sd) {
  FieldChoice best;
  const int count = static_cast<int>(q.size());
  if (count < 8) return best;
  const int modes = modes_count(face.surface);
  Eigen::MatrixXd m(count, modes);
  double extent = 0;
  for (int i = 0; i < count; ++i) {
    Vec3 n;
    surface_distance(face, q[i], n);
    m.row(i) = mode_heights(face.surface, q[i], n, face.center).head(modes).transpose();
    extent = std::max(extent, (q[i] - face.center).norm());
  }
  Eigen::VectorXd mode_sd = Eigen::VectorXd::Constant(modes, 1.0);
  mode_sd.segment(3, 3).setConstant(1.0 / std::max(extent, 1.0));
  if (std::holds_alternative<ConeSurface>(face.surface.shape)) mode_sd(7) = 1.0 / std::max(extent, 1.0);
  const Eigen::MatrixXd wide = m * mode_sd.asDiagonal();
  Eigen::MatrixXd r2(count, count);
  for (int i = 0; i < count; ++i)
    for (int j = 0; j < count; ++j) r2(i, j) = (q[i] - q[j]).norm();
  const Eigen::MatrixXd base = Eigen::MatrixXd(sd.array().square().matrix().asDiagonal()) + wide * wide.transpose();
  const auto log_likelihood = [&](double amplitude, double length) {
    Eigen::MatrixXd k = base;
    if (amplitude > 0) k.array() += amplitude * amplitude * (r2.array() / length).unaryExpr(&matern52);
    const Eigen::LLT<Eigen::MatrixXd> llt(k);
    const Eigen::VectorXd w = llt.matrixL().solve(heights);
    return -0.5 * w.squaredNorm() - llt.matrixL().toDenseMatrix().diagonal().array().log().sum();
  };
  const double none = log_likelihood(0, 1);
  for (const double length : {12.0, 30.0, 60.0, 120.0}) {
    if (length > 12.0 && length > 4 * extent) continue;
    for (const double amplitude : {0.003, 0.01, 0.03, 0.1, 0.3, 1.0}) {
      const double gain = log_likelihood(amplitude, length) - none;
      if (gain > best.log_likelihood_gain + 1e-9) best = {amplitude, length, gain};
    }
  }
  if (best.log_likelihood_gain < 3) best = {};
  return best;
}

}  // namespace asbuilt::fitting
