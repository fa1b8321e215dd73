// SPDX-License-Identifier: GPL-3.0-or-later
// Distances of bodies on an arm and motion certificates, against brute force and against the cases where FCL alone is wrong.
#include "planner/robot/collision.hpp"

#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "tests/unit/robot/arms.hpp"
#include "tests/unit/robot/shapes.hpp"

namespace asbuilt {
namespace {

using test::box_mesh;

const JointVector kReady{0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};

struct Cell {
  Robot robot = *Robot::from(test::large_arm());
  CollisionScene scene{robot};
};

/// Smallest distance over a dense walk of the straight joint move.
double brute_force(const CollisionScene& scene, int a, int b, const JointVector& from, const JointVector& to, int steps) {
  double least = 1e9;
  for (int k = 0; k <= steps; ++k) {
    JointVector q;
    for (int i = 0; i < 6; ++i) q[i] = from[i] + (to[i] - from[i]) * k / steps;
    least = std::min(least, scene.separation(a, b, q).distance_mm);
  }
  return least;
}

TEST(Collision, DistanceOfTwoBoxesIsExactWithItsPlace) {
  Cell c;
  const Vec3 flange = c.robot.forward(kReady).p_mm;
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-20, -20, 0}, {20, 20, 300}));
  // the flange looks down: the tool ends 300 below it
  const int table = c.scene.add("table", kMountBase, box_mesh(flange + Vec3(-300, -300, -400), flange + Vec3(300, 300, -312.5)));
  const Separation s = c.scene.separation(tool, table, kReady);
  EXPECT_TRUE(s.is_exact);
  EXPECT_NEAR(s.distance_mm, 12.5, 1e-6);
  EXPECT_NEAR(s.p_base.z(), flange.z() - 300 - 6.25, 1e-6);
  EXPECT_LT((s.p_base - flange).head<2>().norm(), 29);
}

TEST(Collision, ABodyInsideAnotherIsInContact) {
  Cell c;
  const Vec3 flange = c.robot.forward(kReady).p_mm;
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-20, -20, 10}, {20, 20, 100}));
  const int box = c.scene.add("box", kMountBase, box_mesh(flange - Vec3::Constant(400), flange + Vec3::Constant(400)));
  EXPECT_EQ(c.scene.separation(tool, box, kReady).distance_mm, 0);
  EXPECT_EQ(c.scene.separation(box, tool, kReady).distance_mm, 0);
  const Certificate k = c.scene.certify({{tool, box, 1.0}}, {{kReady}, false});
  EXPECT_FALSE(k.is_free);
}

TEST(Collision, LowerBoundNeverExceedsTheDistance) {
  Cell c;
  Random random = Random::stream(31, "bounds");
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-75, -75, 0}, {75, 75, 295}));
  const int arm = c.scene.add("arm", 3, box_mesh({1185, -130, 640}, {1540, 130, 1030}));
  const int block = c.scene.add("block", kMountBase, box_mesh({1100, -200, 300}, {1500, 200, 700}));
  for (int k = 0; k < 400; ++k) {
    JointVector q = kReady;
    for (double& a : q) a += random.uniform(-0.6, 0.6);
    for (const auto& [a, b] : {std::pair{tool, block}, {arm, block}, {tool, arm}}) {
      const double exact = c.scene.separation(a, b, q).distance_mm;
      const Separation fast = c.scene.separation(a, b, q, 0.5 * exact);
      EXPECT_LE(fast.distance_mm, exact + 1e-9);
      EXPECT_TRUE(fast.is_exact || fast.distance_mm >= 0.5 * exact);
    }
  }
}

/// A thin blade on the flange sweeps past a thin post: FCL's continuous mode calls these free.
TEST(Collision, AThinBladeThroughAThinPostIsFound) {
  Cell c;
  const int blade = c.scene.add("blade", kMountFlange, box_mesh({0, -0.5, 0}, {400, 0.5, 10}));
  const Mesh post_flange = box_mesh(Vec3(230, 95, -40), Vec3(230.4, 95.4, 40));  // 22 degrees from the blade's middle
  const auto T = c.robot.forward(kReady);
  const int post = c.scene.add("post", kMountBase, transformed(T, post_flange));
  JointVector a = kReady, b = kReady;
  a[5] -= rad_from_deg(60), b[5] += rad_from_deg(60);
  EXPECT_GT(c.scene.separation(blade, post, a).distance_mm, 20);
  EXPECT_GT(c.scene.separation(blade, post, b).distance_mm, 20);
  for (const bool forth : {true, false}) {
    const Certificate k = c.scene.certify({{blade, post, 0.1}}, {forth ? std::vector{a, b} : std::vector{b, a}, false});
    EXPECT_FALSE(k.is_free);
    EXPECT_LT((k.p_base - T.point(Vec3(230, 95, 5))).norm(), 50);
  }
}

