// SPDX-License-Identifier: GPL-3.0-or-later
// A cell of boxes for the tests of this room: an arm, a spindle with a cone cutter, a block on a fixture on a table, and a path
// along the block's top edges.
#pragma once

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/tool_path.hpp"

namespace asbuilt::test {

inline Mesh box_mesh(const Vec3& lo, const Vec3& hi) {
  Mesh m;
  for (int i = 0; i < 8; ++i) m.vertices.push_back({i & 1 ? hi.x() : lo.x(), i & 2 ? hi.y() : lo.y(), i & 4 ? hi.z() : lo.z()});
  m.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4}, {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return m;
}

struct SmallCell {
  Job job;
  Location location;
  Features features;
  Burrs burrs;
  ToolPath path;
};

constexpr double kBlockX = 100, kBlockY = 60, kBlockZ = 40;

/// A pass along a top edge of the block, from `a` to `b` (part, on the edge), material on the side of `inward`.
inline CutPass edge_pass(const Vec3& a, const Vec3& b, const Vec3& inward, double width = 0.4) {
  CutPass p;
  p.feature = "top", p.recipe = "deburr", p.tool = "cone", p.edges = {0};
  const Vec3 up = Vec3::UnitZ(), along = (b - a).normalized();
  // 90 degree cone, tip 1 mm, flank touched at half its height (radius 2.25, 1.75 above the tip)
  const Vec3 shift = inward * (width / 2 - 2.25) - up * (width / 2 + 1.75), off = (up - inward).normalized();
  const auto point = [&](const Vec3& on_edge, PathPointKind kind, double clear) {
    PathPoint q;
    q.tip_part = on_edge + shift + clear * off, q.axis_part = -up, q.feed_mm_s = 20, q.kind = kind, q.s_mm = (on_edge - a).dot(along);
    return q;
  };
  p.points = {point(a - 2 * along, PathPointKind::lead_in, 0.8), point(a, PathPointKind::lead_in, 0)};
  for (double s = 10; s < (b - a).norm(); s += 10) p.points.push_back(point(a + s * along, PathPointKind::cut, 0));
  p.points.push_back(point(b, PathPointKind::cut, 0));
  p.points.push_back(point(b + 2 * along, PathPointKind::lead_out, 0.8));
  p.retract_part = up, p.approach_mm = 25;
  return p;
}

inline SmallCell small_cell(const Vec3& part_origin = {1180, -30, 660}) {
  SmallCell c;
  RobotSpec& r = c.job.cell.robot;
  r.model = "boxes";
  OpwParameters o;
  o.a1_mm = 300, o.a2_mm = -150, o.c1_mm = 750, o.c2_mm = 1000, o.c3_mm = 1080, o.c4_mm = 220;
  o.offsets_rad = {0, -kPi / 2, 0, 0, 0, 0};
  o.signs = {-1, 1, 1, -1, 1, -1};
  r.kinematics = o;
  const double limits[6][2] = {{-180, 180}, {-150, 20}, {-110, 150}, {-270, 270}, {-122, 122}, {-350, 350}};
  const double speeds[6] = {120, 115, 120, 190, 180, 260};
  for (int i = 0; i < 6; ++i)
    r.joints[i] = {rad_from_deg(limits[i][0]), rad_from_deg(limits[i][1]), rad_from_deg(speeds[i]), rad_from_deg(i < 3 ? 350 : 600), 50};
  r.home_rad = {0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};
  r.accuracy.absolute = {0.42, 0.2}, r.accuracy.repeatability = {0.07, 0.03}, r.accuracy.short_term = {0.02, 0.01};
  r.links = {{0, box_mesh({-280, -280, 0}, {280, 280, 380})},   {1, box_mesh({-235, -235, 385}, {430, 235, 880})},
             {2, box_mesh({160, -120, 635}, {1410, 120, 865})}, {3, box_mesh({1185, -130, 640}, {1540, 130, 1030})},
             {4, box_mesh({1545, -95, 805}, {2275, 95, 995})},  {5, box_mesh({2280, -80, 815}, {2490, 80, 985})},
             {6, box_mesh({2492, -78, 822}, {2600, 78, 978})}};
  ToolSpec tool;
  tool.id = "cone", tool.number = 1;
  tool.T_flange_tool.p_mm = {0, 0, 350};
  tool.cutter = {CutterShape::cone, kPi / 2, 1, 8, 55, 8, 4};
  tool.mesh_flange = box_mesh({-60, -60, 0}, {60, 60, 294});
  c.job.cell.tools = {tool};
  SensorSpec sensor;
  sensor.id = "detail";
  sensor.mesh_flange = box_mesh({62, -60, 95}, {195, 60, 215});
  c.job.cell.sensors = {sensor};
  const Vec3 foot = part_origin - Vec3(0, 0, 20);
  c.job.cell.obstacles = {{"table", box_mesh(foot + Vec3(-300, -300, -100), foot + Vec3(400, 400, -2))}};
  c.job.fixture.T_base_fixture.p_mm = foot;
  c.job.fixture.mesh_fixture = box_mesh({-20, -20, 0}, {kBlockX + 20, kBlockY + 20, 19});
  Recipe recipe;
  recipe.id = "deburr", recipe.tool = "cone", recipe.width_mm = 0.4, recipe.tolerance_mm = 0.1;
  recipe.feed_min_mm_s = 3, recipe.feed_max_mm_s = 40, recipe.approach_mm = 25, recipe.lead_mm = 2;
  c.job.recipes = {recipe};
  c.job.item_id = "block";
  c.job.part.brep.mesh = box_mesh(Vec3::Zero(), {kBlockX, kBlockY, kBlockZ});
  c.job.part.features = {{"top", "deburr", {0}}};
  c.location.T_base_part.p_mm = part_origin;
  AdaptedEdge edge;
  edge.edge = 0, edge.id = "#88", edge.feature = "top";
  for (double s = 0; s <= kBlockX; s += 0.5) {
    edge.s_mm.push_back(s);
    edge.nominal.push_back({s, 0, kBlockZ});
    edge.adapted.push_back({s, 0, kBlockZ});
  }
  c.features.edges = {edge};
  EdgeBurr burr;
  burr.edge_id = "#88";
  burr.height_upper_mm.assign(edge.s_mm.size(), 0.3);
  c.burrs.edges = {burr};
  c.path.passes = {edge_pass({0, 0, kBlockZ}, {kBlockX, 0, kBlockZ}, Vec3::UnitY())};
  return c;
}

}  // namespace asbuilt::test
