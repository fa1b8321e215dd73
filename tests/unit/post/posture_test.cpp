// SPDX-License-Identifier: GPL-3.0-or-later
// The arm's form as RCONF names it: postures known by construction, and the same form from both ways to describe an arm.
#include <gtest/gtest.h>

#include "postprocessors/inform/posture.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;
using inform::FlipRule;
using inform::posture_of;

JointVector degrees(double a, double b, double c, double d, double e, double f) {
  return {rad_from_deg(a), rad_from_deg(b), rad_from_deg(c), rad_from_deg(d), rad_from_deg(e), rad_from_deg(f)};
}

TEST(InformPosture, home_is_front_upper_flip) {
  const auto p = posture_of(post_context().cell.robot, degrees(0, -100, 100, 0, 90, 0), FlipRule::r_axis);
  EXPECT_FALSE(p.is_rear || p.is_lower_arm || p.is_no_flip || p.is_r_beyond || p.is_t_beyond || p.is_s_beyond);
}

TEST(InformPosture, wrist_behind_the_first_axis_is_rear) {
  EXPECT_TRUE(posture_of(post_context().cell.robot, degrees(0, -150, -50, 0, 90, 0), FlipRule::r_axis).is_rear);
  EXPECT_TRUE(posture_of(post_context().cell.robot, degrees(120, -150, -50, 0, 90, 0), FlipRule::r_axis).is_rear);  // whatever axis 1 does
}

TEST(InformPosture, elbow_below_the_line_is_lower_arm) {
  EXPECT_TRUE(posture_of(post_context().cell.robot, degrees(0, 20, -100, 0, 90, 0), FlipRule::r_axis).is_lower_arm);
}

TEST(InformPosture, both_rules_of_flip) {
  const RobotSpec& r = post_context().cell.robot;
  for (double deg : {0.0, 89.0, -89.0, 271.0, -271.0, 359.0}) EXPECT_FALSE(posture_of(r, degrees(0, -100, 100, deg, 90, 0), FlipRule::r_axis).is_no_flip) << deg;
  for (double deg : {91.0, 180.0, -91.0, 269.0}) EXPECT_TRUE(posture_of(r, degrees(0, -100, 100, deg, 90, 0), FlipRule::r_axis).is_no_flip) << deg;
  EXPECT_TRUE(posture_of(r, degrees(0, -100, 100, 0, -20, 0), FlipRule::b_axis).is_no_flip);
  EXPECT_FALSE(posture_of(r, degrees(0, -100, 100, 180, 20, 0), FlipRule::b_axis).is_no_flip);
}

TEST(InformPosture, turns_beyond_half_a_turn) {
  const auto p = posture_of(post_context().cell.robot, degrees(190, -100, 100, -200, 90, 181), FlipRule::r_axis);
  EXPECT_TRUE(p.is_r_beyond && p.is_t_beyond && p.is_s_beyond);
  EXPECT_FALSE(posture_of(post_context().cell.robot, degrees(180, -100, 100, -179, 90, 180), FlipRule::r_axis).is_s_beyond);
}

/// The same arm as a chain of joints has the same form.
TEST(InformPosture, chain_and_parameters_agree) {
  const RobotSpec opw = post_context().cell.robot;
  RobotSpec chain = opw;
  ChainKinematics k;
  const auto joint = [&](double x, double z, const Vec3& axis) {
    ChainJoint j;
    j.T_parent_joint = {Eigen::Quaterniond::Identity(), Vec3(x, 0, z)};
    j.axis = axis;
    k.joints.push_back(j);
  };
  joint(0, 0, Vec3::UnitZ()), joint(300, 750, Vec3::UnitY()), joint(0, 1000, Vec3::UnitY()), joint(-150, 500, Vec3::UnitZ());
  joint(0, 580, Vec3::UnitY()), joint(0, 220, Vec3::UnitZ());
  chain.kinematics = k;
  Random random(5);
  int rear = 0, lower = 0;
  for (int n = 0; n < 2000; ++n) {
    JointVector q{}, theta{};
    const auto& p = std::get<OpwParameters>(opw.kinematics);
    for (int i = 0; i < 6; ++i) {
      q[i] = random.uniform(opw.joints[i].min_rad, opw.joints[i].max_rad);
      theta[i] = p.signs[i] * q[i] - p.offsets_rad[i];
    }
    const auto a = posture_of(opw, q, FlipRule::r_axis), b = posture_of(chain, theta, FlipRule::r_axis);
    ASSERT_EQ(a.is_rear, b.is_rear) << n;
    ASSERT_EQ(a.is_lower_arm, b.is_lower_arm) << n;
    rear += a.is_rear, lower += a.is_lower_arm;
  }
  EXPECT_GT(rear, 100);
  EXPECT_GT(lower, 100);
}

}  // namespace
}  // namespace asbuilt
