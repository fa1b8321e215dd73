// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/krl/krl.hpp"
#include "postprocessors/linting.hpp"

namespace asbuilt::krl {

std::vector<Check> lint(const ProgramText& text, const PostContext& context) {
  using namespace linting;
  Findings f(kCommonErrors, kCommonWarnings);
  common_rules(f, text, context, read, [](std::string_view line) { return line.substr(0, line.find(';')); }, true);
  return f.checks();
}

}  // namespace asbuilt::krl
