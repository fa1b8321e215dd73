// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a virtual batch as a user would have written them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"

namespace asbuilt::simulate_detail {

void write_text(const std::filesystem::path& file, const std::string& text);
void write_stl(const std::filesystem::path& file, const Mesh& mesh);
void write_cloud(const std::filesystem::path& file, const std::vector<Eigen::Vector3f>& points);
std::string pose_text(const Eigen::Quaterniond& q, const Vec3& p_mm);
template <class A, class B>
std::string pose_text(const Pose<A, B>& T) {
  return pose_text(T.q, T.p_mm);
}
/// The same pose as {xyz, zyx} in degrees (KUKA order).
std::string pose_text_zyx(const Eigen::Quaterniond& q, const Vec3& p_mm);
std::string joints_text(const std::array<double, 6>& q_rad);

Mesh box_mesh(const Vec3& min_mm, const Vec3& max_mm);
Mesh cylinder_mesh(double radius_mm, double z0_mm, double z1_mm, int sides);
void append(Mesh& to, const Mesh& more);

/// The virtual cell: a 2.2 m class six-axis arm, a 90 degree cone, a wide and a detail sensor, a table.
CellSpec virtual_cell();
std::string cell_text(const CellSpec& cell);
/// link meshes, tool, sensors, table as STL under `folder`/meshes, named as cell_text names them.
void write_cell_meshes(const std::filesystem::path& folder, const CellSpec& cell);

}  // namespace asbuilt::simulate_detail
