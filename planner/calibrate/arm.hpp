// SPDX-License-Identifier: GPL-3.0-or-later
// Corrections of an arm's kinematic constants inside the joint solve: which parameters there are, how well they are known
// beforehand, and afterwards which of them the data have spoken about.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/base/result.hpp"
#include "planner/calibrate/solve.hpp"

namespace asbuilt {

/// Rz(q + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); beta (Hayati) matters where the next axis is parallel.
struct DhJoint {
  double d_mm = 0, theta_rad = 0, a_mm = 0, alpha_rad = 0, beta_rad = 0;
};

struct ArmParameters {
  std::vector<std::string> names;  // "d1", "theta2", "a1"
  std::vector<std::string> units;  // mm, rad
  Eigen::VectorXd sd;              // of the belief; 0: held
  /// Flange in base with these additions to the constants at these joints (mm, rad).
  std::function<Pose<frame::Base, frame::Flange>(const Eigen::VectorXd& additions, const std::vector<double>& joints)> forward;
};

struct ArmRecipe {
  double length_sd_mm = 0.5, angle_sd_rad = 8.7e-4;  // 0.05 degree: of a constant as it is stated
  double held_ratio = 0.9;                           // sd after over sd before above this: held by its belief
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("length_sd", s.length_sd_mm), a("angle_sd", s.angle_sd_rad), a("held", s.held_ratio);
  }
};

/// d, theta, a, alpha of each joint; beta too where the axis is parallel to the next.
ArmParameters dh_parameters(const ArmRecipe& recipe, const std::vector<DhJoint>& joints, const Pose<frame::Base, frame::Base>& T_base_first = {});
/// a1 .. c4 and the six offsets. Refuses calibrate.arm_not_opw.
Result<ArmParameters> opw_parameters(const ArmRecipe& recipe, const RobotSpec& robot);

/// Lets the solve correct the arm: views need `joints`.
void correct_arm(Network& network, const ArmParameters& arm);

struct ArmLine {
  std::string name, unit;
  double value = 0, sd = 0, sd_before = 0;
  bool is_held = false;  // the data say nothing: the belief stands
};
std::vector<ArmLine> arm_lines(const ArmRecipe& recipe, const ArmParameters& arm, const NetworkSolution& solution);

/// Directions among the arm's parameters that the data leave to the belief, in words: "d1 - 0.98 d2".
std::vector<std::string> held_directions(const ArmParameters& arm, const NetworkSolution& solution, double held_ratio);

}  // namespace asbuilt
