// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/cell_scene.hpp"

#include <algorithm>

namespace asbuilt {

namespace {
constexpr double kCoreBeyond_mm = 1.0, kCoreMargin_mm = 0.2;
}

std::vector<Watch> CellScene::with_flute(double flute_part_margin_mm) const {
  std::vector<Watch> w = always;
  w.push_back({flute, part, flute_part_margin_mm});
  return w;
}

CellScene cell_scene(const Robot& robot, const Job& job, const Mesh& part, const Location& location, const ToolSpec& tool, double clearance_mm,
                     double flute_mm, double chamfer_mm) {
  CellScene c{CollisionScene(robot), profile_of(tool.cutter), -1, -1, -1, {}, {}, {}};
  std::vector<int> standing, moving;
  c.part = c.scene.add("part", kMountBase, transformed(location.T_base_part, part));
  standing.push_back(c.part);
  standing.push_back(c.scene.add("fixture", kMountBase, transformed(job.fixture.T_base_fixture, job.fixture.mesh_fixture)));
  for (const Obstacle& o : job.cell.obstacles) standing.push_back(c.scene.add("obstacle " + o.name, kMountBase, o.mesh_base));

  for (const LinkMesh& l : job.cell.robot.links) {
    const int b = c.scene.add(l.joint == 0 ? "robot base" : "robot link " + std::to_string(l.joint), l.joint, l.mesh);
    moving.push_back(b);
  }
  moving.push_back(c.scene.add("tool " + tool.id, kMountFlange, tool.mesh_flange));
  for (const SensorSpec& s : job.cell.sensors) moving.push_back(c.scene.add("sensor " + s.id, kMountFlange, s.mesh_flange));
  std::string without;  // a body that is not drawn is never in the way
  const auto missing = [&](bool is_missing, const std::string& name) {
    if (is_missing) without += (without.empty() ? "" : ", ") + name;
  };
  missing(part.triangles.empty(), "part");
  missing(job.fixture.mesh_fixture.triangles.empty(), "fixture");
  missing(tool.mesh_flange.triangles.empty(), "tool " + tool.id);
  for (const SensorSpec& s : job.cell.sensors) missing(s.mesh_flange.triangles.empty(), "sensor " + s.id);
  for (int k = 1; k <= 6; ++k)
    missing(std::none_of(job.cell.robot.links.begin(), job.cell.robot.links.end(),
                         [&](const LinkMesh& l) { return l.joint == k && !l.mesh.triangles.empty(); }),
            "robot link " + std::to_string(k));
  if (!without.empty())
    c.notes.push_back({Note::Level::warning, "motion.not_drawn", "no mesh is given, so nothing is known of their clearance: " + without, "cell"});

  // Directly above the cutting edge the cutter is as near to the work as the cut makes it; from one clearance higher on it is shank.
  const double split = std::min(c.profile.length_mm, c.profile.cutting_height_mm + clearance_mm);
  c.shank = c.scene.add("cutter shank", kMountFlange, transformed(tool.T_flange_tool, cutter_mesh(c.profile, split, c.profile.length_mm)));
  moving.push_back(c.shank);
  c.flute = c.scene.add("cutter", kMountFlange, transformed(tool.T_flange_tool, cutter_mesh(c.profile, 0, split)));

  for (auto m = moving.rbegin(); m != moving.rend(); ++m)  // what hangs lowest first: it fails first
    for (const int s : standing)
      if (c.scene.mount(*m) != kMountBase) c.always.push_back({*m, s, clearance_mm});
  for (std::size_t k = 1; k < standing.size(); ++k) c.always.push_back({c.flute, standing[k], flute_mm});

  const double off = std::min(chamfer_mm + kCoreBeyond_mm, 0.6 * c.profile.radius_max_mm);
  const CutterProfile core = shrunk(c.profile, off);
  if (off > chamfer_mm + 2 * kCoreMargin_mm && !core.outline.empty())
    c.core.push_back({c.scene.add("cutter core", kMountFlange, transformed(tool.T_flange_tool, cutter_mesh(core, 0, split))), c.part, kCoreMargin_mm});

  std::string left_out;
  for (std::size_t i = 0; i < moving.size(); ++i)
    for (std::size_t k = i + 1; k < moving.size(); ++k) {
      const int a = moving[i], b = moving[k];
      if (std::abs(c.scene.mount(a) - c.scene.mount(b)) < 2) continue;  // neighbours touch in their joint
      if (c.scene.separation(a, b, robot.spec().home_rad, clearance_mm).distance_mm < clearance_mm) {
        left_out += (left_out.empty() ? "" : "; ") + c.scene.name(a) + " and " + c.scene.name(b);
        continue;
      }
      c.always.push_back({a, b, clearance_mm});
    }
  if (!left_out.empty())
    c.notes.push_back({Note::Level::note, "motion.pairs_left_out", "nearer than the clearance at home and so not watched: " + left_out, "cell"});
  return c;
}

std::string pair_name(const CellScene& cell, const Watch& watch) { return cell.scene.name(watch.a) + " and " + cell.scene.name(watch.b); }

}  // namespace asbuilt
