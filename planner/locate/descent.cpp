// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/descent.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace asbuilt {
namespace {

constexpr double kScoreReachMm = 14.0;

}  // namespace

double Descent::step(Pose<frame::Base, frame::Part>& T, std::size_t count, double reach_mm) const {
  const Pose<frame::Part, frame::Base> inverse = T.inverse();
  const Mat3 R = inverse.rotation();
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  double score = 0;
  const double lever = 0.3 * cad.size_mm;
  for (std::size_t i = 0; i < count; ++i) {
    const ScenePoint& s = scene.points[i];
    const Vec3 p = R * s.p_base + inverse.p_mm;
    const auto hit = cad.grid.closest_rough(p);
    if (!hit) continue;
    const double d = std::abs(hit->distance_mm);
    if (d >= reach_mm && d >= kScoreReachMm) continue;
    if (s.n_base.squaredNorm() > 0.5 && hit->n.dot(R * s.n_base) < 0.4) continue;
    if (d < kScoreReachMm) score += 1 - d * d / (kScoreReachMm * kScoreReachMm);
    if (d >= reach_mm) continue;
    const double u = 1 - d * d / (reach_mm * reach_mm), w = u * u;
    const double r = (p - hit->p_mm).dot(hit->n);
    Vec6 row;  // moving the part by (t, w) about its center, lengths by the lever
    row << hit->n, (p - cad.center_part).cross(hit->n) / lever;
    H.noalias() += w * row * row.transpose();
    g.noalias() += w * r * row;
  }
  const double n = static_cast<double>(count);
  H.diagonal().array() += 1e-3 * n;
  if (is_held) {  // the fixture pulls back, softly inside its play
    const Vec3 off = R * (T.point(cad.center_part) - (nominal * Pose<frame::Part, frame::Part>(nominal.q.conjugate() * T.q, Vec3::Zero())).point(cad.center_part));
    const Vec3 play = play_mm.cwiseMax(2.0);
    for (int a = 0; a < 3; ++a) H(a, a) += 0.05 * n / (play[a] * play[a]), g[a] -= 0.05 * n * off[a] / (play[a] * play[a]);
    const double held_rad = std::max({play_rad[0].value_or(kPi), play_rad[1].value_or(kPi), play_rad[2].value_or(kPi)});
    if (held_rad < rad_from_deg(45)) {  // small turns only: with a free axis the three do not come apart
      const Vec3 turned = quat_log(nominal.q.conjugate() * T.q) * lever;
      for (int a = 0; a < 3; ++a) {
        const double turn = std::max(*play_rad[static_cast<std::size_t>(a)], rad_from_deg(1)) * lever;
        H(3 + a, 3 + a) += 0.05 * n / (turn * turn), g[3 + a] -= 0.05 * n * turned[a] / (turn * turn);
      }
    }
  }
  const Vec6 x = H.ldlt().solve(g);
  const Eigen::Quaterniond turn = quat_exp(x.tail<3>() / lever);
  const Vec3 shift = cad.center_part + x.head<3>() - turn * cad.center_part;
  T = T * Pose<frame::Part, frame::Part>(turn, shift);
  return score / std::max(1.0, n);
}

double Descent::score(const Pose<frame::Base, frame::Part>& T, std::size_t count) const {
  Pose<frame::Base, frame::Part> copy = T;
  return step(copy, count, 1.0);
}

Candidate Descent::descend_from(Pose<frame::Base, frame::Part> T, std::size_t count, const std::vector<double>& reaches, int steps) const {
  for (const double reach : reaches)
    for (int i = 0; i < steps; ++i) step(T, count, reach);
  Candidate c;
  c.T_base_part = T;
  c.score = score(T, count);
  return c;
}

void keep_best(std::vector<Candidate>& all, const Vec3& center_part, std::size_t most) {
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<Candidate> kept;
  for (const Candidate& c : all) {
    bool is_new = true;
    for (const Candidate& k : kept) {
      if (k.T_base_part.q.angularDistance(c.T_base_part.q) < rad_from_deg(4.0) &&
          (k.T_base_part.point(center_part) - c.T_base_part.point(center_part)).norm() < 4.0) {
        is_new = false;
        break;
      }
    }
    if (is_new) kept.push_back(c);
    if (kept.size() == most) break;
  }
  all = std::move(kept);
}

}  // namespace asbuilt
