// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/streams.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"

namespace asbuilt {

std::optional<TimedPose> pose_at(const std::vector<TimedPose>& s, double t, double gap) {
  const auto after = std::lower_bound(s.begin(), s.end(), t, [](const TimedPose& p, double x) { return p.t_s < x; });
  if (after == s.end() || (after == s.begin() && after->t_s > t)) return std::nullopt;
  if (after->t_s == t) return *after;
  const TimedPose &b = *after, &a = *std::prev(after);
  if (b.t_s - a.t_s > gap) return std::nullopt;
  const double u = (t - a.t_s) / (b.t_s - a.t_s);
  return TimedPose{t, a.q.slerp(u, b.q), (1 - u) * a.p_mm + u * b.p_mm};
}

namespace {

double turn_between(const TimedPose& a, const TimedPose& b) { return quat_log(a.q.conjugate() * b.q).norm(); }

}  // namespace

Result<StreamMatch> match_streams(const MotionStreamRecipe& recipe, const std::vector<TimedPose>& robot, const std::vector<TimedPose>& sensor) {
  struct Move {
    double t, turn;  // of the sensor over [t, t + step]
  };
  std::vector<Move> moves;
  double next = -1e300;
  for (const TimedPose& p : sensor) {
    if (p.t_s < next) continue;
    const auto q = pose_at(sensor, p.t_s + recipe.step_s, recipe.gap_max_s);
    if (!q) continue;
    moves.push_back({p.t_s, turn_between(p, *q)});
    next = p.t_s + 0.5 * recipe.step_s;
  }
  const auto compare = [&](double offset, double& correlation, double& square, double& count, double& slope2) {
    double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0, n = 0;
    square = slope2 = 0;
    std::vector<double> difference;
    std::vector<double> slopes;
    for (const Move& m : moves) {
      const auto a = pose_at(robot, m.t + offset, recipe.gap_max_s), b = pose_at(robot, m.t + offset + recipe.step_s, recipe.gap_max_s);
      if (!a || !b) continue;
      const double turn = turn_between(*a, *b);
      sa += turn, sb += m.turn, saa += turn * turn, sbb += m.turn * m.turn, sab += turn * m.turn, n += 1;
      difference.push_back(turn - m.turn);
      const auto c = pose_at(robot, m.t + offset + 0.01, recipe.gap_max_s), d = pose_at(robot, m.t + offset + 0.01 + recipe.step_s, recipe.gap_max_s);
      slopes.push_back(c && d ? (turn_between(*c, *d) - turn) / 0.01 : 0);
    }
    count = n;
    correlation = n > 10 ? (sab - sa * sb / n) / std::sqrt(std::max(1e-300, (saa - sa * sa / n) * (sbb - sb * sb / n))) : 0;
    // a detector's jumps must not count for more than their presence: Cauchy at the median
    std::vector<double> size;
    for (double d : difference) size.push_back(std::abs(d));
    if (size.empty()) return;
    std::nth_element(size.begin(), size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2), size.end());
    const double scale = 3 * 1.48 * std::max(1e-9, size[size.size() / 2]);
    for (std::size_t i = 0; i < difference.size(); ++i) {
      const double w = 1 / (1 + difference[i] * difference[i] / (scale * scale));
      square += scale * scale * std::log1p(difference[i] * difference[i] / (scale * scale)), slope2 += w * slopes[i] * slopes[i];
    }
  };
  StreamMatch out;
  std::vector<double> offsets, correlations;
  for (double t = -recipe.offset_max_s; t <= recipe.offset_max_s + 1e-9; t += 0.02) {
    double c, s, n, v;
    compare(t, c, s, n, v);
    offsets.push_back(t), correlations.push_back(c);
  }
  const std::size_t best = static_cast<std::size_t>(std::max_element(correlations.begin(), correlations.end()) - correlations.begin());
  out.peak_ratio = correlations[best];
  for (std::size_t i = 1; i + 1 < offsets.size(); ++i)
    if (std::abs(offsets[i] - offsets[best]) > 2 * recipe.step_s && correlations[i] >= correlations[i - 1] && correlations[i] >= correlations[i + 1])
      out.second_peak_ratio = std::max(out.second_peak_ratio, correlations[i] / std::max(1e-9, out.peak_ratio));
  if (moves.size() < 20 || out.peak_ratio < 0.3 || out.second_peak_ratio > recipe.second_peak_max_ratio)
    return refuse({.code = "calibrate.streams_do_not_match",
                   .where = "captures",
                   .message = fmt::format("the turning speeds of robot and sensor agree by {} at best and by {} of that at another offset ({} moves compared); record some seconds of back and forth turning",
                                          fixed_number(out.peak_ratio, 2), fixed_number(out.second_peak_ratio, 2), moves.size()),
                   .measured = out.peak_ratio,
                   .limit = 0.3,
                   .unit = "ratio",
                   .stage = "input"});
  double low = offsets[best] - 0.06, high = offsets[best] + 0.06;
  const auto cost = [&](double t) {
    double c, s, n, v;
    compare(t, c, s, n, v);
    return n > 0 ? s / n : 1e300;
  };
  const double g = 0.6180339887498949;
  double a = high - g * (high - low), b = low + g * (high - low), fa = cost(a), fb = cost(b);
  for (int i = 0; i < 40; ++i) {
    if (fa < fb) high = b, b = a, fb = fa, a = high - g * (high - low), fa = cost(a);
    else low = a, a = b, fa = fb, b = low + g * (high - low), fb = cost(b);
  }
  out.offset_s = 0.5 * (low + high);
  double c, s, n, v;
  compare(out.offset_s, c, s, n, v);
  out.offset_sd_s = v > 0 ? std::sqrt(s / n / v) * std::sqrt(2.0) : recipe.offset_max_s;  // neighbours overlap by half
  return out;
}

}  // namespace asbuilt
