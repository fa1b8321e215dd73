// SPDX-License-Identifier: GPL-3.0-or-later
// A post: a pair of functions for one controller dialect. The reader shares nothing with the writer.
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
  Result<ProgramText> (*write)(const Program&, const PostContext&);
  Result<Program> (*read)(const ProgramText&, const PostContext&);
  /// The dialect's lint rules on the text alone, each a named check ("lint.K-05").
  std::vector<Check> (*lint)(const ProgramText&, const PostContext&);
};

const std::vector<Post>& posts();
const Post* find_post(Language language);

}  // namespace asbuilt
