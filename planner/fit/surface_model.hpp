// SPDX-License-Identifier: GPL-3.0-or-later
// What the fit needs from a surface: signed distance with normal, how the surface moves under small changes of its place and
// size, and the surface so moved. One set of parameters for every type: translation, rotation about a centre, sizes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <string>

#include "planner/geom/surface.hpp"

namespace asbuilt::fitting {

constexpr int kModesMax = 8;
using ModeRow = Eigen::Matrix<double, kModesMax, 1>;

/// Distance from p to the untrimmed surface, positive on the side of the natural normal, and that unit normal at the foot.
double signed_distance(const Surface& surface, const Vec3& p, Vec3& n);

/// 6 for what has no size (plane, free-form), 7 for cylinder and sphere, 8 for cone and torus.
int modes_count(const Surface& surface);

/// Height along n at the surface point q per unit of translation (3, mm), rotation about `center` (3, rad) and sizes
/// (mm; a cone's second: rad). The modes that leave the surface where it is come out as zero or as combinations of others.
ModeRow mode_heights(const Surface& surface, const Vec3& q, const Vec3& n, const Vec3& center);

/// The surface after the change theta (same order as mode_heights).
Surface moved(const Surface& surface, const ModeRow& theta, const Vec3& center);

/// Parameters as a person reads them: mm and degree; empty for what has none.
std::map<std::string, double> readable_parameters(const Surface& surface);

}  // namespace asbuilt::fitting
