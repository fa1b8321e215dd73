// SPDX-License-Identifier: GPL-3.0-or-later
// Raw profiles of a plate with conical holes: rays of the light's fan meet the plate, are seen by the camera unless a wall stands in
// between, smeared by the line's width, with noise that hangs together along the line, outliers and gaps.
#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/simulate/profilometer.hpp"

namespace asbuilt::simulate {
namespace {

/// Depth of the plate below its face at (x, y) of the target frame; 0 outside the holes.
double depth_at(const HolePlate& plate, const Mat3& cell_of_target, double x, double y) {
  const double cx = cell_of_target(0, 0) * x + cell_of_target(0, 1) * y + cell_of_target(0, 2);
  const double cy = cell_of_target(1, 0) * x + cell_of_target(1, 1) * y + cell_of_target(1, 2);
  const int column = int(std::lround(cx)), row = int(std::lround(cy));
  if (column < 0 || row < 0 || column >= plate.columns_count || row >= plate.rows_count) return 0;
  const double rho = std::hypot(cx - column, cy - row) * plate.pitch_mm;
  const double radius = 0.5 * (is_large_hole(plate, column, row) ? plate.large_diameter_mm : plate.diameter_mm);
  return rho < radius ? (radius - rho) / std::tan(0.5 * plate.cone_rad) : 0;
}

}  // namespace

ProfileScan scanned(const ProfilometerCell& cell, const ProfilometerPass& pass, int index, const Vec6& error, Random& random) {
  const HolePlate& plate = cell.plate;
  const ProfilometerDevice& d = cell.device;
  // target -> cells, by three known holes
  const Vec3 o = hole_center(plate, 0, 0), ex = hole_center(plate, 1, 0) - o, ey = hole_center(plate, 0, 1) - o;
  Mat3 cells = Mat3::Zero();
  const double n2 = plate.pitch_mm * plate.pitch_mm;
  cells << ex.x() / n2, ex.y() / n2, -(ex.x() * o.x() + ex.y() * o.y()) / n2, ey.x() / n2, ey.y() / n2, -(ey.x() * o.x() + ey.y() * o.y()) / n2, 0, 0, 1;
  const bool is_moved = cell.moved_from >= 0 && index >= cell.moved_from;
  const auto X = is_moved ? cell.T_flange_sensor.disturbed(cell.moved_by) : cell.T_flange_sensor;
  const auto T_flange_true = pass.T_base_flange.disturbed(error);
  const double sa = std::sin(d.triangulation_rad), ca = std::cos(d.triangulation_rad);
  const double z_source = -(d.baseline_mm * ca / sa) / ca;
  // the camera's centre in sensor coordinates: x 0, y and z from the triangle of camera, source and meeting point
  const double depth = d.baseline_mm * ca / sa;
  const Vec3 camera_sensor(0, -sa * depth, -ca * depth);
  ProfileScan out;
  out.name = pass.name, out.is_held_out = pass.is_held_out;
  const int profiles = int(pass.duration_s * pass.profiles_per_s);
  const int rays = d.is_metric ? 1000 : int(1.6 * d.width_px), columns = d.is_metric ? 800 : d.width_px;
  Vec3 wobble = Vec3::Zero();
  std::vector<double> u(static_cast<std::size_t>(rays)), v(u.size()), row(static_cast<std::size_t>(columns)), white(row.size()), smooth(row.size());
  out.begin.push_back(0);
  for (int i = 0; i < profiles; ++i) {
    const double t = i / pass.profiles_per_s;
    out.t_s.push_back(t);
    out.T_base_flange.push_back({pass.T_base_flange.q, pass.T_base_flange.p_mm + pass.velocity_base_mm_s * t});
    // the path's own error hangs together over some tenths of a second
    for (int a = 0; a < 3; ++a) wobble[a] = 0.98 * wobble[a] + std::sqrt(1 - 0.98 * 0.98) * random.normal(0, cell.path_sd_mm);
    Pose<frame::Base, frame::Flange> at = T_flange_true;
    at.p_mm += pass.velocity_base_mm_s * (t + cell.latency_s) + wobble;
    const auto T_target_sensor = cell.T_base_target.inverse() * at * X;
    const Vec3 source = T_target_sensor.point(Vec3(0, 0, z_source)), camera = T_target_sensor.point(camera_sensor);
    for (int k = 0; k < rays; ++k) {
      const double x_fan = (k - 0.5 * (rays - 1)) / rays * 2 * 70;  // where the ray passes z = 0 of the sensor, mm
      const Vec3 way = T_target_sensor.direction(Vec3(x_fan, 0, -z_source));
      u[std::size_t(k)] = std::numeric_limits<double>::quiet_NaN();
      const double s = plate.sd_mm >= 0 ? 1 / cell.plate_scale_ratio : 1;
      const double lambda = -source.z() / way.z();
      if (!(lambda > 0)) continue;
      Vec3 p = source + lambda * way;
      const double cx = cells(0, 0) * p.x() * s + cells(0, 1) * p.y() * s + cells(0, 2), cy = cells(1, 0) * p.x() * s + cells(1, 1) * p.y() * s + cells(1, 2);
      if (cx < -1.2 || cy < -1.2 || cx > plate.columns_count + 0.2 || cy > plate.rows_count + 0.2) continue;  // beside the plate: out of range
      double below = depth_at(plate, cells, p.x() * s, p.y() * s);
      if (below > 0) {
        for (int step = 0; step < 40; ++step) {
          const Vec3 q = source + ((-below - source.z()) / way.z()) * way;
          const double next = depth_at(plate, cells, q.x() * s, q.y() * s), change = next - below;
          below += 0.7 * change, p = q;
          if (std::abs(change) < 1e-5) break;
        }
        // a wall between the point and the camera
        bool is_hidden = false;
        const Vec3 to_camera = (camera - p) * (1 / (camera.z() - p.z()));
        for (int step = 1; step <= 6 && !is_hidden; ++step) {
          const double rise = below * step / 6.5;
          const Vec3 q = p + to_camera * rise;
          is_hidden = -depth_at(plate, cells, q.x() * s, q.y() * s) > q.z() + 0.01;
        }
        if (is_hidden) continue;
      }
      const Vec3 p_sensor = T_target_sensor.inverse().point(p);
      Vec2 uv;
      if (!project(d, {p_sensor.x(), p_sensor.z()}, uv)) continue;
      u[std::size_t(k)] = uv.x(), v[std::size_t(k)] = uv.y();
    }
    // to the device's own columns
    const double u0 = d.is_metric ? -55 : 0, du = d.is_metric ? 110.0 / columns : 1;
    std::fill(row.begin(), row.end(), std::numeric_limits<double>::quiet_NaN());
    for (int k = 1; k < rays; ++k) {
      double a = u[std::size_t(k) - 1], b = u[std::size_t(k)], va = v[std::size_t(k) - 1], vb = v[std::size_t(k)];
      if (!(std::abs(b - a) < 6 * du)) continue;
      if (a > b) std::swap(a, b), std::swap(va, vb);
      for (int c = std::max(0, int(std::ceil((a - u0) / du))); c < columns && u0 + c * du < b; ++c) row[std::size_t(c)] = va + (vb - va) * (u0 + c * du - a) / std::max(1e-12, b - a);
    }
    auto filtered = [&](const std::vector<double>& in, double sd, std::vector<double>& to) {
      const int reach = std::max(1, int(std::ceil(3 * sd)));
      for (int c = 0; c < columns; ++c) {
        double sum = 0, weight = 0;
        for (int k = -reach; k <= reach; ++k)
          if (c + k >= 0 && c + k < columns && !std::isnan(in[std::size_t(c + k)])) {
            const double w = std::exp(-0.5 * k * k / (sd * sd));
            sum += w * in[std::size_t(c + k)], weight += w;
          }
        to[std::size_t(c)] = std::isnan(in[std::size_t(c)]) || weight == 0 ? std::numeric_limits<double>::quiet_NaN() : sum / weight;
      }
    };
    filtered(row, d.blur_px, smooth);
    row = smooth;
    for (double& w : white) w = random.normal();
    filtered(white, d.correlation_px, smooth);
    const double back = std::sqrt(2 * std::sqrt(kPi) * d.correlation_px);  // the filter's loss of variance
    for (int c = 0; c < columns; ++c) {
      double value = row[std::size_t(c)];
      if (std::isnan(value) || random.uniform() < d.missing_ratio) continue;
      value += d.noise_px * back * smooth[std::size_t(c)];
      if (random.uniform() < d.outlier_ratio) value += random.normal(0, 200 * d.noise_px);
      out.uv.push_back(Eigen::Vector2f(float(u0 + c * du), float(value)));
    }
    out.begin.push_back(std::uint32_t(out.uv.size()));
  }
  return out;
}

}  // namespace asbuilt::simulate
