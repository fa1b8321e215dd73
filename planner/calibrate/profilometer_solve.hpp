// SPDX-License-Identifier: GPL-3.0-or-later
// The joint problem of a profilometer's calibration: residuals whitened with the robot's error of every pose marginalised, their
// derivatives, the solve and the information it leaves. Used by calibrate_profilometer, by pose design and by the comparison with Powell.
#pragma once

#include <vector>

#include "planner/calibrate/profilometer.hpp"

namespace asbuilt {

/// Passes at one pose of the robot: their error has a common part.
struct PoseGroup {
  std::string name;
  std::vector<const HoleView*> passes;
  bool is_held_out = false;
  double robot_scale_ratio = 1;  // of the robot's sd at this pose; above 1 where the pose does not fit
};

/// Groups passes whose flange poses, half way, agree within 2 mm and 0.2 degree of orientation. Order of first appearance.
std::vector<PoseGroup> grouped(const std::vector<HoleView>& views);

struct ProfilometerProblem {
  const ProfilometerRecipe* recipe = nullptr;
  const HolePlate* plate = nullptr;
  std::vector<PoseGroup> groups;            // those to solve with
  std::vector<ModelParameter> intrinsics;
  std::vector<std::vector<float>> weights;  // per group, hole after hole; empty: all 1
  double robot_scale_ratio = 1;
  bool has_robot_error = true;              // false: plain least squares

  int parameter_count() const { return int(intrinsics.size()) + 13; }
};

/// Names of all parameters in order, and the priors' sd (infinite: none) and size of a disturbance.
struct ParameterTable {
  std::vector<std::string> names;
  Eigen::VectorXd prior_sd, size;
};
ParameterTable parameter_table(const ProfilometerProblem& problem);

/// Offsets of the intrinsics and the latency from their priors, in sd; 0 where there is none.
Eigen::VectorXd prior_offsets(const ProfilometerProblem& problem, const ProfilometerState& state);

/// The state disturbed: intrinsics and latency added, poses in their child frames.
ProfilometerState moved(const ProfilometerState& state, const Eigen::VectorXd& delta);

/// Plain residuals of one pass in the plate's frame (3 per hole) and derivatives by all parameters and by the flange's twist.
struct PassResiduals {
  Eigen::VectorXd r;
  Eigen::MatrixXd J, robot;  // robot: 6 columns
};
PassResiduals residuals_of(const HolePlate& plate, const HoleView& pass, const ProfilometerState& state, bool with_jacobian, bool with_robot);

/// Square root of the inverse covariance of one pose's residuals, as (I - Q diag(c) Q^T) W: W the holes' own, Q the robot's directions.
struct Whitener {
  Eigen::VectorXd w;   // per residual
  Eigen::MatrixXd Q;
  Eigen::VectorXd c;
  void apply(Eigen::Ref<Eigen::MatrixXd> m) const;
};
Whitener whitener_of(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& state);

struct SolveReport {
  ProfilometerState state;
  double cost = 0;          // half the sum of squares, priors included
  int iteration_count = 0;
  bool is_converged = false;
};
/// Ceres, whitened at the start and again until it stands. Frames and units as in profilometer.hpp.
SolveReport solve_joint(const ProfilometerProblem& problem, const ProfilometerState& start, int rounds_max_count = 6);

/// Sum of squared whitened residuals and priors with the whitening held: what Ceres minimises, and what Powell is given.
class ProfilometerMerit {
 public:
  ProfilometerMerit(const ProfilometerProblem& problem, const ProfilometerState& whitened_at);
  double operator()(const ProfilometerState& state) const;

 private:
  const ProfilometerProblem& problem_;
  std::vector<Whitener> whiteners_;
};

/// The passes of a group with every sighting where the state and the group's own robot error put it, its noise taken out. Derivatives are
/// taken there: a hole's noise in a derivative would pass for information in directions that the captures do not see at all.
std::vector<HoleView> smoothed(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& state);

/// Information of the captures alone, J^T S^-1 J, and of the priors (diagonal).
struct Information {
  Eigen::MatrixXd data;
  Eigen::VectorXd prior;
};
Information information_of(const ProfilometerProblem& problem, const ProfilometerState& state);
/// A few Gauss-Newton steps from a solution with the derivatives of the smoothed sightings. Least squares takes derivatives at the measured
/// pixels, whose noise is that of the residuals: their product does not average out and bends weak directions by up to an sd.
ProfilometerState polished(const ProfilometerProblem& problem, ProfilometerState state);

/// (data + prior)^-1, scaled before it is inverted.
Eigen::MatrixXd covariance_of(const Information& information, const Eigen::VectorXd& size);

/// The robot error of a group that explains its residuals best, its chi2 over the prior (6 dof), and the residuals left (3 per hole).
struct GroupError {
  Vec6 twist = Vec6::Zero();  // child frame of the flange, t then r; the part common to the passes
  double chi2 = 0;
  Eigen::VectorXd left;
};
GroupError group_error(const ProfilometerProblem& problem, std::size_t group, const ProfilometerState& state);

}  // namespace asbuilt
