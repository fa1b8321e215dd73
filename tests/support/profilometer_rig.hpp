// SPDX-License-Identifier: GPL-3.0-or-later
// A simulated cell for the profilometer's tests and studies, and its holes in the words of the calibration.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "planner/calibrate/profilometer.hpp"
#include "planner/simulate/profilometer.hpp"

namespace asbuilt::rig {

inline simulate::ProfilometerCell profilometer_cell(std::uint64_t seed) {
  Random r = Random::stream(seed, "cell");
  simulate::ProfilometerCell c;
  c.plate = simulate::plate_437();
  c.T_flange_sensor = {quat_exp(Vec3(0.3 + r.normal(0, 0.1), -0.2 + r.normal(0, 0.1), 1.4 + r.normal(0, 0.3))), Vec3(60, -30, 220) + 10 * Vec3(r.normal(), r.normal(), r.normal())};
  c.T_base_target = {quat_exp(Vec3(r.normal(0, 0.1), r.normal(0, 0.1), r.normal())), Vec3(1100, 40, 500)};
  // the device is not as its sheet says
  c.device.focal_mm *= 1 + r.normal(0, 0.01);
  c.device.center_u_px += r.normal(0, 8), c.device.center_v_px += r.normal(0, 8);
  c.device.theta_rad = r.normal(0, 0.01);
  c.device.triangulation_rad += r.normal(0, 0.01);
  c.device.baseline_mm += r.normal(0, 1);
  c.latency_s = r.uniform(-0.003, 0.006);
  return c;
}

inline ProfilometerSheet sheet() {
  ProfilometerSheet s;
  s.focal_mm = 8, s.pixel_mm = 0.0053, s.width_px = 1280, s.height_px = 1024;
  s.baseline_mm = 69.946, s.triangulation_rad = rad_from_deg(25);
  return s;
}

/// The true numbers of the camera model (lens given as measured to ideal).
inline ProfilometerState truth_of(const simulate::ProfilometerCell& c) {
  ProfilometerState s;
  const auto& d = c.device;
  s.intrinsics = camera_of(sheet());
  s.intrinsics.values << d.focal_mm, d.pixel_u_mm, d.pixel_v_mm, d.center_u_px, d.center_v_px, d.k1, d.k2, d.p1, d.p2, d.baseline_mm, d.triangulation_rad, d.theta_rad;
  s.T_flange_sensor = c.T_flange_sensor, s.T_base_target = c.T_base_target, s.latency_s = c.latency_s;
  return s;
}

inline ProfilometerRecipe recipe_of(const simulate::ProfilometerCell& c) {
  ProfilometerRecipe r;
  r.robot_sd_mm = c.robot_sd_mm, r.robot_sd_rad = c.robot_sd_rad, r.repeat_sd_mm = c.repeat_sd_mm, r.repeat_sd_rad = c.repeat_sd_rad;
  r.path_sd_mm = c.path_sd_mm;
  return r;
}

inline std::vector<simulate::ProfilometerPass> passes_of(const simulate::ProfilometerCell& c, const std::vector<simulate::ProfilometerStand>& stands,
                                                         double speed_mm_s = 40, double length_mm = 130) {
  std::vector<simulate::ProfilometerPass> all;
  int pose = -1;
  for (std::size_t i = 0; i < stands.size(); ++i) {
    if (!stands[i].is_backward) ++pose;
    all.push_back(simulate::pass_of(c, stands[i], std::max(0, pose), length_mm, speed_mm_s));
  }
  return all;
}

/// `held` stands are added and marked as held out.
inline std::vector<HoleView> views_of(const simulate::ProfilometerCell& c, const std::vector<simulate::ProfilometerPass>& passes, std::uint64_t seed) {
  Random robot = Random::stream(seed, "robot"), noise = Random::stream(seed, "noise");
  const auto errors = simulate::robot_errors(c, passes, robot);
  std::vector<HoleView> views;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const auto& p = passes[i];
    HoleView v;
    v.name = p.name, v.is_held_out = p.is_held_out;
    for (const simulate::SeenHole& h : simulate::seen_holes(c, p, int(i), errors[i], noise)) {
      HoleSighting s;
      s.column = h.column, s.row = h.row, s.uv = h.uv, s.profile = h.t_s * p.profiles_per_s;
      s.T_base_flange = {p.T_base_flange.q, p.T_base_flange.p_mm + p.velocity_base_mm_s * h.t_s};
      s.velocity_base_mm_s = p.velocity_base_mm_s;
      s.sd_target_mm = Vec3(c.hole_sd_mm, c.hole_sd_mm, 0.5 * c.hole_sd_mm);
      v.holes.push_back(s);
    }
    views.push_back(v);
  }
  return views;
}

/// Five more poses between the published ones, held out.
inline std::vector<simulate::ProfilometerPass> held_out_passes(const simulate::ProfilometerCell& c, double tilt_rad, bool both, int first_pose) {
  std::vector<simulate::ProfilometerPass> all;
  const double t = tilt_rad * 0.6;
  const std::vector<simulate::ProfilometerStand> stands{{-30, t, t}, {25, -t, t}, {40, t, -t}, {-45, -t, -t}, {10, 0, t}};
  for (std::size_t i = 0; i < stands.size(); ++i)
    for (int back = 0; back < (both ? 2 : 1); ++back) {
      auto s = stands[i];
      s.is_backward = back == 1;
      auto p = simulate::pass_of(c, s, first_pose + int(i), 130, 40);
      p.is_held_out = true, p.name = "check " + p.name;
      all.push_back(p);
    }
  return all;
}

}  // namespace asbuilt::rig
