// SPDX-License-Identifier: GPL-3.0-or-later
// Stages 8 and 10: an independent replay of the program, planned and as read back from the emitted text. Own kinematics,
// own distances; shares nothing with planner/robot and planner/plan. It never refuses: it reports.
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/inspection.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/program.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/artefacts/verdict.hpp"

namespace asbuilt {

/// The cell alone: reach, limits, joint speeds, singularity, collision with obstacles and robot, spindle and end-of-program rules.
Verdict verify_program(const CellSpec& cell, const Program& program);

/// The cell and the item: everything above, plus fixture and part, chamfer legs along the adapted edges, gouge, feed against burr.
Verdict verify_item(const Job& job, const Location& location, const Features& features, const Burrs& burrs, const ToolPath& path,
                    const Program& program);

/// An inspection program: the cell as above, fixture and part besides, and every view's stop: in order, where it was planned, standing still.
Verdict verify_inspection(const Job& job, const Location& location, const Inspection& inspection, const Program& program);

/// The last printed digit of everything a dialect prints; 0 where it is not known, then a bound of every dialect stands in.
struct PrintedSteps {
  double position_mm = 0.001, angle_rad = 1e-4 * kPi / 180, speed_mm_s = 0.001;
  JointVector joint_rad{};
  double joint_speed_ratio = 0.01, spindle_rpm = 1, time_s = 0.01;
  enum class Angles { turns_zyx, turns_zyz, vector } angles = Angles::turns_zyx;  // what the printed angles are
  bool is_via_printed = true;   // of an arc; where its centre is, any point of the arc stands for it
  double blend_mm = 0;          // of a rounding distance; 0: the dialect may round less than planned, never more
};

/// What was read back against what was planned: every target, orientation, speed, event, in order; to half the last printed digit, each
/// coordinate in the frame it was printed in.
Verdict compare_programs(const Program& planned, const Program& read_back, const PrintedSteps& steps);

}  // namespace asbuilt
