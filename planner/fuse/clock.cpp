// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/clock.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

namespace asbuilt::fuse_detail {
namespace {

using Vec7 = Eigen::Matrix<double, 7, 1>;

double median(std::vector<double> v) {
  if (v.empty()) return 0;
  const std::size_t k = v.size() / 2;
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(k), v.end());
  return v[k];
}

/// The sensor's motion between the pair's times as the robot did it.
std::optional<Eigen::Isometry3d> robot_motion(const MotionPair& p, const Trajectory& robot, const Pose<frame::Flange, frame::Sensor>& X, double offset_s) {
  const PoseAt a = robot.at(p.t_first_s + offset_s), b = robot.at(p.t_second_s + offset_s);
  if (!a.is_known || !b.is_known) return std::nullopt;
  return ((a.T_base_flange * X).inverse() * (b.T_base_flange * X)).matrix();
}

double value_of(const MotionPair& p, const Vec7& x) { return std::max(0.0, p.c + 2 * p.g.dot(x) + x.dot(p.A * x)); }

/// Least value of the pair's form over all motions (scale held), damped where the frames do not tell.
double best_of(const MotionPair& p) {
  Mat6 A = p.A.topLeftCorner<6, 6>();
  A.diagonal() += Vec6::Constant(1e-6 * A.diagonal().maxCoeff() + 1e-12);
  const Vec6 x = -A.ldlt().solve(Vec6(p.g.head<6>()));
  Vec7 y = Vec7::Zero();
  y.head<6>() = x;
  return std::min(p.c, value_of(p, y));
}

}  // namespace

std::vector<std::size_t> bright_frames(const std::vector<StreamFrame>& frames) {
  std::vector<std::size_t> out;
  std::vector<double> steps;
  for (std::size_t i = 1; i < frames.size(); ++i)
    if (frames[i].brightness_ratio >= 0 && frames[i - 1].brightness_ratio >= 0) steps.push_back(std::abs(frames[i].brightness_ratio - frames[i - 1].brightness_ratio));
  if (steps.size() < 5) return out;
  const double limit = std::max(0.05, 6 * 1.4826 * median(steps));
  for (std::size_t i = 1; i < frames.size(); ++i) {
    if (frames[i].brightness_ratio < 0 || frames[i - 1].brightness_ratio < 0) continue;
    if (frames[i].brightness_ratio - frames[i - 1].brightness_ratio > limit && frames[i - 1].brightness_ratio < 0.95) {
      if (out.empty() || i > out.back() + 1) out.push_back(i);  // the next frame may be brighter still: the flash began in the first
    }
  }
  return out;
}

std::optional<OffsetInterval> flash_offset(const std::vector<StreamFrame>& frames, const std::vector<std::array<double, 2>>& log) {
  const std::vector<std::size_t> bright = bright_frames(frames);
  if (bright.empty() || log.empty()) return std::nullopt;
  const auto interval = [&](std::size_t frame, std::size_t edge) -> std::array<double, 2> {
    const double end = frames[frame].t_s + frames[frame].exposure_s / 2, before = frames[frame - 1].t_s + frames[frame - 1].exposure_s / 2;
    return {log[edge][0] - end, log[edge][1] - before};
  };
  // the k-th bright frame is the (k + shift)-th edge of the log: the shift under which most intervals meet
  std::optional<OffsetInterval> best;
  const auto n = static_cast<std::ptrdiff_t>(bright.size()), m = static_cast<std::ptrdiff_t>(log.size());
  for (std::ptrdiff_t shift = -(n - 1); shift < m; ++shift) {
    OffsetInterval all{-1e300, 1e300, 0};
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      if (k + shift < 0 || k + shift >= m) continue;
      const auto i = interval(bright[static_cast<std::size_t>(k)], static_cast<std::size_t>(k + shift));
      all.low_s = std::max(all.low_s, i[0]), all.high_s = std::min(all.high_s, i[1]);
      ++all.flash_count;
    }
    if (all.flash_count == 0 || all.low_s > all.high_s) continue;
    if (!best || all.flash_count > best->flash_count) best = all;
  }
  // a flash that finds no partner is one too many
  if (best && best->flash_count < static_cast<int>(std::min(n, m))) return std::nullopt;
  return best;
}

