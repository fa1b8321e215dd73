// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/profile.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace asbuilt::burring {

namespace {

constexpr double kPi = 3.14159265358979323846;

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

/// Fine where burrs are low, then in steps of 2 %.
std::vector<double> height_grid(double height_max_mm) {
  std::vector<double> h{0};
  while (h.back() < height_max_mm) h.push_back(h.back() + std::max(0.01, 0.02 * h.back()));
  return h;
}

/// State 0 is "no burr": it is left and entered at a rate along the edge. The others walk, and rarely jump.
Eigen::MatrixXd transition(const ChainOptions& o, const std::vector<double>& h, const Eigen::VectorXd& width, double step_mm) {
  const int n = static_cast<int>(h.size());
  Eigen::MatrixXd t(n, n);
  const double jump = std::min(0.3, o.jump_ratio * step_mm);
  Eigen::VectorXd anywhere(n);  // a burr of any height, rather low than high
  for (int j = 0; j < n; ++j) anywhere(j) = j == 0 ? 0.0 : width(j) / (0.2 + h[j]);
  anywhere /= anywhere.sum();
  for (int i = 0; i < n; ++i) {
    const double sd = (o.walk_mm + o.walk_ratio * h[i]) * std::sqrt(step_mm);
    for (int j = 0; j < n; ++j) t(i, j) = j == 0 ? 0.0 : std::exp(-0.5 * (h[j] - h[i]) * (h[j] - h[i]) / (sd * sd)) * width(j);
    t.row(i) /= t.row(i).sum();
    if (i == 0) {
      const double leave = std::min(0.5, o.leave_ratio * step_mm);
      t.row(0) = (leave - 0.3 * jump) * t.row(0) + 0.3 * jump * anywhere.transpose();
      t(0, 0) = 1 - leave;
    } else {
      const double enter = std::min(0.5, o.leave_ratio * step_mm * std::exp(-h[i] / 0.1));
      t.row(i) = (1 - jump - enter) * t.row(i) + 0.7 * jump * anywhere.transpose();
      t(i, 0) = enter + 0.3 * jump;
    }
  }
  return t;
}

}  // namespace

ChainPosterior height_profile(const ChainOptions& o, const std::vector<double>& stations, const std::vector<HeightSample>& samples,
                              const std::vector<double>& density, bool is_closed) {
  const int count = static_cast<int>(stations.size());
  const std::vector<double> h = height_grid(o.height_max_mm);
  const int n = static_cast<int>(h.size());
  Eigen::VectorXd width(n);
  for (int i = 0; i < n; ++i) width(i) = 0.5 * (h[std::min(n - 1, i + 1)] - h[std::max(0, i - 1)]);
  const double step = count > 1 ? (stations.back() - stations.front()) / (count - 1) : 1;

  // Samples are a Poisson process over the fin's flank: rate `density` up to the height and a little more at its blunt tip, and a
  // thin rate of outliers everywhere.
  // A flank may be dim here although the view of it is good (the light that it needs comes from elsewhere): then it is hit rarely.
  Eigen::MatrixXd emission = Eigen::MatrixXd::Zero(n, count), dim = emission;  // log
  for (const HeightSample& p : samples) {
    const int j = std::clamp(static_cast<int>(std::lround((p.s_mm - stations.front()) / std::max(step, 1e-9))), 0, count - 1);
    const double tip_sd = std::hypot(p.sigma_mm, o.tip_scatter_mm);
    for (int i = 0; i < n; ++i) {
      const double u = (h[i] - p.height_mm) / tip_sd;
      const double tip = std::abs(u) < 8 ? o.tip_mm * std::exp(-0.5 * u * u) / (tip_sd * std::sqrt(2 * kPi)) : 0.0;
      const double rate = p.inlier_ratio * density[j] * (normal_cdf((h[i] - p.height_mm) / p.sigma_mm) + tip);
      emission(i, j) += std::log(rate + o.outliers_mm2);
      dim(i, j) += std::log(o.dim_ratio * rate + o.outliers_mm2);
    }
  }
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < n; ++i)
      if (h[i] > o.threshold_mm) {
        const double hits = density[j] * (h[i] - o.threshold_mm + o.tip_mm) * step;
        const double clear = std::log(1 - o.dim_share) + emission(i, j) - hits, rare = std::log(o.dim_share) + dim(i, j) - o.dim_ratio * hits;
        emission(i, j) = std::max(clear, rare) + std::log1p(std::exp(-std::abs(clear - rare)));
      }

  const Eigen::MatrixXd t = transition(o, h, width, step);
  Eigen::MatrixXd e(n, count);
  for (int j = 0; j < count; ++j) e.col(j) = (emission.col(j).array() - emission.col(j).maxCoeff()).exp();
  Eigen::VectorXd start(n);
  for (int i = 0; i < n; ++i) start(i) = i == 0 ? 0.3 : width(i) / (0.2 + h[i]);
  start /= start.sum();
  Eigen::MatrixXd forward(n, count), backward(n, count);
  // A closed edge is run through twice, so that its first station has a past.
  Eigen::VectorXd before = start;
  double log_evidence = 0;
  for (int lap = 0; lap < (is_closed ? 2 : 1); ++lap)
    for (int j = 0; j < count; ++j) {
      Eigen::VectorXd a = (lap == 0 && j == 0) ? start : Eigen::VectorXd(t.transpose() * before);
      a.array() *= e.col(j).array();
      const double total = a.sum();
      if (lap == (is_closed ? 1 : 0)) log_evidence += std::log(std::max(total, 1e-300)) + emission.col(j).maxCoeff();
      before = total > 0 ? Eigen::VectorXd(a / total) : start;
      forward.col(j) = before;
    }
  Eigen::VectorXd after = Eigen::VectorXd::Ones(n);
  for (int lap = 0; lap < (is_closed ? 2 : 1); ++lap)
    for (int j = count - 1; j >= 0; --j) {
      if (!(lap == 0 && j == count - 1)) after = t * Eigen::VectorXd(after.array() * e.col(j + 1 < count ? j + 1 : 0).array());
      const double total = after.maxCoeff();
      if (total > 0) after /= total;
      backward.col(j) = after;
    }
  ChainPosterior out;
  out.log_evidence = log_evidence;
  for (int j = 0; j < count; ++j) {
    Eigen::VectorXd p = forward.col(j).array() * backward.col(j).array();
    const double total = p.sum();
    if (total > 0) p /= total;
    else p = start;
    double mean = 0, square = 0, none = 0, sum = 0, upper = h.back();
    bool has_upper = false;
    for (int i = 0; i < n; ++i) {
      mean += p(i) * h[i], square += p(i) * h[i] * h[i];
      if (h[i] <= o.threshold_mm) none += p(i);
      sum += p(i);
      if (!has_upper && sum >= 0.975) upper = h[i], has_upper = true;
    }
    out.mean_mm.push_back(mean), out.sd_mm.push_back(std::sqrt(std::max(0.0, square - mean * mean)));
    out.upper_mm.push_back(upper), out.none_ratio.push_back(none);
  }
  return out;
}

}  // namespace asbuilt::burring
