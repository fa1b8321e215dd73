// SPDX-License-Identifier: GPL-3.0-or-later
// From two fitted faces to the edge between them: station by station along the drawing's edge, corners where a third face ends
// it, and the covariance of every station. The closed forms of intersection.hpp are its check, not its replacement: with offset
// fields no closed form exists.
#pragma once

#include <optional>
#include <vector>

#include "planner/fit/associate.hpp"
#include "planner/fit/bundle.hpp"

namespace asbuilt::fitting {

/// The point of both faces in the plane through `seed` square to `tangent`; none when the faces meet at less than
/// `angle_min_rad` there or the search does not converge.
std::optional<Vec3> intersect_at(const FaceModel& face_1, const FaceModel& face_2, const Vec3& seed, const Vec3& tangent,
                                 double angle_min_rad);
/// The point of three faces nearest to `seed`; none when they do not meet well there.
std::optional<Vec3> corner_at(const FaceModel& face_1, const FaceModel& face_2, const FaceModel& face_3, const Vec3& seed);

/// Stations at most step apart on the drawing's edge, moved onto its exact surfaces.
void place_stations(const BrepEdge& edge, const FaceModel& face_1, const FaceModel& face_2, double step_mm, EdgeModel& out);

/// Where an open edge ends: shift of the two ends along the edge (positive: along the tangent), from third faces.
struct EndShift {
  double start_mm = 0, end_mm = 0;
};

/// The stations of `edge` on the fitted faces. Fails (index of the first bad station) when the faces do not meet.
struct Traced {
  std::vector<Vec3> nominal, adapted, tangent;
  int bad_station = -1;
  double bad_angle_rad = 0;
};
Traced trace_edge(const EdgeModel& edge, const std::vector<FaceModel>& faces, const EndShift& ends, double step_mm);

/// Covariance of a point of the edge from the bundle: mm^2, part. s is the arc-length-free gradient at x.
Mat3 edge_covariance(const Bundle& bundle, const std::vector<FaceModel>& faces, const EdgeModel& edge, const Vec3& x, const Vec3& tangent);

}  // namespace asbuilt::fitting
