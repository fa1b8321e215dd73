// SPDX-License-Identifier: GPL-3.0-or-later
// Point clouds from files: PLY (ascii, binary of both byte orders, any layout), PCD (ascii, binary, binary_compressed), XYZ
// text. The format is told by the first bytes, not by the file's name. Coordinates come out as written, without any unit.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt {

struct CloudFile {
  std::string format;                   // "ply ascii", "pcd binary_compressed", ...
  std::vector<Eigen::Vector3f> points;  // finite points in file order
  std::size_t dropped_count = 0;        // points with a NaN or infinite coordinate
};

/// Frames    as in the file.
/// Units     as in the file.
/// Refuses   input.cloud_format, input.cloud_header, input.cloud_no_xyz, input.cloud_truncated, input.cloud_value; each with
///           `name:line` or `name: byte N`, what was found and what is allowed. Never crashes, whatever the bytes are.
/// Cost      O(bytes); binary PLY with float coordinates is copied without a detour.
Result<CloudFile> read_cloud(std::string_view bytes, const std::string& name);

}  // namespace asbuilt
