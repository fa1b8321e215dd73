// SPDX-License-Identifier: GPL-3.0-or-later
// What the distance and the certificate halves of the collision scene share. Internal to the room.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "planner/geom/mesh_query.hpp"
#include "planner/robot/collision.hpp"
#include "planner/robot/kinematic_chain.hpp"

namespace asbuilt {

struct BodySurface;  // FCL's model and the containment query

struct BodyShape {  // everything in the frame of the mount
  struct Ball {
    Vec3 center;
    double radius_mm;
  };
  std::string name;
  int mount = kMountBase;
  Box3 box;
  std::array<Vec3, 8> corners{};
  std::vector<Ball> balls;
  std::vector<Vec3> piece_points;
  std::shared_ptr<const BodySurface> surface;  // none: no triangles
};

struct CollisionScene::Impl {
  Robot robot;
  std::vector<BodyShape> bodies;
};

/// Poses of the mounts in base: 0 base, 1..6 links, 7 flange.
std::array<Rigid, 8> mount_poses(const Robot& robot, const JointVector& q_rad);
double lower_bound(const BodyShape& a, const BodyShape& b, const Rigid& T_a_b);
Separation exact_separation(const BodyShape& a, const BodyShape& b, const Rigid& T_base_a, const Rigid& T_base_b);

}  // namespace asbuilt
