// SPDX-License-Identifier: GPL-3.0-or-later
// The measured points around every station of every edge, in the cross-section's coordinates: how far out over each of the two
// fitted faces (extended past the edge), how far along the edge, and what kind of point it is.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/frames.hpp"

namespace asbuilt::burring {

struct SectionPoint {
  float s_mm, f_1_mm, f_2_mm, sigma_mm;  // sigma along the ray
  float ray_1, ray_2;                    // the ray along the two normals
  int capture;
  float out_mm() const { return std::max(f_1_mm, f_2_mm); }
  /// 1 sd of out_mm: what the noise along the ray is across the face over which the point stands out.
  float sigma_out_mm() const { return sigma_mm * std::max(0.3f, std::abs(f_1_mm > f_2_mm ? ray_1 : ray_2)); }
};

/// How one capture looked at 1 mm of an edge: its points on the two faces close to the edge, and the mean direction of the rays
/// in the section's coordinates (along the two outward normals).
struct Sight {
  int points_1_count = 0, points_2_count = 0;
  float ray_1 = 0, ray_2 = 0;
};

/// Free space: a ray that came back from behind proves that no fin stood in its way. By half millimetre along the edge and by
/// the angle at which a fin could lean (of (f_1, f_2)): the two lowest places at which rays crossed that half-line, in mm standing
/// out over the faces. The second one counts: one stray point may lie.
struct Carving {
  static constexpr int kLeans = 14;
  static constexpr double kBin_mm = 0.5;
  static double lean_rad(int k) { return rad_from_deg(-20.0 + 10.0 * k); }
  std::array<std::array<float, 2>, kLeans> lowest_mm;
  Carving();
  void add(int lean, float at_mm);
};

struct EdgeSection {
  std::vector<SectionPoint> proud;        // standing out near the edge, or perhaps: burr, and what is not
  std::vector<float> face_1_s, face_2_s;  // arc lengths of points on the faces close to the edge: proof of sight, ascending
  std::vector<std::vector<Sight>> sights; // by capture, by mm along the edge; empty for captures that did not see it
  std::vector<Carving> carved;            // by Carving::kBin_mm along the edge
  /// By capture: how far off the heights of its points over face 1 and face 2 may be as a whole (1 sd). 0 where it sees that face
  /// itself beside this edge; else as well as the capture's place is known.
  std::vector<std::array<double, 2>> zero_sd_mm;
  double noise_mm = 0;                    // robust sd of the height of the face points close to the edge
  double offset_1_mm = 0, offset_2_mm = 0;  // median height of those points: what the fit left
};

struct SectionOptions {
  double reach_mm = 5;        // around the edge
  double threshold_mm = 0.03; // points standing out more than this are proud
};

/// The tallest fin that the rays around s leave room for: over all leans, or over those near `lean_rad` (NaN: all). Infinite where no
/// ray passed.
double carved_height_mm(const EdgeSection& section, double s_mm, double lean_rad, double window_mm);

/// Only captures with use[k]. In order of edges; within an edge in order of the cloud.
std::vector<EdgeSection> cut_sections(const SectionOptions& options, const MeasuredCloud& cloud, const Location& location,
                                      const Features& features, const std::vector<char>& use);

}  // namespace asbuilt::burring
