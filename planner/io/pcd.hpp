// SPDX-License-Identifier: GPL-3.0-or-later
// The Point Cloud Data format, version 0.6 and 0.7: ascii, binary, binary_compressed (LZF, fields one after the other).
#pragma once

#include <string>
#include <string_view>

#include "planner/io/cloud_file.hpp"

namespace asbuilt {

bool is_pcd(std::string_view bytes);
/// Refuses like read_cloud.
Result<CloudFile> read_pcd_points(std::string_view bytes, const std::string& name);

}  // namespace asbuilt
