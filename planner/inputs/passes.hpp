// SPDX-License-Identifier: GPL-3.0-or-later
// One pass of a line scanner over a plate with holes: its profiles, and where the flange was at each of them.
#pragma once

#include <optional>

#include "planner/inputs/files_captures.hpp"
#include "planner/inputs/sources.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt::inputs {

/// Profiles are a CSV (t and u, v in pixels or x, z in mm) or a cloud whose y is the way gone (mm). The flange's pose at a profile is
/// that of the log (interpolated on SE(3), or by the joints), or base_flange moved by the velocity. Profiles outside the log are left out.
/// Units mm, s. Faults go to `out` and `faults`: input.pass_without_way, input.log_does_not_cover, and those of the files.
std::optional<ProfileScan> read_pass(Sources& sources, Readout& out, Refusals& faults, const std::filesystem::path& file, const std::string& at, const TargetCaptureText& text, TargetCapture& capture,
                                     const std::optional<Robot>& robot, bool& is_metric);

}  // namespace asbuilt::inputs