std::optional<MotionOffset> solve_offset(const std::vector<MotionPair>& pairs, const Trajectory& robot, const Pose<frame::Flange, frame::Sensor>& X, double start_s, bool with_scale) {
  MotionOffset out;
  std::vector<double> floor(pairs.size(), 0), scatter;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    floor[k] = best_of(pairs[k]);
    if (pairs[k].points_count > 50) scatter.push_back(std::sqrt(floor[k] / pairs[k].points_count));
  }
  if (scatter.size() < 5) return std::nullopt;
  out.scatter_mm = std::max(1e-6, median(scatter));

  struct Row {  // one pair at the present offset
    bool is_used = false;
    double value = 0;          // above the pair's own best
    Vec2 score = Vec2::Zero();
    Eigen::Matrix2d H = Eigen::Matrix2d::Zero();
    double weight = 1;
  };
  std::vector<Row> rows(pairs.size());
  const int n = with_scale ? 2 : 1;
  const auto evaluate = [&](double offset_s, double b) {
    constexpr double h = 5e-4;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const MotionPair& p = pairs[k];
      Row& r = rows[k];
      r = {};
      if (p.points_count <= 50) continue;
      const auto D = robot_motion(p, robot, X, offset_s), before = robot_motion(p, robot, X, offset_s - h), after = robot_motion(p, robot, X, offset_s + h);
      if (!D || !before || !after) continue;
      const Eigen::Isometry3d back = p.motion.inverse();
      Vec7 x = Vec7::Zero(), dt = Vec7::Zero();
      x.head<6>() = screw_log(back * *D), x(6) = b;
      dt.head<6>() = (screw_log(back * *after) - screw_log(back * *before)) / (2 * h);
      Eigen::Matrix<double, 7, 2> J;
      J.col(0) = dt, J.col(1) = Vec7::Unit(6);
      r.is_used = true;
      r.value = std::max(0.0, value_of(p, x) - floor[k]) / p.points_count;
      r.score = J.transpose() * (p.A * x + p.g) / p.points_count;
      r.H = J.transpose() * p.A * J / p.points_count;
    }
    // a pair that the robot's motion does not explain has a bounded say (Cauchy on its misfit)
    std::vector<double> misfit;
    for (const Row& r : rows)
      if (r.is_used) misfit.push_back(r.value);
    const double scale = std::max(1e-12, 2 * median(misfit));
    for (Row& r : rows) r.weight = 1 / (1 + r.value / (4 * scale));
  };
  double offset = start_s, b = 0;
  Eigen::Matrix2d H = Eigen::Matrix2d::Zero();
  for (int iteration = 0; iteration < 30; ++iteration) {
    evaluate(offset, b);
    H.setZero();
    Vec2 g = Vec2::Zero();
    for (const Row& r : rows)
      if (r.is_used) H += r.weight * r.H, g += r.weight * r.score;
    if (n == 1) H(1, 0) = H(0, 1) = 0, H(1, 1) = 1, g(1) = 0;
    if (!(H(0, 0) > 0) || !(H(1, 1) > 0)) break;
    Eigen::Matrix2d damped = H;
    damped(0, 0) *= 1 + 1e-9, damped(1, 1) *= 1 + 1e-9;
    Vec2 step = -damped.ldlt().solve(g);
    step(0) = std::clamp(step(0), -0.02, 0.02), step(1) = std::clamp(step(1), -0.05, 0.05);
    offset += step(0), b += step(1);
    if (std::abs(step(0)) < 1e-7 && std::abs(step(1)) < 1e-8) break;
  }
  evaluate(offset, b);
  H.setZero();
  Eigen::Matrix2d S = Eigen::Matrix2d::Zero();
  std::vector<double> misfit;
  for (const Row& r : rows) {
    if (!r.is_used) continue;
    ++out.pairs_count;
    H += r.weight * r.H;
    S += r.weight * r.weight * r.score * r.score.transpose();
    misfit.push_back(std::sqrt(r.value));
  }
  if (out.pairs_count < 5) return std::nullopt;
  if (n == 1) H(1, 0) = H(0, 1) = 0, H(1, 1) = 1, S(0, 1) = S(1, 0) = 0, S(1, 1) = 0;
  if (!(H(0, 0) > 0)) return std::nullopt;
  // depth scale and offset are told apart only where the motion changes; a scale that no motion shows is left out of the solve
  const double small_sample = out.pairs_count / std::max(1.0, out.pairs_count - static_cast<double>(n));
  Eigen::Matrix2d inverse = Eigen::Matrix2d::Zero();
  if (H(1, 1) > 0 && H.determinant() > 1e-12 * H(0, 0) * H(1, 1)) inverse = H.inverse();
  else inverse(0, 0) = 1 / H(0, 0);
  const Eigen::Matrix2d V = small_sample * inverse * S * inverse;
  out.offset_s = offset, out.sigma_s = std::sqrt(std::max(1e-16, V(0, 0)));
  out.scale_ratio = 1 + b, out.scale_sigma_ratio = n == 2 && inverse(1, 1) > 0 ? std::sqrt(std::max(1e-18, V(1, 1))) : -1;
  out.misfit_mm = median(misfit);

  // the offset by time: one Newton step a window from the common answer
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < pairs.size(); ++k)
    if (rows[k].is_used) order.push_back(k);
  std::sort(order.begin(), order.end(), [&](std::size_t i, std::size_t j) { return pairs[i].t_first_s < pairs[j].t_first_s; });
  const std::size_t windows = std::min<std::size_t>(10, order.size() / 10);
  for (std::size_t w = 0; w < windows; ++w) {
    double h = 0, g = 0, s = 0, t = 0;
    const std::size_t begin = w * order.size() / windows, end = (w + 1) * order.size() / windows;
    for (std::size_t i = begin; i < end; ++i) {
      const Row& r = rows[order[i]];
      h += r.weight * r.H(0, 0), g += r.weight * r.score(0), t += pairs[order[i]].t_first_s;
    }
    if (!(h > 0)) continue;
    const double d = -g / h;
    for (std::size_t i = begin; i < end; ++i) {
      const Row& r = rows[order[i]];
      const double left = r.weight * (r.score(0) + r.H(0, 0) * d);
      s += left * left;
    }
    const double count = static_cast<double>(end - begin);
    out.windows.push_back({t / count, offset + d, std::sqrt(std::max(1e-16, s * count / std::max(1.0, count - 1))) / h});
  }
  return out;
}

