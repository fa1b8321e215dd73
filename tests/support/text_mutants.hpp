// SPDX-License-Identifier: GPL-3.0-or-later
// Single-token changes of an emitted program, and why a change that nothing objects to does nothing.
#pragma once

#include <string>
#include <vector>

#include "planner/base/random.hpp"
#include "postprocessors/post.hpp"

namespace asbuilt::support {

struct TextToken {
  std::size_t file, begin, end;
};
std::vector<TextToken> tokens_of(const ProgramText& text);

/// What a token may become: nothing, itself twice, another digit, another sign, another letter.
std::vector<std::string> changes_of(const std::string& token, Random& random);

/// Every kind of change of a token: nothing, itself twice, the first, the last and another digit, another sign, the point moved, another letter,
/// other tokens of the same program in its place. `pool`: the program's tokens.
std::vector<std::string> every_change_of(const std::string& token, const std::vector<std::string>& pool, Random& random);

/// The line that holds a byte.
std::string line_around(const std::string& bytes, std::size_t at);

/// Why a change that nothing objected to does nothing; empty where it is not known to be harmless.
std::string harmless(Language language, const std::string& line, const std::string& token, const std::string& changed);

}  // namespace asbuilt::support
