// SPDX-License-Identifier: GPL-3.0-or-later
#include "postprocessors/inform/posture.hpp"

#include <cmath>

namespace asbuilt::inform {
namespace {

struct ArmPoints {  // in the arm's plane: x outward from the first axis at its present angle, z along it
  Vec2 shoulder, elbow, wrist;
};

ArmPoints arm_of(const OpwParameters& k, const JointVector& q_rad) {
  const double t2 = k.signs[1] * q_rad[1] - k.offsets_rad[1], t3 = k.signs[2] * q_rad[2] - k.offsets_rad[2];
  const double reach = std::hypot(k.a2_mm, k.c3_mm), psi3 = std::atan2(k.a2_mm, k.c3_mm);
  const Vec2 shoulder(k.a1_mm, k.c1_mm);
  const Vec2 elbow = shoulder + k.c2_mm * Vec2(std::sin(t2), std::cos(t2));
  return {shoulder, elbow, elbow + reach * Vec2(std::sin(t2 + t3 + psi3), std::cos(t2 + t3 + psi3))};
}

ArmPoints arm_of(const ChainKinematics& k, const JointVector& q_rad) {
  Pose<frame::Base, frame::Base> T;
  std::array<Vec3, 6> origin{};
  Vec3 axis1 = Vec3::UnitZ(), out = Vec3::UnitX();
  for (std::size_t i = 0; i < k.joints.size() && i < 6; ++i) {
    const ChainJoint& j = k.joints[i];
    T = T * j.T_parent_joint;
    origin[i] = T.p_mm;
    if (i == 0) axis1 = T.direction(j.axis).normalized();
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(q_rad[i], j.axis.normalized()));
    T = T * Pose<frame::Base, frame::Base>(turn, Vec3::Zero());
    if (i == 0) {  // the direction that is base x (less its part along the axis) when the joint is at 0
      Vec3 x = Vec3::UnitX() - axis1 * axis1.x();
      if (x.norm() < 1e-6) x = Vec3::UnitY() - axis1 * axis1.y();
      out = Eigen::AngleAxisd(q_rad[0], axis1) * x.normalized();
    }
  }
  const auto flat = [&](const Vec3& p) { return Vec2((p - origin[0]).dot(out), (p - origin[0]).dot(axis1)); };
  return {flat(origin[1]), flat(origin[2]), flat(origin[4])};
}

bool is_beyond(double q_rad) { return q_rad > kPi + 1e-9 || q_rad <= -kPi - 1e-9; }

}  // namespace

Posture posture_of(const RobotSpec& robot, const JointVector& q_rad, FlipRule rule) {
  const ArmPoints arm = std::visit([&](const auto& k) { return arm_of(k, q_rad); }, robot.kinematics);
  Posture p;
  p.is_rear = arm.wrist.x() < 0;
  const Vec2 upper = arm.elbow - arm.shoulder, whole = arm.wrist - arm.shoulder;
  p.is_lower_arm = whole.x() * upper.y() - whole.y() * upper.x() < 0;  // the elbow hangs below the line shoulder - wrist
  if (rule == FlipRule::b_axis) {
    p.is_no_flip = q_rad[4] < 0;
  } else {
    const double r = q_rad[3] - 2 * kPi * std::round(q_rad[3] / (2 * kPi));  // -180 .. 180
    p.is_no_flip = r > kPi / 2 || r <= -kPi / 2;
  }
  p.is_r_beyond = is_beyond(q_rad[3]);
  p.is_t_beyond = is_beyond(q_rad[5]);
  p.is_s_beyond = is_beyond(q_rad[0]);
  return p;
}

}  // namespace asbuilt::inform
