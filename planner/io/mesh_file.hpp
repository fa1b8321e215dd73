// SPDX-License-Identifier: GPL-3.0-or-later
// Triangle meshes from and to files. STL, PLY and 3MF are read here, which keeps every digit and names the place where
// a file is broken; OBJ, DAE and the rest go through assimp. Vertices at the same place become one.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/result.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt {

struct MeshFile {
  Mesh mesh;                         // coordinates times mm_per_unit
  std::size_t degenerate_count = 0;  // triangles dropped: two corners at the same place
  std::size_t dropped_count = 0;     // triangles dropped: a NaN or infinite corner
};

/// mm per unit where the format itself says so (3MF, DAE, STEP); nothing for STL, PLY, OBJ and the like.
std::optional<double> mesh_unit_mm(std::string_view bytes, const std::string& name);

/// Frames    as drawn; up-axis conversions of the format are not applied.
/// Units     mm: every coordinate times mm_per_unit.
/// Refuses   input.mesh_format, input.mesh_truncated, input.mesh_broken, input.mesh_empty.
Result<MeshFile> read_mesh(std::string_view bytes, const std::string& name, double mm_per_unit);

/// Binary little-endian PLY of a mesh, float64 coordinates, mm.
std::string write_mesh_ply(const Mesh& mesh);
/// Binary STL of a mesh, mm.
std::string write_mesh_stl(const Mesh& mesh);
/// Binary little-endian PLY of points, float32; normals and sigma are written where they are as many as the points.
std::string write_cloud_ply(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals = {},
                            const std::vector<float>& sigma = {});

}  // namespace asbuilt
