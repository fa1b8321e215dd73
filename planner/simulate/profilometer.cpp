// SPDX-License-Identifier: GPL-3.0-or-later
// The camera's projection, the robot's errors and the passes of a simulated profilometer; the raw profiles are in profilometer_scan.cpp.
#include "planner/simulate/profilometer.hpp"

#include <fmt/format.h>

#include <cmath>
#include <map>

namespace asbuilt::simulate {
namespace {

/// Brown's lens: radial and tangential terms added to a point.
Vec2 bent(const ProfilometerDevice& d, const Vec2& a) {
  const double r2 = a.squaredNorm(), radial = 1 + d.k1 * r2 + d.k2 * r2 * r2;
  return {a.x() * radial + 2 * d.p1 * a.x() * a.y() + d.p2 * (r2 + 2 * a.x() * a.x()),
          a.y() * radial + d.p1 * (r2 + 2 * a.y() * a.y()) + 2 * d.p2 * a.x() * a.y()};
}

}  // namespace

HolePlate plate_437() { return {"437 holes, 4 mm", 23, 19, 4, 2.5, 4, 2 * kPi / 3, {{{10, 8}, {13, 8}, {10, 10}}}, 0.002}; }
HolePlate plate_143() { return {"143 holes, 15 mm", 13, 11, 15, 8, 12, kPi / 2, {{{5, 4}, {8, 4}, {5, 6}}}, 0.002}; }

bool project(const ProfilometerDevice& d, const Vec2& xz, Vec2& uv) {
  if (d.is_metric) {
    const double x = xz.x(), z = xz.y(), q = 1.0 / 50;
    uv = Vec2(d.scale_x_ratio * x + d.form_mm * (x * q) * (z * q), d.scale_z_ratio * z + d.form_mm * (x * q) * (x * q) * (x * q));
    return std::abs(x) < 55 && std::abs(z) < 90;
  }
  // sensor -> camera: turned by the triangulation angle about the line, then by theta about the optical axis
  const double ca = std::cos(d.triangulation_rad), sa = std::sin(d.triangulation_rad), ct = std::cos(d.theta_rad), st = std::sin(d.theta_rad);
  const double X0 = xz.x(), Y0 = -sa * xz.y(), Z = ca * xz.y() + d.baseline_mm * ca / sa;
  if (Z < 5) return false;
  const Vec2 ideal((ct * X0 - st * Y0) / Z, (st * X0 + ct * Y0) / Z);
  Vec2 m = ideal;
  if (d.is_lens_forward) {
    m = bent(d, ideal);
  } else {
    for (int i = 0; i < 30; ++i) {
      const Vec2 e = bent(d, m) - ideal;
      m -= e;  // the lens bends little: this contracts
      if (e.squaredNorm() < 1e-28) break;
    }
  }
  uv = Vec2(m.x() * d.focal_mm / d.pixel_u_mm + d.center_u_px, m.y() * d.focal_mm / d.pixel_v_mm + d.center_v_px);
  return uv.x() >= 0 && uv.y() >= 0 && uv.x() <= d.width_px - 1 && uv.y() <= d.height_px - 1;
}

std::vector<ProfilometerStand> published_stands(double tilt_rad, bool with_roll, bool both_directions) {
  std::vector<ProfilometerStand> all;
  for (const double roll : with_roll ? std::vector<double>{0, kPi / 2, kPi} : std::vector<double>{0})
    for (const double offset : {-60.0, 0.0, 60.0})
      for (const auto& [x, y] : {std::pair{0.0, 0.0}, {tilt_rad, 0.0}, {-tilt_rad, 0.0}, {0.0, tilt_rad}, {0.0, -tilt_rad}})
        for (int back = 0; back < (both_directions ? 2 : 1); ++back) all.push_back({offset, x, y, roll, back == 1});
  return all;
}

ProfilometerPass pass_of(const ProfilometerCell& cell, const ProfilometerStand& s, int pose, double length_mm, double speed_mm_s) {
  Mat3 level;  // sensor over the plate: line along the plate's y, light downwards, motion along x
  level << 0, 1, 0, 1, 0, 0, 0, 0, -1;
  const Eigen::Quaterniond q = Eigen::AngleAxisd(s.roll_rad, Vec3::UnitZ()) * Eigen::Quaterniond(level) *
                               Eigen::AngleAxisd(s.tilt_x_rad, Vec3::UnitX()) * Eigen::AngleAxisd(s.tilt_y_rad, Vec3::UnitY());
  const Vec3 middle = 0.5 * (hole_center(cell.plate, 0, 0) + hole_center(cell.plate, cell.plate.columns_count - 1, cell.plate.rows_count - 1));
  const Pose<frame::Target, frame::Sensor> T_target_sensor(q, middle - q * Vec3(0, 0, s.offset_mm));
  const Vec3 way_target = Eigen::AngleAxisd(s.roll_rad, Vec3::UnitZ()) * Vec3(s.is_backward ? -1 : 1, 0, 0);
  ProfilometerPass p;
  p.name = fmt::format("pose {}{}", pose + 1, s.is_backward ? " back" : "");
  p.pose = pose;
  const auto T_mid = cell.T_base_target * T_target_sensor * cell.T_flange_sensor.inverse();
  const Vec3 way_base = cell.T_base_target.direction(way_target);
  p.T_base_flange = {T_mid.q, T_mid.p_mm - 0.5 * length_mm * way_base};
  p.velocity_base_mm_s = speed_mm_s * way_base;
  p.duration_s = length_mm / speed_mm_s;
  return p;
}

std::vector<Vec6> robot_errors(const ProfilometerCell& cell, const std::vector<ProfilometerPass>& passes, Random& random) {
  auto draw = [&](double sd_mm, double sd_rad) {
    Vec6 e;
    for (int i = 0; i < 6; ++i) e[i] = random.normal(0, i < 3 ? sd_mm : sd_rad);
    return e;
  };
  std::map<int, Vec6> of_pose;
  std::vector<Vec6> all;
  for (const ProfilometerPass& p : passes) {
    if (!of_pose.count(p.pose)) of_pose[p.pose] = draw(cell.robot_sd_mm, cell.robot_sd_rad);
    Vec6 e = of_pose[p.pose] + draw(cell.repeat_sd_mm, cell.repeat_sd_rad);
    if (p.pose == cell.wrong_pose) e += cell.wrong_by;
    all.push_back(e);
  }
  return all;
}

std::vector<SeenHole> seen_holes(const ProfilometerCell& cell, const ProfilometerPass& pass, int index, const Vec6& error, Random& random) {
  const bool is_moved = cell.moved_from >= 0 && index >= cell.moved_from;
  const auto X = is_moved ? cell.T_flange_sensor.disturbed(cell.moved_by) : cell.T_flange_sensor;
  const auto T_base_flange = pass.T_base_flange.disturbed(error);
  const auto T_base_sensor = T_base_flange * X;
  const Vec3 v_sensor = T_base_sensor.q.conjugate() * pass.velocity_base_mm_s;
  std::vector<SeenHole> all;
  for (int row = 0; row < cell.plate.rows_count; ++row)
    for (int column = 0; column < cell.plate.columns_count; ++column) {
      Vec3 a = hole_center(cell.plate, column, row) * cell.plate_scale_ratio;
      a += Vec3(random.normal(0, cell.hole_sd_mm), random.normal(0, cell.hole_sd_mm), random.normal(0, 0.5 * cell.hole_sd_mm));
      if (cell.path_sd_mm > 0) a += Vec3(random.normal(0, cell.path_sd_mm), random.normal(0, cell.path_sd_mm), random.normal(0, cell.path_sd_mm));
      // at time 0 the hole stands at p; it moves by -v t and is in the light when y = 0
      const Vec3 p = T_base_sensor.inverse().point(cell.T_base_target.point(a));
      const double t = p.y() / v_sensor.y();
      const Vec3 q = p - v_sensor * t;
      SeenHole h{column, row, Vec2::Zero(), t - cell.latency_s};
      if (t < 0 || t > pass.duration_s || !project(cell.device, {q.x(), q.z()}, h.uv)) continue;
      all.push_back(h);
    }
  return all;
}

}  // namespace asbuilt::simulate
