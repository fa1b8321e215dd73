// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/error_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/base/random.hpp"
#include "planner/robot/error_parameters.hpp"

namespace asbuilt {
namespace {

using Twists = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// Velocity of the point p (mm) and rotation (rad) in base per unit of each parameter, before stretching and base removal.
Twists motion_in_base(const Robot& robot, const JointVector& q, const Vec3& p) {
  Twists m = Twists::Zero(6, kErrorParameters);
  const auto axes = robot.axes(q);
  const auto links = robot.link_motion(q);
  const double reach = robot.reach_mm();
  for (int i = 0; i < 6; ++i) {
    const Vec3 &w = axes[i].first, &origin = axes[i].second;
    const JointErrorScale& sd = kJointErrorScale[i];
    // Seen from the link before it, a shifted axis moves what hangs on it by (1 - R) shift, a tilted one turns it by (1 - R) tilt.
    // Both are given in the frame of that link; any fixed frame will do for shifts of equal size in all directions.
    const Mat3 R = Eigen::AngleAxisd(q[i], w).toRotationMatrix();
    const Mat3 change = Mat3::Identity() - R;
    const Mat3 link = links[i].rotation();  // of the link before joint i
    int k = kParametersPerJoint * i;
    for (int a = 0; a < 3; ++a, ++k) m.col(k).head<3>() = change * link.col(a) * sd.shift_mm;
    const Vec3 w_zero = link.transpose() * w;
    const Mat3 across = quat_from_z(w_zero, std::abs(w_zero.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY()).toRotationMatrix();
    for (int a = 0; a < 2; ++a, ++k) {
      const Vec3 turn = change * link * across.col(a) * sd.tilt_rad;
      m.col(k).head<3>() = turn.cross(p - origin);
      m.col(k).tail<3>() = turn;
    }
    const std::array<double, 5> along{sd.zero_rad, sd.wave_rad * std::sin(q[i]), sd.wave_rad * std::cos(q[i]), sd.wave_rad * std::sin(2 * q[i]),
                                      sd.wave_rad * std::cos(2 * q[i])};
    for (int a = 0; a < 5; ++a, ++k) {
      m.col(k).head<3>() = along[a] * w.cross(p - origin);
      m.col(k).tail<3>() = along[a] * w;
    }
  }
  // Weight pulls the arm down: the moment of a mass at elbow and wrist about joint 2, of one at the wrist about joint 3.
  const Vec3 elbow = axes[2].second, wrist = axes[4].second, up = Vec3::UnitZ();
  const std::array<Vec3, 2> mass{0.5 * elbow + 0.5 * wrist, wrist};
  for (int a = 0; a < 2; ++a) {
    const Vec3 &w = axes[1 + a].first, &origin = axes[1 + a].second;
    const double turn = -kSag_rad * w.dot((mass[a] - origin).cross(up)) / reach;
    m.col(6 * kParametersPerJoint + a).head<3>() = turn * w.cross(p - origin);
    m.col(6 * kParametersPerJoint + a).tail<3>() = turn * w;
  }
  return m;
}

/// Postures a program works in: tool pointing down within 40 degrees, in front of the arm at working height.
std::vector<JointVector> working_postures(const Robot& robot, const Pose<frame::Flange, frame::Tool>& T_flange_tool) {
  Random random = Random::stream(11, "working volume");
  const JointVector home = robot.spec().home_rad;
  const auto axes = robot.axes(home);
  const Vec3 shoulder = axes[1].second, tip = (robot.forward(home) * T_flange_tool).p_mm, foot = axes[0].second;
  const double bearing = (tip - foot).head<2>().norm() > 1.0 ? std::atan2(tip.y() - foot.y(), tip.x() - foot.x()) : 0.0;
  const double reach = robot.reach_mm();
  const std::size_t wanted = robot.is_opw() ? 200 : 40;
  std::vector<JointVector> out;
  for (int tries = 0; out.size() < wanted && tries < 40 * static_cast<int>(wanted); ++tries) {
    const double radius = reach * random.uniform(0.35, 0.65), angle = bearing + random.uniform(-0.45, 0.45);
    const Vec3 p(foot.x() + radius * std::cos(angle), foot.y() + radius * std::sin(angle), shoulder.z() + reach * random.uniform(-0.15, 0.15));
    const Vec3 z = (Vec3(0, 0, -1) + 0.7 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))).normalized();
    const Pose<frame::Base, frame::Tool> T(quat_from_z(z, Vec3(random.normal(), random.normal(), random.normal())), p);
    if (const auto q = robot.inverse_like(T * T_flange_tool.inverse(), home)) out.push_back(*q);
  }
  if (out.empty()) out.push_back(home);
  return out;
}

}  // namespace

