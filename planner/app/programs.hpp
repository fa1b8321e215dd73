// SPDX-License-Identifier: GPL-3.0-or-later
// Program files from disk, by the language their names tell, read back into neutral programs.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/program.hpp"
#include "planner/base/result.hpp"
#include "postprocessors/post.hpp"

namespace asbuilt {

struct ReadProgram {
  ProgramText text;
  Program program;
};
/// Files that belong to one program and language together: .src with .dat, .JBI with .CND, .nc / .cnc / .mpf.
/// Refuses input.program_language, input.file_missing, and what the language's reader refuses.
Result<std::vector<ReadProgram>> read_programs(const std::vector<std::string>& files, const PostContext& context);

/// How two programs differ, motion by motion.
struct ProgramDifference {
  std::size_t motions_a = 0, motions_b = 0, other_a = 0, other_b = 0;  // other: everything that is no motion
  double position_mm = 0, angle_rad = 0, joint_rad = 0, speed_mm_s = 0;  // the greatest, over motions of the same place
  std::size_t position_at = 0;
};
ProgramDifference difference_of(const Program& a, const Program& b);

}  // namespace asbuilt
