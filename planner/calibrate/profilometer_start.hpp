// SPDX-License-Identifier: GPL-3.0-or-later
// Starts for the joint solve that need no guess: a projective map of pixels into the flange by bilinear least squares, and from it the
// numbers of either model. Frames: base, flange, sensor, target. mm, rad.
#pragma once

#include <optional>

#include "planner/calibrate/profilometer_solve.hpp"

namespace asbuilt {

/// p_flange = A (u', v', 1) / (g u' + h v' + 1) with the plate's pose, from all holes of all groups: linear for g = h = 0, then a damped
/// Gauss-Newton in all 20 numbers. The plane map that it is, in its own gauge. None where there are fewer than 12 holes.
std::optional<ProfilometerState> linear_start(const HolePlate& plate, const std::vector<PoseGroup>& groups, int degree_count);

/// How many times as large as its file the plate looks, along its x and y, measured by the robot's way: from the same linear model, where
/// the plate's axes are free.
Vec2 linear_plate_scale(const HolePlate& plate, const std::vector<PoseGroup>& groups);

/// The camera model nearest to a plane map: focal length, pixels and centre from the sheet, plane of light by decomposing the projectivity.
ProfilometerState camera_from_plane_map(const ProfilometerState& plane_map, const ProfilometerSheet& sheet);

/// Where the plate is, given the sensor: rigid fit of the holes (Umeyama, no scale).
TargetPose plate_pose(const HolePlate& plate, const std::vector<PoseGroup>& groups, const ProfilometerState& state);

}  // namespace asbuilt
