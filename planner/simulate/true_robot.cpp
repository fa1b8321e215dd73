// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/true_robot.hpp"

#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt::simulate_detail {

TrueRobot::TrueRobot(const RobotSpec& spec, const Pose<frame::Flange, frame::Tool>& T_flange_tool, std::uint64_t seed, double absolute_mm,
                     double slow_mm, double quick_mm) {
  const Vec3 Z = Vec3::UnitZ(), Y = Vec3::UnitY();
  std::array<Vec3, 6> w{Z, Y, Y, Z, Y, Z}, p;
  if (const auto* given = std::get_if<ChainKinematics>(&spec.kinematics)) {
    must(given->joints.size() == 6, "the virtual robot has six joints");
    is_chain_ = true;
    Pose<frame::Base, frame::Base> T;  // base to the joint, every joint at 0
    for (std::size_t i = 0; i < 6; ++i) {
      T = T * given->joints[i].T_parent_joint;
      w[i] = T.direction(given->joints[i].axis).normalized(), p[i] = T.p_mm;
    }
    T = T * given->T_last_tip;
    at_zero_ = {T.q, T.p_mm};
  } else {
    opw_ = std::get<OpwParameters>(spec.kinematics);
    const double x4 = opw_.a1_mm + opw_.a2_mm, z3 = opw_.c1_mm + opw_.c2_mm, z5 = z3 + opw_.c3_mm;
    p = {Vec3(0, 0, 0), Vec3(opw_.a1_mm, 0, opw_.c1_mm), Vec3(opw_.a1_mm, 0, z3), Vec3(x4, opw_.b_mm, z3), Vec3(x4, opw_.b_mm, z5), Vec3(x4, opw_.b_mm, z5)};
    at_zero_ = {Eigen::Quaterniond::Identity(), Vec3(x4, opw_.b_mm, z5 + opw_.c4_mm)};
  }

  Random r = Random::stream(seed, "true robot");
  const double shift[6] = {0.15, 0.20, 0.15, 0.12, 0.07, 0.05}, tilt_deg[6] = {0.004, 0.004, 0.003, 0.002, 0.0015, 0.001};
  const double zero_deg[6] = {0.006, 0.008, 0.009, 0.004, 0.003, 0.004}, wave_deg[6] = {0.003, 0.003, 0.003, 0.0015, 0.001, 0.001};
  for (int i = 0; i < 6; ++i) {
    const auto v = [&](double s) { return Vec3(r.normal(0, s), r.normal(0, s), r.normal(0, s)); };
    Axis& a = axes_[i];
    a.w = w[i], a.p = p[i];
    a.dp = v(shift[i]), a.dw = v(rad_from_deg(tilt_deg[i]));
    a.zero_rad = r.normal(0, rad_from_deg(zero_deg[i]));
    a.wave1_rad = r.normal(0, rad_from_deg(wave_deg[i])), a.wave2_rad = r.normal(0, rad_from_deg(wave_deg[i]));
    a.phase1_rad = r.uniform(0, 2 * kPi), a.phase2_rad = r.uniform(0, 2 * kPi);
  }
  sag_rad_ = {std::abs(r.normal(0, rad_from_deg(0.004))), std::abs(r.normal(0, rad_from_deg(0.003)))};

  // postures over the working volume, tool roughly down
  std::vector<Joints> postures;
  const double spread_deg[6] = {40, 35, 35, 40, 35, 180};
  for (int k = 0; k < 200; ++k) {
    Joints q;
    double lean_deg = 0;  // of upper arm and forearm together
    for (int i = 0; i < 6; ++i) {
      const double off = r.uniform(-spread_deg[i], spread_deg[i]);
      // angles of the model are drawn and turned into joints: theta = sign * q - offset; the wrist takes the tool back to pointing down
      const double theta_deg = (i == 1 ? 5 : i == 2 ? 90 : i == 4 ? 180 - lean_deg : 0) + off;
      if (i == 1 || i == 2) lean_deg += theta_deg;
      q[i] = is_chain_ ? spec.home_rad[i] + rad_from_deg(off) : (rad_from_deg(theta_deg) + opw_.offsets_rad[i]) * opw_.signs[i];
    }
    postures.push_back(q);
  }
  Eigen::Matrix3Xd want(3, postures.size()), got(3, postures.size());
  for (int round = 0; round < 5; ++round) {
    base_ = {};
    for (std::size_t k = 0; k < postures.size(); ++k) {
      want.col(k) = (chain(postures[k], false, nullptr) * T_flange_tool).p_mm;
      got.col(k) = (chain(postures[k], true, nullptr) * T_flange_tool).p_mm;
    }
    base_ = Pose<frame::Base, frame::Base>(Eigen::Isometry3d(Eigen::umeyama(got, want, false)));
    double mean = 0;
    for (std::size_t k = 0; k < postures.size(); ++k) mean += (base_.point(got.col(k)) - want.col(k)).norm() / postures.size();
    if (round < 4) scale_ *= absolute_mm / mean;
  }
  // scatter in joint space, scaled at the tool point
  std::array<double, 6> share{1, 1, 1.2, 2, 2, 3};
  double rms = 0;
  for (std::size_t k = 0; k < 40; ++k)
    for (int i = 0; i < 6; ++i) {
      Joints q = postures[k];
      const Vec3 a = (chain(q, false, nullptr) * T_flange_tool).p_mm;
      q[i] += 1e-5 * share[i];
      rms += ((chain(q, false, nullptr) * T_flange_tool).p_mm - a).squaredNorm() / 40;
    }
  const double unit = 1e-5 / std::sqrt(rms);
  for (int i = 0; i < 6; ++i) {
    slow_rad_[i] = r.normal() * share[i] * unit * slow_mm;
    quick_rad_[i] = share[i] * unit * quick_mm;
  }
}

