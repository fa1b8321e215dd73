// SPDX-License-Identifier: GPL-3.0-or-later
// Distances between the bodies of a cell at a posture, and certificates that a whole motion keeps them apart.
// Distances are FCL's discrete ones between surface meshes; FCL reports a body inside another as far apart and penetration as 0,
// so containment is tested beside it, and its continuous mode is not used at all.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "planner/robot/robot.hpp"

namespace asbuilt {

/// Where a body hangs: 0 fixed in base, 1..6 on that link (drawn in base with every joint at 0), 7 on the flange (drawn in it).
constexpr int kMountBase = 0, kMountFlange = 7;

struct Separation {
  double distance_mm = 1e9;       // 0 when touching, overlapping or inside
  bool is_exact = false;          // else a lower bound
  Vec3 p_base = Vec3::Zero();     // where the two are nearest (exact ones that are apart)
};

/// Two bodies that have to stay `margin_mm` apart.
struct Watch {
  int a = -1, b = -1;
  double margin_mm = 0;
};

struct JointPath {
  std::vector<JointVector> q_rad;
  /// Between points: false, straight in joint space; true, one point of the flange (the tool's tip) straight in space and the
  /// flange turning about one line, joints following.
  bool is_linear = false;
  Vec3 straight_point_flange = Vec3::Zero();
};

struct Certificate {
  bool is_free = true;
  double clearance_mm = 1e9;      // certified lower bound over the motion and all watches; where not free, the distance found
  int watch = -1;                 // the nearest, or the one that failed
  std::size_t block = 0;          // the failed one's place: between points block and block + 1
  double at_ratio = 0;            // and how far along it
  JointVector q_rad{};            // the posture there
  Vec3 p_base = Vec3::Zero();     // the place in base
};

class CollisionScene {
 public:
  explicit CollisionScene(const Robot& robot);
  const Robot& robot() const;
  /// A body without triangles is kept and never near anything.
  int add(const std::string& name, int mount, Mesh mesh);
  const std::string& name(int body) const;
  int mount(int body) const;
  int size() const;

  /// A lower bound of the distance when it is at least `enough_mm`, the exact distance otherwise.
  Separation separation(int a, int b, const JointVector& q_rad, double enough_mm = 1e9) const;

  /// Proves that every watched pair stays apart over the whole motion, or finds where it does not.
  /// Method: the points of a body on link k move at most mu = sum over the joints up to k of |dq_j| R_j, R_j the greatest
  /// distance of the body from axis j over the block; a block with distances d1, d2 at its ends is free with margin m when
  /// d1 + d2 - mu >= 2 m (Schwarzer, Saha, Latombe 2005), else it is halved. For linear blocks a body on the flange moves at
  /// most the straight point's travel plus turn times its radius about it, and joints are bounded by their chord and their bow at the middle.
  Certificate certify(const std::vector<Watch>& watches, const JointPath& path) const;

  struct Impl;

 private:
  std::shared_ptr<Impl> impl_;
};

}  // namespace asbuilt
