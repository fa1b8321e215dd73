// SPDX-License-Identifier: GPL-3.0-or-later
// UR script: the rows of the post table.
#pragma once

#include "postprocessors/post.hpp"

namespace asbuilt::ur {

Result<ProgramText> write(const Program& program, const PostContext& context);
Result<Program> read(const ProgramText& text, const PostContext& context);
std::vector<Check> lint(const ProgramText& text, const PostContext& context);

}  // namespace asbuilt::ur
