// SPDX-License-Identifier: GPL-3.0-or-later
// A small cell made by construction: a part with a round hole and any outline around it, two sensors by ray casting, a robot
// whose error is drawn from its own model. Truth is known exactly.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/random.hpp"

namespace asbuilt::synthetic {

/// A corner of the outline, counter-clockwise. The run from it to the next corner is one face: straight, or an arc about the
/// origin where both have the same radius.
struct Corner {
  double angle_rad, radius_mm;
};

/// Extruded from z = 0 to height about a round hole at the origin. Edge ids: "top-N", "bottom-N" by outline run, "hole-top".
PartSpec make_part(const std::vector<Corner>& outline, double hole_radius_mm, double height_mm);
/// Eight lugs on a ring, the first wider (0 for none wider); lugs_count 0: a plain ring.
PartSpec make_ring(int lugs_count = 8, double wider_mm = 10);
/// An outline without any symmetry.
PartSpec make_bracket(bool is_mirrored = false);

/// Features named "f" and so on: edges whose id begins with one of the prefixes.
void add_feature(PartSpec& part, const std::string& id, const std::vector<std::string>& edge_ids);

/// A six-axis cell with a wide and a detail sensor, one cutter, one recipe, a fixture plate under the part; play 6 mm, 1 deg,
/// free about z or not.
Job make_job(PartSpec part, bool is_free_about_z);

struct View {
  int sensor = 0;                        // 0: wide, 1: detail
  Vec3 aim_part = Vec3::Zero();          // looked at
  Vec3 from_part = Vec3::UnitZ();        // direction towards the sensor
  double turn_rad = 0;                   // of the flange about the line of sight
  std::string feature;
  bool is_working = false;               // flange z along the recipe's axis; `from_part` is then ignored
};
/// Wide all around, detail in working orientation twice and obliquely twice over each aim.
std::vector<View> usual_views(const std::vector<std::pair<std::string, Vec3>>& feature_aims, bool with_wide_sides = true);

struct Truth {
  Pose<frame::Base, frame::Part> T_base_part;          // true
  Eigen::VectorXd arm;                                 // parameters of the error model
  Vec6 calibrated = Vec6::Zero();                      // the arm's mean twist in the postures that sensors and tool were calibrated in, flange frame
  std::vector<Pose<frame::Base, frame::Flange>> T_base_flange_true;
  std::vector<Pose<frame::Base, frame::Sensor>> T_base_sensor_true;
};
struct ScanOptions {
  std::uint64_t seed = 1;
  Pose<frame::Part, frame::Part> play;                  // true seat against nominal, child frame
  double robot_ratio = 1;                               // of the model's error; 0: a perfect robot
  double noise_ratio = 1;                               // of the sensors' noise
  double hand_eye_ratio = 1;                            // draws from the calibration's covariance
  Vec3 detail_hand_eye_fault_mm = Vec3::Zero();         // a fault that the calibration does not know
  double form_mm = 0;                                   // every face is off by a normal draw of this size
  int wide_pixels = 90, detail_pixels = 70;             // along the wide side
  const PartSpec* scanned_part = nullptr;               // another part than the drawing's
};
/// Fills job.captures.
Truth scan(Job& job, const std::vector<View>& views, const ScanOptions& options);

}  // namespace asbuilt::synthetic
