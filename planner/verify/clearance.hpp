// SPDX-License-Identifier: GPL-3.0-or-later
// Distances of everything that moves from everything that stands, with a bound between the samples: two samples d apart in the joints
// move no point further than the sum of |dq| times its distance from the axis, so (d1 + d2 - bound) / 2 is certain in between
// (Schwarzer, Saha, Latombe 2005; algorithms B9.6). Own trees of triangles with exact triangle distances; CGAL's AABB tree tells inside from outside.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "planner/geom/mesh_query.hpp"
#include "planner/verify/replay.hpp"

namespace asbuilt::verifying {

/// The triangles that were nearest the time before: a good first guess.
struct WitnessPair {
  int mine = -1, theirs = -1;
};

/// Triangles in a tree of spheres and boxes, for exact distances between two of them.
class Tree {
 public:
  Tree() = default;
  explicit Tree(Mesh mesh);
  bool is_empty() const { return nodes_.empty(); }
  const Mesh& mesh() const { return mesh_; }
  Vec3 center() const { return nodes_.front().center; }
  double radius() const { return nodes_.front().radius; }
  /// Distance of this surface, moved by T into the other's frame, from the other surface; 0 where they cross.
  /// Where it is more than cap_mm only a lower bound above cap_mm is promised.
  double distance(const Eigen::Isometry3d& T, const Tree& other, double cap_mm, WitnessPair* witness = nullptr) const;

 private:
  struct Node {
    Vec3 center = Vec3::Zero();
    double radius = 0;
    Box3 box;
    int left = -1, right = -1, triangle = -1;
  };
  Mesh mesh_;
  std::vector<Node> nodes_;
  int build(std::vector<int>& order, int begin, int end);
};

/// A solid that stands still: in base, or in the frame of `link` for a part of the arm itself.
struct Standing {
  Standing(std::string name_in, Mesh mesh, int link_in = 0) : name(std::move(name_in)), tree(mesh), query(std::move(mesh)), link(link_in) {}
  std::string name;
  Tree tree;
  MeshQuery query;
  int link = 0;
};

/// A solid that moves with a link (0 base .. 6) or with the flange (7).
class Body {
 public:
  Body(std::string name, int link, Mesh mesh);
  const std::string& name() const { return name_; }
  int link() const { return link_; }
  bool is_empty() const { return tree_.is_empty(); }
  /// Pose of the body in base at a posture.
  Eigen::Isometry3d pose(const ArmState& s) const { return link_ >= 7 ? s.flange : s.link[static_cast<std::size_t>(link_)]; }
  /// Distance of the body at T (body to the standing mesh's frame); 0 where the surfaces cross, negative when one is inside the other.
  double distance(const Eigen::Isometry3d& T, const Standing& standing, double cap_mm = 1e9, WitnessPair* witness = nullptr) const;
  /// How far a point of the body can get on the way from posture a to b, at most, seen from the link it is compared with.
  double motion_bound(const ArmState& a, const JointVector& q_a, const JointVector& q_b, int from_link) const;

 private:
  std::string name_;
  int link_;
  Tree tree_;
  std::shared_ptr<const MeshQuery> query_;
};

struct PairRule {
  const Body* body;
  const Standing* standing;
  double least_mm;      // required
  bool only_rapid;      // checked only where the cutter is not cutting
};

struct ClearanceResult {
  double least_mm = 1e9;       // certain at every sample; at most a tenth below the true least distance
  int instruction = -1;
  std::string pair;
  bool is_certain = true;      // the bound holds between the samples too
  double uncertain_mm = 1e9;   // what could be shown at the worst place where it does not
};

/// Follows the samples; `is_cutting` says per sample whether the spindle cuts there.
/// `states` are the arm at the samples.
ClearanceResult follow_clearance(const Arm& arm, const std::vector<Sample>& samples, const std::vector<ArmState>& states,
                                 const std::vector<char>& is_cutting, const PairRule& rule);
std::vector<ArmState> states_of(const Arm& arm, const std::vector<Sample>& samples);

/// The cutter as a closed mesh in the tool's frame.
Mesh cutter_mesh(const Cutter& cutter, int around_count = 32);

}  // namespace asbuilt::verifying
