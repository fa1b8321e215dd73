// SPDX-License-Identifier: GPL-3.0-or-later
// How well one view by itself measures the target's pose. Internal to the room.
#pragma once

#include "planner/calibrate/network.hpp"

namespace asbuilt {

/// In the target's frame, translation first. What the view does not tell stays as good as unknown (10 mm, 10 rad).
Mat6 measured_covariance(const Network& network, const NetworkView& view, const NetworkState& state, const Pose<frame::Sensor, frame::Target>& T_sensor_target,
                         double sensor_sd, double sensor_sd_rad);

}  // namespace asbuilt
