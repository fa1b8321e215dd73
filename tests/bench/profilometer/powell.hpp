// SPDX-License-Identifier: GPL-3.0-or-later
// The method the published system uses, as the comparison: Powell's conjugate directions with line searches by Brent, as in its classical
// form, and NLopt's PRAXIS, its descendant. Both see a function of numbers only.  Sources: [Powell1964], [Brent1973].
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <nlopt.hpp>
#include <vector>

namespace asbuilt::peer {

struct Minimum {
  Eigen::VectorXd x;
  double value = 0;
  long evaluation_count = 0;
};
using Function = std::function<double(const Eigen::VectorXd&)>;

/// Brackets and narrows along `direction` (golden section with parabolas); moves x there.
inline double line_minimum(const Function& f, Eigen::VectorXd& x, const Eigen::VectorXd& direction, double f0, double tolerance, long& count) {
  auto at = [&](double t) { ++count; return f(x + t * direction); };
  double a = 0, fa = f0, b = 1, fb = at(1);
  if (fb > fa) std::swap(a, b), std::swap(fa, fb);
  double c = b + 1.618 * (b - a), fc = at(c);
  for (int i = 0; fc < fb && i < 60; ++i) a = b, fa = fb, b = c, fb = fc, c = b + 1.618 * (b - a), fc = at(c);
  double lo = std::min(a, c), hi = std::max(a, c), m = b, w = b, v = b, fm = fb, fw = fb, fv = fb, d = 0, e = 0;
  for (int i = 0; i < 100; ++i) {
    const double mid = 0.5 * (lo + hi), tol = tolerance * std::abs(m) + 1e-10;
    if (std::abs(m - mid) <= 2 * tol - 0.5 * (hi - lo)) break;
    bool is_golden = true;
    if (std::abs(e) > tol) {
      double r = (m - w) * (fm - fv), q = (m - v) * (fm - fw), p = (m - v) * q - (m - w) * r;
      q = 2 * (q - r);
      if (q > 0) p = -p;
      q = std::abs(q);
      const double last = e;
      e = d;
      if (std::abs(p) < std::abs(0.5 * q * last) && p > q * (lo - m) && p < q * (hi - m)) {
        d = p / q, is_golden = false;
        if (m + d - lo < 2 * tol || hi - m - d < 2 * tol) d = m < mid ? tol : -tol;
      }
    }
    if (is_golden) e = m < mid ? hi - m : lo - m, d = 0.381966 * e;
    const double t = m + (std::abs(d) >= tol ? d : (d > 0 ? tol : -tol)), ft = at(t);
    if (ft <= fm) {
      (t < m ? hi : lo) = m;
      v = w, fv = fw, w = m, fw = fm, m = t, fm = ft;
    } else {
      (t < m ? lo : hi) = t;
      if (ft <= fw || w == m) v = w, fv = fw, w = t, fw = ft;
      else if (ft <= fv || v == m || v == w) v = t, fv = ft;
    }
  }
  if (fm < f0) x += m * direction;
  return std::min(fm, f0);
}

/// Powell 1964 with the direction of largest decrease replaced. Stops when a sweep lowers f by less than `tolerance` of it.
inline Minimum powell(const Function& f, Eigen::VectorXd x, double tolerance, long evaluations_max) {
  const Eigen::Index n = x.size();
  Eigen::MatrixXd U = Eigen::MatrixXd::Identity(n, n);
  Minimum out;
  double fx = f(x);
  out.evaluation_count = 1;
  while (out.evaluation_count < evaluations_max) {
    const Eigen::VectorXd x0 = x;
    const double f_start = fx;
    Eigen::Index biggest = 0;
    double drop = 0;
    for (Eigen::Index i = 0; i < n; ++i) {
      const double before = fx;
      fx = line_minimum(f, x, U.col(i), fx, 1e-4, out.evaluation_count);
      if (before - fx > drop) drop = before - fx, biggest = i;
    }
    if (2 * (f_start - fx) <= tolerance * (std::abs(f_start) + std::abs(fx)) + 1e-25) break;
    const Eigen::VectorXd step = x - x0;
    ++out.evaluation_count;
    const double f_far = f(x + step);
    if (f_far < f_start) {
      const double a = f_start - fx - drop, b = f_start - f_far;
      if (2 * (f_start - 2 * fx + f_far) * a * a - drop * b * b < 0) {
        fx = line_minimum(f, x, step, fx, 1e-4, out.evaluation_count);
        U.col(biggest) = U.col(n - 1), U.col(n - 1) = step;
      }
    }
  }
  out.x = x, out.value = fx;
  return out;
}

inline Minimum praxis(const Function& f, const Eigen::VectorXd& x0, double tolerance, int evaluations_max) {
  struct Call {
    const Function* f;
    long count = 0;
  } call{&f};
  nlopt::opt opt(nlopt::LN_PRAXIS, unsigned(x0.size()));
  opt.set_min_objective(
      [](unsigned n, const double* x, double*, void* data) {
        Call* c = static_cast<Call*>(data);
        ++c->count;
        return (*c->f)(Eigen::Map<const Eigen::VectorXd>(x, n));
      },
      &call);
  nlopt::srand(1);
  opt.set_ftol_rel(tolerance);
  opt.set_maxeval(evaluations_max);
  std::vector<double> x(x0.data(), x0.data() + x0.size());
  double value = 0;
  try {
    opt.optimize(x, value);
  } catch (const std::exception&) {  // round-off limited: x is the best so far
    value = f(Eigen::Map<const Eigen::VectorXd>(x.data(), x0.size()));
  }
  return {Eigen::Map<const Eigen::VectorXd>(x.data(), x0.size()), value, call.count};
}

}  // namespace asbuilt::peer
