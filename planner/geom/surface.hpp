// SPDX-License-Identifier: GPL-3.0-or-later
// Exact surfaces as CAD files give them, in one frame, mm and rad. Parameters u, v as in ISO 10303-42.
#pragma once

#include <memory>
#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "planner/geom/curve.hpp"
#include "planner/geom/mesh.hpp"

namespace asbuilt {

class MeshQuery;

struct PlaneSurface {  // normal = at.z
  Placement at;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at);
  }
};
struct CylinderSurface {  // axis at.z; natural normal points away from the axis
  Placement at;
  double radius_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("radius", s.radius_mm);
  }
};
struct ConeSurface {  // radius(v) = radius_mm + v tan(half_angle); v along at.z
  Placement at;
  double radius_mm = 0, half_angle_rad = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("radius", s.radius_mm), a("half_angle", s.half_angle_rad);
  }
};
struct SphereSurface {
  Placement at;
  double radius_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("radius", s.radius_mm);
  }
};
struct TorusSurface {
  Placement at;
  double major_mm = 0, minor_mm = 0;
  bool is_inner_lobe = false;  // DEGENERATE_TOROIDAL_SURFACE with select_outer false
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("major", s.major_mm), a("minor", s.minor_mm), a("is_inner_lobe", s.is_inner_lobe);
  }
};
struct BSplineSurface {
  int degree_u = 1, degree_v = 1, count_u = 0, count_v = 0;
  std::vector<double> knots_u, knots_v;  // expanded
  std::vector<Vec3> poles;               // poles[i * count_v + j]
  std::vector<double> weights;           // empty: not rational
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("degree_u", s.degree_u), a("degree_v", s.degree_v), a("count_u", s.count_u), a("count_v", s.count_v);
    a("knots_u", s.knots_u), a("knots_v", s.knots_v), a("poles", s.poles), a("weights", s.weights);
  }
};
struct RevolutionSurface {  // u = angle about the axis, v = curve parameter
  Curve profile;
  Vec3 axis_point = Vec3::Zero(), axis = Vec3::UnitZ();
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("profile", s.profile), a("axis_point", s.axis_point), a("axis", s.axis);
  }
};
struct ExtrusionSurface {  // u = curve parameter, v in mm along the unit direction
  Curve profile;
  Vec3 direction = Vec3::UnitZ();
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("profile", s.profile), a("direction", s.direction);
  }
};
struct Surface;
struct OffsetSurface {
  std::shared_ptr<Surface> basis;
  double distance_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("basis", s.basis), a("distance", s.distance_mm);
  }
};
/// A patch of triangles (a part given as a mesh); u = triangle index, v unused.
struct FacetSurface {
  std::shared_ptr<Mesh> patch;
  std::shared_ptr<const MeshQuery> query;  // over the patch, for speed; may be absent (all triangles are tried then)
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("patch", s.patch);
  }
};

struct Surface {
  std::variant<PlaneSurface, CylinderSurface, ConeSurface, SphereSurface, TorusSurface, BSplineSurface, RevolutionSurface,
               ExtrusionSurface, OffsetSurface, FacetSurface>
      shape;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("shape", s.shape);
  }
};

/// "plane", "cylinder", "cone", "sphere", "torus", "bspline", "revolution", "extrusion", "offset", "facets".
std::string_view surface_type(const Surface& s);

/// True where project() needs no search: a seed can then only choose the turn, never lead astray.
bool has_closed_form_foot(const Surface& s);

struct SurfacePoint {
  Vec3 p = Vec3::Zero(), du = Vec3::Zero(), dv = Vec3::Zero();
  Vec3 n = Vec3::UnitZ();  // unit natural normal du x dv; at a pole the limit
};
SurfacePoint evaluate(const Surface& s, double u, double v);

/// Position with first and second derivatives; the second ones of an offset surface are those of its basis.
struct SurfaceJet {
  Vec3 p = Vec3::Zero(), du = Vec3::Zero(), dv = Vec3::Zero(), duu = Vec3::Zero(), duv = Vec3::Zero(), dvv = Vec3::Zero();
};
/// order 1 leaves the second derivatives of B-splines at zero and is faster.
SurfaceJet evaluate_jet(const Surface& s, double u, double v, int order = 2);

/// Where the parameters live, found by evaluation. A pole is a border that is one point in space.
struct SurfaceDomain {
  double u0 = -1e300, u1 = 1e300, v0 = -1e300, v1 = 1e300;
  bool is_bounded_u = false, is_bounded_v = false;  // false: unbounded or periodic without a border
  bool is_periodic_u = false, is_periodic_v = false;
  bool is_pole_u0 = false, is_pole_u1 = false, is_pole_v0 = false, is_pole_v1 = false;
};
SurfaceDomain domain(const Surface& s);

/// The surface mapped by p -> linear p + shift; linear is a rotation, possibly mirrored, times one scale.
/// `is_reversed`: the natural normal of the result is opposite to the mapped natural normal.
Surface transformed(const Eigen::Affine3d& T, const Surface& s, bool& is_reversed);

/// The point of the (untrimmed) surface nearest to p.
struct SurfaceFoot {
  double u = 0, v = 0;
  Vec3 p = Vec3::Zero(), n = Vec3::UnitZ();  // foot and unit natural normal there
  double signed_distance_mm = 0;             // n . (query - foot): positive on the side of the natural normal
};
SurfaceFoot project(const Surface& s, const Vec3& p_mm, const std::optional<Vec2>& seed_uv = std::nullopt);
/// The same with the domain at hand: for many points on one surface.
SurfaceFoot project(const Surface& s, const SurfaceDomain& domain, const Vec3& p_mm, const std::optional<Vec2>& seed_uv = std::nullopt);

}  // namespace asbuilt
