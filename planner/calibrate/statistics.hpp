// SPDX-License-Identifier: GPL-3.0-or-later
// The few distributions that calibration is judged by.
#pragma once

namespace asbuilt {

/// Probability that a chi-squared variable of this many degrees of freedom (any positive real) exceeds x.
double chi2_tail(double x, double dof);
/// The value that a chi-squared variable exceeds with this probability.
double chi2_limit(double tail_probability, double dof);

}  // namespace asbuilt
