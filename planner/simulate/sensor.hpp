// SPDX-License-Identifier: GPL-3.0-or-later
// A structured-light sensor: a camera, a projector beside it, rays into the scene, noise that is correlated from pixel to
// pixel, lost points at grazing incidence and in the projector's shadow, mixed pixels at edges, outliers.
#pragma once

#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"

namespace asbuilt::simulate_detail {

struct SensorModel {
  double pitch_mm = 0.4;           // pixel on the part at the working distance
  double noise_mm = 0.006;         // along the ray, 1 sd
  double correlation_px = 1.0;     // Gaussian filter of the noise
  double bias_mm = 0.003;          // low-order form error over the field
  double baseline_mm = 100;        // projector beside the camera, along sensor x
  double outlier_ratio = 0.004;
  double lateral_mm = 0;           // working distance and field come from the sheet
};

/// Points in the sensor's frame. The scene is in base.
std::vector<Eigen::Vector3f> scan(const MeshQuery& scene_base, const SensorSpec& sheet, const SensorModel& model,
                                  const Pose<frame::Base, frame::Sensor>& T_base_sensor, Random& random);

}  // namespace asbuilt::simulate_detail
