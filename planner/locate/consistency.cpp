// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/consistency.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

namespace asbuilt {
namespace {

constexpr std::size_t kPlacesMin = 10;
constexpr double kSeenMin = 0.5;  // of a direction's prior variance that the data take away: tested is where they outweigh the prior

/// chi^2 of a vector of given covariance, over directions that have some; `unit` is the measure in which "some" is meant.
struct Chi {
  double statistic = 0, dof = 0;
};
Chi chi_square(const Eigen::MatrixXd& unit_root, const Eigen::MatrixXd& covariance, const Eigen::VectorXd& x) {
  const auto L = unit_root.triangularView<Eigen::Lower>();
  const Eigen::MatrixXd half = L.solve(covariance);
  const Eigen::MatrixXd white = L.solve(half.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eig(0.5 * (white + white.transpose()));
  const Eigen::VectorXd u = eig.eigenvectors().transpose() * L.solve(x);
  Chi out;
  for (Eigen::Index i = 0; i < u.size(); ++i)
    if (eig.eigenvalues()[i] > kSeenMin) out.statistic += u[i] * u[i] / eig.eigenvalues()[i], out.dof += 1;
  return out;
}

HandEyeTest hand_eye_test(const RobotPrior& prior, const AdjustState& state, int at) {
  const Mat6 before = prior.covariance.block<6, 6>(at, at), after = state.covariance.block<6, 6>(6 + at, 6 + at);
  const Vec6 x = state.robot.segment<6>(at);
  HandEyeTest t;
  const auto seen = [&](int size) {
    const Eigen::MatrixXd root = Eigen::MatrixXd(before.topLeftCorner(size, size)).llt().matrixL();
    const Chi chi = chi_square(root, (before - after).topLeftCorner(size, size), x.head(size));
    return chi_square_tail(chi.statistic, chi.dof);
  };
  const double strain = x.dot(before.ldlt().solve(x));
  t.strain_sd = std::sqrt(strain / 6);
  t.p = std::min({seen(6), seen(3), chi_square_tail(strain, 6)});
  // The prior taken out again: what the data alone say.
  const Mat6 information = after.inverse();
  Mat6 data = information - Mat6(before.inverse());
  data = 0.5 * (data + data.transpose());
  data.diagonal() += 1e-9 * information.diagonal();
  const Eigen::LDLT<Mat6> solver(data);
  t.shift_mm = Vec6(solver.solve(information * x)).head<3>();
  t.shift_sd_mm = (Mat6(solver.solve(Mat6::Identity())) + before).diagonal().head<3>().cwiseMax(0).cwiseSqrt();
  return t;
}

}  // namespace

double chi_square_tail(double x, double dof) {
  if (dof <= 0 || x <= 0) return 1;
  const double a = 0.5 * dof, y = 0.5 * x, front = std::exp(-y + a * std::log(y) - std::lgamma(a));
  if (y < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 500 && term > 1e-14 * sum; ++n) term *= y / (a + n), sum += term;
    return std::max(0.0, 1 - sum * front);
  }
  double b = y + 1 - a, c = 1e300, d = 1 / b, h = d;  // Lentz
  for (int i = 1; i < 500; ++i) {
    const double an = -i * (i - a);
    b += 2;
    d = an * d + b, c = b + an / c;
    if (std::abs(d) < 1e-300) d = 1e-300;
    if (std::abs(c) < 1e-300) c = 1e-300;
    d = 1 / d;
    const double step = d * c;
    h *= step;
    if (std::abs(step - 1) < 1e-14) break;
  }
  return front * h;
}

std::vector<HandEyeTest> hand_eye_tests(const RobotPrior& prior, const Adjusted& adjusted) {
  std::vector<HandEyeTest> out;
  for (std::size_t s = 0; s < prior.sensor_at.size(); ++s) {
    if (prior.sensor_at[s] < 0) continue;
    out.push_back(hand_eye_test(prior, adjusted.state, prior.sensor_at[s]));
    out.back().sensor = static_cast<int>(s);
  }
  return out;
}

namespace {

struct Place {  // of two captures: how far apart they see it
  Vec6 wrench;
  double apart_mm, own_mm2;  // variance of both captures' own errors
};

/// Robust weights of the places around the motion x, and how much larger their scatter is than foretold.
struct Weighed {
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  double total = 0;
};
Weighed weigh(const std::vector<Place>& places, const Vec6& x) {
  constexpr double kTuning = 3.0, kMedianOfNormal = 0.6745;
  std::vector<double> size;
  for (const Place& p : places) size.push_back(std::abs(p.apart_mm - p.wrench.dot(x)) / std::sqrt(p.own_mm2));
  std::vector<double> sorted = size;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2), sorted.end());
  const double scale = std::max(1.0, sorted[sorted.size() / 2] / kMedianOfNormal);
  Weighed out;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double u = size[i] / (kTuning * scale), w = 1 / (1 + u * u), weight = w * w;
    const double information = weight / (places[i].own_mm2 * scale * scale);
    out.H += information * places[i].wrench * places[i].wrench.transpose();
    out.g += information * places[i].apart_mm * places[i].wrench;
    out.total += weight;
  }
  return out;
}

