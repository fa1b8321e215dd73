// SPDX-License-Identifier: GPL-3.0-or-later
// The arm as it really is: axes shifted and tilted, joint zeros off, gear waves, sag, and scatter from motion to motion.
// Written for the virtual cell alone; it shares no kinematics with planner/robot.
#pragma once

#include <array>
#include <optional>

#include "planner/artefacts/job.hpp"
#include "planner/base/random.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt::simulate_detail {

using Joints = std::array<double, 6>;  // rad

class TrueRobot {
 public:
  /// Errors drawn from the seed and scaled so that the mean absolute error of the tool point is `absolute_mm` after the best
  /// rigid fit of the base frame; scatter: `slow_mm` once for the day, `quick_mm` for every motion (lengths, rms).
  TrueRobot(const RobotSpec& spec, const Pose<frame::Flange, frame::Tool>& T_flange_tool, std::uint64_t seed, double absolute_mm,
            double slow_mm, double quick_mm);

  Pose<frame::Base, frame::Flange> nominal(const Joints& q_rad) const;
  Pose<frame::Base, frame::Flange> actual(const Joints& q_rad) const;                  // without the quick scatter
  Pose<frame::Base, frame::Flange> actual(const Joints& q_rad, Random& scatter) const;  // one motion

 private:
  struct Axis {
    Vec3 w, p, dw, dp;
    double zero_rad, wave1_rad, wave2_rad, phase1_rad, phase2_rad;
  };
  OpwParameters opw_;           // signs and offsets of the joints; those of a chain are 1 and 0
  bool is_chain_ = false;       // axes out of a URDF
  std::array<Axis, 6> axes_;
  Pose<frame::Base, frame::Flange> at_zero_;
  std::array<double, 2> sag_rad_{};
  std::array<double, 6> slow_rad_{}, quick_rad_{};
  Pose<frame::Base, frame::Base> base_;
  double scale_ = 1;

  Pose<frame::Base, frame::Flange> chain(const Joints& q_rad, bool real, const Joints* extra) const;
};

/// The posture a programmer would teach: near home, above all in the arm's first three joints.
std::optional<Joints> posture(const Robot& robot, const Pose<frame::Base, frame::Flange>& T_base_flange);

/// The arm of a scenario: everything about it follows from the seed.
TrueRobot arm_of(const RobotSpec& spec, const Pose<frame::Flange, frame::Tool>& T_flange_tool, std::uint64_t seed);

}  // namespace asbuilt::simulate_detail
