// SPDX-License-Identifier: GPL-3.0-or-later
// The error model against an arm whose parameters are really changed, and its size against the cell's figures.
#include "planner/robot/error_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "planner/base/random.hpp"
#include "planner/robot/error_parameters.hpp"
#include "planner/robot/kinematic_chain.hpp"
#include "tests/unit/robot/arms.hpp"

namespace asbuilt {
namespace {

const Pose<frame::Flange, frame::Tool> kTool(Eigen::Quaterniond::Identity(), Vec3(0, 0, 350));

JointVector posture(Random& random) {
  return {random.uniform(-1, 1), random.uniform(-2, -1), random.uniform(1, 2), random.uniform(-1, 1), random.uniform(0.5, 1.8), random.uniform(-3, 3)};
}

/// The flange of an arm in which parameter k is really one (stretched) standard deviation times `amount` off.
Rigid disturbed_flange(const Robot& robot, int k, double amount, const JointVector& q_in) {
  std::array<Vec3, 6> axis, point;
  const auto zero = robot.axes(JointVector{});
  for (int i = 0; i < 6; ++i) axis[i] = zero[i].first, point[i] = zero[i].second;
  JointVector q = q_in;
  const int joint = k / kParametersPerJoint, what = k % kParametersPerJoint;
  const JointErrorScale& sd = kJointErrorScale[joint];
  if (what < 3) point[joint][what] += amount * sd.shift_mm;
  if (what == 3 || what == 4) {
    const Mat3 across = quat_from_z(axis[joint], std::abs(axis[joint].x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY()).toRotationMatrix();
    axis[joint] = quat_exp(across.col(what - 3) * amount * sd.tilt_rad) * axis[joint];
  }
  const double turn = q_in[joint];
  if (what == 5) q[joint] += amount * sd.zero_rad;
  if (what == 6) q[joint] += amount * sd.wave_rad * std::sin(turn);
  if (what == 7) q[joint] += amount * sd.wave_rad * std::cos(turn);
  if (what == 8) q[joint] += amount * sd.wave_rad * std::sin(2 * turn);
  if (what == 9) q[joint] += amount * sd.wave_rad * std::cos(2 * turn);
  const auto flange = robot.forward(JointVector{});
  return flange_of(KinematicChain::from_axes(axis, point, rigid_of(flange)), q);
}

TEST(ErrorModel, EveryParameterMovesTheFlangeAsAReallyChangedArmUpToOneMotionOfTheBase) {
  const Robot robot = *Robot::from(test::large_arm());
  const RobotErrorModel model(robot, kTool);
  Random random = Random::stream(21, "error model");
  for (int k = 0; k < 6 * kParametersPerJoint; ++k) {
    Vec6 first = Vec6::Zero();
    for (int n = 0; n < 6; ++n) {
      const JointVector q = posture(random);
      const double h = 0.01 * model.scale_ratio();
      const Rigid a = disturbed_flange(robot, k, -h, q), b = disturbed_flange(robot, k, h, q);
      const auto T = robot.forward(q);
      // What the changed arm does minus what the model says, as a motion of the whole base: the same in every posture.
      Vec6 moved;
      moved.tail<3>() = quat_log(Eigen::Quaterniond(b.R * a.R.transpose())) / 0.02;
      moved.head<3>() = (b.p - a.p) / 0.02;
      const Vec6 said = model.twist(q).col(k);
      const Vec3 w = moved.tail<3>() - T.rotation() * said.tail<3>();
      const Vec3 v = moved.head<3>() - T.rotation() * said.head<3>() - w.cross(T.p_mm);  // of base's origin
      Vec6 base;
      base << v, w;
      if (n == 0) first = base;
      EXPECT_LT((base - first).head<3>().norm(), 1e-5) << "parameter " << k;
      EXPECT_LT((base - first).tail<3>().norm(), 1e-8) << "parameter " << k;
    }
  }
}

TEST(ErrorModel, MeanErrorOverTheWorkingVolumeIsTheCellsFigure) {
  for (const double mean : {0.42, 0.1}) {
    RobotSpec s = test::large_arm();
    s.accuracy.absolute = {mean, 0.2};
    const Robot robot = *Robot::from(s);
    const RobotErrorModel model(robot, kTool);
    Random random = Random::stream(22, "other draws");
    double sum = 0;
    int n = 0;
    for (int k = 0; k < 60; ++k) {
      const Vec3 p(random.uniform(950, 1700), random.uniform(-500, 500), random.uniform(350, 1100));
      const Vec3 z = (Vec3(0, 0, -1) + 0.7 * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1))).normalized();
      const Pose<frame::Base, frame::Tool> T(quat_from_z(z, Vec3(random.normal(), random.normal(), random.normal())), p);
      const auto q = robot.inverse_near(T * kTool.inverse(), s.home_rad);
      if (!q) continue;
      const Eigen::MatrixXd m = model.twist(*q);
      for (int d = 0; d < 40; ++d) {
        Eigen::VectorXd eta(model.size());
        for (double& e : eta) e = random.normal();
        const Vec6 xi = m * eta;
        sum += (xi.head<3>() + xi.tail<3>().cross(kTool.p_mm)).norm(), ++n;
      }
    }
    ASSERT_GT(n, 1000);
    EXPECT_NEAR(sum / n, mean, 0.15 * mean);
  }
}

TEST(ErrorModel, ScatterAtTheToolIsTheShortTermFigure) {
  const Robot robot = *Robot::from(test::large_arm());
  const RobotErrorModel model(robot, kTool);
  Random random = Random::stream(23, "scatter");
  double sum = 0;
  for (int k = 0; k < 200; ++k) {
    const Mat6 c = model.scatter(posture(random));
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<Mat6>(c).eigenvalues()[0], -1e-12);
    Eigen::Matrix<double, 3, 6> at_tool;
    at_tool << Mat3::Identity(), -skew(kTool.p_mm);
    sum += (at_tool * c * at_tool.transpose()).trace() / 200;
  }
  EXPECT_NEAR(std::sqrt(sum), std::hypot(0.02, 0.01), 0.25 * std::hypot(0.02, 0.01));
}

TEST(ErrorModel, NearPosturesErrAlike) {
  const Robot robot = *Robot::from(test::large_arm());
  const RobotErrorModel model(robot, kTool);
  const JointVector q{0.1, -1.6, 1.7, 0.1, 1.4, 0.3};
  JointVector near = q, far = q;
  for (double& a : near) a += 0.01;
  far[5] += kPi, far[3] += 0.5, far[4] -= 0.5;
  const auto length = [&](const JointVector& other) {
    // in base: both errors at the tool
    const auto at = [&](const JointVector& x) {
      const Eigen::MatrixXd m = model.twist(x);
      Eigen::Matrix<double, 3, 6> at_tool;
      at_tool << Mat3::Identity(), -skew(kTool.p_mm);
      return Eigen::MatrixXd(robot.forward(x).rotation() * at_tool * m);
    };
    return (at(q) - at(other)).norm();
  };
  EXPECT_LT(length(near), 0.02);
  EXPECT_GT(length(far), 5 * length(near));
}

}  // namespace
}  // namespace asbuilt