TEST(Collision, ATinyPlateThroughAThinWallIsFound) {
  Cell c;
  const Vec3 flange = c.robot.forward(kReady).p_mm;
  const int plate = c.scene.add("plate", kMountFlange, box_mesh({-1, -0.2, 50}, {1, 0.2, 52}));
  const int wall = c.scene.add("wall", kMountBase, box_mesh(flange + Vec3(-300, 30, -300), flange + Vec3(300, 30.4, 300)));
  // 100 mm through the wall, straight for the flange
  const auto T = c.robot.forward(kReady);
  const auto to = c.robot.inverse_near({T.q, T.p_mm + Vec3(0, 100, 0)}, kReady);
  ASSERT_TRUE(to.has_value());
  EXPECT_GT(c.scene.separation(plate, wall, kReady).distance_mm, 20);
  EXPECT_GT(c.scene.separation(plate, wall, *to).distance_mm, 20);
  for (const bool is_linear : {true, false}) {
    const Certificate k = c.scene.certify({{plate, wall, 0.05}}, {{kReady, *to}, is_linear});
    EXPECT_FALSE(k.is_free) << is_linear;
  }
}

TEST(Collision, CertificateAgainstBruteForceOnRandomMotions) {
  Cell c;
  Random random = Random::stream(32, "certificates");
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-75, -75, 0}, {75, 75, 295}));
  const int fore = c.scene.add("forearm", 4, box_mesh({1545, -95, 805}, {2275, 95, 995}));
  const int upper = c.scene.add("upper arm", 2, box_mesh({160, -120, 635}, {1410, 120, 865}));
  const int block = c.scene.add("block", kMountBase, box_mesh({1150, -150, 700}, {1450, 150, 1260}));
  int free_count = 0, hit_count = 0;
  for (int k = 0; k < 250; ++k) {
    JointVector a = kReady, b;
    for (double& v : a) v += random.uniform(-0.5, 0.5);
    b = a;
    for (double& v : b) v += random.uniform(-0.4, 0.4);
    for (const auto& [x, y] : {std::pair{tool, block}, {fore, block}, {tool, upper}}) {
      const double margin = 3;
      const double least = brute_force(c.scene, x, y, a, b, 60);
      const Certificate certificate = c.scene.certify({{x, y, margin}}, {{a, b}, false});
      if (certificate.is_free) {
        ++free_count;
        EXPECT_GE(least, margin);
        EXPECT_LE(certificate.clearance_mm, least + 1e-6);
      } else {
        ++hit_count;
        EXPECT_LT(certificate.clearance_mm, margin + 0.05);
        EXPECT_NEAR(c.scene.separation(x, y, certificate.q_rad).distance_mm, certificate.clearance_mm, 1e-6);
      }
      EXPECT_TRUE(certificate.is_free || least <= margin + 2) << "a motion with room to spare is certified";
    }
  }
  EXPECT_GT(free_count, 100);
  EXPECT_GT(hit_count, 50);
}

