// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/statistics.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

// Regularised incomplete gamma: series below a + 1, continued fraction above (Lentz).
double chi2_tail(double x, double dof) {
  const double a = dof / 2, h = x / 2;
  if (!(h > 0) || !(a > 0)) return 1;
  int sign = 0;
  const double scale = std::exp(-h + a * std::log(h) - lgamma_r(a, &sign));
  if (h < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 10000 && term > 1e-16 * sum; ++n) term *= h / (a + n), sum += term;
    return std::clamp(1 - sum * scale, 0.0, 1.0);
  }
  double b = h + 1 - a, c = 1e300, d = 1 / b, f = d;
  for (int n = 1; n < 10000; ++n) {
    const double an = -n * (n - a);
    b += 2;
    d = 1 / (an * d + b), c = b + an / c;
    const double step = c * d;
    f *= step;
    if (std::abs(step - 1) < 1e-15) break;
  }
  return std::clamp(f * scale, 0.0, 1.0);
}

double chi2_limit(double tail_probability, double dof) {
  double low = 0, high = dof + 10;
  while (chi2_tail(high, dof) > tail_probability && high < 1e9) high *= 2;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    (chi2_tail(middle, dof) > tail_probability ? low : high) = middle;
  }
  return (low + high) / 2;
}

}  // namespace asbuilt
