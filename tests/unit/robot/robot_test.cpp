// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of the arm's kinematics: round trips over random poses, every turn inside the limits, singular wrists, derivatives.
#include "planner/robot/robot.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "planner/base/random.hpp"
#include "tests/unit/robot/arms.hpp"

namespace asbuilt {
namespace {

using test::large_arm;
using test::odd_arm;

Robot robot_of(const RobotSpec& s) {
  auto r = Robot::from(s);
  EXPECT_TRUE(r.has_value());
  return *r;
}

JointVector random_joints(const RobotSpec& s, Random& random) {
  JointVector q;
  for (int i = 0; i < 6; ++i) q[i] = random.uniform(s.joints[i].min_rad, s.joints[i].max_rad);
  return q;
}

double pose_error_mm(const Pose<frame::Base, frame::Flange>& a, const Pose<frame::Base, frame::Flange>& b) {
  return (a.p_mm - b.p_mm).norm() + 1000 * (a.rotation() - b.rotation()).norm();
}

TEST(Robot, ForwardOfTheLargeArmByHand) {
  const Robot r = robot_of(large_arm());
  // theta = (0, -100 + 90, 100, 0, 90, 0) deg: forearm at 90 deg, flange looking down.
  const auto T = r.forward(large_arm().home_rad);
  const double a = rad_from_deg(-10);
  const Vec3 want(300 + 1000 * std::sin(a) + 1080, 0, 750 + 1000 * std::cos(a) + 150 - 220);
  EXPECT_LT((T.p_mm - want).norm(), 1e-9);
  EXPECT_LT((T.direction(Vec3::UnitZ()) - Vec3(0, 0, -1)).norm(), 1e-12);
}

TEST(Robot, InverseReproducesThePoseAndHoldsTheStartingJoints) {
  for (const RobotSpec& s : {large_arm(), odd_arm()}) {
    const Robot r = robot_of(s);
    Random random = Random::stream(7, "inverse");
    double worst = 0;
    int missed = 0;
    for (int k = 0; k < 50000; ++k) {
      const JointVector q = random_joints(s, random);
      const auto T = r.forward(q);
      bool is_found = false;
      for (const JointVector& v : r.inverse(T)) {
        worst = std::max(worst, pose_error_mm(r.forward(v), T));
        EXPECT_GE(r.joint_margin_rad(v), -1e-8);
        double d = 0;
        for (int i = 0; i < 6; ++i) d = std::max(d, std::abs(v[i] - q[i]));
        is_found |= d < 1e-6;
      }
      missed += !is_found;
    }
    EXPECT_LT(worst, 1e-6) << s.model;
    EXPECT_EQ(missed, 0) << s.model;
  }
}

TEST(Robot, EveryFullTurnInsideTheLimitsIsReturned) {
  const Robot r = robot_of(odd_arm());  // every joint may turn twice about: 2^6 turns of each branch
  const auto T = r.forward({0.2, 0.9, -0.3, 0.5, 0.7, -0.6});
  const auto all = r.inverse(T);
  ASSERT_FALSE(all.empty());
  EXPECT_EQ(all.size() % 64, 0u);
  auto sorted = all;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(std::unique(sorted.begin(), sorted.end()), sorted.end());
  EXPECT_EQ(all, r.inverse(T));
}

TEST(Robot, OutOfReachHasNoSolution) {
  const Robot r = robot_of(large_arm());
  EXPECT_TRUE(r.inverse({Eigen::Quaterniond::Identity(), Vec3(2800, 0, 700)}).empty());
  EXPECT_TRUE(r.inverse({Eigen::Quaterniond::Identity(), Vec3(0, 0, 1e6)}).empty());
}

TEST(Robot, SingularWristKeepsJointFour) {
  const Robot r = robot_of(large_arm());
  for (const double q4 : {-1.3, 0.0, 0.4, 2.0}) {
    JointVector q{0.3, -1.7, 1.1, q4, 0, 0.9};
    const auto T = r.forward(q);
    for (const JointVector& v : r.inverse(T)) EXPECT_LT(pose_error_mm(r.forward(v), T), 1e-6);
    ASSERT_FALSE(r.inverse(T).empty());
    const auto near = r.inverse_near(T, q);
    ASSERT_TRUE(near.has_value());
    for (int i = 0; i < 6; ++i) EXPECT_NEAR((*near)[i], q[i], 1e-6);
    EXPECT_LT(r.singularity_ratio(q), 1e-7);
  }
}

TEST(Robot, NearlySingularWristStaysExact) {
  const Robot r = robot_of(large_arm());
  for (const double q5 : {1e-3, 1e-6, 1e-8, 3e-9, 1e-9, 1e-10}) {
    const JointVector q{0.3, -1.7, 1.1, 0.7, q5, 0.9};
    const auto T = r.forward(q);
    const auto all = r.inverse(T);
    ASSERT_FALSE(all.empty());
    for (const JointVector& v : all) EXPECT_LT(pose_error_mm(r.forward(v), T), 2e-6) << q5;
  }
}

/// However the hand is turned, an arm that stands as at home is expected to stand so: half a turn of the hand is no reason to reach
/// over the shoulder.
TEST(Robot, TheExpectedSolutionKeepsShoulderAndElbow) {
  const Robot r = robot_of(large_arm());
  const JointVector home{0, rad_from_deg(-100), rad_from_deg(100), 0, rad_from_deg(90), 0};
  Random random = Random::stream(17, "expected");
  int seen = 0;
  for (int k = 0; k < 500; ++k) {
    const JointVector q{random.uniform(-1, 1), random.uniform(-2.1, -1.2), random.uniform(1.3, 2.2), random.uniform(-0.5, 0.5), random.uniform(0.5, 1.8), random.uniform(-3.2, 3.2)};
    if ((r.branch(q) & 3) != (r.branch(home) & 3)) continue;
    ++seen;
    const auto found = r.inverse_like(r.forward(q), home);
    ASSERT_TRUE(found.has_value());
    EXPECT_LT(pose_error_mm(r.forward(*found), r.forward(q)), 1e-6);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR((*found)[i], q[i], 1e-6) << k;
  }
  EXPECT_GT(seen, 300);
}

TEST(Robot, NearestSolutionIsTheNearest) {
  const RobotSpec s = large_arm();
  const Robot r = robot_of(s);
  Random random = Random::stream(9, "nearest");
  for (int k = 0; k < 500; ++k) {
    const auto T = r.forward(random_joints(s, random));
    const JointVector near = random_joints(s, random);
    const auto got = r.inverse_near(T, near);
    ASSERT_TRUE(got.has_value());
    const auto distance = [&](const JointVector& v) {
      double d = 0;
      for (int i = 0; i < 6; ++i) d = std::max(d, std::abs(v[i] - near[i]));
      return d;
    };
    for (const JointVector& v : r.inverse(T)) EXPECT_LE(distance(*got), distance(v) + 1e-9);
  }
}

TEST(Robot, BranchIsTheSameForAllTurnsAndDiffersBetweenSolutions) {
  const RobotSpec s = odd_arm();
  const Robot r = robot_of(s);
  Random random = Random::stream(10, "branch");
  for (int k = 0; k < 50; ++k) {
    std::map<int, JointVector> principal;
    for (const JointVector& v : r.inverse(r.forward(random_joints(s, random)))) {
      const auto [at, is_new] = principal.emplace(r.branch(v), v);
      if (is_new) continue;
      for (int i = 0; i < 6; ++i) EXPECT_NEAR(std::remainder(v[i] - at->second[i], 2 * kPi), 0, 1e-9);
    }
  }
}

TEST(Robot, JacobianIsTheDerivativeOfForward) {
  const RobotSpec s = odd_arm();
  const Robot r = robot_of(s);
  Random random = Random::stream(11, "jacobian");
  for (int k = 0; k < 50; ++k) {
    const JointVector q = random_joints(s, random);
    const Vec3 p_flange(30, -20, 150);
    const auto T = r.forward(q);
    const Mat6 j = r.jacobian(q, T.point(p_flange));
    for (int i = 0; i < 6; ++i) {
      const double h = 1e-5;
      JointVector a = q, b = q;
      a[i] -= h, b[i] += h;
      const auto Ta = r.forward(a), Tb = r.forward(b);
      const Vec3 v = (Tb.point(p_flange) - Ta.point(p_flange)) / (2 * h);
      const Vec3 w = quat_log(Tb.q * Ta.q.conjugate()) / (2 * h);
      EXPECT_LT((j.col(i).head<3>() - v).norm(), 1e-4);
      EXPECT_LT((j.col(i).tail<3>() - w).norm(), 1e-8);
    }
  }
}

TEST(Robot, LinksMoveAsTheFlangeDoes) {
  const RobotSpec s = odd_arm();
  const Robot r = robot_of(s);
  Random random = Random::stream(12, "links");
  const auto zero = r.forward(JointVector{});
  for (int k = 0; k < 50; ++k) {
    const JointVector q = random_joints(s, random);
    const auto links = r.link_motion(q);
    EXPECT_LT(links[0].p_mm.norm(), 1e-12);
    EXPECT_LT(pose_error_mm(links[6] * zero, r.forward(q)), 1e-8);
    // link 2 hangs on joints 1 and 2 only
    JointVector q2 = q;
    for (int i = 2; i < 6; ++i) q2[i] = random.uniform(-3, 3);
    EXPECT_LT((links[2].p_mm - r.link_motion(q2)[2].p_mm).norm(), 1e-9);
  }
  for (const auto& T : r.link_motion(JointVector{})) EXPECT_LT(T.p_mm.norm() + (T.rotation() - Mat3::Identity()).norm(), 1e-9);
}

/// The same arm given as a chain of joints is found to be OPW and answers alike.
TEST(Robot, ConstantsAreDerivedFromAnEquivalentChain) {
  for (const RobotSpec& s : {large_arm(), odd_arm()}) {
    const Robot given = robot_of(s);
    RobotSpec c = s;
    ChainKinematics chain;
    const auto axes = given.axes(JointVector{});
    Pose<frame::Base, frame::Base> before;
    Random random = Random::stream(13, "chain frames");
    for (int i = 0; i < 6; ++i) {  // frames turned at random and slid along their axes
      const Eigen::Quaterniond q = quat_exp(Vec3(random.normal(), random.normal(), random.normal()));
      const Pose<frame::Base, frame::Base> here(q, axes[i].second + axes[i].first * random.uniform(-100, 100));
      ChainJoint j;
      j.T_parent_joint = before.inverse() * here;
      j.axis = q.conjugate() * axes[i].first;
      chain.joints.push_back(j);
      before = here;
    }
    const auto flange = given.forward(JointVector{});
    chain.T_last_tip = before.inverse() * Pose<frame::Base, frame::Base>(flange.q, flange.p_mm);
    c.kinematics = chain;
    const Robot derived = robot_of(c);
    ASSERT_TRUE(derived.is_opw());
    const OpwParameters &o = *derived.opw(), &want = *given.opw();
    EXPECT_NEAR(o.a1_mm, want.a1_mm, 1e-8);
    EXPECT_NEAR(o.a2_mm, want.a2_mm, 1e-8);
    EXPECT_NEAR(std::abs(o.b_mm), std::abs(want.b_mm), 1e-8);
    EXPECT_NEAR(o.c2_mm, want.c2_mm, 1e-8);
    EXPECT_NEAR(o.c3_mm, want.c3_mm, 1e-8);
    EXPECT_NEAR(o.c4_mm, want.c4_mm, 1e-8);
    for (int k = 0; k < 200; ++k) {
      const JointVector q = random_joints(s, random);
      const auto T = given.forward(q);
      EXPECT_LT(pose_error_mm(derived.forward(q), T), 1e-8);
      auto a = given.inverse(T), b = derived.inverse(T);
      std::sort(a.begin(), a.end()), std::sort(b.begin(), b.end());
      ASSERT_EQ(a.size(), b.size());
      for (std::size_t n = 0; n < a.size(); ++n)
        for (int i = 0; i < 6; ++i) EXPECT_NEAR(a[n][i], b[n][i], 1e-6);
    }
  }
}

TEST(Robot, BadKinematicsAreRefused) {
  RobotSpec s = large_arm();
  std::get<OpwParameters>(s.kinematics).c2_mm = 0;
  auto r = Robot::from(s);
  ASSERT_FALSE(r.has_value());
  EXPECT_EQ(r.error()[0].code, "robot.bad_kinematics");
  s = large_arm();
  s.joints[3].max_rad = s.joints[3].min_rad;
  EXPECT_FALSE(Robot::from(s).has_value());
  s = large_arm();
  s.kinematics = ChainKinematics{};
  EXPECT_FALSE(Robot::from(s).has_value());
}

}  // namespace
}  // namespace asbuilt
