// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/joint_feed.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

constexpr double kSmoothing_s = 0.02;

double floor_tenth(double v) { return std::floor(v * 10 + 1e-6) / 10; }

}  // namespace

std::optional<FeedFault> follow_with_joints(const std::array<JointSpec, 6>& joints, double ratio, const std::vector<JointVector>& q,
                                            const std::vector<Vec3>& tip, double feed_min, std::vector<double>& feed) {
  const std::size_t n = q.size();
  std::vector<double> length(n, 0);
  for (std::size_t i = 1; i < n; ++i) {
    length[i] = (tip[i] - tip[i - 1]).norm();
    if (length[i] < 1e-6) continue;
    for (int j = 0; j < 6; ++j) {
      const double limit = ratio * joints[j].speed_rad_s, dq = std::abs(q[i][j] - q[i - 1][j]);
      if (!(limit > 0) || dq * feed[i] <= limit * length[i]) continue;
      const double wanted = floor_tenth(limit * length[i] / dq);
      if (wanted < feed_min) return FeedFault{i, j, wanted, true};
      feed[i] = std::min(feed[i], wanted);
    }
  }
  for (int round = 0; round < 200; ++round) {
    bool is_changed = false;
    for (std::size_t i = 1; i + 1 < n; ++i) {
      if (length[i] < 1e-6 || length[i + 1] < 1e-6) continue;
      const double time = std::max(0.5 * (length[i] / feed[i] + length[i + 1] / feed[i + 1]), kSmoothing_s);
      for (int j = 0; j < 6; ++j) {
        const double limit = ratio * joints[j].acceleration_rad_s2;
        if (!(limit > 0)) continue;
        const double before = (q[i][j] - q[i - 1][j]) * feed[i] / length[i], after = (q[i + 1][j] - q[i][j]) * feed[i + 1] / length[i + 1];
        const double a = std::abs(after - before) / time;
        if (a <= limit) continue;
        // A change of direction slows both blocks, a change of feed the faster one.
        const double factor = std::max(0.5, 0.98 * limit / a), faster = std::max(feed[i], feed[i + 1]);
        for (const std::size_t k : {i, i + 1}) {
          if (feed[k] < faster - 0.05) continue;
          const double wanted = floor_tenth(feed[k] * factor);
          if (wanted < feed_min) return FeedFault{k, j, wanted, false};
          feed[k] = wanted;
          is_changed = true;
        }
      }
    }
    if (!is_changed) break;
  }
  return std::nullopt;
}

}  // namespace asbuilt
