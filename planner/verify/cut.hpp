// SPDX-License-Identifier: GPL-3.0-or-later
// What the cutter leaves on the adapted edges: the gap between the cutter's body at every pose of the replay and the cross-section of
// the edge. Own model of the cutter, by distance and not by construction. Frame base, mm.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/verify/replay.hpp"

namespace asbuilt::verifying {

/// A pose of the cutter while it cuts.
struct CutPose {
  Vec3 tip = Vec3::Zero(), axis = -Vec3::UnitZ();  // tool z
  double speed_mm_s = 0;
  int instruction = -1;
};

struct EdgeCut {  // arrays parallel to s_mm
  std::vector<double> s_mm, leg_1_mm, leg_2_mm, depth_mm, beyond_mm;  // beyond: depth past (width + tolerance) cos(beta / 2)
  std::vector<double> speed_mm_s;   // where it cuts deepest; 0: not touched
  std::vector<double> rate_mm3_s;   // largest over the visits
};

/// The cutter's outline with its angles worked out.
class CutterForm {
 public:
  explicit CutterForm(const Cutter& cutter);
  /// Signed size of the gap between a point at height u above the tip and distance rho from the axis, and the cutter; negative inside.
  double gap(double u_mm, double rho_mm) const;
  double flank_mm() const { return flank_; }
  double top_mm() const { return top_; }

 private:
  CutterShape shape_;
  double radius_, tip_, shank_, tangent_, cosine_, flank_, top_;
};

EdgeCut cut_edge(const AdaptedEdge& edge, const EdgeBurr* burr, const Pose<frame::Base, frame::Part>& T_base_part, const Cutter& cutter,
                 const std::vector<CutPose>& poses, double width_mm, double tolerance_mm);

struct Stray {
  double depth_mm = 0;
  Vec3 p_base = Vec3::Zero();
  int instruction = -1;
};
/// How deep the cutter goes into the drawing's part (moved along with the nearest worked edge) away from every worked edge.
Stray stray_cut(const Features& features, const MeshQuery& part, const Pose<frame::Base, frame::Part>& T_base_part, const Cutter& cutter,
                const std::vector<CutPose>& poses, double width_mm, double tolerance_mm);

}  // namespace asbuilt::verifying
