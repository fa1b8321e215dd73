// SPDX-License-Identifier: GPL-3.0-or-later
// One program in one dialect: written, read back, compared with the plan. Internal to the room.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/program.hpp"
#include "planner/artefacts/program_text.hpp"
#include "planner/artefacts/verdict.hpp"
#include "planner/base/result.hpp"
#include "postprocessors/post.hpp"

namespace asbuilt {

/// A program as it was written, and as it was read back from what was written.
struct Posted {
  ProgramText text;
  Program read_back;
  std::vector<Check> checks;  // lint, and planned against read back
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("text", s.text), a("read_back", s.read_back), a("checks", s.checks);
  }
};

/// Refuses what the dialect cannot say, and what its reader does not take back.
Result<Done<Posted>> write_and_read_back(const Post& post, const Program& program, const PostContext& context);
/// A failed check as a refusal; none of a verdict without checks is let through either.
Refusals refusals_of(const Verdict& verdict, const std::string& what);

}  // namespace asbuilt
