// SPDX-License-Identifier: GPL-3.0-or-later
// Candidates for a pass: which turn about the tool axis with which branch of the arm, what each would cost, and following one
// along the path.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "planner/plan/motion/pass_motion.hpp"

namespace asbuilt {

constexpr double kJumpLimit_rad = 0.35;         // between neighbouring points: more is another branch or turn
constexpr double kSingularityLimit_ratio = 0.02;

/// Why a path could not be followed, how near to success that was, and what was met on the way.
struct PathFault {
  int rank = -1;  // 0 unreachable, 1 joint limit, 2 branch lost, 3 singular
  std::size_t station = 0;
  Refusal refusal;
  double joint_margin_rad = 1e9, singularity_ratio = 1e9;
};

struct PassCandidate {
  double turn_rad = 0, cost_mm = 0;
  JointVector q_first{};
};

double largest_joint_step(const JointVector& a, const JointVector& b);
std::string text_mm(double v);              // two decimals
std::string text_point(const Vec3& p_mm);   // "(1, 2, 3)"
std::string place(const PassTask& task, std::size_t station);

/// Tool pose at a station with a turn about its axis; turn 0 has tool x as near as it can be to the task's hint.
Pose<frame::Base, frame::Tool> tool_pose(const PassTask& task, std::size_t station, double turn_rad);

/// Joints along the path (every `stride`-th station and the last), starting at q_first; turns parallel to the stations.
std::optional<std::vector<JointVector>> follow_path(const PassTask& task, const PassTools& tools, const std::vector<double>& turns,
                                                    const JointVector& q_first, std::size_t stride, PathFault& fault);

/// 1 sd of the tool's error at the station relative to the same place in the reference posture, mm; 0 without a reference.
double departure_mm(const PassTask& task, const PassTools& tools, std::size_t station, const JointVector& q);

/// What limits and singularities cost at a posture, mm: nothing from 10 degrees and 0.06 on.
double posture_cost_mm(const Robot& robot, const JointVector& q);

/// Every branch at the turn that can follow the whole thinned path.
void add_candidates(const PassTask& task, const PassTools& tools, double turn_rad, const JointVector& q_before,
                    std::vector<PassCandidate>& candidates, PathFault& fault);

/// What came of following and certifying one choice of turns.
struct Attempt {
  std::optional<PassMotion> motion;
  std::size_t station = 0;       // where it failed
  bool is_turn_blocked = false;  // what hangs on the flange meets what stands: no branch of the arm helps at this turn
};
using TryPass = std::function<Attempt(const PassTask& task, const std::vector<double>& turns, const JointVector& q_first)>;

/// Turns that change along the path, by a ladder over thinned stations with turns every 10 degrees; what `try_one` turns down
/// is forbidden for the next of at most 20 rounds. The turn changes by at most 3 degrees per mm.
std::optional<PassMotion> search_changing_turn(const PassTask& task, const PassTools& tools, const JointVector& q_before, const TryPass& try_one);

}  // namespace asbuilt
