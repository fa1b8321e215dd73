// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/burr/profile.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::burring {

namespace {

constexpr double kPi = 3.14159265358979323846;

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

double step_of(const std::vector<double>& stations) {
  return stations.size() > 1 ? (stations.back() - stations.front()) / static_cast<double>(stations.size() - 1) : 1;
}

/// Steps from station to station. State 0 is "no burr": it is left and entered at a rate along the edge. The others walk, and rarely
/// jump to a burr of any height, rather low than high.
class Steps {
 public:
  Steps(const ChainOptions& o, const std::vector<double>& h, double step_mm) {
    const Eigen::Index n = static_cast<Eigen::Index>(h.size());
    const Eigen::VectorXd width = widths(h);
    const double jump = std::min(0.3, o.jump_ratio * step_mm);
    anywhere_.resize(n), none_.resize(n), jump_.setZero(n);
    for (Eigen::Index j = 0; j < n; ++j) anywhere_(j) = j == 0 ? 0.0 : width(j) / (0.2 + h[static_cast<std::size_t>(j)]);
    anywhere_ /= anywhere_.sum();
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto at = [&](Eigen::Index j) { return h[static_cast<std::size_t>(j)]; };
      const double sd = (o.walk_mm + o.walk_ratio * at(i)) * std::sqrt(step_mm);
      Eigen::Index from = std::max<Eigen::Index>(1, i), to = std::min(n, std::max<Eigen::Index>(2, i + 1));
      while (from > 1 && at(i) - at(from - 1) < 5 * sd) --from;
      while (to < n && at(to) - at(i) < 5 * sd) ++to;
      Eigen::VectorXd row(to - from);
      for (Eigen::Index j = from; j < to; ++j) row(j - from) = std::exp(-0.5 * (at(j) - at(i)) * (at(j) - at(i)) / (sd * sd)) * width(j);
      if (row.sum() > 0) row /= row.sum();
      if (i == 0) {
        const double leave = std::min(0.5, o.leave_ratio * step_mm);
        row *= leave - 0.3 * jump, jump_(0) = 0.3 * jump, none_(0) = 1 - leave;
      } else {
        const double enter = std::min(0.5, o.leave_ratio * step_mm * std::exp(-at(i) / 0.1));
        row *= 1 - jump - enter, jump_(i) = 0.7 * jump, none_(i) = enter + 0.3 * jump;
      }
      from_.push_back(from), rows_.push_back(std::move(row));
    }
  }
  Eigen::VectorXd ahead(const Eigen::VectorXd& p) const {
    Eigen::VectorXd out = p.dot(jump_) * anywhere_;
    for (std::size_t i = 0; i < rows_.size(); ++i)
      if (const double x = p(static_cast<Eigen::Index>(i)); x > 1e-14) out.segment(from_[i], rows_[i].size()) += x * rows_[i];
    out(0) += p.dot(none_);
    return out;
  }
  Eigen::VectorXd back(const Eigen::VectorXd& q) const {
    Eigen::VectorXd out = q.dot(anywhere_) * jump_ + q(0) * none_;
    for (std::size_t i = 0; i < rows_.size(); ++i) out(static_cast<Eigen::Index>(i)) += rows_[i].dot(q.segment(from_[i], rows_[i].size()));
    return out;
  }
  static Eigen::VectorXd widths(const std::vector<double>& h) {
    const std::size_t n = h.size();
    Eigen::VectorXd width(static_cast<Eigen::Index>(n));
    for (std::size_t i = 0; i < n; ++i) width(static_cast<Eigen::Index>(i)) = 0.5 * (h[std::min(n - 1, i + 1)] - h[i > 0 ? i - 1 : 0]);
    return width;
  }

 private:
  Eigen::VectorXd anywhere_, none_, jump_;
  std::vector<Eigen::Index> from_;
  std::vector<Eigen::VectorXd> rows_;
};

/// State of the chain: the height, and whether the fin is dim. Dimness stays with probability e^(-step / dim_length) and is else drawn
/// anew. Both passes are scaled station by station.
class Passes {
 public:
  double log_evidence = 0;

