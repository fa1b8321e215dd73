// SPDX-License-Identifier: GPL-3.0-or-later
// A robot described by a URDF: the chain of six turning joints from `base` to `tip`, and the shapes of its links.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

/// One shape of a link: a mesh file, or triangles of a box, cylinder or sphere.
struct UrdfShape {
  std::string link, file;                       // file as written; empty for triangles
  int joint = 0;                                // 0: does not move; k: moves with joint k of the chain
  int line = 0;                                 // of the URDF
  Vec3 scale = Vec3::Ones();                    // of a mesh file, per axis
  Pose<frame::Base, frame::Base> T_base_shape;  // every joint at 0
  Mesh mesh_shape;                              // mm, in the shape's own frame
};
struct UrdfRobot {
  ChainKinematics kinematics;
  std::vector<std::array<double, 2>> limits_rad;  // of the six joints; lower == upper where the file gives none
  std::vector<double> speed_rad_s;                // 0 where the file gives none
  std::vector<UrdfShape> shapes;                  // collision shapes of a link; its visual ones where it has no other
};

/// Frames    base: the frame of link `base`; shapes are placed in it with every joint at 0.
/// Units     metres and radians in the file; mm and rad out.
/// Refuses   input.urdf_syntax, input.urdf_link (unknown base or tip, no chain), input.urdf_joints (not six turning joints),
/// input.urdf_value.
Result<Done<UrdfRobot>> read_urdf(std::string_view bytes, const std::string& name, const std::string& base, const std::string& tip);

}  // namespace asbuilt
