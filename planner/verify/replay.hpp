// SPDX-License-Identifier: GPL-3.0-or-later
// Runs a neutral program the way controllers do: joint moves straight in the joints, linear moves straight for the TCP with the
// orientation turned by every rule in use, arcs through the auxiliary point. Frame base, mm, rad, s.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "planner/artefacts/program.hpp"
#include "planner/verify/arm.hpp"

namespace asbuilt::verifying {

struct Sample {
  int instruction = -1;
  JointVector q_rad{};
  Pose<frame::Base, frame::Tool> T_base_tool;
  double speed_mm_s = 0;   // of the TCP; linear moves
  double rpm = 0;          // of the spindle while it moves here
  bool is_joint = false;   // reached by a joint move
  double dt_s = 0;         // since the sample before
};

struct ReplaySettings {
  double cutting_speed_max_mm_s = 60;  // linear moves up to this speed with the spindle on are sampled finely
  double cutting_step_mm = 0.25, free_step_mm = 2.0, joint_step_rad = 0.026;
};

struct Extreme {
  double value = 0;
  int instruction = -1;
};

struct Replay {
  std::vector<Sample> samples;
  double duration_s = 0;
  std::size_t moves_count = 0;
  // what was met on the way
  std::vector<int> unreached;                  // instructions whose target or way the arm cannot reach
  std::vector<int> before_setup;               // moves before the tool, linear ones before the frame
  int first_motion = -1, last_motion = -1;
  bool is_first_joint = false;
  double rpm_at_end = 0;
  Extreme orientation_step_rad;                // greatest turn within one linear block
  Extreme orientation_rules_rad;               // greatest difference between the rules
  Extreme blend_off_mm;                        // how far a rounded corner leaves the path while the spindle runs
  Extreme speed_ratio;                         // joint speed over its limit
  Extreme acceleration_ratio;                  // joint acceleration over its limit: along curves, and through rounded corners with their feed steps
  Extreme spline_rules_mm;                     // greatest difference between the curves in use through the points of a spline
  std::vector<int> off_path;                   // outputs at a place that is not on the motion they belong to
  std::vector<int> arc_in_transfer;            // joint moves with the welding arc on, or a switch that is not paired
  std::array<bool, 5> is_on{};                 // equipment at the end
  Extreme jump_rad;                            // greatest joint step between two samples of a linear move
  Extreme limit_margin_rad{1e9, -1};           // least distance to a joint limit
  Extreme singularity_ratio{1e9, -1};          // least, over linear moves
  Extreme linear_speed_max_mm_s, linear_speed_min_mm_s{1e9, -1};
};

Replay replay(const CellSpec& cell, const Arm& arm, const Program& program, const ReplaySettings& settings);

/// "instruction 17: linear move to [..]"
std::string place_of(const Program& program, int instruction);

}  // namespace asbuilt::verifying
