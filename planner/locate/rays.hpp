// SPDX-License-Identifier: GPL-3.0-or-later
// What the measured rays say about a pose of the part: where each should end on the drawing and where it did. Decides between
// places that the descent alone finds alike.
#pragma once

#include <vector>

#include "planner/locate/cad_model.hpp"
#include "planner/locate/scene.hpp"

namespace asbuilt {

struct Candidate {
  Pose<frame::Base, frame::Part> T_base_part;
  double score = 0;            // of the descent, 0..1
  double log_likelihood = 0;   // by rays, discounted for neighbours' correlation
  double inlier_ratio = 0;     // rays that end on the part, of those that should
  double see_through_ratio = 0;
  std::size_t rays_count = 0;  // that should end on the part
};

/// How strictly a reading has to lie on the drawing.
struct RayRules {
  double form_mm = 1.0;      // 1 sd by which the part may differ from its drawing, at least three times the reading's own
  bool has_normals = false;  // the reading's normal must fit too
  double behind_ratio = 0.01;  // of readings that pass through where the part is, all the same
  double grazing_mm = 0.5;     // a ray that stays this close to the surface only scrapes the part
};

/// Fills likelihood and ratios. Method: first hit of the hypothesised part along each measured ray; extra material is cheap,
/// a ray that passes through where the part should be is dear; what lies on the known fixture says nothing.
void look_along_rays(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, std::size_t rays_max, Candidate& candidate);

/// By how much the scans prefer pose a to pose b, as a log-likelihood ratio, negative where they prefer b. Method: every ray that ends
/// differently under the two votes by its own ratio; votes are averaged over places of 8 mm (neighbours and captures that look at
/// the same place tell the same), rays that only scrape the part are left out. Of the sum over places half counts (places next to each
/// other), and no more than half its squared ratio to the scatter, which is read off the places that vote for the loser and is at least
/// one strong place.
double preference(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, const Candidate& a, const Candidate& b,
                  const RayRules& rules = {});

}  // namespace asbuilt