std::optional<OffsetSearch> search_offset(const std::vector<MotionPair>& pairs, const Trajectory& robot, const Pose<frame::Flange, frame::Sensor>& X, double low_s, double high_s,
                                          double step_s) {
  std::vector<double> floor;
  int good = 0;
  for (const MotionPair& p : pairs) floor.push_back(best_of(p)), good += p.points_count > 50;
  const int steps = static_cast<int>(std::clamp((high_s - low_s) / step_s, 1.0, 200000.0));
  std::vector<double> cost(static_cast<std::size_t>(steps) + 1, std::numeric_limits<double>::infinity());
  for (int i = 0; i <= steps; ++i) {
    const double offset = low_s + (high_s - low_s) * i / steps;
    double sum = 0;
    int used = 0;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      if (pairs[k].points_count <= 50) continue;
      const auto D = robot_motion(pairs[k], robot, X, offset);
      if (!D) continue;
      Vec7 x = Vec7::Zero();
      x.head<6>() = screw_log(pairs[k].motion.inverse() * *D);
      sum += std::sqrt(std::max(0.0, value_of(pairs[k], x) - floor[k]) / pairs[k].points_count);  // rms: one bad pair does not decide
      ++used;
    }
    if (used >= 5 && used >= good / 2) cost[static_cast<std::size_t>(i)] = sum / used;
  }
  const auto best = std::min_element(cost.begin(), cost.end());
  if (!std::isfinite(*best)) return std::nullopt;
  OffsetSearch out;
  const auto at = best - cost.begin();
  out.offset_s = low_s + (high_s - low_s) * static_cast<double>(at) / steps;
  double ordinary = 0, second = std::numeric_limits<double>::infinity();
  std::vector<double> finite;
  for (const double c : cost)
    if (std::isfinite(c)) finite.push_back(c);
  ordinary = median(finite);
  const auto apart = static_cast<std::ptrdiff_t>(std::ceil(0.1 / std::max(1e-9, (high_s - low_s) / steps)));  // another minimum: 0.1 s away, and a minimum of its own
  for (std::ptrdiff_t i = 1; i + 1 < static_cast<std::ptrdiff_t>(cost.size()); ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (std::abs(i - at) < apart || !(cost[k] <= cost[k - 1] && cost[k] <= cost[k + 1])) continue;
    second = std::min(second, cost[k]);
  }
  if (std::isfinite(second) && ordinary > *best) out.second_ratio = std::clamp((ordinary - second) / (ordinary - *best), 0.0, 1.0);
  return out;
}

