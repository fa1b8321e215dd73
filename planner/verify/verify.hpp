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

/// What was read back against what was planned: every target, orientation, speed, event, in order; to half the last printed digit.
/// `joint_step_rad`: the last printed digit of a joint where it is coarser than 0.001 degree (pulses). `blend_step_mm`: that of a rounding
/// distance; 0 where the dialect may round less than planned.
Verdict compare_programs(const Program& planned, const Program& read_back, double position_step_mm, double angle_step_rad,
                         double speed_step_mm_s, double joint_step_rad = 0, double blend_step_mm = 0);

}  // namespace asbuilt
