// SPDX-License-Identifier: GPL-3.0-or-later
// Where a rotating cutter has to stand so that, moved along an edge, it leaves a chamfer of the wanted legs.
//
// The cutter is a solid of revolution about `up` (unit, from the tip to the spindle; tool z is its negative). Moved straight along the
// edge's tangent its flank sweeps a plane (cone, cylinder) or a round groove (ball); the legs are where that surface meets the two
// faces. Everything in one frame (part), mm. Source: algorithms B6.6, derived anew for edges not perpendicular to the axis.
#pragma once

#include <string>

#include "planner/artefacts/job.hpp"

namespace asbuilt {

/// One cross-section of an edge: point, unit tangent, outward unit normals of its two faces.
struct EdgeStation {
  Vec3 p = Vec3::Zero(), tau = Vec3::UnitX(), n_1 = Vec3::UnitZ(), n_2 = Vec3::UnitY();
};

/// The cutter at one station.
struct CutterPlacement {
  Vec3 tip = Vec3::Zero(), up = Vec3::UnitZ();
  Vec3 m = Vec3::UnitZ();                       // outward unit normal of the chamfer
  double leg_1_mm = 0, leg_2_mm = 0;            // on face 1 and face 2
  Vec3 slope_1 = Vec3::Zero(), slope_2 = Vec3::Zero();  // d leg = slope . d edge, mm per mm
  double area_mm2 = 0;                          // cross-section of the chamfer
  double contact_radius_mm = 0;
  std::string fault;                            // empty: it fits
  double fault_measured = 0, fault_limit = 0;
  std::string fault_unit;
};

/// Height of the part of the cutter that makes the chamfer, from the tip: a cone's flank, a ball's lower half, a cylinder's side.
double flank_mm(const Cutter& cutter);
/// Radius at the height above the tip.
double radius_mm(const Cutter& cutter, double height_mm);
/// Size of the gap between the point (tool frame, so that the body has z <= 0) and the cutter; negative inside.
double gap_mm(const Cutter& cutter, const Vec3& p_tool);

/// Material angle at the station, rad.
double material_angle_rad(const EdgeStation& station);
/// Unit direction in face 1 (or 2) away from the edge, perpendicular to it.
Vec3 into_face(const EdgeStation& station, int face);

/// The tip for legs whose mean is width_mm, the flank then moved outward by offset_mm (roughing).
/// The contact lies at contact_height_ratio of the flank. A placement with a fault says why the cutter cannot do it.
CutterPlacement place_cutter(const Cutter& cutter, const EdgeStation& station, const Vec3& up, double width_mm, double offset_mm,
                       double contact_height_ratio);

/// The axis (up) within cone_rad of `wanted_up` for which both legs come out most alike.
Vec3 tilted_up(const Cutter& cutter, const EdgeStation& station, const Vec3& wanted_up, double cone_rad);

}  // namespace asbuilt
