// SPDX-License-Identifier: GPL-3.0-or-later
// A calibration whose truth is known by construction: a sensor on the flange (or fixed) looks at a target from tilted poses.
#pragma once

#include <limits>

#include "planner/base/random.hpp"
#include "planner/calibrate/hand_eye.hpp"
#include "planner/calibrate/network.hpp"

namespace asbuilt::testing_calibrate {

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
  const Pose<frame::Flange, frame::Sensor> hand(quat_exp(Vec3(0.3, -0.5, 1.4)), Vec3(80, -30, 150));
  const Pose<frame::Base, frame::Target> place(quat_exp(Vec3(r.normal(0, 0.1), r.normal(0, 0.1), r.normal())), Vec3(1200, 40, 600));
  const Pose<frame::Base, frame::Sensor> eye(quat_exp(Vec3(2.6, 0.3, -0.4)), Vec3(1300, 200, 900));
  const Pose<frame::Flange, frame::Target> held(quat_exp(Vec3(0.2, 0.1, 0.7)), Vec3(20, -15, 120));
  if (o.is_sensor_fixed) t.T_mount_sensor = {eye.q, eye.p_mm}, t.T_place_target = {held.q, held.p_mm};
  else t.T_mount_sensor = {hand.q, hand.p_mm}, t.T_place_target = {place.q, place.p_mm};
  for (int k = 0; k < o.views_count; ++k) {
    Vec3 axis(r.normal(), r.normal(), r.normal());
    if (o.is_one_axis) axis = Vec3(0, 0, 1);
    const Vec3 w = axis.normalized() * r.uniform(-1, 1) * rad_from_deg(o.tilt_deg);
    // the sensor looks at the target from 206 mm
    const Eigen::Quaterniond q = (quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()) * quat_exp(w)).normalized();
    const Vec3 c = o.sight == Sight::sphere ? Vec3(0, 0, 0) : middle;
    const Pose<frame::Target, frame::Sensor> at(q, c - q * Vec3(r.normal(0, 6), r.normal(0, 6), 206 + r.uniform(-25, 25)));
    const auto T_true = o.is_sensor_fixed ? eye * at.inverse() * held.inverse() : place * at * hand.inverse();
    Vec6 e;
    for (int i = 0; i < 3; ++i) e[i] = r.normal(0, o.robot_mm), e[3 + i] = r.normal(0, o.robot_rad);
    NetworkView v;
    v.name = "view " + std::to_string(k + 1);
    // true = commanded.disturbed(error)
    v.T_base_flange = T_true * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse();
    const auto C = at.inverse();
    const auto noise = [&]() { return r.normal(0, o.noise_mm); };
    if (o.sight == Sight::point) {
      for (std::size_t j = 0; j < points.size(); ++j)
        if (o.drop_ball_every <= 0 || j != static_cast<std::size_t>(k % o.drop_ball_every)) v.observations.push_back({points[j], C.point(points[j]) + Vec3(noise(), noise(), noise()), static_cast<int>(j)});
    } else if (o.sight == Sight::pixel) {
      for (std::size_t j = 0; j < points.size(); ++j) {
        const Vec3 s = C.point(points[j]);
        const double x = s.x() / s.z(), y = s.y() / s.z(), r2 = x * x + y * y, d = 1 + t.sensor[kK1] * r2 + t.sensor[kK2] * r2 * r2;
        v.observations.push_back({points[j],
                                  Vec3(t.sensor[kFx] * (x * d + 2 * t.sensor[kP1] * x * y + t.sensor[kP2] * (r2 + 2 * x * x)) + t.sensor[kCx] + noise(),
                                       t.sensor[kFy] * (y * d + t.sensor[kP1] * (r2 + 2 * y * y) + 2 * t.sensor[kP2] * x * y) + t.sensor[kCy] + noise(), 0),
                                  static_cast<int>(j)});
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
