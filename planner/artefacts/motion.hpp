// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 7b's artefact: the whole job in joint space, in order, from home to home.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

using JointVector = std::array<double, 6>;  // rad

enum class SegmentKind { transfer, approach, cut, retract };
inline std::string_view name_of(SegmentKind k) {
  switch (k) {
    case SegmentKind::transfer: return "transfer";
    case SegmentKind::approach: return "approach";
    case SegmentKind::cut: return "cut";
    default: return "retract";
  }
}

/// transfer: straight in joint space between the points; the others: straight for the TCP between the points.
/// The first point of a segment is the last of the one before (the first segment starts at home).
struct MotionSegment {
  SegmentKind kind = SegmentKind::transfer;
  int pass = -1;                                           // index into ToolPath::passes; -1 for transfers
  std::vector<JointVector> q_rad;
  std::vector<Pose<frame::Base, frame::Tool>> T_base_tool; // parallel to q_rad (fk of it to 1e-6 mm)
  std::vector<double> speed_mm_s;                          // on the way TO the point; linear segments
  double speed_ratio = 0;                                  // of the joints' limits; transfers
  double clearance_mm = 1e9;                               // certified lower bound over the segment
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("kind", s.kind), a("pass", s.pass), a("q", s.q_rad), a("T_base_tool", s.T_base_tool), a("speed", s.speed_mm_s);
    a("speed_ratio", s.speed_ratio), a("clearance", s.clearance_mm);
  }
};

struct Motion {
  std::vector<MotionSegment> segments;
  double clearance_min_mm = 1e9;      // everything that must not touch, over all segments
  double joint_margin_min_rad = 1e9;
  double singularity_min_ratio = 1e9; // smallest singular value of the length-scaled Jacobian while cutting
  double duration_s = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("segments", s.segments), a("clearance_min", s.clearance_min_mm), a("joint_margin_min", s.joint_margin_min_rad);
    a("singularity_min", s.singularity_min_ratio), a("duration", s.duration_s);
  }
};

}  // namespace asbuilt
