// SPDX-License-Identifier: GPL-3.0-or-later
// One pass in joint space: the turn about the tool axis and the arm's branch, approach, cut and retract, feeds, certificates.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "planner/artefacts/motion.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/plan/motion/cell_scene.hpp"
#include "planner/plan/motion/motion.hpp"
#include "planner/robot/error_model.hpp"

namespace asbuilt {

struct PassStation {  // a point of the path in base, before the turn about the axis is chosen
  Vec3 tip = Vec3::Zero(), axis = -Vec3::UnitZ();
  double feed_mm_s = 0, s_mm = 0;
  bool is_emitted = true;   // else only looked at on the way: blocks may be long
};

/// Everything a pass is planned with.
struct PassTask {
  std::string where;                        // "feature lug2, pass 1 of 2, edge #88"
  std::vector<PassStation> stations;        // at most 5 mm and 4.5 degrees of axis between two
  Vec3 retract_base = Vec3::UnitZ();
  double approach_mm = 0, approach_speed_mm_s = 0, feed_min_mm_s = 0;
  Vec3 x_hint = Vec3::UnitX();              // tool x at turn 0: that of the reference posture, or of home
  std::optional<JointVector> q_reference;   // the posture the points were corrected for
  double flute_approach_mm = 1;             // how far the cutter keeps from the part
  double flute_near_mm = 5;                 // until it is this near to the lead-in
};

/// Options common to all passes.
struct PassTools {
  const Robot* robot = nullptr;
  const Robot* free_robot = nullptr;        // the same arm without joint limits, to tell why there is no solution
  const CellScene* cell = nullptr;
  const RobotErrorModel* errors = nullptr;  // null: no reference posture known
  Pose<frame::Flange, frame::Tool> T_flange_tool;
  double joint_margin_rad = 0;
};

struct PassMotion {
  std::vector<PassStation> stations;                // the task's, or finer ones where the turn changes
  std::vector<JointVector> approach, cut, retract;  // ends shared
  std::vector<double> feed_mm_s;                    // of the cut, on the way TO each station
  double approach_speed_mm_s = 0;
  double approach_clearance_mm = 0, cut_clearance_mm = 0, retract_clearance_mm = 0;
  double joint_margin_rad = 0, singularity_ratio = 0;
  double departure_mm = 0;                          // 1 sd of the arm's error relative to the reference posture
};

/// Tries the way from where the arm is to the pass. First without a search; thorough only where no candidate can do without.
using AcceptPass = std::function<std::optional<Refusal>(const PassMotion& motion, bool is_thorough)>;

/// The best motion of the pass that `accept` takes; the trouble nearest to success otherwise.
///
/// Frames    base. Units mm, rad.
/// Method    turns 0, +-5, .. 180 degrees about the tool axis and every branch of the inverse, followed on a thinned path, costed
///           in mm: error of the arm against the reference posture, nearness to limits and singularity, way from where the arm
///           is. The cheapest are then followed point by point and certified, one after another; the first that holds wins.
///           Where no constant turn holds, a ladder over the path lets the turn change (ladder.hpp).
/// Refuses   motion.unreachable, motion.joint_limit, motion.singular, motion.collision, motion.no_approach, motion.joint_speed,
///           and what `accept` refuses.
Result<PassMotion> plan_pass(const PassTask& task, const PassTools& tools, const JointVector& q_before, const AcceptPass& accept);

}  // namespace asbuilt
