// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/arm.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <memory>

#include "planner/base/number.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {

ArmParameters dh_parameters(const ArmRecipe& recipe, const std::vector<DhJoint>& joints, const Pose<frame::Base, frame::Base>& T_base_first) {
  ArmParameters arm;
  struct Slot {
    std::size_t joint;
    int what;
  };
  std::vector<Slot> slots;
  const char* words[] = {"d", "theta", "a", "alpha", "beta"};
  for (std::size_t j = 0; j < joints.size(); ++j)
    for (int w = 0; w < 5; ++w) {
      if (w == 4 && (std::abs(std::sin(joints[j].alpha_rad)) > 0.1 || j + 1 == joints.size())) continue;
      slots.push_back({j, w});
      arm.names.push_back(words[w] + std::to_string(j + 1));
      arm.units.push_back(w == 0 || w == 2 ? "mm" : "rad");
    }
  arm.sd.resize(static_cast<Eigen::Index>(slots.size()));
  for (std::size_t i = 0; i < slots.size(); ++i) arm.sd[static_cast<Eigen::Index>(i)] = arm.units[i] == "mm" ? recipe.length_sd_mm : recipe.angle_sd_rad;
  arm.forward = [joints, slots, T_base_first](const Eigen::VectorXd& add, const std::vector<double>& q) {
    std::vector<DhJoint> at = joints;
    for (std::size_t i = 0; i < slots.size(); ++i) {
      DhJoint& j = at[slots[i].joint];
      double* field[] = {&j.d_mm, &j.theta_rad, &j.a_mm, &j.alpha_rad, &j.beta_rad};
      *field[slots[i].what] += add[static_cast<Eigen::Index>(i)];
    }
    Pose<frame::Base, frame::Base> T = T_base_first;
    for (std::size_t j = 0; j < at.size(); ++j) {
      const Eigen::Quaterniond turn = quat_exp(Vec3(0, 0, q[j] + at[j].theta_rad));
      T = T * Pose<frame::Base, frame::Base>(turn * quat_exp(Vec3(at[j].alpha_rad, 0, 0)) * quat_exp(Vec3(0, at[j].beta_rad, 0)), turn * Vec3(at[j].a_mm, 0, 0) + Vec3(0, 0, at[j].d_mm));
    }
    return Pose<frame::Base, frame::Flange>(T.q, T.p_mm);
  };
  return arm;
}

Result<ArmParameters> opw_parameters(const ArmRecipe& recipe, const RobotSpec& robot) {
  const auto* opw = std::get_if<OpwParameters>(&robot.kinematics);
  if (!opw)
    return refuse({.code = "calibrate.arm_not_opw",
                   .where = "robot",
                   .message = "the cell gives the arm as a URDF, allowed OPW constants: a calibration file holds corrections of these only; write kinematics: {opw: ..} into the cell",
                   .stage = "input"});
  ArmParameters arm;
  for (const char* n : {"a1", "a2", "b", "c1", "c2", "c3", "c4"}) arm.names.push_back(n), arm.units.push_back("mm");
  for (int i = 1; i <= 6; ++i) arm.names.push_back("offset" + std::to_string(i)), arm.units.push_back("rad");
  arm.sd.resize(13);
  arm.sd << Eigen::VectorXd::Constant(7, recipe.length_sd_mm), Eigen::VectorXd::Constant(6, recipe.angle_sd_rad);
  RobotSpec spec;
  spec.model = robot.model, spec.joints = robot.joints, spec.home_rad = robot.home_rad, spec.accuracy = robot.accuracy;
  spec.kinematics = *opw;
  arm.forward = [spec](const Eigen::VectorXd& add, const std::vector<double>& q) {
    RobotSpec at = spec;
    OpwParameters& o = std::get<OpwParameters>(at.kinematics);
    double* field[] = {&o.a1_mm, &o.a2_mm, &o.b_mm, &o.c1_mm, &o.c2_mm, &o.c3_mm, &o.c4_mm};
    for (int i = 0; i < 7; ++i) *field[i] += add[i];
    for (std::size_t i = 0; i < 6; ++i) o.offsets_rad[i] += add[7 + static_cast<Eigen::Index>(i)];
    const auto robot_at = Robot::from(at);
    must(robot_at.has_value(), "an arm with small corrections is an arm");
    JointVector joints{};
    for (std::size_t i = 0; i < 6; ++i) joints[i] = q[i];
    return robot_at->forward(joints);
  };
  return arm;
}

