// SPDX-License-Identifier: GPL-3.0-or-later
// A face whose exact surface cannot be used: meshed flat over its border, so that the shell stays closed.
#pragma once

#include "planner/io/step/tessellate.hpp"

namespace asbuilt::step {

/// Best-fit plane of the border. False: the border encloses nothing.
bool flat_fallback(const Body& body, int face, BodyMesh& mesh);

}  // namespace asbuilt::step
