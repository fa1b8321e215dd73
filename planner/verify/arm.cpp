// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/arm.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt::verifying {

namespace {

using Iso = Eigen::Isometry3d;

Iso turn_about(const Vec3& point, const Vec3& direction, double angle_rad) {
  Iso t = Iso::Identity();
  t.linear() = Eigen::AngleAxisd(angle_rad, direction).toRotationMatrix();
  t.translation() = point - t.linear() * point;
  return t;
}
Iso slide_along(const Vec3& direction, double length) {
  Iso t = Iso::Identity();
  t.translation() = length * direction;
  return t;
}

}  // namespace

Arm::Arm(const RobotSpec& spec) {
  if (const auto* o = std::get_if<OpwParameters>(&spec.kinematics)) {
    // Upright posture (theta = 0), Brandstoetter et al. 2014; then moved to joints = 0, where theta_i = -offset_i.
    const Vec3 z = Vec3::UnitZ(), y = Vec3::UnitY();
    const double x_4 = o->a1_mm + o->a2_mm;
    const std::array<Screw, 6> upright{{{{0, 0, 0}, z, false},
                                        {{o->a1_mm, 0, o->c1_mm}, y, false},
                                        {{o->a1_mm, 0, o->c1_mm + o->c2_mm}, y, false},
                                        {{x_4, o->b_mm, 0}, z, false},
                                        {{x_4, o->b_mm, o->c1_mm + o->c2_mm + o->c3_mm}, y, false},
                                        {{x_4, o->b_mm, 0}, z, false}}};
    Iso so_far = Iso::Identity();
    for (std::size_t i = 0; i < 6; ++i) {
      const double theta = -o->offsets_rad[i];
      screw_[i] = {so_far * upright[i].point, so_far.linear() * upright[i].direction * static_cast<double>(o->signs[i]), false};
      so_far = so_far * turn_about(upright[i].point, upright[i].direction, theta);
    }
    Iso tip = Iso::Identity();
    tip.translation() = Vec3(x_4, o->b_mm, o->c1_mm + o->c2_mm + o->c3_mm + o->c4_mm);
    home_ = so_far * tip;
  } else {
    const auto& c = std::get<ChainKinematics>(spec.kinematics);
    must(c.joints.size() == 6, "a robot has six joints");
    Iso so_far = Iso::Identity();
    for (std::size_t i = 0; i < 6; ++i) {
      so_far = so_far * c.joints[i].T_parent_joint.matrix();
      screw_[i] = {so_far.translation(), so_far.linear() * c.joints[i].axis.normalized(), c.joints[i].is_prismatic};
    }
    home_ = so_far * c.T_last_tip.matrix();
  }
  double reach = 0;
  Vec3 before = screw_[0].point;
  for (std::size_t i = 1; i < 6; ++i) reach += (screw_[i].point - before).norm(), before = screw_[i].point;
  reach_mm_ = std::max(1.0, (screw_[0].point - home_.translation()).norm());
  reach_mm_ = std::max(reach_mm_, 0.5 * reach);
}

ArmState Arm::state(const JointVector& q) const {
  ArmState s;
  Iso t = Iso::Identity();
  s.link[0] = t;
  for (std::size_t i = 0; i < 6; ++i) {
    s.axis[i] = {t * screw_[i].point, t.linear() * screw_[i].direction};
    t = t * (screw_[i].is_prismatic ? slide_along(screw_[i].direction, q[i]) : turn_about(screw_[i].point, screw_[i].direction, q[i]));
    s.link[i + 1] = t;
  }
  s.flange = t * home_;
  return s;
}

namespace {
Mat6 jacobian_of(const ArmState& s, const std::array<bool, 6>& is_prismatic) {
  Mat6 j;
  for (int i = 0; i < 6; ++i) {
    const JointAxis& a = s.axis[static_cast<std::size_t>(i)];
    if (is_prismatic[static_cast<std::size_t>(i)]) {
      j.col(i) << a.direction, Vec3::Zero();
    } else {
      j.col(i) << a.direction.cross(s.flange.translation() - a.point), a.direction;
    }
  }
  return j;
}
}  // namespace

std::optional<JointVector> Arm::follow(const Iso& wanted, const JointVector& from) const {
  std::array<bool, 6> slides{};
  for (std::size_t i = 0; i < 6; ++i) slides[i] = screw_[i].is_prismatic;
  JointVector q = from;
  for (int round = 0; round < 30; ++round) {
    const ArmState s = state(q);
    Vec6 e;
    e.head<3>() = wanted.translation() - s.flange.translation();
    const Eigen::AngleAxisd w(wanted.linear() * s.flange.linear().transpose());
    e.tail<3>() = w.angle() * w.axis();
    if (e.head<3>().norm() < 1e-7 && e.tail<3>().norm() < 1e-10) return q;
    Mat6 j = jacobian_of(s, slides);
    j.topRows<3>() /= reach_mm_, e.head<3>() /= reach_mm_;
    const Mat6 normal = j.transpose() * j + 1e-14 * Mat6::Identity();
    Vec6 step = normal.ldlt().solve(j.transpose() * e);
    const double longest = step.cwiseAbs().maxCoeff();
    if (!std::isfinite(longest)) return std::nullopt;
    if (longest > 0.2) step *= 0.2 / longest;
    for (int i = 0; i < 6; ++i) q[static_cast<std::size_t>(i)] += step[i];
  }
  const ArmState s = state(q);
  const double off = (wanted.translation() - s.flange.translation()).norm();
  const double turn = Eigen::AngleAxisd(wanted.linear() * s.flange.linear().transpose()).angle();
  if (off < 1e-4 && turn < 1e-7) return q;
  return std::nullopt;
}

double Arm::singularity_ratio(const JointVector& q) const {
  std::array<bool, 6> slides{};
  for (std::size_t i = 0; i < 6; ++i) slides[i] = screw_[i].is_prismatic;
  Mat6 j = jacobian_of(state(q), slides);
  j.topRows<3>() /= reach_mm_;
  return j.jacobiSvd().singularValues()(5);
}

}  // namespace asbuilt::verifying