void correct_arm(Network& network, const ArmParameters& arm) {
  network.arm_sd = arm.sd;
  const auto shared = std::make_shared<const ArmParameters>(arm);
  network.relinearise = [shared](const Eigen::VectorXd& at, std::vector<NetworkView>& views) {
    for (NetworkView& v : views) {
      if (v.joints.empty()) continue;
      v.T_base_flange = shared->forward(at, v.joints);
      v.robot_twist.resize(6, at.size());
      for (Eigen::Index i = 0; i < at.size(); ++i) {
        const double h = shared->units[static_cast<std::size_t>(i)] == "mm" ? 1e-3 : 1e-6;
        Eigen::VectorXd more = at, less = at;
        more[i] += h, less[i] -= h;
        v.robot_twist.col(i) = (twist_between(v.T_base_flange, shared->forward(more, v.joints)) - twist_between(v.T_base_flange, shared->forward(less, v.joints))) / (2 * h);
      }
    }
  };
  network.relinearise(Eigen::VectorXd::Zero(arm.sd.size()), network.views);
}

std::vector<ArmLine> arm_lines(const ArmRecipe& recipe, const ArmParameters& arm, const NetworkSolution& s) {
  std::vector<ArmLine> out;
  const Eigen::Index first = 12 + kSensorConstants;
  for (std::size_t i = 0; i < arm.names.size(); ++i) {
    const Eigen::Index k = static_cast<Eigen::Index>(i);
    ArmLine l{arm.names[i], arm.units[i], s.state.arm[k], std::sqrt(std::max(0.0, s.covariance(first + k, first + k))), arm.sd[k]};
    l.is_held = l.sd > recipe.held_ratio * l.sd_before;
    out.push_back(std::move(l));
  }
  return out;
}

std::vector<std::string> held_directions(const ArmParameters& arm, const NetworkSolution& s, double held_ratio) {
  const Eigen::Index n = arm.sd.size(), first = 12 + kSensorConstants;
  // covariance in units of the beliefs: eigenvalues near 1 are directions in which the data said nothing
  const Eigen::MatrixXd C = arm.sd.cwiseInverse().asDiagonal() * s.covariance.block(first, first, n, n) * arm.sd.cwiseInverse().asDiagonal();
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> es(0.5 * (C + C.transpose()));
  std::vector<std::string> out;
  for (Eigen::Index i = n - 1; i >= 0 && std::sqrt(std::max(0.0, es.eigenvalues()[i])) > held_ratio; --i) {
    const Eigen::VectorXd v = es.eigenvectors().col(i);
    std::vector<std::pair<double, std::size_t>> order;
    for (Eigen::Index k = 0; k < n; ++k)
      if (std::abs(v[k]) > 0.25) order.emplace_back(-std::abs(v[k]), static_cast<std::size_t>(k));
    std::sort(order.begin(), order.end());
    std::string text;
    const double sign = order.empty() || v[static_cast<Eigen::Index>(order[0].second)] > 0 ? 1 : -1;
    for (const auto& [size, k] : order) text += fmt::format("{}{} {}", text.empty() ? "" : " ", fixed_number(sign * v[static_cast<Eigen::Index>(k)], 2), arm.names[k]);
    out.push_back(text);
  }
  return out;
}

}  // namespace asbuilt
