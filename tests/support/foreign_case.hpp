// SPDX-License-Identifier: GPL-3.0-or-later
// A folder for the parsers of other people (tests/contract/second_readers.py): the cell, the plan as they list it, the programs.
#pragma once

#include <filesystem>
#include <vector>

#include "postprocessors/post.hpp"

namespace asbuilt::support {

/// Writes FOLDER/{cell.json,expected.json,LANGUAGE/files}; `tools` are those the cell is said to have.
void write_foreign_case(const std::filesystem::path& folder, const PostContext& context, const std::vector<ToolSpec>& tools, const Program& plan,
                        const std::vector<ProgramText>& texts);

}  // namespace asbuilt::support
