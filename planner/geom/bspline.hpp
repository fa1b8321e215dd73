// SPDX-License-Identifier: GPL-3.0-or-later
// Non-uniform B-spline basis functions and their derivatives, on expanded knot vectors, clamped or not.
// Source: Piegl, Tiller, The NURBS Book, algorithms A2.1 and A2.3.
#pragma once

#include <vector>

namespace asbuilt {

constexpr int kMaxDegree = 25;

/// The valid parameter range of a spline with this knot vector: [knots[degree], knots[pole_count]].
struct KnotRange {
  double t0 = 0, t1 = 0;
};
KnotRange knot_range(const std::vector<double>& knots, int degree);

/// Index k with knots[k] <= t < knots[k+1], inside the valid range; t at or past the end gives the last non-empty span.
int knot_span(const std::vector<double>& knots, int degree, double t);

/// Values and derivatives up to `order` (0..2) of the degree + 1 functions that are not zero on the span.
struct Basis {
  double n[3][kMaxDegree + 1];
};
void basis_at(const std::vector<double>& knots, int degree, int span, double t, int order, Basis& out);

}  // namespace asbuilt