Pose<frame::Base, frame::Flange> TrueRobot::chain(const Joints& q_rad, bool real, const Joints* extra) const {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  double theta[6];
  for (int i = 0; i < 6; ++i) theta[i] = opw_.signs[i] * q_rad[i] - opw_.offsets_rad[i];
  double lean2 = std::sin(theta[1]), lean3 = std::sin(theta[1] + theta[2]);
  if (is_chain_) {  // how far the two long members lie down, from the axes themselves
    const Mat3 R2 = (Eigen::AngleAxisd(theta[0], axes_[0].w) * Eigen::AngleAxisd(theta[1], axes_[1].w)).toRotationMatrix();
    const Mat3 R3 = R2 * Eigen::AngleAxisd(theta[2], axes_[2].w).toRotationMatrix();
    lean2 = (R2 * (axes_[2].p - axes_[1].p)).head<2>().norm() / std::max(1.0, (axes_[2].p - axes_[1].p).norm());
    lean3 = (R3 * (axes_[4].p - axes_[2].p)).head<2>().norm() / std::max(1.0, (axes_[4].p - axes_[2].p).norm());
  }
  for (int i = 0; i < 6; ++i) {
    const Axis& a = axes_[i];
    double th = theta[i];
    Vec3 w = a.w, p = a.p;
    if (real) {
      th += scale_ * (a.zero_rad + a.wave1_rad * std::sin(theta[i] + a.phase1_rad) + a.wave2_rad * std::sin(2 * theta[i] + a.phase2_rad));
      if (i == 1) th += scale_ * sag_rad_[0] * (0.45 * lean2 + 0.55 * lean3);
      if (i == 2) th += scale_ * sag_rad_[1] * lean3;
      if (extra) th += (*extra)[i];
      w = (w + scale_ * a.dw).normalized();
      p += scale_ * a.dp;
    }
    const Mat3 R = Eigen::AngleAxisd(th, w).toRotationMatrix();
    Eigen::Isometry3d E = Eigen::Isometry3d::Identity();
    E.linear() = R;
    E.translation() = p - R * p;
    T = T * E;
  }
  const Pose<frame::Base, frame::Flange> out(T * at_zero_.matrix());
  return real ? base_ * out : out;
}

Pose<frame::Base, frame::Flange> TrueRobot::nominal(const Joints& q_rad) const { return chain(q_rad, false, nullptr); }

Pose<frame::Base, frame::Flange> TrueRobot::actual(const Joints& q_rad) const { return chain(q_rad, true, &slow_rad_); }

Pose<frame::Base, frame::Flange> TrueRobot::actual(const Joints& q_rad, Random& scatter) const {
  Joints e = slow_rad_;
  for (int i = 0; i < 6; ++i) e[i] += quick_rad_[i] * scatter.normal();
  return chain(q_rad, true, &e);
}

std::optional<Joints> posture(const Robot& robot, const Pose<frame::Base, frame::Flange>& T) {
  const double weight[6] = {1.5, 1.5, 1.2, 0.6, 0.8, 0.4};
  std::optional<Joints> best;
  double best_cost = 1e300;
  for (const JointVector& q : robot.inverse(T)) {
    double cost = 0;
    for (int i = 0; i < 6; ++i) cost += weight[i] * std::abs(q[i] - robot.spec().home_rad[i]);
    if (cost < best_cost) best_cost = cost, best = q;
  }
  return best;
}

TrueRobot arm_of(const RobotSpec& spec, const Pose<frame::Flange, frame::Tool>& T_flange_tool, std::uint64_t seed) {
  return TrueRobot(spec, T_flange_tool, seed, 0.42, 0.07, 0.02);
}

}  // namespace asbuilt::simulate_detail
