// SPDX-License-Identifier: GPL-3.0-or-later
// Exact curves as CAD files give them, in one frame, mm and rad.
#pragma once

#include <optional>
#include <string_view>
#include <variant>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

/// A right-handed orthonormal placement (ISO 10303-42 axis2_placement_3d).
struct Placement {
  Vec3 origin = Vec3::Zero(), x = Vec3::UnitX(), y = Vec3::UnitY(), z = Vec3::UnitZ();
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("origin", s.origin), a("x", s.x), a("y", s.y), a("z", s.z);
  }
};

struct LineCurve {  // p(t) = origin + t * direction (unit: t in mm)
  Vec3 origin = Vec3::Zero(), direction = Vec3::UnitX();
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("origin", s.origin), a("direction", s.direction);
  }
};
struct CircleCurve {  // p(t) = origin + r (cos t x + sin t y)
  Placement at;
  double radius_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("radius", s.radius_mm);
  }
};
struct EllipseCurve {
  Placement at;
  double a_mm = 0, b_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("a", s.a_mm), a("b", s.b_mm);
  }
};
struct HyperbolaCurve {  // p(t) = origin + a cosh t x + b sinh t y
  Placement at;
  double a_mm = 0, b_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("a", s.a_mm), a("b", s.b_mm);
  }
};
struct ParabolaCurve {  // p(t) = origin + f t^2 x + 2 f t y
  Placement at;
  double focal_mm = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("at", s.at), a("focal", s.focal_mm);
  }
};
struct BSplineCurve {
  int degree = 1;
  std::vector<double> knots;    // expanded, count = poles + degree + 1
  std::vector<Vec3> poles;      // mm
  std::vector<double> weights;  // empty: not rational
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("degree", s.degree), a("knots", s.knots), a("poles", s.poles), a("weights", s.weights);
  }
};
struct PolylineCurve {  // p(t): t = index + fraction
  std::vector<Vec3> points;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("points", s.points);
  }
};

struct Curve {
  std::variant<LineCurve, CircleCurve, EllipseCurve, HyperbolaCurve, ParabolaCurve, BSplineCurve, PolylineCurve> shape;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("shape", s.shape);
  }
};

struct CurvePoint {
  Vec3 p = Vec3::Zero(), d1 = Vec3::Zero(), d2 = Vec3::Zero();  // position and derivatives by the parameter
};
CurvePoint evaluate(const Curve& c, double t);

/// "line", "circle", "ellipse", "hyperbola", "parabola", "bspline", "polyline".
std::string_view curve_type(const Curve& c);

/// Where the parameter lives. Closed curves may be evaluated past t1: the parameter wraps.
struct CurveDomain {
  double t0 = -1e300, t1 = 1e300;
  bool is_bounded = false;
  bool is_closed = false;  // the ends meet (found by evaluation, never by a flag); circle and ellipse: 2 pi
  double period() const { return t1 - t0; }
};
CurveDomain domain(const Curve& c);

/// The point of the curve nearest to p. With a seed the nearest point around it, else the nearest of all.
struct CurveFoot {
  double t = 0;
  Vec3 p = Vec3::Zero();
  double distance_mm = 0;
};
CurveFoot project(const Curve& c, const Vec3& p_mm, const std::optional<double>& seed_t = std::nullopt);

/// The curve mapped by p -> linear p + shift; linear is a rotation, possibly mirrored, times one scale.
Curve transformed(const Eigen::Affine3d& T, const Curve& c);
Placement transformed_axes(const Eigen::Affine3d& T, const Placement& at);  // keeps x and y, z = x cross y

}  // namespace asbuilt