  Passes(const ChainOptions& options, const std::vector<double>& h, double step, const Emission& emission, const std::vector<double>& share)
      : share_(share), share_else_(options.dim_share), steps_(options, h, step), stays_(std::exp(-step / options.dim_length_mm)),
        e_{emission.clear, emission.dim}, most_(emission.clear.cols()) {
    for (Eigen::Index j = 0; j < most_.size(); ++j) {
      most_(j) = std::max(e_[0].col(j).maxCoeff(), e_[1].col(j).maxCoeff());
      for (auto& m : e_) m.col(j) = (m.col(j).array() - most_(j)).exp();
    }
    start_ = Steps::widths(h);
    for (Eigen::Index i = 0; i < start_.size(); ++i) start_(i) = i == 0 ? 0.3 : start_(i) / (0.2 + h[static_cast<std::size_t>(i)]);
    start_ /= start_.sum();
  }
  /// A closed edge is run through twice, so that its first station has a past.
  void run_forward(bool is_closed, bool is_kept) {
    const Eigen::Index count = most_.size();
    if (is_kept)
      for (auto& f : forward_) f.resize(start_.size(), count);
    Eigen::VectorXd before[2];
    for (int lap = 0; lap < (is_closed ? 2 : 1); ++lap)
      for (Eigen::Index j = 0; j < count; ++j) {
        Eigen::VectorXd a[2];
        const double dim = share(j);
        if (lap == 0 && j == 0) {
          a[0] = (1 - dim) * start_, a[1] = dim * start_;
        } else {
          const Eigen::VectorXd from_0 = steps_.ahead(before[0]), from_1 = steps_.ahead(before[1]);
          a[0] = stays_ * from_0 + (1 - stays_) * (1 - dim) * (from_0 + from_1);
          a[1] = stays_ * from_1 + (1 - stays_) * dim * (from_0 + from_1);
        }
        double total = 0;
        for (int v = 0; v < 2; ++v) a[v].array() *= e_[v].col(j).array(), total += a[v].sum();
        if (lap == (is_closed ? 1 : 0)) log_evidence += std::log(std::max(total, 1e-300)) + most_(j);
        for (int v = 0; v < 2; ++v) {
          before[v] = total > 0 ? Eigen::VectorXd(a[v] / total) : Eigen::VectorXd(0.5 * start_);
          if (is_kept) forward_[v].col(j) = before[v];
        }
      }
  }
  /// How likely each height (rows) is at each station (columns); after run_forward.
  Eigen::MatrixXd marginal(bool is_closed) const {
    const Eigen::Index count = most_.size(), n = start_.size();
    Eigen::MatrixXd out(n, count);
    Eigen::VectorXd after[2] = {Eigen::VectorXd::Ones(n), Eigen::VectorXd::Ones(n)};
    for (int lap = 0; lap < (is_closed ? 2 : 1); ++lap)
      for (Eigen::Index j = count - 1; j >= 0; --j) {
        if (!(lap == 0 && j == count - 1)) {
          const Eigen::Index next = j + 1 < count ? j + 1 : 0;
          const double dim = share(next);
          const Eigen::VectorXd to_0 = steps_.back(after[0].cwiseProduct(e_[0].col(next))), to_1 = steps_.back(after[1].cwiseProduct(e_[1].col(next)));
          const Eigen::VectorXd anew = (1 - stays_) * ((1 - dim) * to_0 + dim * to_1);
          after[0] = stays_ * to_0 + anew, after[1] = stays_ * to_1 + anew;
        }
        const double total = std::max(after[0].maxCoeff(), after[1].maxCoeff());
        for (auto& x : after)
          if (total > 0) x /= total;
        out.col(j) = forward_[0].col(j).cwiseProduct(after[0]) + forward_[1].col(j).cwiseProduct(after[1]);
        if (const double sum = out.col(j).sum(); sum > 0) out.col(j) /= sum;
        else out.col(j) = start_;
      }
    return out;
  }

 private:
  double share(Eigen::Index j) const { return share_.empty() ? share_else_ : share_[static_cast<std::size_t>(j)]; }

  const std::vector<double>& share_;
  double share_else_;
  Steps steps_;
  double stays_;
  Eigen::MatrixXd e_[2];
  Eigen::VectorXd most_, start_;
  Eigen::MatrixXd forward_[2];
};

}  // namespace

/// Fine where burrs are low, then in steps of 2 %.
std::vector<double> height_grid(double height_max_mm) {
  std::vector<double> h{0};
  while (h.back() < height_max_mm) h.push_back(h.back() + std::max(0.01, 0.02 * h.back()));
  return h;
}

double exposed_mm(const ChainOptions& o, double height_mm) {
  const double over = height_mm - o.threshold_mm;
  if (over <= 0) return 0;
  return over + o.tip_mm + (o.crest_ratio > 0 ? o.crest_ratio * o.crest_mm * (1 - std::exp(-over / o.crest_mm)) : 0.0);
}

