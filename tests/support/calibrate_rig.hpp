// SPDX-License-Identifier: GPL-3.0-or-later
// A calibration whose truth is known by construction: a sensor on the flange (or fixed) looks at a target from tilted poses.
#pragma once

#include <limits>

#include "planner/base/random.hpp"
#include "planner/calibrate/hand_eye.hpp"
#include "planner/calibrate/network.hpp"

namespace asbuilt::testing_calibrate {

/// Where the sensor and the target are: `hand` and `place` of a sensor on the flange, `eye` and `held` of a fixed one.
inline const Pose<frame::Flange, frame::Sensor> kHand(quat_exp(Vec3(0.3, -0.5, 1.4)), Vec3(80, -30, 150));
inline const Pose<frame::Base, frame::Sensor> kEye(quat_exp(Vec3(2.6, 0.3, -0.4)), Vec3(1300, 200, 900));
inline const Pose<frame::Flange, frame::Target> kHeld(quat_exp(Vec3(0.2, 0.1, 0.7)), Vec3(20, -15, 120));
inline const Vec3 kPlace_mm(1200, 40, 600);

/// A turn about any axis, or about z alone, up to the tilt either way.
inline Eigen::Quaterniond tilt(Random& r, bool is_one_axis, double tilt_deg) {
  Vec3 axis(r.normal(), r.normal(), r.normal());
  if (is_one_axis) axis = Vec3(0, 0, 1);
  return quat_exp(axis.normalized() * r.uniform(-1, 1) * rad_from_deg(tilt_deg));
}

/// The arm's error: true = commanded.disturbed(error).
inline Vec6 arm_error(Random& r, double mm, double rad) {
  Vec6 e;
  for (int i = 0; i < 3; ++i) e[i] = r.normal(0, mm), e[3 + i] = r.normal(0, rad);
  return e;
}

/// Where a point is seen: fx fy cx cy k1 k2 p1 p2.
inline Vec2 pixel_of(const double* camera, const Vec3& p_sensor) {
  const double x = p_sensor.x() / p_sensor.z(), y = p_sensor.y() / p_sensor.z(), r2 = x * x + y * y;
  const double d = 1 + camera[4] * r2 + camera[5] * r2 * r2;
  return {camera[0] * (x * d + 2 * camera[6] * x * y + camera[7] * (r2 + 2 * x * x)) + camera[2],
          camera[1] * (y * d + camera[6] * (r2 + 2 * y * y) + 2 * camera[7] * x * y) + camera[3]};
}

struct RigOptions {
  std::uint64_t seed = 1;
  int views_count = 27;
  double tilt_deg = 30, robot_mm = 0, robot_rad = 0, noise_mm = 0;  // noise in px where the sight is a pixel
  bool is_sensor_fixed = false, is_one_axis = false;
  Sight sight = Sight::point;
  double radius_mm = 40;  // Sight::sphere
  int drop_ball_every = 7;
};

struct Rig {
  NetworkState truth;
  Network network;
  std::vector<Pose<frame::Sensor, frame::Target>> seen;  // true
  std::vector<MotionView> motions() const {
    std::vector<MotionView> m;
    for (std::size_t k = 0; k < network.views.size(); ++k) {
      const NetworkView& v = network.views[k];
      auto T = seen[k];
      if (network.sight == Sight::point && v.observations.size() >= 3) {
        std::vector<Vec3> a, b;
        for (const Observation& o : v.observations) a.push_back(o.p_target), b.push_back(o.z);
        T = pose_of_points(a, b);
      }
      m.push_back({v.name, place_mount(v.T_base_flange, network.is_sensor_fixed), T});
    }
    return m;
  }
};

inline Rig make_rig(const RigOptions& o) {
  Random r(o.seed);
  Rig g;
  g.network.sight = o.sight, g.network.is_sensor_fixed = o.is_sensor_fixed;
  NetworkState& t = g.truth;
  std::vector<Vec3> points = {Vec3(0, 0, 0), Vec3(31, 4, 1), Vec3(8, 27, -2), Vec3(24, 20, 13)};
  if (o.sight == Sight::pixel) {
    points.clear();
    for (int i = 0; i < 8; ++i)
      for (int k = 0; k < 6; ++k) points.emplace_back(6.0 * i, 6.0 * k, 0);
    t.sensor = {0, 0, 1350, 1352, 640, 512, -0.11, 0.17, 0.0004, -0.0003, 0};
  }
  if (o.sight == Sight::sphere) t.sensor[kRadius] = o.radius_mm, g.network.is_target_free = {true, true, true, false, false, false};
  Vec3 middle = Vec3::Zero();
  for (const Vec3& p : points) middle += p / static_cast<double>(points.size());
  const Pose<frame::Base, frame::Target> place(quat_exp(Vec3(r.normal(0, 0.1), r.normal(0, 0.1), r.normal())), kPlace_mm);
  if (o.is_sensor_fixed) t.T_mount_sensor = {kEye.q, kEye.p_mm}, t.T_place_target = {kHeld.q, kHeld.p_mm};
  else t.T_mount_sensor = {kHand.q, kHand.p_mm}, t.T_place_target = {place.q, place.p_mm};
  for (int k = 0; k < o.views_count; ++k) {
    // the sensor looks at the target from 206 mm
    const Eigen::Quaterniond turn = tilt(r, o.is_one_axis, o.tilt_deg);
    const Eigen::Quaterniond q = (quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()) * turn).normalized();
    const Vec3 c = o.sight == Sight::sphere ? Vec3(0, 0, 0) : middle;
    const Pose<frame::Target, frame::Sensor> at(q, c - q * Vec3(r.normal(0, 6), r.normal(0, 6), 206 + r.uniform(-25, 25)));
    const auto T_true = o.is_sensor_fixed ? kEye * at.inverse() * kHeld.inverse() : place * at * kHand.inverse();
    const Vec6 e = arm_error(r, o.robot_mm, o.robot_rad);
    NetworkView v;
    v.name = "view " + std::to_string(k + 1);
    v.T_base_flange = T_true * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse();
    const auto C = at.inverse();
    const auto noise = [&]() { return r.normal(0, o.noise_mm); };
    if (o.sight == Sight::point) {
      for (std::size_t j = 0; j < points.size(); ++j)
        if (o.drop_ball_every <= 0 || j != static_cast<std::size_t>(k % o.drop_ball_every)) v.observations.push_back({points[j], C.point(points[j]) + Vec3(noise(), noise(), noise()), static_cast<int>(j)});
    } else if (o.sight == Sight::pixel) {
      for (std::size_t j = 0; j < points.size(); ++j) {
        const Vec2 s = pixel_of(&t.sensor[kFx], C.point(points[j]));
        v.observations.push_back({points[j], Vec3(s.x() + noise(), s.y() + noise(), 0), static_cast<int>(j)});
      }
    } else if (o.sight == Sight::pose) {
      Vec6 z;
      for (int i = 0; i < 3; ++i) z[i] = r.normal(0, o.noise_mm), z[3 + i] = r.normal(0, 1e-2 * o.noise_mm);
      Pose<frame::Sensor, frame::Target> M(C.q * quat_exp(z.tail<3>()), C.p_mm + z.head<3>());
      v.T_sensor_target = M;
    } else if (o.sight == Sight::sphere) {
      // a laser line: points of the sensor's x-z plane on the ball
      const Vec3 s = C.point(Vec3::Zero());
      const double rho2 = o.radius_mm * o.radius_mm - s.y() * s.y();
      if (rho2 <= 0) continue;
      for (int j = 0; j < 80; ++j) {
        const double a = rad_from_deg(-50 + 100.0 * j / 79);
        const double rho = std::sqrt(rho2) + noise();
        v.observations.push_back({Vec3::Zero(), Vec3(s.x() + rho * std::sin(a), 0, s.z() - rho * std::cos(a)), j});
      }
    }
    g.seen.push_back(C);
    g.network.views.push_back(v);
  }
  return g;
}

}  // namespace asbuilt::testing_calibrate
