// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/geom/bspline.hpp"

#include <algorithm>

namespace asbuilt {

KnotRange knot_range(const std::vector<double>& knots, int degree) {
  return {knots[degree], knots[knots.size() - 1 - degree]};
}

int knot_span(const std::vector<double>& knots, int degree, double t) {
  const int last = static_cast<int>(knots.size()) - degree - 2;  // last span index
  if (t >= knots[last + 1]) {
    int k = last;
    while (k > degree && knots[k] >= knots[k + 1]) --k;
    return k;
  }
  if (t <= knots[degree]) {
    int k = degree;
    while (k < last && knots[k] >= knots[k + 1]) ++k;
    return k;
  }
  const auto it = std::upper_bound(knots.begin() + degree, knots.begin() + last + 2, t);
  return static_cast<int>(it - knots.begin()) - 1;
}

void basis_at(const std::vector<double>& knots, int p, int span, double t, int order, Basis& out) {
  double ndu[kMaxDegree + 1][kMaxDegree + 1];
  double left[kMaxDegree + 1], right[kMaxDegree + 1];
  ndu[0][0] = 1;
  for (int j = 1; j <= p; ++j) {
    left[j] = t - knots[span + 1 - j];
    right[j] = knots[span + j] - t;
    double saved = 0;
    for (int r = 0; r < j; ++r) {
      ndu[j][r] = right[r + 1] + left[j - r];
      const double temp = ndu[j][r] != 0 ? ndu[r][j - 1] / ndu[j][r] : 0;
      ndu[r][j] = saved + right[r + 1] * temp;
      saved = left[j - r] * temp;
    }
    ndu[j][j] = saved;
  }
  for (int j = 0; j <= p; ++j) out.n[0][j] = ndu[j][p];
  for (int k = 1; k <= order; ++k)
    for (int j = 0; j <= p; ++j) out.n[k][j] = 0;
  const int top = std::min(order, p);
  if (top == 0) return;
  double a[2][3];
  const auto over = [](double x, double y) { return y != 0 ? x / y : 0.0; };
  for (int r = 0; r <= p; ++r) {
    int s1 = 0, s2 = 1;
    a[0][0] = 1;
    double factor = p;
    for (int k = 1; k <= top; ++k) {
      double d = 0;
      const int rk = r - k, pk = p - k;
      if (r >= k) {
        a[s2][0] = over(a[s1][0], ndu[pk + 1][rk]);
        d = a[s2][0] * ndu[rk][pk];
      }
      const int j1 = rk >= -1 ? 1 : -rk;
      const int j2 = r - 1 <= pk ? k - 1 : p - r;
      for (int j = j1; j <= j2; ++j) {
        a[s2][j] = over(a[s1][j] - a[s1][j - 1], ndu[pk + 1][rk + j]);
        d += a[s2][j] * ndu[rk + j][pk];
      }
      if (r <= pk) {
        a[s2][k] = -over(a[s1][k - 1], ndu[pk + 1][r]);
        d += a[s2][k] * ndu[r][pk];
      }
      out.n[k][r] = d * factor;
      factor *= p - k;
      std::swap(s1, s2);
    }
  }
}

}  // namespace asbuilt
