// SPDX-License-Identifier: GPL-3.0-or-later
// 3MF (core specification): the triangles of every item of the build, components and transforms applied. Read here and not by
// assimp, whose reader ends the program on a broken archive and leaves the unit out.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "planner/io/mesh_file.hpp"

namespace asbuilt {

/// mm per unit of the model; millimetres where the file names none; nothing where it is no 3MF.
std::optional<double> three_mf_unit_mm(std::string_view bytes);

/// Refuses input.mesh_broken.
Result<MeshFile> read_three_mf(std::string_view bytes, const std::string& name, double mm_per_unit);

}  // namespace asbuilt
