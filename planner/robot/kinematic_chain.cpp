// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/robot/kinematic_chain.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

Rigid turned_z(const Rigid& T, double q) {
  const double c = std::cos(q), s = std::sin(q);
  Rigid r;
  r.R.col(0) = c * T.R.col(0) + s * T.R.col(1);
  r.R.col(1) = c * T.R.col(1) - s * T.R.col(0);
  r.R.col(2) = T.R.col(2);
  r.p = T.p;
  return r;
}

Vec3 rotation_vector(const Mat3& R) { return quat_log(Eigen::Quaterniond(R)); }

}  // namespace

KinematicChain KinematicChain::from_axes(const std::array<Vec3, 6>& axis, const std::array<Vec3, 6>& point, const Rigid& flange_at_zero) {
  KinematicChain c;
  Rigid before;
  for (int i = 0; i < 6; ++i) {
    c.axis[i] = axis[i].normalized();
    c.point[i] = point[i];
    // x as near as possible to the frame before it, so that round robots get round numbers
    const Rigid here{quat_from_z(c.axis[i], before.R.col(0)).toRotationMatrix(), point[i]};
    c.link[i] = before.inverse() * here;
    c.zero_inverse[i] = here.inverse();
    before = here;
  }
  c.link[6] = before.inverse() * flange_at_zero;
  // Stretched reach from axis 1: the distance of axis 2 from axis 1, then point to point.
  const Vec3 d = point[1] - point[0];
  c.reach_mm = (d - c.axis[0] * c.axis[0].dot(d)).norm();
  for (int i = 2; i < 6; ++i) c.reach_mm += (point[i] - point[i - 1]).norm();
  c.reach_mm = std::max(c.reach_mm + (flange_at_zero.p - point[5]).norm(), 1.0);
  return c;
}

std::array<Rigid, 7> joint_frames(const KinematicChain& chain, const JointVector& q_rad) {
  std::array<Rigid, 7> f;
  f[0] = turned_z(chain.link[0], q_rad[0]);
  for (int i = 1; i < 6; ++i) f[i] = turned_z(f[i - 1] * chain.link[i], q_rad[i]);
  f[6] = f[5] * chain.link[6];
  return f;
}

Rigid flange_of(const KinematicChain& chain, const JointVector& q_rad) {
  Rigid f = turned_z(chain.link[0], q_rad[0]);
  for (int i = 1; i < 6; ++i) f = turned_z(f * chain.link[i], q_rad[i]);
  return f * chain.link[6];
}

std::optional<JointVector> newton_inverse(const KinematicChain& chain, const Rigid& target, JointVector q, int iterations_count) {
  const double scale = 1.0 / chain.reach_mm;
  double damping = 1e-6, before = 1e300;
  JointVector best = q;
  Vec6 e_best = Vec6::Zero();
  Mat6 j_best = Mat6::Zero();
  for (int k = 0; k < iterations_count; ++k) {
    const auto f = joint_frames(chain, q);
    Vec6 e;
    e.head<3>() = (target.p - f[6].p) * scale;
    e.tail<3>() = rotation_vector(target.R * f[6].R.transpose());
    const double now = e.squaredNorm();
    if (now < before) {
      const bool is_at_floor = now < 1e-28 && now > 0.01 * before;
      best = q, e_best = e, before = now;
      if (now < 1e-31 || is_at_floor) break;
      for (int i = 0; i < 6; ++i) {
        const Vec3 w = f[i].R.col(2);
        j_best.col(i).head<3>() = w.cross(f[6].p - f[i].p) * scale;
        j_best.col(i).tail<3>() = w;
      }
      damping = std::max(damping * 0.1, now < 1e-8 ? 0.0 : 1e-9);
    } else {
      if (before < 1e-26) break;
      damping = std::max(damping * 10, 1e-9);
      if (damping > 1e6) break;
    }
    const Mat6 h = j_best.transpose() * j_best + (damping + 1e-16) * Mat6::Identity();
    Vec6 step = h.ldlt().solve(j_best.transpose() * e_best);
    const double largest = step.cwiseAbs().maxCoeff();
    if (largest > 0.5) step *= 0.5 / largest;
    for (int i = 0; i < 6; ++i) q[i] = best[i] + step[i];
  }
  const double error_mm = e_best.head<3>().norm() * chain.reach_mm, error_rad = e_best.tail<3>().norm();
  const bool converged = before < 1e300 && error_mm < 1e-9 + 1e-12 * chain.reach_mm && error_rad < 1e-11;
  if (!converged) return std::nullopt;
  return best;
}

}  // namespace asbuilt
