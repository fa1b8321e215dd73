// SPDX-License-Identifier: GPL-3.0-or-later
// Passes of the simulated profilometer as the files a user has: a captures file, profiles as CSV or PLY, robot logs.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "planner/base/number.hpp"
#include "planner/io/file.hpp"
#include "tests/support/profilometer_rig.hpp"

namespace asbuilt::rig {

/// 120 holes, half the pixels: quick.
inline simulate::ProfilometerCell small_cell(std::uint64_t seed) {
  auto c = profilometer_cell(seed);
  c.plate = {"120 holes, 8 mm", 12, 10, 8, 4.5, 7, 2 * kPi / 3, {{{5, 4}, {8, 4}, {5, 6}}}, 0.002};
  c.device.width_px = 640, c.device.height_px = 512, c.device.pixel_u_mm = c.device.pixel_v_mm = 0.0106;
  c.device.center_u_px = 319.5 + 4, c.device.center_v_px = 255.5 - 3;
  c.path_sd_mm = 0.002;
  return c;
}
inline ProfilometerSheet small_sheet() {
  auto s = sheet();
  s.width_px = 640, s.height_px = 512, s.pixel_mm = 0.0106;
  return s;
}
inline simulate::ProfilometerPass pass_at(const simulate::ProfilometerCell& c, const simulate::ProfilometerStand& s, int pose = 0) {
  auto p = simulate::pass_of(c, s, pose, 130, 40);
  p.profiles_per_s = 80;
  return p;
}
/// Eight poses, both ways (or one), wide tilts and rolls; the last is held out.
inline std::vector<simulate::ProfilometerPass> raw_passes(const simulate::ProfilometerCell& c, bool both = true) {
  const double t = 0.35;
  const std::vector<simulate::ProfilometerStand> stands{{0, 0, 0, 0}, {-45, t, 0, kPi / 2}, {45, 0, t, 0}, {0, -t, 0, kPi}, {30, 0, -t, kPi / 2}, {-30, t, t, kPi}, {20, -t, t, 0}, {-20, 0.1, -t, kPi}};
  std::vector<simulate::ProfilometerPass> passes;
  for (std::size_t i = 0; i < stands.size(); ++i)
    for (int back = 0; back < (both ? 2 : 1); ++back) {
      auto s = stands[i];
      s.is_backward = back == 1;
      passes.push_back(pass_at(c, s, int(i)));
      passes.back().is_held_out = i + 1 == stands.size();
    }
  return passes;
}
inline std::vector<ProfileScan> scans_of(const simulate::ProfilometerCell& c, const std::vector<simulate::ProfilometerPass>& passes, std::uint64_t seed) {
  Random robot = Random::stream(seed, "robot"), noise = Random::stream(seed, "noise");
  const auto errors = simulate::robot_errors(c, passes, robot);
  std::vector<ProfileScan> scans;
  for (std::size_t i = 0; i < passes.size(); ++i) scans.push_back(simulate::scanned(c, passes[i], int(i), errors[i], noise));
  return scans;
}

enum class PassFiles { csv_with_velocity, csv_with_log, ply_with_velocity };

template <class A, class B>
std::string pose_yaml(const Pose<A, B>& T) {
  return "{xyz: [" + shortest_number(T.p_mm.x()) + ", " + shortest_number(T.p_mm.y()) + ", " + shortest_number(T.p_mm.z()) + "], quat: [" + shortest_number(T.q.w()) + ", " + shortest_number(T.q.x()) + ", " +
         shortest_number(T.q.y()) + ", " + shortest_number(T.q.z()) + "]}";
}

/// Writes cell.yaml, captures.yaml and the passes into the folder. The cell's sensor `line` stands nominally near the true one.
inline void write_captures(const std::filesystem::path& folder, const simulate::ProfilometerCell& c, const std::vector<simulate::ProfilometerPass>& passes, const std::vector<ProfileScan>& scans, PassFiles form,
                           const std::string& name = "captures.yaml", bool with_sheet = true) {
  namespace fs = std::filesystem;
  fs::create_directories(folder);
  const auto put = [&](const std::string& file, const std::string& text) { std::ofstream(folder / file, std::ios::binary) << text; };
  std::string cell = *read_file("tests/refuse/base/cell.yaml", "cell");
  auto nominal = c.T_flange_sensor;
  nominal.p_mm += Vec3(2, -1, 1.5);
  cell.replace(cell.find("sensors:\n"), 9, "sensors:\n  - id: line\n    kind: profile\n    flange_sensor: " + pose_yaml(nominal) + "\n    range: [80, 260]\n    field_of_view: [100, 120]\n    noise: 0.02\n");
  put("cell.yaml", cell);
  const HolePlate& p = c.plate;
  const auto pair = [](const std::array<int, 2>& v) { return "[" + std::to_string(v[0]) + ", " + std::to_string(v[1]) + "]"; };
  std::string yaml = "asbuilt: captures/1\ncell: cell.yaml\nsensor: line\ntaken: 2026-11-18\nvalid_days: 30\n";
  yaml += "robot_sd: {position: " + shortest_number(c.robot_sd_mm) + ", turn: " + shortest_number(deg_from_rad(c.robot_sd_rad)) + "}\n";
  yaml += "repeat_sd: {position: " + shortest_number(c.repeat_sd_mm) + ", turn: " + shortest_number(deg_from_rad(c.repeat_sd_rad)) + "}\n";
  yaml += "target: {kind: hole_plate, columns: " + std::to_string(p.columns_count) + ", rows: " + std::to_string(p.rows_count) + ", pitch: " + shortest_number(p.pitch_mm) + ", diameter: " + shortest_number(p.diameter_mm) +
          ", large_diameter: " + shortest_number(p.large_diameter_mm) + ", cone: " + fixed_number(deg_from_rad(p.cone_rad), 4) + ", origin: " + pair(p.large[0]) + ", along_x: " + pair(p.large[1]) + ", along_y: " + pair(p.large[2]) + "}\n";
  if (with_sheet && !c.device.is_metric)
    yaml += "sheet: {focal: 8, pixel: " + shortest_number(c.device.pixel_u_mm) + ", width: " + std::to_string(c.device.width_px) + ", height: " + std::to_string(c.device.height_px) + ", baseline: 69.946, triangulation: 25}\n";
  yaml += "captures:\n";
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const ProfileScan& s = scans[k];
    const std::string stem = name.substr(0, name.find('.')) + "_" + std::to_string(k);
    std::string rows = c.device.is_metric ? "t,x,z\n" : "t,u,v\n";
    std::string points;
    std::size_t count = 0;
    const double speed = passes[k].velocity_base_mm_s.norm();
    for (std::size_t i = 0; i < s.t_s.size(); ++i) {
      if (s.begin[i] == s.begin[i + 1]) rows += fixed_number(s.t_s[i], 6) + ",nan,nan\n";
      for (std::uint32_t m = s.begin[i]; m < s.begin[i + 1]; ++m) {
        const std::string a = fixed_number(double(s.uv[m].x()), 3), b = fixed_number(double(s.uv[m].y()), 4);
        if (form == PassFiles::ply_with_velocity) points += a + " " + fixed_number(speed * s.t_s[i], 5) + " " + b + "\n", ++count;
        else rows += fixed_number(s.t_s[i], 6) + "," + a + "," + b + "\n";
      }
    }
    const bool is_ply = form == PassFiles::ply_with_velocity;
    const std::string file = stem + (is_ply ? ".ply" : ".csv");
    put(file, is_ply ? "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) + "\nproperty float x\nproperty float y\nproperty float z\nend_header\n" + points : rows);
    yaml += "  - {name: " + stem + ", " + (is_ply ? "cloud: " : "profiles: ") + file;
    if (form == PassFiles::csv_with_log) {
      std::string log = "t,x,y,z,qw,qx,qy,qz\n";
      for (std::size_t i = 0; i < s.t_s.size(); ++i) {
        const auto& T = s.T_base_flange[i];
        // a sample before and one after every profile, off its time
        const double dt = i == 0 ? -0.004 : 0.001;
        for (const double d : {dt, i + 1 == s.t_s.size() ? 0.006 : 0.005}) {
          const Vec3 at = T.p_mm + passes[k].velocity_base_mm_s * d;
          log += fixed_number(s.t_s[i] + d, 6);
          for (const double v : {at.x(), at.y(), at.z()}) log += "," + fixed_number(v, 6);
          for (const double v : {T.q.w(), T.q.x(), T.q.y(), T.q.z()}) log += "," + fixed_number(v, 10);
          log += "\n";
        }
      }
      put(stem + "_log.csv", log);
      yaml += ", robot_log: " + stem + "_log.csv";
    } else {
      yaml += ", base_flange: " + pose_yaml(s.T_base_flange.front()) + ", velocity: [" + shortest_number(passes[k].velocity_base_mm_s.x()) + ", " + shortest_number(passes[k].velocity_base_mm_s.y()) + ", " +
              shortest_number(passes[k].velocity_base_mm_s.z()) + "]";
    }
    if (s.is_held_out) yaml += ", held_out: true";
    yaml += "}\n";
  }
  put(name, yaml);
}

}  // namespace asbuilt::rig
