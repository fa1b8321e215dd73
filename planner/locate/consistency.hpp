// SPDX-License-Identifier: GPL-3.0-or-later
// Do captures, calibrations and robot agree within what their covariances allow? Answered by probabilities: how often a sound
// cell would look as bad as this one or worse.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "planner/locate/adjust.hpp"

namespace asbuilt {

/// P(chi^2 with dof degrees of freedom > x). Incomplete gamma function by series or continued fraction.
double chi_square_tail(double x, double dof);

/// A sensor's hand-eye as calibrated against what the data make of it.
struct HandEyeTest {
  int sensor = -1;
  /// The smaller of two: of the posterior mean over the directions in which the data outweigh the prior (its covariance there is prior
  /// minus posterior), and of all six numbers in units of the prior alone (which is larger than that).
  double p = 1;
  double strain_sd = 0;                                                // root mean square of the six numbers in prior sd
  Vec3 shift_mm = Vec3::Zero(), shift_sd_mm = Vec3::Zero();            // what the data alone say, in the sensor's frame; 1 sd of data and prior together
};

/// By sensor in use, ascending.
std::vector<HandEyeTest> hand_eye_tests(const RobotPrior& prior, const Adjusted& adjusted);

/// Two captures by the places they share: chi^2 of the six numbers of their relative motion.
struct PairTest {
  int capture_1 = -1, capture_2 = -1;
  std::size_t places_count = 0;
  double apart_mm = 0, allowed_mm = 0;  // root mean square over the shared places; allowed: 1 sd
  double statistic = 0, dof = 0, p = 1;
};

/// Pairs that share at least ten places, ascending by capture.
std::vector<PairTest> pair_tests(const RobotPrior& prior, const AdjustRequest& request, const Adjusted& adjusted);

}  // namespace asbuilt
