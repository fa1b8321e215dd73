// SPDX-License-Identifier: GPL-3.0-or-later
// The pieces: cutter outline, measured part, feeds that joints can follow, free moves.
#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/plan/motion/cutter_profile.hpp"
#include "planner/plan/motion/joint_feed.hpp"
#include "planner/plan/motion/ladder.hpp"
#include "planner/plan/motion/scanned_part.hpp"
#include "planner/robot/free_move.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

TEST(CutterProfile, ConeByHand) {
  const CutterProfile p = profile_of({CutterShape::cone, kPi / 2, 1, 8, 55, 8, 4});
  EXPECT_NEAR(p.cutting_height_mm, 3.5, 1e-12);
  EXPECT_NEAR(cutter_distance(p, {0, 0, 2}), 2, 1e-12);           // below the tip
  EXPECT_NEAR(cutter_distance(p, {10, 0, -20}), 6, 1e-12);        // beside the shank
  EXPECT_NEAR(cutter_distance(p, {0, 0, -20}), -4, 1e-12);        // on the axis
  const double s = std::sqrt(0.5);
  EXPECT_NEAR(cutter_distance(p, Vec3(2.25 + s, 0, -1.75 + s)), 1, 1e-12);  // square off the flank
}

TEST(CutterProfile, MeshHoldsTheSolidAndLittleMore) {
  Random random = Random::stream(51, "cutter");
  for (const Cutter& c : {Cutter{CutterShape::cone, kPi / 2, 1, 8, 55, 8, 4}, Cutter{CutterShape::cone, kPi / 3, 0, 10, 40, 6, 2},
                          Cutter{CutterShape::ball, 0, 0, 6, 50, 6, 2}, Cutter{CutterShape::cylinder, 0, 0, 12, 60, 10, 3}}) {
    const CutterProfile p = profile_of(c);
    const MeshQuery mesh(cutter_mesh(p, 0, p.length_mm));
    const MeshQuery low(cutter_mesh(p, 0, 7)), high(cutter_mesh(p, 7, p.length_mm));
    for (int k = 0; k < 400; ++k) {
      const Vec3 v(random.uniform(-8, 8), random.uniform(-8, 8), random.uniform(-65, 3));
      const double d = cutter_distance(p, v);
      if (d < -0.01) {
        EXPECT_TRUE(mesh.contains(v));
        EXPECT_TRUE(std::abs(v.z() + 7) < 1e-3 || low.contains(v) != high.contains(v));
      }
      EXPECT_TRUE(d < 0.15 || !mesh.contains(v));
    }
  }
}

TEST(CutterProfile, ShrunkIsInsideByAsMuch) {
  Random random = Random::stream(54, "core");
  for (const Cutter& c : {Cutter{CutterShape::cone, kPi / 2, 1, 8, 55, 8, 4}, Cutter{CutterShape::ball, 0, 0, 6, 50, 6, 2},
                          Cutter{CutterShape::cylinder, 0, 0, 12, 60, 10, 3}}) {
    const CutterProfile p = profile_of(c), core = shrunk(p, 1.2);
    ASSERT_GE(core.outline.size(), 3u);
    for (int k = 0; k < 2000; ++k) {
      const Vec3 v(random.uniform(-6, 6), random.uniform(-6, 6), random.uniform(-12, 1));
      if (cutter_distance(core, v) < 0) {
        EXPECT_LE(cutter_distance(p, v), -1.2 + 1e-6);
      } else if (cutter_distance(core, v) > 0.1 && v.z() > -9) {
        EXPECT_GE(cutter_distance(p, v), -1.2 - 1e-6);
      }
    }
  }
}

TEST(ScannedPart, MovesWithItsEdgesAndOnlyNearThem) {
  auto c = test::small_cell();
  for (Vec3& p : c.features.edges[0].adapted) p += Vec3(0, -0.7, 0.2);
  const Mesh m = scanned_part(c.job.part.brep.mesh, c.features);
  for (std::size_t i = 0; i < m.vertices.size(); ++i) {
    const Vec3 was = c.job.part.brep.mesh.vertices[i], moved = m.vertices[i] - was;
    const bool is_on_edge = was.y() == 0 && was.z() == 40, is_far = was.y() == 60;
    EXPECT_TRUE(!is_on_edge || (moved - Vec3(0, -0.7, 0.2)).norm() < 1e-12);
    EXPECT_TRUE(!is_far || moved.norm() < 1e-12);
  }
}

