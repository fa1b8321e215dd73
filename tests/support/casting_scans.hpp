// SPDX-License-Identifier: GPL-3.0-or-later
// Raw castings and what a structured-light sensor sees of them: procedural parts, extra material that the drawing lacks (flash,
// risers), shrinkage and bend, noise that is correlated from pixel to pixel, lost and mixed pixels. Shares no code with the search.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "planner/geom/mesh.hpp"

namespace asbuilt::casting_scans {

struct Part {
  std::string name;
  Mesh drawing;
  double parting_z_mm = 0;                 // flash stands out of the sides here
  std::vector<std::array<double, 4>> risers;  // x, y, z of the foot, radius
};
/// An outline without symmetry; a housing with bosses; a plate that one boss keeps from being symmetric; a flange of four bolts
/// with one boss at its side.
std::vector<Part> parts();
/// The same four kinds with sizes, places and counts drawn by seed.
std::vector<Part> drawn_parts(std::uint64_t seed);

struct View {
  Vec3 eye_part = Vec3::Zero();            // looks at the middle of the part
  double roll_rad = 0;
};
/// 8 angles x 3 heights, turned and lifted by some degrees at random.
std::vector<View> views(std::uint64_t seed, double distance_mm);

struct Options {
  std::uint64_t seed = 1;
  bool has_extra = true;                   // flash and risers
  double lost_ratio = 0.1;                 // pixels lost at random, in patches
  double noise_mm = 0.18;
  int columns = 240, rows = 150;
};
struct Scan {
  std::vector<Vec3> p_sensor, n_sensor;    // in the sensor's frame (z into the scene); normals of neighbouring pixels, towards the sensor
  Pose<frame::Sensor, frame::Part> T_sensor_part;  // truth
};
Scan scan(const Part& part, const View& view, const Options& options);

}  // namespace asbuilt::casting_scans
