// SPDX-License-Identifier: GPL-3.0-or-later
// Where a part may be when nothing is known of it: every rotation, and for each the shifts that many readings agree on.
#pragma once

#include <vector>

#include "planner/locate/cad_model.hpp"

namespace asbuilt {

/// Rotations spread evenly over all of them (Alexa, Super-Fibonacci Spirals, CVPR 2022).
std::vector<Eigen::Quaterniond> even_rotations(int count);

/// What the drawing says to a reading's normal: its surface by direction, in cells of equal size.
class Ballot {
 public:
  Ballot() = default;
  explicit Ballot(const CadModel& cad);
  bool is_empty() const { return points_.empty(); }
  double cell_mm() const { return cell_mm_; }
  const std::vector<CadSample>& points() const { return points_; }

  /// Points p with unit normals n in the scan's frame; R takes the part's directions to the scan's. Up to `most` shifts t with
  /// p = R m + t for many points m of the part whose normal fits, best first.
  std::vector<Vec3> shifts(const std::vector<Vec3>& p, const std::vector<Vec3>& n, const Mat3& R, std::size_t most) const;

 private:
  std::vector<CadSample> points_;
  std::vector<std::vector<std::uint32_t>> by_direction_;  // soft: within 24 deg of the direction's middle
  double cell_mm_ = 8;
};

/// A motion that takes the part nearly onto itself.
struct SelfMotion {
  Pose<frame::Part, frame::Part> motion;
  double overlap = 0;  // of the surface that comes to lie on the surface, 0..1
  bool is_exact = false;
};

/// The part's pseudo-symmetries, best first, the identity left out. Method: the drawing searched in itself (votes, then descent).
std::vector<SelfMotion> self_motions(const CadModel& cad, const Ballot& ballot);

/// What a search over all rotations needs of the drawing; made once per drawing.
struct CadFreeSearch {
  Ballot ballot;
  std::vector<SelfMotion> motions;
};
void prepare_free_search(CadModel& cad);

}  // namespace asbuilt
