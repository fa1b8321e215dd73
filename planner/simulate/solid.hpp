// SPDX-License-Identifier: GPL-3.0-or-later
// The virtual part: a prismatic body with bosses, nominal and as made. Every face is a plane or a cylinder of its own, so the
// truth of every edge is known in closed form: it is where two such surfaces meet. Frame: part. mm, rad.
#pragma once

#include <string>
#include <vector>

#include "planner/base/random.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt::simulate_detail {

/// n . p = d for a plane (unit n out of the material); for a cylinder with a vertical axis at (cx, cy).
struct Face {
  bool is_cylinder = false;
  Vec3 n = Vec3::UnitZ();
  double d_mm = 0;
  double cx_mm = 0, cy_mm = 0, radius_mm = 0;
  bool is_bore = false;  // cylinder with the material outside

  double signed_distance(const Vec3& p) const;  // positive outside the material
  Vec3 outward(const Vec3& p) const;
};

/// One closed contour of side faces, counter-clockwise seen from above; a single cylinder is a full circle.
struct Contour {
  std::vector<Face> sides;
  std::vector<Vec3> corners;  // nominal corner i between side i and side i + 1 (start values of the solver)
};

struct Boss {
  std::string id;
  Contour contour;
  Face top;
};

/// Body between `bottom` and `top`, an outer contour, bores through it, bosses on its top.
struct Solid {
  Face bottom, top;
  Contour outer;
  std::vector<Contour> bores;
  std::vector<Boss> bosses;
  std::vector<std::string> features;  // ids of the bosses whose top edges are to be worked; "body": the top's outer contour
};

/// Edge `index` of a contour with a cap plane, as a dense polyline.
struct TrueEdge {
  std::string id, feature;
  bool is_closed = false;
  std::vector<Vec3> p, tangent, n_1, n_2;  // n_1 of the cap, n_2 of the side
  std::vector<double> s_mm;
};

Solid make_ring(bool with_lugs);
Solid make_bracket();
/// Every face disturbed within the shop's tolerance: offsets, tilts, radii, centres.
Solid as_made(const Solid& nominal, Random& random, double scale);
/// Triangles for ray casting; outward.
Mesh mesh_of(const Solid& solid, double step_mm);
/// The worked edges: the same ids in the same order for the nominal and the made solid.
std::vector<TrueEdge> worked_edges(const Solid& solid, double step_mm);
/// The nominal as a STEP file (AP214, millimetres).
std::string step_text(const Solid& nominal, const std::string& name);

}  // namespace asbuilt::simulate_detail
