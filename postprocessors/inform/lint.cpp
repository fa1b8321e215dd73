// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/inform/inform.hpp"
#include "postprocessors/linting.hpp"

namespace asbuilt::inform {

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  using namespace linting;
  Findings f(kCommonErrors, kCommonWarnings);
  common_rules(f, text, context, read, [](std::string_view line) { return line.starts_with("'") ? std::string_view() : line; }, true);
  return f.checks();
}

}  // namespace asbuilt::inform