struct RobotErrorModel::Impl {
  Robot robot;
  double scale = 0, scatter_scale = 0;
  Vec3 center = Vec3::Zero();  // where the base motion is taken away about
  Twists base;                 // that motion: translation of `center`, then rotation, in base, per parameter, stretched
};

RobotErrorModel::RobotErrorModel(const Robot& robot, const Pose<frame::Flange, frame::Tool>& T_flange_tool) {
  auto impl = std::make_shared<Impl>(Impl{robot, 0, 0, Vec3::Zero(), Twists::Zero(6, kErrorParameters)});
  const auto postures = working_postures(robot, T_flange_tool);
  const int n = static_cast<int>(postures.size());
  std::vector<Vec3> tips;
  for (const JointVector& q : postures) {
    tips.push_back((robot.forward(q) * T_flange_tool).p_mm);
    impl->center += tips.back() / n;
  }
  Eigen::MatrixXd errors(3 * n, kErrorParameters), rigid(3 * n, 6);
  double scatter = 0;
  for (int k = 0; k < n; ++k) {
    errors.middleRows<3>(3 * k) = motion_in_base(robot, postures[k], tips[k]).topRows<3>();
    rigid.middleRows<3>(3 * k) << Mat3::Identity(), -skew(tips[k] - impl->center);
    const Mat6 j = robot.jacobian(postures[k], tips[k]);
    for (int i = 0; i < 6; ++i) scatter += (j.col(i).head<3>() * kScatterRatio[i]).squaredNorm() / n;
  }
  const Eigen::MatrixXd base = rigid.colPivHouseholderQr().solve(errors);
  const Eigen::MatrixXd left = errors - rigid * base;
  // Mean length of the left-over error, by fixed draws of the parameters.
  Random random = Random::stream(12, "error draws");
  double mean_mm = 0;
  constexpr int kDraws = 300;
  Eigen::VectorXd eta(kErrorParameters);
  for (int d = 0; d < kDraws; ++d) {
    for (double& e : eta) e = random.normal();
    const Eigen::VectorXd e = left * eta;
    for (int k = 0; k < n; ++k) mean_mm += e.segment<3>(3 * k).norm() / (static_cast<double>(n) * kDraws);
  }
  const RobotAccuracy& a = robot.spec().accuracy;
  impl->scale = mean_mm > 0 ? a.absolute.mean_mm / mean_mm : 0.0;
  impl->scatter_scale = scatter > 0 ? std::hypot(a.short_term.mean_mm, a.short_term.sd_mm) / std::sqrt(scatter) : 0.0;
  impl->base = base * impl->scale;
  impl_ = std::move(impl);
}

int RobotErrorModel::size() const { return kErrorParameters; }
double RobotErrorModel::scale_ratio() const { return impl_->scale; }

Eigen::MatrixXd RobotErrorModel::twist(const JointVector& q_rad) const {
  const auto T = impl_->robot.forward(q_rad);
  Twists m = motion_in_base(impl_->robot, q_rad, T.p_mm) * impl_->scale;
  m.topRows<3>() -= impl_->base.topRows<3>() - skew(T.p_mm - impl_->center) * impl_->base.bottomRows<3>();
  m.bottomRows<3>() -= impl_->base.bottomRows<3>();
  const Mat3 R = T.rotation().transpose();
  m.topRows<3>() = (R * m.topRows<3>()).eval();
  m.bottomRows<3>() = (R * m.bottomRows<3>()).eval();
  return m;
}

Mat6 RobotErrorModel::scatter(const JointVector& q_rad) const {
  const auto T = impl_->robot.forward(q_rad);
  Mat6 j = impl_->robot.jacobian(q_rad, T.p_mm);
  const Mat3 R = T.rotation().transpose();
  Mat6 body;
  body.topRows<3>() = R * j.topRows<3>();
  body.bottomRows<3>() = R * j.bottomRows<3>();
  Vec6 sd;
  for (int i = 0; i < 6; ++i) sd[i] = kScatterRatio[i] * impl_->scatter_scale;
  return body * sd.cwiseAbs2().asDiagonal() * body.transpose();
}

}  // namespace asbuilt
