// SPDX-License-Identifier: GPL-3.0-or-later
// STEP (ISO 10303-21: AP203, AP214, AP242) without a CAD kernel: exact faces and edges with their ids, and a watertight mesh.
#pragma once

#include <string>
#include <string_view>

#include "planner/base/result.hpp"
#include "planner/geom/brep.hpp"

namespace asbuilt {

struct StepTiming {  // s, of one call
  double parse_s = 0, topology_s = 0, mesh_s = 0;
};
struct StepOptions {
  double chord_mm = 0;           // 0: 1e-4 of the diagonal, at most 0.02 mm, at least 0.001 mm; never below 5e-6 of the diagonal
  double angle_rad = 0.1745;     // largest turn of the normal between neighbouring points
  double edge_step_mm = 1.0;     // samples of edges are at most this far apart (and 10 degrees); wider only in parts with over 2e5 samples
  bool want_mesh = true;         // false: no mesh, areas and volumes, and shells are not checked for being inside out
  StepTiming* timing = nullptr;  // filled where given
};

/// Reads the bytes of a STEP file into one B-rep in the frame of the file's root, mm.
/// Refuses step.not_step, step.truncated, step.no_body, step.limits, ... with `name:line: #id KEYWORD: what` in `where`.
/// Whatever is not understood is named in Brep::unread and in the faults of faces and edges; the rest still comes in.
Result<Done<Brep>> read_step(std::string_view bytes, const std::string& name, const StepOptions& options = {});

}  // namespace asbuilt