TEST(JointFeed, HoldsEveryLimitAndNeverRaisesAFeed) {
  Random random = Random::stream(52, "feeds");
  std::array<JointSpec, 6> joints;
  for (JointSpec& j : joints) j.speed_rad_s = 0.05, j.acceleration_rad_s2 = 0.3;
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<JointVector> q{JointVector{}};
    std::vector<Vec3> tip{Vec3::Zero()};
    std::vector<double> feed{20};
    JointVector rate;
    for (double& r : rate) r = random.uniform(-0.002, 0.002);
    for (int k = 0; k < 40; ++k) {
      const double step = random.uniform(0.2, 4);
      for (double& r : rate) r += random.uniform(-0.0002, 0.0002);
      JointVector next = q.back();
      for (int i = 0; i < 6; ++i) next[i] += rate[i] * step;
      q.push_back(next), tip.push_back(tip.back() + Vec3(step, 0, 0)), feed.push_back(random.uniform(5, 40));
      feed.back() = std::floor(feed.back() * 10) / 10;
    }
    const std::vector<double> asked = feed;
    ASSERT_FALSE(follow_with_joints(joints, 0.8, q, tip, 0.1, feed).has_value());
    for (std::size_t i = 1; i < q.size(); ++i) {
      EXPECT_LE(feed[i], asked[i]);
      const double length = (tip[i] - tip[i - 1]).norm();
      for (int j = 0; j < 6; ++j) {
        EXPECT_LE(std::abs(q[i][j] - q[i - 1][j]) * feed[i] / length, 0.8 * 0.05 + 1e-9);
        if (i + 1 == q.size()) continue;
        const double next = (tip[i + 1] - tip[i]).norm();
        const double change = (q[i + 1][j] - q[i][j]) * feed[i + 1] / next - (q[i][j] - q[i - 1][j]) * feed[i] / length;
        EXPECT_LE(std::abs(change) / std::max(0.02, 0.5 * (length / feed[i] + next / feed[i + 1])), 0.8 * 0.3 + 1e-6);
      }
    }
  }
}

TEST(Ladder, AsCheapAsTheBestOfAllWays) {
  Random random = Random::stream(53, "ladders");
  for (int trial = 0; trial < 300; ++trial) {
    const std::size_t rungs = 1 + random.below(5);
    std::vector<std::vector<double>> cost(rungs);
    for (auto& r : cost)
      for (std::size_t k = 1 + random.below(4); k > 0; --k) r.push_back(random.uniform() < 0.1 ? INFINITY : random.uniform());
    std::vector<std::vector<std::vector<double>>> step(rungs);
    for (std::size_t r = 1; r < rungs; ++r)
      for (std::size_t b = 0; b < cost[r].size(); ++b) {
        step[r].emplace_back();
        for (std::size_t a = 0; a < cost[r - 1].size(); ++a) step[r][b].push_back(random.uniform() < 0.3 ? INFINITY : random.uniform());
      }
    const auto total = [&](const std::vector<int>& way) {
      double t = 0;
      for (std::size_t r = 0; r < rungs; ++r) t += cost[r][way[r]] + (r > 0 ? step[r][way[r]][way[r - 1]] : 0.0);
      return t;
    };
    double best = INFINITY;
    std::vector<int> way(rungs, 0);
    for (bool more = true; more;) {
      best = std::min(best, total(way));
      more = false;
      for (std::size_t r = 0; r < rungs && !more; ++r) {
        if (++way[r] < static_cast<int>(cost[r].size())) more = true;
        else way[r] = 0;
      }
    }
    const auto found = climb_ladder(cost, [&](std::size_t r, int node, std::vector<LadderStep>& steps) {
      for (std::size_t a = 0; a < cost[r - 1].size(); ++a)
        if (step[r][node][a] < INFINITY) steps.push_back({static_cast<int>(a), step[r][node][a]});
    });
    ASSERT_EQ(found.has_value(), best < INFINITY);
    EXPECT_TRUE(!found || std::abs(total(*found) - best) < 1e-12);
  }
}

TEST(FreeMove, GoesRoundAWallAndIsTheSameEveryTime) {
  const auto c = test::small_cell();
  const Robot robot = *Robot::from(c.job.cell.robot);
  CollisionScene scene(robot);
  const int tool = scene.add("tool", kMountFlange, c.job.cell.tools[0].mesh_flange);
  JointVector a = c.job.cell.robot.home_rad, b = a;
  a[0] = -0.5, b[0] = 0.5;
  const Vec3 flange = robot.forward(c.job.cell.robot.home_rad).p_mm;
  const int wall = scene.add("wall", kMountBase, test::box_mesh(flange + Vec3(-250, -10, -600), flange + Vec3(250, 10, 100)));
  const std::vector<Watch> watches{{tool, wall, 5}};
  ASSERT_FALSE(scene.certify(watches, {{a, b}, false}).is_free);
  const auto way = find_free_move(scene, watches, a, b, 5000);
  ASSERT_TRUE(way.has_value());
  EXPECT_EQ(way->front(), a);
  EXPECT_EQ(way->back(), b);
  EXPECT_TRUE(scene.certify(watches, {*way, false}).is_free);
  for (int k = 0; k < 3; ++k) EXPECT_EQ(*find_free_move(scene, watches, a, b, 5000), *way);
}

}  // namespace
}  // namespace asbuilt
