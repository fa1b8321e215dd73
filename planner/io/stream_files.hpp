// SPDX-License-Identifier: GPL-3.0-or-later
// What lies beside the images or profiles of a moving sensor: the camera's numbers (JSON), the times of the frames, the profiles.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct CameraFile {
  DepthCamera camera;
  std::optional<double> rate_hz;              // frames in a second, where the frames carry no times
  double exposure_s = 0;
  std::optional<std::array<double, 4>> plane; // of a line scanner's light in the sensor's frame: a x + b y + c z = d, unit normal
};
/// `fx, fy, cx, cy` (also `ppx, ppy`), `width, height`, `distortion` (k1, k2, p1, p2, k3), `depth_unit` (mm) or `depth_scale` (m), `fps`,
/// `exposure_ms`, `plane: [a, b, c, d]`.
/// Refuses input.camera_syntax, input.camera_value.
Result<CameraFile> read_camera_file(std::string_view bytes, const std::string& name);

struct FrameTime {
  std::string file;
  double t_s = 0, exposure_s = 0, brightness_ratio = -1;
};
/// `frames.csv` of a folder of images: file, t (or t_ms, ..), exposure_ms, brightness (0..1 or 0..255). `t` is the middle of the exposure.
/// Refuses input.frames_columns, input.frames_clock, input.table_*.
Result<std::vector<FrameTime>> read_frame_times(std::string_view bytes, const std::string& name);

struct ProfileFile {
  struct Line {
    double t_s = 0;
    std::size_t begin = 0, end = 0;
  };
  std::vector<Eigen::Vector3f> points;  // sensor frame, mm: (x, 0, z), or on the plane of light
  std::vector<Line> lines;              // times ascend
  std::size_t dropped_count = 0;        // points without a reading
  double first_s = 0;                   // time of the first profile, readings in it or not
  bool is_pixel = false;                // points are (u, 0, v) in pixels, as delivered
};
/// One point a row: t and x, z (mm), or t and u, v (pixels, with the camera's numbers and its plane). Rows of the same t are one profile.
/// `keeps_pairs`: pixels are left as they are, (u, 0, v), for a calibration that maps them; no camera is needed then.
/// Refuses input.profile_columns, input.profile_clock, input.profile_camera, input.profile_empty, input.table_*.
Result<ProfileFile> read_profiles(std::string_view bytes, const std::string& name, const std::optional<CameraFile>& camera, bool keeps_pairs = false);

}  // namespace asbuilt
