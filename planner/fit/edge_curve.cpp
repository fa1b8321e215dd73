// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/edge_curve.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace asbuilt::fitting {

namespace {

constexpr double kAngleMin_rad = 0.17453292519943295;  // 10 degrees

Vec3 interpolate(const std::vector<Vec3>& v, std::size_t i, double t) { return v[i] + (v[i + 1] - v[i]) * t; }

}  // namespace

std::optional<Vec3> intersect_at(const FaceModel& face_1, const FaceModel& face_2, const Vec3& seed, const Vec3& tangent,
                                 double angle_min_rad) {
  Vec3 x = seed;
  for (int k = 0; k < 30; ++k) {
    Vec3 n_1, n_2;
    const double d_1 = face_distance(face_1, x, n_1), d_2 = face_distance(face_2, x, n_2);
    if (n_1.cross(n_2).norm() < std::sin(angle_min_rad)) return std::nullopt;
    Mat3 m;
    m.row(0) = n_1, m.row(1) = n_2, m.row(2) = tangent;
    const Eigen::PartialPivLU<Mat3> lu(m);
    if (std::abs(lu.determinant()) < 1e-3) return std::nullopt;
    Vec3 step = lu.solve(Vec3(-d_1, -d_2, -tangent.dot(x - seed)));
    if (!step.allFinite()) return std::nullopt;
    if (const double l = step.norm(); l > 5) step *= 5 / l;
    x += step;
    if (step.norm() < 1e-9) return x;
  }
  Vec3 n;
  if (std::abs(face_distance(face_1, x, n)) < 1e-6 && std::abs(face_distance(face_2, x, n)) < 1e-6) return x;
  return std::nullopt;
}

std::optional<Vec3> corner_at(const FaceModel& face_1, const FaceModel& face_2, const FaceModel& face_3, const Vec3& seed) {
  Vec3 x = seed;
  for (int k = 0; k < 30; ++k) {
    Vec3 n_1, n_2, n_3;
    const Vec3 d(face_distance(face_1, x, n_1), face_distance(face_2, x, n_2), face_distance(face_3, x, n_3));
    Mat3 m;
    m.row(0) = n_1, m.row(1) = n_2, m.row(2) = n_3;
    const Eigen::PartialPivLU<Mat3> lu(m);
    if (std::abs(lu.determinant()) < 0.3) return std::nullopt;
    const Vec3 step = lu.solve(-d);
    if (step.norm() > 5) return std::nullopt;
    x += step;
    if (step.norm() < 1e-8) return x;
  }
  return std::nullopt;
}

void place_stations(const BrepEdge& edge, const FaceModel& face_1, const FaceModel& face_2, double step_mm, EdgeModel& out) {
  const std::size_t count = edge.p.size();
  std::vector<double> s(count, 0);
  for (std::size_t i = 1; i < count; ++i) s[i] = s[i - 1] + (edge.p[i] - edge.p[i - 1]).norm();
  const int steps = std::max(2, static_cast<int>(std::ceil(s.back() / step_mm - 1e-9)));
  FaceModel flat_1 = face_1, flat_2 = face_2;
  flat_1.surface = face_1.nominal, flat_2.surface = face_2.nominal;
  flat_1.field = {}, flat_2.field = {};
  out.nominal.clear(), out.tangent.clear();
  std::size_t i = 0;
  for (int k = 0; k <= steps; ++k) {
    const double at = s.back() * k / steps;
    while (i + 2 < count && s[i + 1] < at) ++i;
    const double t = s[i + 1] > s[i] ? std::clamp((at - s[i]) / (s[i + 1] - s[i]), 0.0, 1.0) : 0;
    const Vec3 p = interpolate(edge.p, i, t);
    Vec3 tangent = edge.tangent.size() == count ? interpolate(edge.tangent, i, t) : Vec3(edge.p[i + 1] - edge.p[i]);
    tangent.normalize();
    const auto x = intersect_at(flat_1, flat_2, p, tangent, 0.01);
    out.nominal.push_back(x && (*x - p).norm() < 0.5 ? *x : p);
    out.tangent.push_back(tangent);
  }
  if (out.is_closed) out.nominal.back() = out.nominal.front(), out.tangent.back() = out.tangent.front();
  out.current = out.nominal;
}

