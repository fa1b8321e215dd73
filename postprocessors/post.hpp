// SPDX-License-Identifier: GPL-3.0-or-later
// A post: functions for one controller dialect. `write` turns a neutral program into the controller's files, `read` turns files
// back into a neutral program, `lint` checks the dialect's rules on the files. The reader shares nothing with the writer: the
// writer's helpers are in writing.hpp, the readers' in reading.hpp, and no file includes both.
//
// Frames: the neutral program holds every pose in base. A dialect prints points in the frame of the last SetFrame (Beckhoff: turned
// by right angles; INFORM: base, where the machine gives no user frame), relative to that frame *as printed*; what is read back therefore differs from the plan by rounding of the point alone: each coordinate in
// the printed frame by at most half of position_step_mm (a distance by at most sqrt(3)/2 of it), each printed angle by half of
// angle_step_rad.
#pragma once

#include <string_view>
#include <vector>

#include "planner/artefacts/program.hpp"
#include "planner/artefacts/program_text.hpp"
#include "planner/artefacts/verdict.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

/// What the controller already knows or a dialect must not guess. No clock: the date is an input.
struct PostContext {
  CellSpec cell;      // controller, tools (number, T_flange_tool, spindle), joints, home
  std::string date;   // ISO, e.g. "2026-11-22": the scan's date
};

struct Post {
  Language language;
  std::string_view title, extension;
  double position_step_mm, angle_step_rad, speed_step_mm_s;  // last printed digit
  /// Frames: in base. Units: mm, rad, mm/s. Refuses: post.* (a missing machine value, what the dialect cannot say).
  Result<ProgramText> (*write)(const Program&, const PostContext&);
  /// Frames: out base. Refuses: read.* with "file:line" for every token outside the read subset.
  Result<Program> (*read)(const ProgramText&, const PostContext&);
  /// The dialect's lint rules on the text alone, each a named check ("lint.K-05"). Rules that only warn always pass and carry
  /// the number of findings in `measured` and the first place in `where`.
  std::vector<Check> (*lint)(const ProgramText&, const PostContext&);
  /// Last printed digit of each joint, rad; pulses differ from robot to robot.
  JointVector (*joint_step_rad)(const PostContext&);
  double joint_speed_step_ratio;  // last printed digit of a joint move's speed
  double spindle_step_ratio;      // of the spindle speed, of max_rpm
  double time_step_s, blend_step_mm;
  /// What the dialect can say besides; who plans for it cuts, straightens or keeps straight what it cannot.
  enum class Arcs { anywhere, in_planes_of_the_frame, in_planes_of_base };
  Arcs arcs = Arcs::anywhere;
  bool has_path_events = false;  // outputs at a place on the path
  bool has_rounding = true;      // without it every point is passed exactly
  bool has_splines = true, has_equipment = true;
  bool is_in_base = false;       // prints its points in base, whatever frame was set
};

const std::vector<Post>& posts();
const Post* find_post(Language language);

}  // namespace asbuilt
