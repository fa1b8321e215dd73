// SPDX-License-Identifier: GPL-3.0-or-later
// Curves made of other curves: pieces of any kind as rational B-splines, joined end to end; offsets in space.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "planner/geom/surface.hpp"

namespace asbuilt::step {

/// The curve from t0 to t1 (either direction) as a clamped B-spline over [0, 1]; exact for every kind of curve.
BSplineCurve as_bspline(const Curve& c, double t0, double t1);

/// Pieces end to end as one curve; each starts where the one before ends (the gap is for the caller to look at). Degrees are raised to
/// the highest; the knots between pieces have full multiplicity, so kinks stay kinks.
BSplineCurve joined(const std::vector<BSplineCurve>& pieces);

/// A curve known by its points as cubic pieces within 1e-6 mm, first between the breaks given. Nothing where a point is missing.
std::optional<Curve> fitted(const std::function<std::optional<Vec3>(double)>& at, std::vector<double> breaks);

/// OFFSET_CURVE_3D: p + distance * (direction x tangent) / |direction x tangent|. Lines and circles about the direction stay what
/// they are; others become cubic pieces within 1e-6 mm. Nothing where the tangent runs along the direction.
std::optional<Curve> offset_in_space(const Curve& c, double distance_mm, const Vec3& direction);

/// The part of a turned profile between its crossings of the axis whose turn passes the points of a face. Where parts pass them alike the
/// seam tells, which is the profile itself; without one it is the first part. Nothing where the profile does not cross its axis.
std::optional<Curve> profile_beside_axis(const RevolutionSurface& s, const std::vector<Vec3>& points,
                                         const std::vector<Vec3>& on_seam = {});

}  // namespace asbuilt::step
