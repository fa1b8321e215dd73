// SPDX-License-Identifier: GPL-3.0-or-later
// The swept cutter against the part: does it touch anything but the chamfer it is to make? Frame: part.
#pragma once

#include <vector>

#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/geom/mesh_query.hpp"

namespace asbuilt {

/// One position of the cutter. `shift` is adapted minus nominal where it works: the drawing's mesh is moved along with it.
struct CutterPose {
  Vec3 tip = Vec3::Zero(), up = Vec3::UnitZ(), shift = Vec3::Zero();
};

struct Intrusion {
  double depth_mm = 0;   // how much deeper than allowed; <= 0: none
  Vec3 p_part = Vec3::Zero();
};

class ToolFit {
 public:
  /// `worked` are the edges' stations where a chamfer is wanted; within 1.6 (width + tolerance) of them the chamfer's own depth is allowed.
  ToolFit(const MeshQuery& part, const Cutter& cutter, std::vector<Vec3> worked_nominal, double width_mm, double tolerance_mm,
          double elsewhere_mm);
  /// The worst point of the cutter's surface at this pose.
  Intrusion check(const CutterPose& pose) const;

 private:
  const MeshQuery& part_;
  Cutter cutter_;
  std::vector<Vec3> worked_;  // sorted by x
  double near_mm_, near_allowed_mm_, elsewhere_mm_;
  std::vector<double> rings_mm_;
  bool is_near_worked(const Vec3& p) const;
};

}  // namespace asbuilt