// Samples are a Poisson process over the fin's flank: rate `density` up to the height and a little more at its blunt tip, and a thin
// rate of outliers everywhere. A flank may be dim although the view of it is good (the light that it needs comes from elsewhere):
// then it is hit rarely.
Emission emission_of(const ChainOptions& o, const std::vector<double>& h, const std::vector<double>& stations,
                     const std::vector<HeightSample>& samples, const std::vector<double>& density) {
  const int n = static_cast<int>(h.size()), count = static_cast<int>(stations.size());
  const double step = step_of(stations);
  Emission out{Eigen::MatrixXd::Zero(n, count), Eigen::MatrixXd::Zero(n, count)};
  for (const HeightSample& p : samples) {
    const int j = std::clamp(static_cast<int>(std::lround((p.s_mm - stations.front()) / std::max(step, 1e-9))), 0, count - 1);
    const double tip_sd = std::hypot(p.sigma_mm, o.tip_scatter_mm), full = p.inlier_ratio * density[static_cast<std::size_t>(j)];
    const double far = 6 * tip_sd, deep = std::max(far, o.crest_ratio > 0 ? 5 * o.crest_mm : 0.0);
    // Strays are a share of what is read: where fins are hit rarely, a point on one is rarely a stray.
    const double strays = std::clamp(o.outliers_ratio * density[static_cast<std::size_t>(j)], 0.05 * o.outliers_mm2, o.outliers_mm2), stray = std::log(strays);
    const double clear_above = std::log(full + strays), dim_above = std::log(o.dim_ratio * full + strays);
    for (int i = 0; i < n; ++i) {
      const double over = h[static_cast<std::size_t>(i)] - p.height_mm;
      if (over < -far) {
        out.clear(i, j) += stray, out.dim(i, j) += stray;
      } else if (over > deep) {
        out.clear(i, j) += clear_above, out.dim(i, j) += dim_above;
      } else {
        const double u = over / tip_sd, v = over / p.sigma_mm, ratio = p.sigma_mm / o.crest_mm;
        double shape = normal_cdf(v) + o.tip_mm * std::exp(-0.5 * u * u) / (tip_sd * std::sqrt(2 * kPi));
        if (o.crest_ratio > 0) shape += o.crest_ratio * std::exp(-over / o.crest_mm + 0.5 * ratio * ratio) * normal_cdf(v - ratio);  // blurred
        const double rate = full * shape;
        out.clear(i, j) += std::log(rate + strays), out.dim(i, j) += std::log(o.dim_ratio * rate + strays);
      }
    }
  }
  // Poorly seen, a flank is hit rarely all over, or well but only up to a line that may run anywhere below its crest.
  std::vector<std::vector<double>> heights(static_cast<std::size_t>(count));
  for (const HeightSample& p : samples)
    if (p.inlier_ratio > 0.3)
      heights[static_cast<std::size_t>(std::clamp(static_cast<int>(std::lround((p.s_mm - stations.front()) / std::max(step, 1e-9))), 0, count - 1))].push_back(p.height_mm);
  for (int j = 0; j < count; ++j) {
    auto& seen = heights[static_cast<std::size_t>(j)];
    std::sort(seen.begin(), seen.end());
    std::size_t below = 0;
    const double rate = density[static_cast<std::size_t>(j)] * step;
    for (int i = 0; i < n; ++i) {
      const double at = h[static_cast<std::size_t>(i)], hits = rate * exposed_mm(o, at);
      while (below < seen.size() && seen[below] <= at) ++below;
      const double line = below > 0 ? rate * exposed_mm(o, seen[below - 1]) : 0.0;
      const double patchy = out.clear(i, j) - std::min(hits, line + std::log(std::max(1.0, hits))), rare = out.dim(i, j) - o.dim_ratio * hits;
      out.clear(i, j) -= hits;
      out.dim(i, j) = std::max(patchy, rare) + std::log1p(std::exp(-std::abs(patchy - rare))) - std::log(2.0);
    }
  }
  return out;
}

double log_evidence(const ChainOptions& o, const std::vector<double>& grid, const std::vector<double>& stations, const Emission& emission,
                    bool is_closed, const std::vector<double>& dim_share) {
  Passes passes(o, grid, step_of(stations), emission, dim_share);
  passes.run_forward(is_closed, false);
  return passes.log_evidence;
}

ChainPosterior height_profile(const ChainOptions& o, const std::vector<double>& stations, const std::vector<HeightSample>& samples,
                              const std::vector<double>& density, bool is_closed, const std::vector<double>& dim_share) {
  const std::vector<double> h = height_grid(o.height_max_mm);
  Passes passes(o, h, step_of(stations), emission_of(o, h, stations, samples, density), dim_share);
  passes.run_forward(is_closed, true);
  const Eigen::MatrixXd marginal = passes.marginal(is_closed);
  ChainPosterior out;
  out.log_evidence = passes.log_evidence;
  for (Eigen::Index j = 0; j < marginal.cols(); ++j) {
    double mean = 0, square = 0, none = 0, sum = 0, upper = h.back(), middle = 0;
    bool has_middle = false;
    bool has_upper = false;
    for (std::size_t i = 0; i < h.size(); ++i) {
      const double p = marginal(static_cast<Eigen::Index>(i), j);
      if (!has_middle && sum + p >= 0.5) {
        middle = i > 0 ? h[i - 1] + (h[i] - h[i - 1]) * std::clamp((0.5 - sum) / std::max(p, 1e-12) + 0.5, 0.0, 1.0) : 0.0, has_middle = true;
      }
      mean += p * h[i], square += p * h[i] * h[i], sum += p;
      if (h[i] <= o.threshold_mm) none += p;
      if (!has_upper && sum >= 0.975) upper = h[i], has_upper = true;
    }
    out.mean_mm.push_back(mean), out.median_mm.push_back(middle), out.sd_mm.push_back(std::sqrt(std::max(0.0, square - mean * mean)));
    out.upper_mm.push_back(upper), out.none_ratio.push_back(none);
  }
  return out;
}

}  // namespace asbuilt::burring
