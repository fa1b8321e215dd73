// SPDX-License-Identifier: GPL-3.0-or-later
// Points along edges: once per edge for the mesh, so that both faces share them, and finer ones for the edges of the B-rep.
#pragma once

#include "planner/io/step/topology.hpp"

namespace asbuilt::step {

struct Tolerance {
  double chord_mm = 0.02, angle_rad = 0.1745;
};

/// A point where the normal turns by more than half the angle within this length (a pole, a corner where the surface's own sides run
/// together) has no normal of its own: what counts is the normal this far inside.
constexpr double kNormalReach_mm = 1e-3;
bool is_settled(const Vec3& normal, const Vec3& normal_inside, double angle_rad);

/// Parameters from t0 to t1 (either direction) so that chords stay within the chord tolerance and tangents turn by at most the
/// angle between neighbours.
std::vector<double> sample_curve(const Curve& c, double t0, double t1, const Tolerance& tolerance, int count_min = 1);

/// Fills TopoEdge::t and ::vertex; appends to the mesh vertices (the first ones are the body's vertices, in order).
void sample_edges(Body& body, const Tolerance& tolerance, std::vector<Vec3>& vertices);

}  // namespace asbuilt::step
