// SPDX-License-Identifier: GPL-3.0-or-later
// The cloud boiled down: the points of one capture on one face in one 5 mm cell give one distance to the drawing. Points of a
// cell share sensor error, so a cell counts as a few readings, however dense the scan.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/locate/cad_model.hpp"

namespace asbuilt {

struct Cluster {
  int capture = -1, face = -1;
  std::uint64_t patch = 0, cell = 0;   // of the part; clusters of one face and cell see the same place; a patch is 5 x 5 x 5 cells
  Vec3 p_base = Vec3::Zero();          // mean, as placed (uncorrected)
  Vec3 p_part = Vec3::Zero(), n_part = Vec3::UnitZ();
  Vec6 wrench = Vec6::Zero();          // means of n and (p - center) x n in base: d distance / d twist about the center
  double distance_mm = 0;              // of the uncorrected points to the drawing at the pose of association (outside positive)
  double variance_mm2 = 0;             // of that mean, as this capture's own error
  int count = 0;
};

struct ClusterRequest {
  const MeasuredCloud* cloud = nullptr;
  const CadModel* cad = nullptr;
  Pose<frame::Base, frame::Part> T_base_part;
  Vec3 center_base = Vec3::Zero();
  std::vector<Vec6> twists;            // by capture: what corrects its points, about the center
  double gate_mm = 3.0;                // farther points belong to something else
  double edge_band_mm = 1.0;           // nothing within this of a sharp edge: burrs and breaks
  double cell_mm = 5.0;
};

/// In the order of face, patch, cell, capture. The same for any order of points and captures (up to the captures' numbers).
std::vector<Cluster> make_clusters(const ClusterRequest& request);

}  // namespace asbuilt
