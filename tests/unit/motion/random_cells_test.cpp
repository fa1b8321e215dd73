// SPDX-License-Identifier: GPL-3.0-or-later
// Cells drawn at random: every one is planned soundly or refused with a reason of this room, and what is planned keeps clear in a
// dense replay that shares only the distance function.
#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "planner/plan/motion/motion.hpp"
#include "planner/robot/collision.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

test::SmallCell random_cell(Random& random) {
  auto c = test::small_cell({random.uniform(600, 2100), random.uniform(-700, 700), random.uniform(200, 1100)});
  const double yaw = random.uniform(-3, 3), tilt = random.uniform() < 0.5 ? 0 : random.uniform(-0.4, 0.4);
  c.location.T_base_part.q = Eigen::AngleAxisd(yaw, Vec3::UnitZ()) * Eigen::AngleAxisd(tilt, Vec3::UnitX());
  c.job.fixture.T_base_fixture.q = c.location.T_base_part.q;
  if (random.uniform() < 0.7) c.job.cell.obstacles.clear();
  c.path.passes.clear();
  const Vec3 corner[4] = {{0, 0, 40}, {100, 0, 40}, {100, 60, 40}, {0, 60, 40}};
  const Vec3 inward[4] = {Vec3::UnitY(), -Vec3::UnitX(), -Vec3::UnitY(), Vec3::UnitX()};
  for (int e = 0; e < 4; ++e) c.path.passes.push_back(test::edge_pass(corner[e], corner[(e + 1) % 4], inward[e]));
  for (std::uint64_t n = random.below(4); n > 0; --n) {
    const Vec3 at = c.location.T_base_part.p_mm + Vec3(random.uniform(-400, 400), random.uniform(-400, 400), random.uniform(-100, 500));
    c.job.cell.obstacles.push_back(
        {"box " + std::to_string(n), test::box_mesh(at, at + Vec3(random.uniform(5, 200), random.uniform(5, 200), random.uniform(5, 200)))});
  }
  return c;
}

TEST(RandomCells, PlannedSoundlyOrRefused) {
  Random random = Random::stream(61, "random cells");
  int planned = 0, refused = 0;
  for (int k = 0; k < 16; ++k) {
    const auto c = random_cell(random);
    MotionRecipe recipe;
    recipe.planner_iterations_count = 500;
    const auto m = plan_motion(recipe, c.job, c.location, c.features, c.burrs, c.path);
    if (!m) {
      ++refused;
      EXPECT_EQ(m.error().front().code.rfind("motion.", 0), 0u) << m.error().front().code;
      EXPECT_FALSE(m.error().front().where.empty());
      continue;
    }
    ++planned;
    CollisionScene scene(*Robot::from(c.job.cell.robot));
    std::vector<int> moving{scene.add("tool", kMountFlange, c.job.cell.tools[0].mesh_flange),
                            scene.add("sensor", kMountFlange, c.job.cell.sensors[0].mesh_flange)};
    for (const LinkMesh& l : c.job.cell.robot.links)
      if (l.joint > 0) moving.push_back(scene.add("link", l.joint, l.mesh));
    std::vector<int> standing{scene.add("part", kMountBase, transformed(c.location.T_base_part, c.job.part.brep.mesh)),
                              scene.add("fixture", kMountBase, transformed(c.job.fixture.T_base_fixture, c.job.fixture.mesh_fixture))};
    for (const Obstacle& o : c.job.cell.obstacles) standing.push_back(scene.add(o.name, kMountBase, o.mesh_base));
    double least = 1e9;
    for (const MotionSegment& s : m->artefact.segments)
      for (std::size_t i = 1; i < s.q_rad.size(); ++i)
        for (int f = 0; f <= 6; ++f) {
          JointVector q;
          for (int j = 0; j < 6; ++j) q[j] = s.q_rad[i - 1][j] + (s.q_rad[i][j] - s.q_rad[i - 1][j]) * f / 6;
          for (const int a : moving)
            for (const int b : standing) least = std::min(least, scene.separation(a, b, q, 20).distance_mm);
        }
    EXPECT_GE(least, 2.9) << "case " << k;
  }
  EXPECT_GT(planned, 3);
  EXPECT_GT(refused, 1);
}

}  // namespace
}  // namespace asbuilt
