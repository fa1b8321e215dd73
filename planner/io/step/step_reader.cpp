// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/step/step_reader.hpp"

namespace asbuilt {

Result<Done<Brep>> read_step(std::string_view, const std::string& name, const StepOptions&) {
  return refuse({.code = "step.not_built", .where = name, .message = "", .stage = "input"});
}

}  // namespace asbuilt
