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
  double noise_mm = 0.006;         // along the ray, 1 sd, looking straight at the surface
  double slope_power = 1;          // it grows with 1 / cos^power of the angle between ray and normal
  double tail_ratio = 0.08;        // share of pixels with three times the noise
  double correlation_px = 1.0;     // Gaussian filter of the noise
  double bias_mm = 0.003;          // low-order form error over the field, half of it the same in every picture
  double baseline_mm = 100;        // projector beside the camera, along sensor x
  double outlier_ratio = 0.004;
  double specular_ratio = 0.005;   // highlights away from the mirror direction; near it half the pixels are lost or off
  double scale_ppm = 100;          // 1 sd of the scale error of the device
  double quantum_mm = 0.0005;
  // of this very device, from draw_device:
  double form[4] = {0, 0, 0, 0};
  double scale = 0;
};
void draw_device(SensorModel& model, Random& random);

/// A place where an edge is missing: between its ends along t the material above the bevel plane is gone.
struct Chip {
  Vec3 p = Vec3::Zero(), t = Vec3::UnitX(), m = Vec3::UnitZ();  // in base; m: the outward bisector
  double half_length_mm = 0, depth_mm = 0;
};

/// Takes away about this share of the points, in patches of 5 mm.
void lose_points(std::vector<Eigen::Vector3f>& points, double share, Random& random);

/// Points in the sensor's frame. The scene is in base.
std::vector<Eigen::Vector3f> scan(const MeshQuery& scene_base, const SensorSpec& sheet, const SensorModel& model,
                                  const Pose<frame::Base, frame::Sensor>& T_base_sensor, Random& random,
                                  const std::vector<Chip>& chips = {});

}  // namespace asbuilt::simulate_detail
