// SPDX-License-Identifier: GPL-3.0-or-later
// What a sensor sees of points on a surface from a pose: field, range, incidence, both eyes free, and how many of its pixels fall there.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/geom/ray_tree.hpp"

namespace asbuilt::inspecting {

struct SensorEye {  // frame sensor: z into the scene
  std::array<double, 2> half_width_ratio{};   // of the field at distance 1
  std::array<double, 2> range_mm{};
  double working_distance_mm = 0, pitch_ratio = 0;  // pixel at distance 1
  double noise_mm = 0;                        // along the ray at the working distance
  double cos_incidence_min_ratio = 0;
  Vec3 second_mm = Vec3::Zero();              // the other eye
  bool has_second = false;
  std::vector<std::string> assumed;           // what the cell does not say
};
/// From the sheet; where it is silent 1 pixel in 300 of the width, 68 degrees, and the second eye at 0.45 of the working distance
/// along x are taken, and said.
SensorEye eye_of(const SensorSpec& sensor);

/// Everything that can stand in the way. `standing` is in base; `riding` hangs on the flange, `links` are drawn in base with every joint at 0.
struct Blockers {
  RayTree standing_base;
  std::vector<RayTree> riding_flange;         // one for each sensor: all but its own body
  std::vector<std::pair<int, RayTree>> links; // link 1..6
};

/// A place on a face, and what it stands for.
struct Patch {
  Vec3 p = Vec3::Zero(), n = Vec3::UnitZ();   // base; n out of the material
  double area_mm2 = 0;
  double offset_mm = 0;                       // from the edge, along the face
};

enum class Unseen { seen, out_of_field, out_of_range, too_steep, hidden, hidden_from_second };
std::string_view name_of(Unseen u);

/// A pose of the sensor with what moves with it.
struct Stand {
  int sensor = 0;
  Pose<frame::Base, frame::Sensor> T_base_sensor;
  std::optional<Pose<frame::Base, frame::Flange>> T_base_flange;         // none: nothing rides along
  const std::array<Pose<frame::Base, frame::Base>, 7>* link_motion = nullptr;  // none: the arm is not looked at
};

/// Whether the patch gives points; then `density` is how many a mm^2.
/// `margin_mm`: kept inside the field and the range.
Unseen look(const SensorEye& eye, const Blockers& blockers, const Stand& stand, const Patch& patch, double margin_mm, double& density_per_mm2);

}  // namespace asbuilt::inspecting
