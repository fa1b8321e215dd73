// SPDX-License-Identifier: GPL-3.0-or-later
// Pairs of depth frames -> equations of the sensor's motion between them (projective point-to-plane).
#pragma once

#include "planner/fuse/clock.hpp"
#include "planner/fuse/depth_frame.hpp"

namespace asbuilt::fuse_detail {

/// `start`: T_first_second to begin from. Iterates to the frames' own best motion (damped where they do not tell), then writes the
/// equations around it. points_count 0 where the two do not overlap.
MotionPair motion_pair(const DepthFrame& first, const DepthFrame& second, const CameraRays& rays, double sigma_mm, const Eigen::Isometry3d& start);

}  // namespace asbuilt::fuse_detail
