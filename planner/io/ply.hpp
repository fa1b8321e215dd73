// SPDX-License-Identifier: GPL-3.0-or-later
// The Polygon File Format: header, points, and a walk over all its elements that finds where a file ends too early.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/result.hpp"
#include "planner/io/cloud_file.hpp"

namespace asbuilt {

enum class PlyType : std::uint8_t { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
enum class PlyFormat : std::uint8_t { ascii, little_endian, big_endian };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::float32;
  bool is_list = false;
  PlyType count_type = PlyType::uint8;
};
struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
};
struct PlyHeader {
  PlyFormat format = PlyFormat::ascii;
  std::vector<PlyElement> elements;
  std::size_t data_begin = 0;  // byte
  int data_line = 1;           // line of the first byte of data, from 1
};

bool is_ply(std::string_view bytes);
/// Refuses input.cloud_header.
Result<PlyHeader> read_ply_header(std::string_view bytes, const std::string& name);
/// The points of element `vertex`; all elements are walked to their end. Refuses like read_cloud.
Result<CloudFile> read_ply_points(std::string_view bytes, const std::string& name);

struct PlyPolygons {
  std::vector<Vec3> vertices;          // all of them, also those that are no numbers
  std::vector<std::uint32_t> sizes;    // corners of each face
  std::vector<std::uint32_t> corners;  // face after face; each names a vertex
};
/// The vertices and faces (`vertex_indices` or `vertex_index` of element `face`). Refuses like read_cloud, and input.cloud_value where
/// a face names a vertex that is not there.
Result<PlyPolygons> read_ply_polygons(std::string_view bytes, const std::string& name);

}  // namespace asbuilt
