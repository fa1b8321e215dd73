// SPDX-License-Identifier: GPL-3.0-or-later
// Arms for the tests of this room: two made-up ones and a reader of real URDF files.
#pragma once

#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>

#include "planner/artefacts/job.hpp"
#include "planner/io/urdf.hpp"

namespace asbuilt::test {

inline void set_limits(RobotSpec& spec, const std::array<std::array<double, 2>, 6>& deg, double speed_deg_s = 150) {
  for (int i = 0; i < 6; ++i) {
    spec.joints[i].min_rad = rad_from_deg(deg[i][0]);
    spec.joints[i].max_rad = rad_from_deg(deg[i][1]);
    spec.joints[i].speed_rad_s = rad_from_deg(speed_deg_s);
    spec.joints[i].acceleration_rad_s2 = rad_from_deg(500);
    spec.joints[i].jerk_rad_s3 = rad_from_deg(4000);
  }
}

/// A large arm with signs and an offset, joint 6 able to turn almost twice about.
inline RobotSpec large_arm() {
  RobotSpec s;
  s.model = "large";
  OpwParameters o;
  o.a1_mm = 300, o.a2_mm = -150, o.b_mm = 0, o.c1_mm = 750, o.c2_mm = 1000, o.c3_mm = 1080, o.c4_mm = 220;
  o.offsets_rad = {0, -kPi / 2, 0, 0, 0, 0};
  o.signs = {-1, 1, 1, -1, 1, -1};
  s.kinematics = o;
  set_limits(s, {{{-180, 180}, {-150, 20}, {-110, 150}, {-270, 270}, {-122, 122}, {-350, 350}}});
  s.home_rad = {0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};
  s.accuracy.absolute = {0.42, 0.2};
  s.accuracy.repeatability = {0.07, 0.03};
  s.accuracy.short_term = {0.02, 0.01};
  return s;
}

/// A small arm with a lateral offset and every sign and offset in use.
inline RobotSpec odd_arm() {
  RobotSpec s;
  s.model = "odd";
  OpwParameters o;
  o.a1_mm = 25, o.a2_mm = -35, o.b_mm = 18, o.c1_mm = 400, o.c2_mm = 315, o.c3_mm = 365, o.c4_mm = 80;
  o.offsets_rad = {0.3, -kPi / 2, 0.1, -0.4, 0.2, kPi};
  o.signs = {-1, 1, -1, 1, -1, 1};
  s.kinematics = o;
  set_limits(s, {{{-360, 360}, {-360, 360}, {-360, 360}, {-360, 360}, {-360, 360}, {-360, 360}}});
  return s;
}

inline std::filesystem::path robots_folder() { return std::filesystem::path("../shared/data/robots"); }

/// The chain from base to tip. None where there is no such chain of six turning joints.
inline std::optional<RobotSpec> spec_of_urdf(const std::filesystem::path& file, const std::string& base, const std::string& tip) {
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const auto read = read_urdf(bytes, file.filename(), base, tip);
  if (!read) return std::nullopt;
  RobotSpec spec;
  spec.model = file.stem();
  spec.kinematics = read->artefact.kinematics;
  for (int i = 0; i < 6; ++i)
    spec.joints[i] = {read->artefact.limits_rad[i][0], read->artefact.limits_rad[i][1], read->artefact.speed_rad_s[i], 10, 100};
  return spec;
}

}  // namespace asbuilt::test
