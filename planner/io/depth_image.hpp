// SPDX-License-Identifier: GPL-3.0-or-later
// One depth image: 16-bit grey PNG, row by row, 0 = no reading.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt {

struct DepthImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint16_t> depth_count;  // width x height; one count is the camera's depth unit
};

/// Size as the header states it, without decoding. Refuses input.depth_format, input.depth_size (more than 64 megapixels).
Result<DepthImage> read_depth_header(std::string_view bytes, const std::string& name);
/// Refuses what read_depth_header refuses, and input.depth_broken (cut off, damaged).
Result<DepthImage> read_depth_image(std::string_view bytes, const std::string& name);
/// PNG bytes of an image.
std::string write_depth_png(const DepthImage& image);

}  // namespace asbuilt
