// SPDX-License-Identifier: GPL-3.0-or-later
// The cell of one job as bodies that must not touch: arm, tool, cutter, sensors, part, fixture, obstacles.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"
#include "planner/plan/motion/cutter_profile.hpp"
#include "planner/robot/collision.hpp"

namespace asbuilt {

struct CellScene {
  CollisionScene scene;
  CutterProfile profile;
  int part = -1, flute = -1, shank = -1;
  /// Watches that hold at all times: arm, tool, sensors and shank against part, fixture and obstacles; the arm against itself;
  /// the flute against fixture and obstacles.
  std::vector<Watch> always;
  /// The part against the core of the cutter, what is left of it when more than the chamfer's depth is taken off: however the path
  /// runs, the cutter goes nowhere deeper into the part than it has to for its edge, and a little. None for cutters too thin.
  std::vector<Watch> core;
  std::vector<Note> notes;

  /// `always` and the flute against the part.
  std::vector<Watch> with_flute(double flute_part_margin_mm) const;
};

/// The scene with the tool of a recipe and the part's mesh as measured. `clearance_mm`: everything but the flute; `flute_mm`: the flute against fixture and
/// obstacles; `chamfer_mm`: how deep the cutter goes into the part at its edge, at most. Pairs of the arm with itself that are nearer than the clearance at home are built that way and are left out (a
/// note names them); bodies that both stand still are not watched.
CellScene cell_scene(const Robot& robot, const Job& job, const Mesh& part, const Location& location, const ToolSpec& tool, double clearance_mm,
                     double flute_mm, double chamfer_mm);

/// "tool cone-90 and fixture", for messages.
std::string pair_name(const CellScene& cell, const Watch& watch);

}  // namespace asbuilt
