// SPDX-License-Identifier: GPL-3.0-or-later
// Whole captures with known truth, from the same rig: clouds of balls and planes, laser lines, board points, tips.
#pragma once

#include "planner/artefacts/captures.hpp"
#include "planner/calibrate/image_targets.hpp"
#include "tests/support/calibrate_rig.hpp"

namespace asbuilt::testing_calibrate {

struct JobOptions {
  std::uint64_t seed = 1;
  TargetKind kind = TargetKind::balls;
  int captures_count = 20;
  double tilt_deg = 30, robot_mm = 0.05, robot_rad = 1e-4, noise = 0.01;  // noise in mm, px of a board
  bool is_sensor_fixed = false, is_one_axis = false, is_depth_only = false;
  double scale_ratio = 1;          // of the sensor's lengths
  Vec6 moved = Vec6::Zero();       // the sensor has moved by this twist since its nominal pose
  double field_mm = 6;             // how far the looked-at point wanders
  double depth_mm = 25;
};

struct TrueJob {
  CalibrationRequest request;
  Pose<frame::Flange, frame::Sensor> T_true;  // of a fixed sensor: base, sensor
};

inline TrueJob make_job(const JobOptions& o) {
  Random r(o.seed);
  TrueJob j;
  CalibrationRequest& q = j.request;
  q.subject = o.kind == TargetKind::tip ? CalibrationRequest::Subject::tool : CalibrationRequest::Subject::sensor;
  q.id = "wide", q.cell_file = "cell.yaml", q.taken = "2026-11-20", q.is_sensor_fixed = o.is_sensor_fixed;
  q.target.kind = o.kind;
  q.sensor_sd = o.noise, q.sensor_sd_rad = o.noise / 100;
  q.robot_sd_mm = std::max(1e-3, o.robot_mm), q.robot_sd_rad = std::max(2e-6, o.robot_rad);
  q.repeat_sd_mm = 0.02, q.repeat_sd_rad = 4e-5;
  q.tool_turn_sd_rad = rad_from_deg(0.3);
  std::vector<Vec3> points;
  if (o.kind == TargetKind::balls) {
    q.target.diameter_mm = 8.731;
    points = q.target.centers_mm = {Vec3(0, 0, 0), Vec3(31, 4, 1), Vec3(8, 27, -2), Vec3(24, 20, 13)};
  }
  if (o.kind == TargetKind::ball) q.target.diameter_mm = 80;
  const bool is_board = o.kind == TargetKind::checkerboard || o.kind == TargetKind::charuco || o.kind == TargetKind::circle_grid;
  if (is_board) q.target.columns_count = 9, q.target.rows_count = 7, q.target.pitch_mm = 8, points = board_points(q.target);
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : points) middle += p / static_cast<double>(points.size());
  const CameraConstants camera{1350, 1352, 640, 512, -0.11, 0.17, 4e-4, -3e-4, 0};
  if (is_board) q.camera = camera;
  const auto hand = kHand.disturbed(o.moved);
  const auto eye = kEye.disturbed(o.moved);
  const Pose<frame::Base, frame::Target> place(quat_exp(Vec3(0.1, -0.07, 0.6)), kPlace_mm);
  if (!o.is_sensor_fixed) q.nominal = kHand;
  j.T_true = o.is_sensor_fixed ? Pose<frame::Flange, frame::Sensor>(eye.q, eye.p_mm) : hand;
  const double far = o.kind == TargetKind::ball ? 300 : 206;
  for (int k = 0; k < o.captures_count; ++k) {
    const Eigen::Quaterniond by = tilt(r, o.is_one_axis, o.tilt_deg);
    Eigen::Quaterniond look = quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
    if (o.kind == TargetKind::corner) look = quat_from_z(-Vec3(1, 1, 1), Vec3::UnitX());
    const Eigen::Quaterniond turn = (look * by).normalized();
    const Pose<frame::Target, frame::Sensor> at(turn, middle - turn * Vec3(r.normal(0, o.field_mm), r.normal(0, o.field_mm), far + r.uniform(-o.depth_mm, o.depth_mm)));
    const auto T_true = o.is_sensor_fixed ? eye * at.inverse() * kHeld.inverse() : place * at * hand.inverse();
    const Vec6 e = arm_error(r, o.robot_mm, o.robot_rad);
    TargetCapture c;
    c.name = "capture " + std::to_string(k + 1);
    c.T_base_flange = T_true * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse();
    const auto C = at.inverse();
    const auto noisy = [&](const Vec3& p) { return Vec3(o.scale_ratio * p + Vec3(r.normal(0, o.noise), r.normal(0, o.noise), r.normal(0, o.noise))); };
    if (o.kind == TargetKind::balls || (o.kind == TargetKind::ball && o.is_depth_only)) {
      const double radius = q.target.diameter_mm / 2;
      for (const Vec3& b : o.kind == TargetKind::balls ? points : std::vector<Vec3>{Vec3::Zero()}) {
        const Vec3 m = C.point(b);
        for (int i = 0; i < 900; ++i) {
          const Vec3 u = Vec3(r.normal(), r.normal(), r.normal()).normalized();
          if (u.dot(m.normalized()) < -0.45) c.points_mm.push_back(o.scale_ratio * (m + u * (radius + r.normal(0, o.noise))));
        }
      }
      if (o.kind == TargetKind::balls)
        for (int i = 0; i < 1500; ++i) {  // the plate they stand on
          const Vec3 p = C.point(Vec3(r.uniform(-30, 60), r.uniform(-30, 60), -10));
          c.points_mm.push_back(noisy(p));
        }
    } else if (o.kind == TargetKind::ball) {
      const Vec3 s = C.point(Vec3::Zero());
      const double rho2 = 1600 - s.y() * s.y();
      if (rho2 <= 100) {
        --k;
        continue;
      }
      for (int i = 0; i < 300; ++i) {
        const double a = rad_from_deg(-50 + 100.0 * i / 299), rho = std::sqrt(rho2) + r.normal(0, o.noise);
        c.points_mm.emplace_back(s.x() + rho * std::sin(a), 0, s.z() - rho * std::cos(a));
      }
      for (int i = 0; i < 60; ++i) c.points_mm.emplace_back(s.x() + r.uniform(-90, 90), 0, s.z() + 60 + r.normal(0, o.noise));
    } else if (is_board) {
      for (std::size_t i = 0; i < points.size(); ++i) {
        const Vec2 s = pixel_of(camera.data(), C.point(points[i]));
        c.corners.push_back({static_cast<int>(i), Vec2(s.x() + r.normal(0, o.noise), s.y() + r.normal(0, o.noise))});
      }
      if (o.kind != TargetKind::charuco && k % 3 == 1)  // a detector that began at the other end
        for (ImagePoint& p : c.corners) p.id = static_cast<int>(points.size()) - 1 - p.id;
    } else if (o.kind == TargetKind::plane || o.kind == TargetKind::corner) {
      for (int i = 0; i < 1500; ++i) {
        const int axis_of_plane = o.kind == TargetKind::plane ? 2 : i % 3;
        Vec3 p(r.uniform(0, 60), r.uniform(0, 60), r.uniform(0, 60));
        if (o.kind == TargetKind::plane) p.head<2>().array() -= 30;
        p[axis_of_plane] = 0;
        c.points_mm.push_back(noisy(C.point(p)));
      }
    } else if (o.kind == TargetKind::pose) {
      Vec6 z;
      for (int i = 0; i < 3; ++i) z[i] = r.normal(0, o.noise), z[3 + i] = r.normal(0, q.sensor_sd_rad);
      c.T_sensor_target = C.disturbed(z);
    } else if (o.kind == TargetKind::tip) {
      // the tip stands on a fixed point: the sensor's frame is the tool's
      const Pose<frame::Base, frame::Sensor> tip(place.q * turn, place.p_mm + Vec3(r.normal(0, o.noise), r.normal(0, o.noise), r.normal(0, o.noise)));
      c.T_base_flange = tip * hand.inverse() * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse();
    }
    q.captures.push_back(std::move(c));
  }
  return j;
}

}  // namespace asbuilt::testing_calibrate
