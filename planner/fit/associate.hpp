// SPDX-License-Identifier: GPL-3.0-or-later
// Which measured points lie on which face beside which edge. By the drawing first, with wide margins; then again by the edges
// and faces fitted so far. Points near any edge stay out: there burrs live, and a burr must not tilt a face.
#pragma once

#include <algorithm>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/fit/face_model.hpp"
#include "planner/geom/polyline_index.hpp"

namespace asbuilt::fitting {

/// An edge to be worked with its stations in part, and the two face models it lies between.
struct EdgeModel {
  int edge = -1;                        // index into Brep::edges
  std::string feature;
  int slot_1 = -1, slot_2 = -1;         // indices into the face models
  bool is_convex = true, is_closed = false;
  std::vector<Vec3> nominal, tangent;   // stations on the nominal surfaces, tangents of the nominal edge
  std::vector<Vec3> current;            // the same stations on the surfaces fitted so far
};

/// Points of one capture on one face within one cell, averaged robustly.
struct Cell {
  int slot = -1, capture = -1, edge = -1;  // edge: index into the edge models it was found beside
  Vec3 p_base = Vec3::Zero();              // as in the cloud, before corrections
  double s_mm = 0, inside_mm = 0;          // along that edge, and distance from it
  double sd_mm = 0, scatter_mm = 0;
  int points_count = 0;
};

struct Association {
  double from_mm = 0, reach_mm = 0;        // points between these distances from the edge are taken
  double other_edges_mm = 0;               // distance kept from every other edge of the part
  double gate_mm = 0;                      // largest distance from the face
  double cell_mm = 2.0;
  /// Faces (by slot) of which too little was seen beside their edge: they are taken up to far_reach_mm into the face.
  std::vector<char> is_far;
  double far_reach_mm = 0;
  double reach_of(int slot) const { return slot < static_cast<int>(is_far.size()) && is_far[slot] ? far_reach_mm : reach_mm; }
  double reach_most() const { return is_far.empty() ? reach_mm : std::max(reach_mm, far_reach_mm); }
};

/// Cells in a fixed order (slot, capture, place). Captures that are not fine count only beside edges marked in coarse_edges.
std::vector<Cell> associate(const Association& how, const MeasuredCloud& cloud, const Pose<frame::Base, frame::Part>& T_base_part,
                            const std::vector<Pose<frame::Base, frame::Base>>& corrections, const std::vector<char>& is_fine,
                            const std::vector<char>& coarse_edges, const std::vector<EdgeModel>& edges,
                            const std::vector<FaceModel>& faces, const PolylineIndex& all_edges, const std::vector<int>& all_edges_index);

}  // namespace asbuilt::fitting
