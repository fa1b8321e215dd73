// SPDX-License-Identifier: GPL-3.0-or-later
// Beckhoff TwinCAT NC I (TF5100, classic dialect). Not the CNC of TF5200: no commands with #, no coordinate systems, no control flow.
#pragma once

#include "postprocessors/post.hpp"

namespace asbuilt::nci {

Result<ProgramText> write(const Program& program, const PostContext& context);
Result<Program> read(const ProgramText& text, const PostContext& context);
std::vector<Check> lint(const ProgramText& text, const PostContext& context);

}  // namespace asbuilt::nci
