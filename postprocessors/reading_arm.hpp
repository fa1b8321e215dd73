// SPDX-License-Identifier: GPL-3.0-or-later
// Joints for Cartesian joint targets, for the readers: PTP to a frame, MOVJ to a Cartesian position, MOVL to pulses. By the verifier's arm,
// which shares nothing with the planner's. Never included by a writer.
#pragma once

#include <functional>

#include "planner/verify/arm.hpp"
#include "postprocessors/reading.hpp"

namespace asbuilt::reading {

/// What the reader knows of the arm between the motions: where it stands, for targets that keep the present posture.
class ArmReader {
 public:
  explicit ArmReader(const PostContext& context) : context_(context) {}

  /// Pose of the tool in base at joint values (degrees).
  Pose<frame::Base, frame::Tool> tool_at(const std::array<double, 6>& q_deg, const ToolSpec& tool) const;

  /// All joint values within the limits that bring the tool there, whole turns included, in one order; degrees.
  std::vector<std::array<double, 6>> all(const Pose<frame::Base, frame::Tool>& T_base_tool, const ToolSpec& tool) const;

  /// The only one that `is_wanted` takes. Refuses read.posture where none is, read.ambiguous where several are.
  std::array<double, 6> one(const Line& line, const Pose<frame::Base, frame::Tool>& T_base_tool, const ToolSpec& tool,
                            const std::function<bool(const std::array<double, 6>&)>& is_wanted) const;

 private:
  const PostContext& context_;
  mutable std::optional<verifying::Arm> arm_;
  const verifying::Arm& arm() const {
    if (!arm_) arm_.emplace(context_.cell.robot);
    return *arm_;
  }
};

}  // namespace asbuilt::reading