Traced trace_edge(const EdgeModel& edge, const std::vector<FaceModel>& faces, const EndShift& ends, double step_mm) {
  Traced out;
  const FaceModel &face_1 = faces[edge.slot_1], &face_2 = faces[edge.slot_2];
  const std::size_t count = edge.nominal.size();
  std::vector<double> s(count, 0);
  for (std::size_t i = 1; i < count; ++i) s[i] = s[i - 1] + (edge.nominal[i] - edge.nominal[i - 1]).norm();
  const double length = std::max(s.back() + ends.end_mm - ends.start_mm, step_mm);
  // One station more than the drawing's length asks for: the adapted edge may be a little longer.
  const int steps = std::max(2, static_cast<int>(std::ceil(1.01 * length / step_mm - 1e-9)));
  std::size_t i = 0;
  for (int k = 0; k <= steps; ++k) {
    const double u = static_cast<double>(k) / steps, at = s.back() * u;
    while (i + 2 < count && s[i + 1] < at) ++i;
    const double t = std::clamp((at - s[i]) / std::max(1e-12, s[i + 1] - s[i]), 0.0, 1.0);
    const Vec3 nominal = interpolate(edge.nominal, i, t), tangent = interpolate(edge.tangent, i, t).normalized();
    const Vec3 guess = nominal + interpolate(edge.current, i, t) - interpolate(edge.nominal, i, t);
    const Vec3 seed = guess - tangent * tangent.dot(guess - nominal) + tangent * ((1 - u) * ends.start_mm + u * ends.end_mm);
    auto x = intersect_at(face_1, face_2, seed, tangent, kAngleMin_rad);
    if (!x) {
      if (out.bad_station < 0) {
        out.bad_station = k;
        Vec3 n_1, n_2;
        surface_distance(face_1, seed, n_1), surface_distance(face_2, seed, n_2);
        out.bad_angle_rad = std::atan2(n_1.cross(n_2).norm(), n_1.dot(n_2) * face_1.outward() * face_2.outward());
      }
      x = seed;
    }
    out.nominal.push_back(nominal), out.adapted.push_back(*x), out.tangent.push_back(tangent);
  }
  if (edge.is_closed) out.adapted.back() = out.adapted.front(), out.nominal.back() = out.nominal.front();
  return out;
}

Mat3 edge_covariance(const Bundle& bundle, const std::vector<FaceModel>& faces, const EdgeModel& edge, const Vec3& x, const Vec3& tangent) {
  const FaceModel &face_1 = faces[edge.slot_1], &face_2 = faces[edge.slot_2];
  const int unknowns = static_cast<int>(bundle.covariance.rows());
  Eigen::MatrixXd g = Eigen::MatrixXd::Zero(unknowns, 2);
  Mat3 m;
  Eigen::Vector2d rest = Eigen::Vector2d::Zero();
  int column = 0;
  for (const int slot : {edge.slot_1, edge.slot_2}) {
    const FaceModel& face = faces[slot];
    Vec3 n;
    const double d = surface_distance(face, x, n);
    const Vec3 q = x - d * n;
    const Eigen::VectorXd row = height_gradient(face, q, n);
    g.block(bundle.offset[slot], column, row.size(), 1) = row;
    if (face.field.size() > 0) rest(column) = field_rest_variance(face.field, row.tail(face.field.size()));
    m.row(column) = n;
    ++column;
  }
  m.row(2) = tangent;
  Eigen::Matrix2d heights;
  // Only the blocks of the two faces are touched.
  const int o[2] = {bundle.offset[edge.slot_1], bundle.offset[edge.slot_2]};
  const int w[2] = {modes_count(face_1.surface) + face_1.field.size(), modes_count(face_2.surface) + face_2.field.size()};
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j)
      heights(i, j) = g.col(i).segment(o[i], w[i]).dot(bundle.covariance.block(o[i], o[j], w[i], w[j]) * g.col(j).segment(o[j], w[j]));
  heights.diagonal() += rest;
  const Mat3 inverse = m.inverse();
  const Eigen::Matrix<double, 3, 2> k = inverse.leftCols<2>();
  return k * heights * k.transpose();
}

}  // namespace asbuilt::fitting
