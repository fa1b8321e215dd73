// SPDX-License-Identifier: GPL-3.0-or-later
// The nominal solid as STEP AP214: one MANIFOLD_SOLID_BREP, planes and cylinders, lines and circles, millimetres.
#include <algorithm>

#include "planner/simulate/solid.hpp"
#include "planner/simulate/step_writer.hpp"

namespace asbuilt::simulate_detail {
namespace {

int surface_of(StepWriter& w, const Face& f, const Vec3& near) {
  if (f.is_cylinder) return w.cylinder(Vec3(f.cx_mm, f.cy_mm, 0), Vec3::UnitZ(), f.radius_mm);
  return w.plane(near - f.n * f.signed_distance(near), f.n);
}

struct Rim {  // edges of one contour against one cap, each counter-clockwise about z
  std::vector<int> edges;
  std::vector<Vec3> starts;
};

Vec3 start_of(const Contour& c, std::size_t i, double z) {
  if (c.sides.size() == 1) return Vec3(c.sides[0].cx_mm + c.sides[0].radius_mm, c.sides[0].cy_mm, z);
  Vec3 p = c.corners[(i + c.sides.size() - 1) % c.sides.size()];
  p.z() = z;
  return p;
}

/// Edge i runs from start i to start i + 1, except a hollow arc, whose circle has to run the other way about its own axis.
Rim rim_of(StepWriter& w, const Contour& c, double z) {
  Rim r;
  for (std::size_t i = 0; i < c.sides.size(); ++i) {
    const Vec3 a = start_of(c, i, z), b = start_of(c, (i + 1) % c.sides.size(), z);
    const Face& f = c.sides[i];
    r.starts.push_back(a);
    if (!f.is_cylinder) {
      r.edges.push_back(w.line_edge(a, b));
    } else {
      const bool hollow = f.is_bore && c.sides.size() > 1;
      r.edges.push_back(w.circle_edge(Vec3(f.cx_mm, f.cy_mm, z), hollow ? Vec3(-Vec3::UnitZ()) : Vec3(Vec3::UnitZ()), f.radius_mm, a, b));
    }
  }
  return r;
}

std::vector<std::pair<int, bool>> around(const Rim& r, bool counter_clockwise) {
  std::vector<std::pair<int, bool>> out;
  for (int e : r.edges) out.emplace_back(e, counter_clockwise);
  if (!counter_clockwise) std::reverse(out.begin(), out.end());
  return out;
}

/// The side faces between two rims. `inside_out`: the contour bounds a bore.
void walls(StepWriter& w, const Contour& c, const Rim& low, const Rim& high, bool inside_out) {
  const std::size_t n = c.sides.size();
  std::vector<int> risers;
  for (std::size_t i = 0; i < n; ++i) risers.push_back(w.line_edge(low.starts[i], high.starts[i]));
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t j = (i + 1) % n;
    std::vector<std::pair<int, bool>> loop;
    if (!inside_out)
      loop = {{low.edges[i], true}, {risers[j], true}, {high.edges[i], false}, {risers[i], false}};
    else
      loop = {{risers[i], true}, {high.edges[i], true}, {risers[j], false}, {low.edges[i], false}};
    const int l = w.loop(loop), s = surface_of(w, c.sides[i], low.starts[i]);
    w.face(s, !c.sides[i].is_bore, {l});
  }
}

}  // namespace

std::string step_text(const Solid& s, const std::string& name) {
  StepWriter w;
  const double z0 = -s.bottom.d_mm, z1 = s.top.d_mm;
  const Rim outer_low = rim_of(w, s.outer, z0), outer_high = rim_of(w, s.outer, z1);
  std::vector<int> top_loops = {w.loop(around(outer_high, true))}, bottom_loops = {w.loop(around(outer_low, false))};
  walls(w, s.outer, outer_low, outer_high, false);
  for (const Contour& b : s.bores) {
    const Rim low = rim_of(w, b, z0), high = rim_of(w, b, z1);
    top_loops.push_back(w.loop(around(high, false)));
    bottom_loops.push_back(w.loop(around(low, true)));
    walls(w, b, low, high, true);
  }
  for (const Boss& b : s.bosses) {
    const Rim low = rim_of(w, b.contour, z1), high = rim_of(w, b.contour, b.top.d_mm);
    top_loops.push_back(w.loop(around(low, false)));
    walls(w, b.contour, low, high, false);
    const int l = w.loop(around(high, true)), t = surface_of(w, b.top, Vec3(0, 0, b.top.d_mm));
    w.face(t, true, {l});
  }
  const int t = surface_of(w, s.top, Vec3(0, 0, z1)), b = surface_of(w, s.bottom, Vec3(0, 0, z0));
  w.face(t, true, top_loops);
  w.face(b, true, bottom_loops);
  return w.finish(name);
}

}  // namespace asbuilt::simulate_detail
