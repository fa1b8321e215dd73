// SPDX-License-Identifier: GPL-3.0-or-later
// The verifier's arm against the planner's: two derivations, one machine.
#include "planner/verify/arm.hpp"

#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt::verifying {
namespace {

JointVector random_posture(Random& random, const RobotSpec& spec) {
  JointVector q;
  for (std::size_t i = 0; i < 6; ++i) q[i] = random.uniform(0.9 * spec.joints[i].min_rad, 0.9 * spec.joints[i].max_rad);
  return q;
}

void expect_same_arm(const RobotSpec& spec) {
  const Arm arm(spec);
  const auto robot = Robot::from(spec);
  ASSERT_TRUE(robot);
  Random random(3);
  for (int k = 0; k < 500; ++k) {
    const JointVector q = random_posture(random, spec);
    const ArmState s = arm.state(q);
    const auto T = robot->forward(q);
    EXPECT_LT((s.flange.translation() - T.p_mm).norm(), 1e-8);
    EXPECT_LT((s.flange.linear() - T.rotation()).norm(), 1e-10);
    const auto links = robot->link_motion(q);
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_LT((s.link[i].translation() - links[i].p_mm).norm(), 1e-7) << i;
      EXPECT_LT((s.link[i].linear() - links[i].rotation()).norm(), 1e-10) << i;
    }
  }
}

TEST(Arm, agrees_with_the_planners_arm_for_opw_constants) {
  expect_same_arm(testing::six_axis_arm());
  RobotSpec shifted = testing::six_axis_arm();
  std::get<OpwParameters>(shifted.kinematics).b_mm = 35;
  std::get<OpwParameters>(shifted.kinematics).offsets_rad = {0.1, -1.2, 0.3, -0.2, 0.15, 0.4};
  expect_same_arm(shifted);
}

TEST(Arm, agrees_with_the_planners_arm_for_a_chain) {
  RobotSpec spec = testing::six_axis_arm();
  ChainKinematics c;
  const Vec3 axes[6] = {Vec3::UnitZ(), Vec3::UnitY(), Vec3::UnitY(), -Vec3::UnitX(), Vec3::UnitY(), -Vec3::UnitX()};
  const Vec3 offsets[6] = {{0, 0, 400}, {180, 0, 0}, {0, 0, 600}, {120, 0, 30}, {500, 0, 0}, {100, 0, 0}};
  for (int i = 0; i < 6; ++i) {
    ChainJoint j;
    j.name = "a" + std::to_string(i + 1), j.T_parent_joint.p_mm = offsets[i], j.axis = axes[i];
    c.joints.push_back(j);
  }
  c.T_last_tip.q = quat_from_zyx(0, kPi / 2, 0);
  spec.kinematics = c;
  expect_same_arm(spec);
}

TEST(Arm, follows_a_line_and_comes_back_to_the_same_joints) {
  const Arm arm(testing::six_axis_arm());
  const JointVector start{0.2, -1.6, 1.5, 0.3, 1.1, -0.4};
  const Eigen::Isometry3d from = arm.flange(start);
  JointVector q = start;
  for (int leg = 0; leg < 4; ++leg)
    for (int k = 1; k <= 50; ++k) {
      Eigen::Isometry3d T = from;
      const double f = 2.0 * k;
      const Vec3 corner[5] = {{0, 0, 0}, {100, 0, 0}, {100, 100, 0}, {0, 100, 0}, {0, 0, 0}};
      T.translation() += corner[leg] + f / 100 * (corner[leg + 1] - corner[leg]);
      const auto next = arm.follow(T, q);
      ASSERT_TRUE(next);
      q = *next;
      EXPECT_LT((arm.flange(q).translation() - T.translation()).norm(), 1e-6);
    }
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(q[i], start[i], 1e-8);
}

TEST(Arm, says_when_it_cannot_arrive) {
  const Arm arm(testing::six_axis_arm());
  Eigen::Isometry3d far = arm.flange({0, -1.5, 1.5, 0, 1, 0});
  far.translation() = Vec3(5000, 0, 0);
  EXPECT_FALSE(arm.follow(far, {0, -1.5, 1.5, 0, 1, 0}));
}

TEST(Arm, sees_the_wrists_singularity) {
  const Arm arm(testing::six_axis_arm());
  EXPECT_LT(arm.singularity_ratio({0.2, -1.6, 1.5, 0.3, 0.0, -0.4}), 1e-6);
  EXPECT_GT(arm.singularity_ratio({0.2, -1.6, 1.5, 0.3, 1.1, -0.4}), 0.02);
}

}  // namespace
}  // namespace asbuilt::verifying
