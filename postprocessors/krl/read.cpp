// SPDX-License-Identifier: GPL-3.0-or-later
// KUKA KRL -> neutral program. A whitelist written from dialect.md: straight-line programs with sub-program calls, named or
// literal positions, PTP to axis values, LIN, CIRC and their spline singles, frames, speeds, rounding, outputs and triggers.
// A statement outside it is a refusal with file and line, never a guess.
#include "postprocessors/krl/reader.hpp"

namespace asbuilt::krl {

Program Reader::read() {
  for (const ProgramFile& f : text_.files) load(f);
  if (order_.empty()) fail({}, "read.missing", "no .src file with a DEF");
  const Module& main = modules_.at(order_.front());
  build_.program.name = std::string(original_name_);
  build_.program.header = main.header;
  run(main);
  if (is_in_spline_) fail(main.head, "read.missing", "ENDSPLINE is missing");
  if (!armed_at_.text.empty()) fail(armed_at_, "read.trigger", "no motion follows this TRIGGER, so it never fires");
  return std::move(build_.program);
}

Result<Program> read(const ProgramText& text, const PostContext& context) {
  return guarded([&]() -> Result<Program> { return Reader(text, context).read(); });
}

}  // namespace asbuilt::krl