/// The tool's tip moves straight while the flange turns about it by up to 30 degrees: the flange itself runs on an arc.
TEST(Collision, CertificateOfStraightMovesOfATipAgainstBruteForce) {
  Cell c;
  Random random = Random::stream(34, "straight tip");
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-75, -75, 0}, {75, 75, 295}));
  const int fore = c.scene.add("forearm", 4, box_mesh({1545, -95, 805}, {2275, 95, 995}));
  const int block = c.scene.add("block", kMountBase, box_mesh({1150, -150, 700}, {1450, 150, 1160}));
  const Pose<frame::Flange, frame::Tool> T_flange_tool(Eigen::Quaterniond::Identity(), Vec3(0, 0, 350));
  int free_count = 0, hit_count = 0;
  for (int k = 0; k < 120; ++k) {
    JointVector q = kReady;
    for (double& v : q) v += random.uniform(-0.3, 0.3);
    const auto A = c.robot.forward(q) * T_flange_tool;
    const Pose<frame::Base, frame::Tool> B((A.q * quat_exp(0.3 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)))).normalized(),
                                           A.p_mm + Vec3(random.uniform(-50, 50), random.uniform(-50, 50), random.uniform(-50, 50)));
    const auto at = [&](double t) { return Pose<frame::Base, frame::Tool>(A.q.slerp(t, B.q).normalized(), A.p_mm + t * (B.p_mm - A.p_mm)) * T_flange_tool.inverse(); };
    JointPath path{{q}, true, T_flange_tool.p_mm};
    bool ok = true;
    for (int s = 1; s <= 6 && ok; ++s) {
      const auto n = c.robot.inverse_near(at(s / 6.0), path.q_rad.back());
      ok = n.has_value();
      if (ok) path.q_rad.push_back(*n);
    }
    if (!ok) continue;
    for (const int body : {tool, fore}) {
      double least = 1e9;
      JointVector v = q;
      for (int s = 0; s <= 120; ++s) {
        v = *c.robot.inverse_near(at(s / 120.0), v);
        least = std::min(least, c.scene.separation(body, block, v).distance_mm);
      }
      const Certificate certificate = c.scene.certify({{body, block, 3}}, path);
      (certificate.is_free ? free_count : hit_count) += 1;
      EXPECT_TRUE(!certificate.is_free || (least >= 3 - 1e-6 && certificate.clearance_mm <= least + 1e-6));
      EXPECT_TRUE(certificate.is_free || least <= 5);
    }
  }
  EXPECT_GT(free_count, 50);
  EXPECT_GT(hit_count, 10);
}

TEST(Collision, CertificateOfStraightMovesAgainstBruteForce) {
  Cell c;
  Random random = Random::stream(33, "straight");
  const int tool = c.scene.add("tool", kMountFlange, box_mesh({-75, -75, 0}, {75, 75, 295}));
  const int fore = c.scene.add("forearm", 4, box_mesh({1545, -95, 805}, {2275, 95, 995}));
  const int block = c.scene.add("block", kMountBase, box_mesh({1150, -150, 500}, {1450, 150, 760}));
  int free_count = 0;
  for (int k = 0; k < 150; ++k) {
    JointVector q = kReady;
    for (double& v : q) v += random.uniform(-0.3, 0.3);
    const auto A = c.robot.forward(q);
    JointPath path{{q}, true};
    Pose<frame::Base, frame::Flange> B(
        (A.q * quat_exp(Vec3(random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2)))).normalized(),
        A.p_mm + Vec3(random.uniform(-150, 150), random.uniform(-150, 150), random.uniform(-150, 50)));
    bool ok = true;
    for (int s = 1; s <= 8 && ok; ++s) {
      const auto n = c.robot.inverse_near({A.q.slerp(s / 8.0, B.q), A.p_mm + s / 8.0 * (B.p_mm - A.p_mm)}, path.q_rad.back());
      ok = n.has_value();
      if (ok) path.q_rad.push_back(*n);
    }
    if (!ok) continue;
    for (const int body : {tool, fore}) {
      double least = 1e9;
      JointVector at = q;
      for (int s = 0; s <= 160; ++s) {
        const auto n = c.robot.inverse_near({A.q.slerp(s / 160.0, B.q), A.p_mm + s / 160.0 * (B.p_mm - A.p_mm)}, at);
        ASSERT_TRUE(n.has_value());
        at = *n;
        least = std::min(least, c.scene.separation(body, block, at).distance_mm);
      }
      const Certificate certificate = c.scene.certify({{body, block, 3}}, path);
      if (certificate.is_free) {
        ++free_count;
        EXPECT_GE(least, 3 - 1e-6);
        EXPECT_LE(certificate.clearance_mm, least + 1e-6);
      }
      EXPECT_TRUE(certificate.is_free || least <= 5);
    }
  }
  EXPECT_GT(free_count, 60);
}

}  // namespace
}  // namespace asbuilt
