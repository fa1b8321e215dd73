// SPDX-License-Identifier: GPL-3.0-or-later
// From a network and its starts to a calibration that may be trusted: starts cross-checked, held-out views measured, outliers and
// weak motions named, poses to add proposed.
#pragma once

#include <string>
#include <vector>

#include "planner/base/result.hpp"
#include "planner/calibrate/hand_eye.hpp"
#include "planner/calibrate/network.hpp"

namespace asbuilt {

struct CalibrateRecipe {
  NetworkRecipe network;
  double min_motion_rad = 0.26;     // 15 degrees: motion pairs that enter the closed forms
  double spread_min_rad = 0.10;     // the second independent turn between the views (root mean square) must reach this
  double point_sd_max_mm = 1.0;     // of the point the sensor looks at: above, nothing is written
  double turn_sd_max_rad = 0.087;   // 5 degrees, of the sensor's orientation
  double outliers_max_ratio = 0.25; // of the views
  double motion_gap_max_rad = 0.035;  // 2 degrees: median difference of the turns of robot and sensor
  int folds_count = 5;              // each view is predicted once by a solve without it
  int views_min_count = 5;
  int poses_to_add_count = 3;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("network", s.network), a("min_motion", s.min_motion_rad), a("spread_min", s.spread_min_rad), a("point_sd_max", s.point_sd_max_mm);
    a("turn_sd_max", s.turn_sd_max_rad), a("outliers_max", s.outliers_max_ratio), a("motion_gap_max", s.motion_gap_max_rad), a("folds", s.folds_count);
    a("views_min", s.views_min_count), a("poses_to_add", s.poses_to_add_count);
  }
};

struct StartLine {
  std::string method;
  double from_best_mm = 0, from_best_rad = 0;  // of the closed form itself, at the point the sensor looks at, and as a turn
  double cost = 0;                             // of the solve from there
  double end_mm = 0;                           // how far that solve ended from the best one, at the same point
  bool is_converged = false;
};

struct ViewLine {
  std::string name;
  bool is_held_out = false;       // marked so in the captures; else it was held out in its fold
  bool is_used = true;            // no outlier
  double residual_rms = 0;        // mm or px, before the robot's error is taken out
  double held_out_rms = 0;        // the same, predicted without this view
  double held_out_rad = 0;        // Sight::pose: rotation
  double expected_rms = 0;        // what the model says the held-out residual should be
  double held_out_chi2_ratio = 0; // squared whitened held-out residual per row
  double robot_mm = 0, robot_rad = 0;  // the robot error that explains it best
  double leverage_ratio = 0;      // 0..1, how much the answer hangs on this view
};

struct WeakDirection {
  std::string text;    // "turn about the sensor's x: 1.3 deg (sd)"
  double sd = 0;
  std::string unit;    // mm, deg
  double point_mm = 0; // what one sd of it moves at the point the sensor looks at
};

struct PoseToAdd {
  Pose<frame::Base, frame::Flange> T_base_flange;
  double point_sd_mm = 0;  // of the looked-at point when this and the ones before it are added
  double turn_sd_rad = 0;
};

struct Calibrated {
  Network network;  // as solved; views relinearised
  NetworkSolution solution;
  std::string unit;  // of the residuals: mm, px
  std::vector<StartLine> starts;
  std::vector<ViewLine> views;
  double fit_rms = 0;
  // views predicted without themselves: the accuracy to quote
  double held_out_rms = 0, held_out_mean = 0, held_out_max = 0, held_out_rad = 0;  // rad: mean turn, Sight::pose
  double held_out_expected = 0;      // what the model says held_out_rms should be
  double held_out_rms_mm = 0;        // px are turned into mm at the target's distance
  double p_held_out = 1;             // probability of residuals this large if model and sds are right
  MotionSpread spread;
  std::vector<WeakDirection> weak;
  std::vector<PoseToAdd> poses_to_add;
  Vec3 p_look = Vec3::Zero();        // the point the sensor looks at, its frame: mean of the target
  double point_sd_mm = 0;            // largest sd of that point in the mount's frame
  double turn_sd_rad = 0;
  std::vector<Note> notes;
};

/// Solves from every start and keeps the best.
/// Refuses calibrate.too_few_views, calibrate.motion_degenerate, calibrate.not_converged, calibrate.starts_disagree,
///         calibrate.too_many_outliers.
Result<Done<Calibrated>> calibrate_network(const CalibrateRecipe& recipe, const Network& network, const std::vector<MotionStart>& starts,
                                           const NetworkState& base_state = {});

/// The weakest directions of a covariance of the mount in words, worst first.
std::vector<WeakDirection> weak_directions(const Mat6& covariance, const Vec3& p_look, int count);

/// Poses that would help most: turns of existing views about the target, chosen greedily by the information they add.
std::vector<PoseToAdd> poses_to_add(const NetworkRecipe& sds, const Network& network, const NetworkState& state, const Eigen::MatrixXd& information,
                                    const Vec3& p_look, int count);

}  // namespace asbuilt