std::optional<RateOffset> rotation_rate_offset(const std::vector<TimedRotation>& hand, const std::vector<TimedRotation>& eye, double low_s, double high_s, double window_s) {
  if (hand.size() < 4 || eye.size() < 4) return std::nullopt;
  struct Turn {
    double t0_s, t1_s;
    Vec3 w;
  };
  std::vector<Turn> turns;  // of the eye over about one window, without overlap in excess of a half
  for (std::size_t i = 0; i < eye.size();) {
    std::size_t j = i;
    while (j < eye.size() && eye[j].t_s < eye[i].t_s + window_s) ++j;
    if (j >= eye.size()) break;
    if (eye[j].t_s - eye[i].t_s < 1.5 * window_s) turns.push_back({eye[i].t_s, eye[j].t_s, quat_log(eye[i].q.conjugate() * eye[j].q)});
    i = std::max(i + 1, i + (j - i) / 2);
  }
  const auto hand_at = [&](double t, Eigen::Quaterniond& q) {
    const auto it = std::lower_bound(hand.begin(), hand.end(), t, [](const TimedRotation& h, double v) { return h.t_s < v; });
    if (it == hand.begin() || it == hand.end()) return false;
    const TimedRotation &b = *it, &a = *(it - 1);
    if (b.t_s - a.t_s > 0.2) return false;
    q = a.q * quat_exp((t - a.t_s) / (b.t_s - a.t_s) * quat_log(a.q.conjugate() * b.q));
    return true;
  };
  const auto kabsch = [](const Mat3& H) {  // R with R eye = hand
    Eigen::JacobiSVD<Mat3> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
    Mat3 D = Mat3::Identity();
    D(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant();
    return Mat3(svd.matrixU() * D * svd.matrixV().transpose());
  };
  std::vector<double> residual;
  std::vector<char> was_used;
  /// Robust mean residual; fills residual and R.
  const auto cost_at = [&](double offset, Mat3& R) {
    std::vector<std::pair<Vec3, Vec3>> both;
    was_used.assign(turns.size(), 0);
    for (std::size_t k = 0; k < turns.size(); ++k) {
      Eigen::Quaterniond a, b;
      if (!hand_at(turns[k].t0_s + offset, a) || !hand_at(turns[k].t1_s + offset, b)) continue;
      both.emplace_back(quat_log(a.conjugate() * b), turns[k].w);
      was_used[k] = 1;
    }
    if (both.size() < 10 || both.size() < turns.size() / 3) return std::numeric_limits<double>::infinity();
    std::vector<double> weight(both.size(), 1);
    double cost = 0;
    for (int pass = 0; pass < 4; ++pass) {
      Mat3 H = Mat3::Zero();
      for (std::size_t k = 0; k < both.size(); ++k) H += weight[k] * both[k].first * both[k].second.transpose();
      R = kabsch(H);
      residual.clear();
      for (const auto& [h, e] : both) residual.push_back((h - R * e).norm());
      const double s = std::max(1e-9, 1.4826 * median(residual));
      cost = 0;
      for (std::size_t k = 0; k < both.size(); ++k) {
        const double u = residual[k] / (2 * s);
        weight[k] = 1 / (1 + u * u);
      }
      for (const double r : residual) cost += std::min(r, 0.2);
      cost /= static_cast<double>(both.size());
    }
    return cost;
  };
  constexpr double step = 0.005;
  const int steps = static_cast<int>(std::clamp((high_s - low_s) / step, 2.0, 100000.0));
  std::vector<double> cost;
  Mat3 R = Mat3::Identity();
  for (int i = 0; i <= steps; ++i) cost.push_back(cost_at(low_s + (high_s - low_s) * i / steps, R));
  const std::ptrdiff_t at = std::min_element(cost.begin(), cost.end()) - cost.begin();
  if (!std::isfinite(cost[static_cast<std::size_t>(at)])) return std::nullopt;
  RateOffset out;
  double offset = low_s + (high_s - low_s) * static_cast<double>(at) / steps;
  // Gauss-Newton in offset with the rotation re-solved, weights bounded (Cauchy)
  double H = 0, S = 0;
  for (int iteration = 0; iteration < 25; ++iteration) {
    cost_at(offset, R);
    const double s = std::max(1e-9, 1.4826 * median(residual));
    H = 0, S = 0;
    double g = 0;
    constexpr double h = 0.01;
    for (std::size_t k = 0; k < turns.size(); ++k) {
      Eigen::Quaterniond a, b, a0, b0, a1, b1;
      if (!hand_at(turns[k].t0_s + offset, a) || !hand_at(turns[k].t1_s + offset, b) || !hand_at(turns[k].t0_s + offset - h, a0) || !hand_at(turns[k].t1_s + offset - h, b0) ||
          !hand_at(turns[k].t0_s + offset + h, a1) || !hand_at(turns[k].t1_s + offset + h, b1))
        continue;
      const Vec3 r = quat_log(a.conjugate() * b) - R * turns[k].w, d = (quat_log(a1.conjugate() * b1) - quat_log(a0.conjugate() * b0)) / (2 * h);
      const double w = 1 / (1 + r.squaredNorm() / (4 * s * s));
      H += w * d.squaredNorm(), g += w * d.dot(r), S += w * w * d.dot(r) * d.dot(r);
    }
    if (!(H > 0)) return std::nullopt;
    const double move = std::clamp(-g / H, -0.02, 0.02);
    offset += move;
    if (std::abs(move) < 1e-7) break;
  }
  cost_at(offset, R);
  out.offset_s = offset, out.sigma_s = std::sqrt(2 * S) / H;  // windows overlap by half
  out.q_hand_eye = Eigen::Quaterniond(R).normalized();
  out.residual_rms_rad = 1.4826 * median(residual);
  std::vector<double> finite;
  for (const double c : cost)
    if (std::isfinite(c)) finite.push_back(c);
  const double ordinary = median(finite), best = cost[static_cast<std::size_t>(at)];
  for (std::ptrdiff_t i = 1; i + 1 < static_cast<std::ptrdiff_t>(cost.size()); ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (std::abs(i - at) * (high_s - low_s) / steps < 0.3 || !(cost[k] <= cost[k - 1] && cost[k] <= cost[k + 1])) continue;
    out.second_ratio = std::max(out.second_ratio, std::clamp((ordinary - cost[k]) / std::max(1e-12, ordinary - best), 0.0, 1.0));
  }
  return out;
}

}  // namespace asbuilt::fuse_detail
