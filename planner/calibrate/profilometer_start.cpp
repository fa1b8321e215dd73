// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/profilometer_start.hpp"

#include <Eigen/Dense>
#include <cmath>

namespace asbuilt {
namespace {

using Unknowns = Eigen::Matrix<double, 20, 1>;  // A by columns (9), the plate's x and y in base (6), its origin (3), g, h

struct Spread {
  Vec2 center = Vec2::Zero();
  double half = 1;
};

Spread spread_of(const std::vector<PoseGroup>& groups) {
  Vec2 lo = Vec2::Constant(1e300), hi = -lo;
  for (const PoseGroup& g : groups)
    for (const HoleView* v : g.passes)
      for (const HoleSighting& h : v->holes) lo = lo.cwiseMin(h.uv), hi = hi.cwiseMax(h.uv);
  return {0.5 * (lo + hi), std::max(1e-9, 0.5 * (hi - lo).maxCoeff())};
}

/// Normal equations and cost at x. Rows are in mm, base frame.
double assemble(const HolePlate& plate, const std::vector<PoseGroup>& groups, const Spread& s, const Unknowns& x, Eigen::Matrix<double, 20, 20>* N,
                Unknowns* rhs) {
  double cost = 0;
  if (N) N->setZero(), rhs->setZero();
  for (const PoseGroup& g : groups)
    for (const HoleView* v : g.passes)
      for (const HoleSighting& h : v->holes) {
        const Vec2 q = (h.uv - s.center) / s.half;
        const Vec3 w(q.x(), q.y(), 1);
        const double den = 1 + x[18] * q.x() + x[19] * q.y();
        const Mat3 R = h.T_base_flange.rotation();
        const Vec3 Rp = R * (x.segment<3>(0) * w[0] + x.segment<3>(3) * w[1] + x.segment<3>(6) * w[2]) / den;
        const Vec3 a = hole_center(plate, h.column, h.row);
        const Vec3 r = Rp + h.T_base_flange.p_mm - x.segment<3>(9) * a.x() - x.segment<3>(12) * a.y() - x.segment<3>(15);
        cost += r.squaredNorm();
        if (!N) continue;
        Eigen::Matrix<double, 3, 20> J;
        for (int c = 0; c < 3; ++c) J.block<3, 3>(0, 3 * c) = R * (w[c] / den);
        J.block<3, 3>(0, 9) = -Mat3::Identity() * a.x();
        J.block<3, 3>(0, 12) = -Mat3::Identity() * a.y();
        J.block<3, 3>(0, 15) = -Mat3::Identity();
        J.col(18) = -Rp * (q.x() / den), J.col(19) = -Rp * (q.y() / den);
        N->selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
        *rhs += J.transpose() * r;
      }
  return cost;
}

std::optional<Unknowns> bilinear(const HolePlate& plate, const std::vector<PoseGroup>& groups, const Spread& s) {
  std::size_t count = 0;
  for (const PoseGroup& g : groups)
    for (const HoleView* v : g.passes) count += v->holes.size();
  if (count < 12) return {};
  Eigen::Matrix<double, 20, 20> N;
  Unknowns rhs, x = Unknowns::Zero();
  double damping = 1e-9;
  double cost = assemble(plate, groups, s, x, &N, &rhs);
  for (int round = 0; round < 60; ++round) {
    Eigen::Matrix<double, 20, 20> M = N.selfadjointView<Eigen::Lower>();
    if (round == 0) M.bottomRows<2>().setZero(), M.rightCols<2>().setZero(), M.bottomRightCorner<2, 2>().setIdentity(), rhs.tail<2>().setZero();
    M.diagonal() += (damping * M.diagonal()).cwiseMax(1e-12 * M.diagonal().maxCoeff());
    const Unknowns step = M.ldlt().solve(-rhs);
    const double next = assemble(plate, groups, s, x + step, nullptr, nullptr);
    if (next < cost || round == 0) {
      const bool is_done = round > 0 && cost - next < 1e-9 * cost;
      x += step, cost = assemble(plate, groups, s, x, &N, &rhs), damping = std::max(1e-12, damping / 10);
      if (is_done) break;
    } else {
      damping = std::max(1e-9, damping * 20);
      if (damping > 1e6) break;
    }
  }
  if (!x.allFinite()) return {};
  return x;
}

}  // namespace

std::optional<ProfilometerState> linear_start(const HolePlate& plate, const std::vector<PoseGroup>& groups, int degree_count) {
  const Spread s = spread_of(groups);
  const auto found = bilinear(plate, groups, s);
  if (!found) return {};
  const Unknowns& x = *found;
  ProfilometerState out;
  ProfilometerIntrinsics& m = out.intrinsics;
  m.model = ProfilometerModel::plane_map, m.uv_center = s.center, m.uv_half = s.half, m.degree_count = degree_count;
  m.values = Eigen::VectorXd::Zero(Eigen::Index(plane_map_parameters(degree_count, 1).size()));
  const Vec3 origin = x.segment<3>(6), du = x.segment<3>(0) - origin * x[18], dv = x.segment<3>(3) - origin * x[19];
  const Vec3 ex = du.normalized(), ez = (dv - ex * ex.dot(dv)).normalized();
  m.values.head<5>() << du.norm(), ex.dot(dv), ez.dot(dv), x[18], x[19];
  Mat3 R;
  R << ex, ez.cross(ex), ez;
  out.T_flange_sensor = {Eigen::Quaterniond(R).normalized(), origin};
  const Vec3 px = x.segment<3>(9).normalized(), py = (x.segment<3>(12) - px * px.dot(x.segment<3>(12))).normalized();
  R << px, py, px.cross(py);
  out.T_base_target = {Eigen::Quaterniond(R).normalized(), x.segment<3>(15)};
  if (!out.T_flange_sensor.q.coeffs().allFinite() || !out.T_base_target.q.coeffs().allFinite()) return {};
  return out;
}

Vec2 linear_plate_scale(const HolePlate& plate, const std::vector<PoseGroup>& groups) {
  const auto x = bilinear(plate, groups, spread_of(groups));
  return x ? Vec2(x->segment<3>(9).norm(), x->segment<3>(12).norm()) : Vec2(1, 1);
}

ProfilometerState camera_from_plane_map(const ProfilometerState& map, const ProfilometerSheet& sheet) {
  const Eigen::VectorXd& k = map.intrinsics.values;
  // pixel -> (x, z) of the map's own frame, and back
  Mat3 G, T;
  G << k[0], k[1], 0, 0, k[2], 0, k[3], k[4], 1;
  const double half = map.intrinsics.uv_half;
  T << 1 / half, 0, -map.intrinsics.uv_center.x() / half, 0, 1 / half, -map.intrinsics.uv_center.y() / half, 0, 0, 1;
  ProfilometerState out = map;
  out.intrinsics = camera_of(sheet);
  Eigen::VectorXd& c = out.intrinsics.values;
  Mat3 K;
  K << c[0] / c[1], 0, c[3], 0, c[0] / c[2], c[4], 0, 0, 1;
  Mat3 N = (G * T * K).inverse();  // ~ [r_x r_z t]
  N /= 0.5 * (N.col(0).norm() + N.col(1).norm());
  if (N(2, 2) < 0) N = -N;
  const Vec3 ex = N.col(0).normalized(), ez = (N.col(1) - ex * ex.dot(N.col(1))).normalized();
  Mat3 R;
  R << ex, ez.cross(ex), ez;
  const Pose<frame::Target, frame::Sensor> T_camera_map(Eigen::Quaterniond(R).normalized(), N.col(2));
  Vec3 n = R.col(1);
  if (n.z() * sheet.triangulation_rad < 0) n = -n;
  const double alpha = std::asin(std::clamp(n.z(), -1.0, 1.0)), theta = std::atan2(-n.x(), n.y()), depth = n.dot(N.col(2)) / n.z();
  c[9] = depth * std::tan(alpha), c[10] = alpha, c[11] = theta;
  const Pose<frame::Target, frame::Sensor> T_camera_sensor(Eigen::Quaterniond(rotation_camera_sensor(alpha, theta)), Vec3(0, 0, depth));
  const Vec6 by = twist_between(T_camera_map, T_camera_sensor);
  out.T_flange_sensor = map.T_flange_sensor.disturbed(by);
  return out;
}

TargetPose plate_pose(const HolePlate& plate, const std::vector<PoseGroup>& groups, const ProfilometerState& s) {
  std::vector<Vec3> a, b;
  for (const PoseGroup& g : groups)
    for (const HoleView* v : g.passes)
      for (const HoleSighting& h : v->holes) {
        const Vec2 xz = plane_point(s.intrinsics, h.uv);
        const Vec3 p = h.T_base_flange.point(s.T_flange_sensor.point(Vec3(xz.x(), 0, xz.y()))) + h.velocity_base_mm_s * s.latency_s;
        if (p.allFinite()) a.push_back(hole_center(plate, h.column, h.row)), b.push_back(p);
      }
  if (a.size() < 3) return {};
  const Eigen::Map<const Eigen::Matrix3Xd> from(a.front().data(), 3, Eigen::Index(a.size())), to(b.front().data(), 3, Eigen::Index(b.size()));
  return TargetPose(Eigen::Isometry3d(Eigen::umeyama(from, to, false)));
}

}  // namespace asbuilt
