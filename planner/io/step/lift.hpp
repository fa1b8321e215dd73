// SPDX-License-Identifier: GPL-3.0-or-later
// Loops lifted to the universal cover of (u, v): sample by sample, without jumps, with the turns each loop makes around the surface.
#pragma once

#include <optional>
#include <vector>

#include "planner/io/step/foot_walk.hpp"
#include "planner/io/step/topology.hpp"

namespace asbuilt::step {

struct LiftedPoint {
  Vec2 uv = Vec2::Zero();
  int vertex = -1;
  Vec3 p = Vec3::Zero();
  Vec2 uv_mid = Vec2::Zero();
  bool has_mid = false;
  Vec3 p_mid = Vec3::Zero();
  int edge = -1;
  double t_a = 0, t_b = 0;
};
using Lifted = std::vector<LiftedPoint>;

/// One loop as points in chart direction; the last point is not repeated.
Lifted loop_points(const Body& body, const TopoLoop& loop, bool is_reversed, const std::vector<Vec3>& vertices);
Vec3 area_vector(const Lifted& l);

struct Periods {
  double u = 0, v = 0;  // 0: not periodic
};

/// A border of the domain that is one point in space.
struct Pole {
  int axis = 1;  // 0: a border in u, 1: a border in v
  bool is_high = false;
  double value = 0;
  Vec3 p = Vec3::Zero();
};

class Lifter {
 public:
  Lifter(const Surface& s, const SurfaceDomain& d);
  const std::vector<Pole>& poles() const { return poles_; }
  Periods period() const { return period_; }
  double worst_mm = 0;  // largest distance of a point from the surface

  const Pole* pole_at(const Vec3& p) const;
  Vec2 lift(const Vec3& p, const std::optional<Vec2>& seed);
  /// Adds the parameters of a loop; turns (windings) come back. A point at a pole becomes two or more chart points. False: the loop
  /// lies wholly in a pole.
  bool lift_loop(Lifted& loop, int& wind_u, int& wind_v);

 private:
  Vec2 near_to(Vec2 uv, const Vec2& seed) const;
  Vec2 raw(const Vec3& p, const std::optional<Vec2>& seed);

  const Surface& s_;
  const SurfaceDomain& d_;
  FootWalk walk_;
  std::vector<Pole> poles_;
  Periods period_;
};

}  // namespace asbuilt::step