PairTest pair_test(const std::vector<Place>& places, const Mat6& D) {
  PairTest t;
  t.places_count = places.size();
  const Mat6 L = D.llt().matrixL();
  // From no motion and from the one that all places together ask for; kept is the one on which more places agree. From the first alone, faces along which the part was
  // moved would outvote the few that stand across.
  Weighed seen;
  for (const bool from_all : {false, true}) {
    Vec6 x = Vec6::Zero();
    if (from_all) {
      Mat6 H = Mat6::Zero();
      Vec6 g = Vec6::Zero();
      for (const Place& p : places) H += p.wrench * p.wrench.transpose() / p.own_mm2, g += p.wrench * (p.apart_mm / p.own_mm2);
      x = L * (L.transpose() * H * L + 1e-6 * Mat6::Identity()).ldlt().solve(L.transpose() * g);
    }
    Weighed here;
    for (int round = 0; round < 8; ++round) {
      here = weigh(places, x);
      const Mat6 Hw = L.transpose() * here.H * L + Mat6::Identity();
      x = L * Hw.ldlt().solve(L.transpose() * here.g);
    }
    if (here.total > seen.total) seen = here;
  }
  if (seen.total < static_cast<double>(kPlacesMin)) return t;  // too few of them agree on any motion
  double apart = 0, allowed = 0;
  for (const Place& p : places) apart += p.apart_mm * p.apart_mm, allowed += p.wrench.dot(D * p.wrench) + p.own_mm2;
  const double n = static_cast<double>(places.size());
  t.apart_mm = std::sqrt(apart / n), t.allowed_mm = std::sqrt(allowed / n);
  // g = H x with noise of covariance H, x of covariance D: in the root of D, seen directions only.
  const Mat6 Hw = L.transpose() * seen.H * L;
  const Eigen::SelfAdjointEigenSolver<Mat6> eig(0.5 * (Hw + Hw.transpose()));
  const Vec6 u = eig.eigenvectors().transpose() * (L.transpose() * seen.g);
  for (int i = 0; i < 6; ++i) {
    const double h = eig.eigenvalues()[i];
    if (h > 1.0) t.statistic += u[i] * u[i] / (h * h + h), t.dof += 1;
  }
  t.p = chi_square_tail(t.statistic, t.dof);
  return t;
}

}  // namespace

std::vector<PairTest> pair_tests(const RobotPrior& prior, const AdjustRequest& request, const Adjusted& adjusted) {
  std::map<std::pair<int, int>, std::vector<Place>> pairs;
  const auto& clusters = adjusted.clusters;
  const auto variance = [&](const Cluster& c) {
    const double f = adjusted.state.sensor_factor[static_cast<std::size_t>(request.cloud->captures[static_cast<std::size_t>(c.capture)].sensor)];
    return f * f * c.variance_mm2;
  };
  for (std::size_t i = 0; i < clusters.size(); ++i)
    for (std::size_t j = i + 1; j < clusters.size() && clusters[j].face == clusters[i].face && clusters[j].cell == clusters[i].cell; ++j) {
      pairs[{clusters[i].capture, clusters[j].capture}].push_back(
          {0.5 * (clusters[i].wrench + clusters[j].wrench), clusters[i].distance_mm - clusters[j].distance_mm, variance(clusters[i]) + variance(clusters[j])});
    }
  const Eigen::MatrixXd root = prior.covariance.llt().matrixL();
  std::vector<Eigen::MatrixXd> rooted;
  for (const auto& m : prior.capture) rooted.push_back(m * root);
  std::vector<PairTest> out;
  for (const auto& [key, places] : pairs) {
    if (places.size() < kPlacesMin) continue;
    const Eigen::MatrixXd d = rooted[static_cast<std::size_t>(key.first)] - rooted[static_cast<std::size_t>(key.second)];
    out.push_back(pair_test(places, d * d.transpose()));
    out.back().capture_1 = key.first, out.back().capture_2 = key.second;
  }
  return out;
}

}  // namespace asbuilt
