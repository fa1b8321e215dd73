// SPDX-License-Identifier: GPL-3.0-or-later
// The peers: PCL's registration with the same clouds. Points in mm; normals unit, zero where none.
#pragma once

#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt::peers {

struct Cloud {
  std::vector<Vec3> p, n;
};
/// Means over cubic cells, normals averaged.
Cloud thinned(const Cloud& cloud, double cell_mm);

using Motion = Pose<frame::Part, frame::Base>;  // takes the scan to the part

/// FPFH and SAC prerejective: three points, as published: voxel, 4 x voxel as inlier distance, iterations.
Motion fpfh_ransac(const Cloud& scan, const Cloud& part, double voxel_mm, int iterations);
struct Fine {
  Motion motion;
  double seconds = 0;  // process time, one thread
};
Fine icp_point_to_plane(const Cloud& scan, const Cloud& part, const Motion& start, double gate_mm);
Fine gicp(const Cloud& scan, const Cloud& part, const Motion& start, double gate_mm);

}  // namespace asbuilt::peers
