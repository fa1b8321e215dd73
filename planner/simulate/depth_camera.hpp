// SPDX-License-Identifier: GPL-3.0-or-later
// A low-cost stereo depth camera: disparity noise that is correlated over patches, fattened foregrounds, flying pixels, holes, a form
// error of its field, an error of its scale. One image at a time. Frames: the scene in base, the image in the sensor's. mm.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/io/depth_image.hpp"

namespace asbuilt::simulate_detail {

struct RayHit {
  double distance_mm = 0;
  Vec3 n = Vec3::UnitZ();  // unit, out of the material
};
using RayScene = std::function<std::optional<RayHit>(const Vec3& p_base, const Vec3& d_base)>;

/// Bodies in closed form, for scenes whose truth is exact.
struct Body {
  enum class Kind { floor, sphere, cylinder, box };  // floor: the half space below z = 0 of its frame; cylinder: about z, from 0 up
  Kind kind = Kind::floor;
  Pose<frame::Base, frame::Obstacle> T_base_body;
  Vec3 size_mm = Vec3::Zero();                       // sphere: radius; cylinder: radius, -, height; box: edges, centred in x and y, from 0 up
};
RayScene scene_of(std::vector<Body> bodies);
RayScene scene_of(const MeshQuery& mesh);
/// Distance of a point to a body's surface, negative inside.
double distance_mm(const Body& body, const Vec3& p_base);

struct DepthCameraModel {
  DepthCamera camera;
  double baseline_mm = 18, disparity_sd_px = 0.08;
  double correlation_px = 4.0;           // of the noise
  int fatten_px = 4;                     // foregrounds grow by so many pixels, half the matching window
  double flying_ratio = 0.02;            // of the pixels beside a step: anything between front and back
  double hole_ratio = 0.05;              // of the image, in patches
  double scale_ratio = 1.0;              // of the depth
  double bowl_mm = 0.15;                 // form error at the image's corner
  double ripple_px = 0.02;               // of the disparity, with the period of a pixel
  double incidence_max_rad = 1.22;       // 70 degrees
  double range_min_mm = 50, range_max_mm = 600;
};
/// D405-like: 1280 x 720 cropped to `width` x `height`, focal length 650 px, counts of 0.1 mm.
DepthCameraModel stereo_camera(int width_px, int height_px);

/// The image from T_base_sensor.
DepthImage depth_image(const RayScene& scene, const DepthCameraModel& model, const Pose<frame::Base, frame::Sensor>& T_base_sensor, Random& random);

}  // namespace asbuilt::simulate_detail
