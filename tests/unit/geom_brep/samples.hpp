// SPDX-License-Identifier: GPL-3.0-or-later
// One surface and one curve of every kind, in a general position.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "planner/geom/surface.hpp"

namespace asbuilt::test {

inline Placement tilted() {
  Placement p;
  const Eigen::Quaterniond q(Eigen::AngleAxisd(0.7, Vec3(1, 2, -0.5).normalized()));
  p.origin = {3, -7, 11};
  p.x = q * Vec3::UnitX(), p.y = q * Vec3::UnitY(), p.z = q * Vec3::UnitZ();
  return p;
}

inline BSplineCurve wavy_curve(bool rational) {
  BSplineCurve c;
  c.degree = 3;
  c.knots = {0, 0, 0, 0, 1, 2.5, 4, 4, 4, 4};
  c.poles = {{0, 0, 0}, {4, 5, 1}, {9, -3, 2}, {14, 4, -1}, {18, 1, 3}, {24, 0, 0}};
  if (rational) c.weights = {1, 0.8, 1.7, 1, 0.6, 1};
  return c;
}

inline BSplineSurface wavy_surface(bool rational) {
  BSplineSurface s;
  s.degree_u = 3, s.degree_v = 2, s.count_u = 5, s.count_v = 4;
  s.knots_u = {0, 0, 0, 0, 0.4, 1, 1, 1, 1};
  s.knots_v = {0, 0, 0, 1, 2, 2, 2};
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 4; ++j) {
      s.poles.push_back({i * 6.0, j * 5.0, 2.0 * std::sin(i * 1.3) + 1.5 * std::cos(j * 0.9 + i)});
      if (rational) s.weights.push_back(1 + 0.3 * ((i * 3 + j * 5) % 4));
    }
  return s;
}

inline std::vector<std::pair<std::string, Curve>> curves() {
  return {{"line", {LineCurve{{1, 2, 3}, Vec3(1, -2, 0.5).normalized()}}},
          {"circle", {CircleCurve{tilted(), 5}}},
          {"ellipse", {EllipseCurve{tilted(), 7, 3}}},
          {"hyperbola", {HyperbolaCurve{tilted(), 4, 3}}},
          {"parabola", {ParabolaCurve{tilted(), 1.5}}},
          {"bspline", {wavy_curve(false)}},
          {"rational", {wavy_curve(true)}}};
}

struct SurfaceSample {
  std::string name;
  Surface surface;
  double u0, u1, v0, v1;  // where to try it
};

inline std::vector<SurfaceSample> surfaces() {
  const Placement at = tilted();
  Surface base{wavy_surface(false)};
  return {{"plane", {PlaneSurface{at}}, -5, 5, -5, 5},
          {"cylinder", {CylinderSurface{at, 4}}, 0.1, 6.1, -5, 5},
          {"cone", {ConeSurface{at, 4, 0.4}}, 0.1, 6.1, -5, 9},
          {"cone_narrowing", {ConeSurface{at, 9, -0.5}}, 0.1, 6.1, -4, 8},
          {"sphere", {SphereSurface{at, 6}}, 0.1, 6.1, -1.4, 1.4},
          {"torus", {TorusSurface{at, 10, 3, false}}, 0.1, 6.1, 0.1, 6.1},
          {"lemon", {TorusSurface{at, 2, 5, true}}, 0.1, 6.1, 2.1, 4.1},
          {"apple", {TorusSurface{at, 2, 5, false}}, 0.1, 6.1, -1.8, 1.8},
          {"bspline", base, 0.05, 0.95, 0.1, 1.87},
          {"rational", {wavy_surface(true)}, 0.05, 0.95, 0.1, 1.87},
          {"revolution", {RevolutionSurface{{LineCurve{at.origin + 6 * at.x, (0.3 * at.x + at.z).normalized()}}, at.origin, at.z}}, 0.1, 6.1, 0, 8},
          {"revolved_ellipse", {RevolutionSurface{{EllipseCurve{{at.origin + 12 * at.x, at.x, at.z, -at.y}, 3, 2}}, at.origin, at.z}}, 0.1, 6.1, 0.1, 6.1},
          {"extrusion", {ExtrusionSurface{{wavy_curve(false)}, Vec3(0.1, 0.2, 1).normalized()}}, 0.1, 3.9, -5, 5},
          {"extruded_circle", {ExtrusionSurface{{CircleCurve{at, 3}}, at.z}}, 0.1, 6.1, -5, 5},
          {"offset", {OffsetSurface{std::make_shared<Surface>(base), 0.3}}, 0.1, 0.9, 0.2, 1.77}};
}

}  // namespace asbuilt::test
