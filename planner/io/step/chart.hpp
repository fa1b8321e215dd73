// SPDX-License-Identifier: GPL-3.0-or-later
// A face flattened: its loops lifted to the (u, v) plane without jumps, cut open where the surface closes on itself, closed off
// at poles, so that it becomes a plain region bounded by polygons. Spheres use a stereographic chart instead, which has no seam.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/io/step/sample.hpp"

namespace asbuilt::step {

struct ChartPoint {
  Vec2 q = Vec2::Zero();      // chart coordinates
  int vertex = -1;            // mesh vertex
  Vec2 q_mid = Vec2::Zero();  // chart image of the middle of the edge piece that starts here
  bool has_mid = false;       // false: the piece is straight in the chart
  int edge = -1;              // the edge the piece is of, with its parameters; -1: a generated cut
  double t_a = 0, t_b = 0;
};
using ChartLoop = std::vector<ChartPoint>;

/// q = ((u, v) - origin) scaled, with the axes turned by a quarter for bands that close in v; or stereographic.
struct Chart {
  const Surface* surface = nullptr;
  const SurfaceDomain* domain = nullptr;
  Vec2 scale = Vec2::Ones();  // chart units per parameter unit
  bool is_turned = false;     // q = (v, -u)
  bool is_stereographic = false;
  Placement stereo;  // origin: centre; z: away from the centre of projection
  double radius_mm = 0;
  bool is_plane = false;

  Vec2 uv(const Vec2& q) const;
  Vec2 q(const Vec2& uv) const;
  struct Jet {
    Vec3 p, d0, d1;  // position and derivatives by the chart coordinates
  };
  Jet at(const Vec2& q) const;
};

struct FaceChart {
  Chart chart;
  std::vector<ChartLoop> loops;
  bool is_whole_surface = false;  // no boundary at all
  std::string fault;              // not empty: could not be flattened
};

/// `vertices` may grow (generated seams and poles). Loops come out with the interior on the left for the natural normal.
FaceChart flatten_face(const Body& body, int face, const Tolerance& tolerance, std::vector<Vec3>& vertices);

}  // namespace asbuilt::step
