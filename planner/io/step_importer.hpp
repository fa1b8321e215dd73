// SPDX-License-Identifier: GPL-3.0-or-later
// STEP through assimp: our reader as one of its importers, so that one front door opens CAD and meshes alike.
#pragma once

namespace Assimp {
class Importer;
}

namespace asbuilt {

/// After this `importer.ReadFile("part.step", ..)` gives the part: one node for each place in the assembly, named by its product and
/// usage; one mesh for each body, with normals of the exact faces and its colour as material; metadata `UnitScaleFactor` (cm, as assimp
/// has it), `SourceAsset_Format`, and mm as unit of the coordinates. IFC files stay with assimp's own reader, which is asked after ours.
/// Precision: float32, as assimp has it; the planner itself reads STEP by read_step.
void register_step_importer(Assimp::Importer& importer);

}  // namespace asbuilt
