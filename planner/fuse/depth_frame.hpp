// SPDX-License-Identifier: GPL-3.0-or-later
// One depth image as points: rays of the camera, normals from the image's own neighbourhood, weights, and no pixel beside a step.
// Frame: sensor. mm.
#pragma once

#include <cstdint>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/fuse/streams.hpp"

namespace asbuilt::fuse_detail {

/// The camera's rays: (x / z, y / z) of every pixel, lens undone once.
class CameraRays {
 public:
  explicit CameraRays(const DepthCamera& camera);
  const DepthCamera& camera() const { return camera_; }
  const Eigen::Vector2f& ray(std::size_t pixel) const { return ray_[pixel]; }
  /// Pixel that sees the point of the sensor's frame; -1 outside the image.
  std::ptrdiff_t pixel_of(const Eigen::Vector3f& p_sensor) const;

 private:
  DepthCamera camera_;
  bool has_lens_ = false;
  std::vector<Eigen::Vector2f> ray_;
};

struct FrameRecipe {
  int edge_mask_px = 3;                  // pixels beside a step that say nothing: half the matching window of a stereo camera
  int normal_window_px = 4;              // half width of the window a normal is taken from
  double incidence_max_rad = 1.134;      // 65 degrees
  double jump_sigma_ratio = 6.0;         // a step: more than so many sd of the depth, and more than so many pixels
};

struct FramePixel {                      // weight 0: not to be used
  float z_mm = 0, weight = 0;
  Eigen::Vector3f n_sensor = Eigen::Vector3f::Zero();  // unit, towards the sensor
};
struct DepthFrame {
  int width_px = 0, height_px = 0, stride_px = 1;
  std::vector<FramePixel> pixels;
  std::size_t used_count = 0, masked_count = 0;
};
/// 1 sd of a reading at this depth: grows with the square of it (triangulation).
double depth_sigma_mm(const SensorSpec& sensor, double z_mm);
/// `stride`: every n-th pixel in x and y gets a normal and a weight, the others none. Weight: cos(incidence) (sigma at the working
/// distance / sigma here)^2; zero beside steps and beyond the greatest incidence.
DepthFrame frame_of(const DepthPixels& image, const CameraRays& rays, const SensorSpec& sensor, const FrameRecipe& recipe, int stride);

}  // namespace asbuilt::fuse_detail
