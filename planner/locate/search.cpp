// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/search.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace asbuilt {
namespace {

constexpr double kScoreReachMm = 14.0;

/// Evenly spread rotations on S^3.
std::vector<Eigen::Quaterniond> super_fibonacci(int count) {
  const double phi = std::sqrt(2.0), psi = 1.533751168755204288118041;
  std::vector<Eigen::Quaterniond> out;
  for (int i = 0; i < count; ++i) {
    const double s = i + 0.5, t = s / count, d = 2 * kPi * s;
    const double r = std::sqrt(t), R = std::sqrt(1 - t), a = d / phi, b = d / psi;
    out.emplace_back(R * std::cos(b), r * std::sin(a), r * std::cos(a), R * std::sin(b));
  }
  return out;
}

struct Descent {
  const CadModel& cad;
  const Scene& scene;
  Pose<frame::Base, frame::Part> nominal;
  Vec3 play_mm;
  std::array<std::optional<double>, 3> play_rad;

  /// One damped step of point to plane; returns the mean score at the pose it was given.
  double step(Pose<frame::Base, frame::Part>& T, std::size_t count, double reach_mm) const {
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
    {  // the fixture pulls back, softly inside its play
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

  double score(const Pose<frame::Base, frame::Part>& T, std::size_t count) const {
    Pose<frame::Base, frame::Part> copy = T;
    return step(copy, count, 1.0);
  }

  Candidate descend_from(Pose<frame::Base, frame::Part> T, std::size_t count, const std::vector<double>& reaches, int steps) const {
    for (const double reach : reaches)
      for (int i = 0; i < steps; ++i) step(T, count, reach);
    Candidate c;
    c.T_base_part = T;
    c.score = score(T, count);
    return c;
  }
};

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

}  // namespace

std::vector<Pose<frame::Base, frame::Part>> starts(const FixtureSpec& fixture) {
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  int free_count = 0;
  for (const auto& p : fixture.play_rad) free_count += !p || *p > rad_from_deg(175);
  std::vector<Pose<frame::Base, frame::Part>> out;
  if (free_count >= 2) {
    for (const auto& q : super_fibonacci(4000)) out.push_back(nominal * Pose<frame::Part, frame::Part>(q, Vec3::Zero()));
    return out;
  }
  std::array<std::vector<double>, 3> angles;
  for (std::size_t a = 0; a < 3; ++a) {
    if (!fixture.play_rad[a] || *fixture.play_rad[a] > rad_from_deg(175)) {
      for (int i = 0; i < 360; ++i) angles[a].push_back(rad_from_deg(i));
    } else {
      const int side = static_cast<int>(std::floor(*fixture.play_rad[a] / rad_from_deg(8.0)));
      for (int i = -side; i <= side; ++i) angles[a].push_back(i * rad_from_deg(8.0));
    }
  }
  for (const double z : angles[2])
    for (const double y : angles[1])
      for (const double x : angles[0]) out.push_back(nominal * Pose<frame::Part, frame::Part>(quat_from_zyx(z, y, x), Vec3::Zero()));
  return out;
}

std::vector<Candidate> descend(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  Descent descent{cad, scene, nominal, fixture.play_mm, fixture.play_rad};
  int free_count = 0;
  for (const auto& p : fixture.play_rad) free_count += !p || *p > rad_from_deg(175);
  const std::vector<Pose<frame::Base, frame::Part>> from = starts(fixture);
  std::vector<Candidate> all(from.size());
  const std::size_t few = std::min<std::size_t>(scene.points.size(), from.size() > 60 ? 200 : 2000), some = std::min<std::size_t>(scene.points.size(), 1000);
  const std::size_t many = std::min<std::size_t>(scene.points.size(), 4000);
  tbb::parallel_for(std::size_t{0}, from.size(), [&](std::size_t i) { all[i] = descent.descend_from(from[i], few, {30, 20}, 4); });
  if (free_count < 2) {  // and gently: on a low part a long reach can pull a start that was nearly right off sideways
    std::vector<Candidate> gentle(from.size());
    tbb::parallel_for(std::size_t{0}, from.size(), [&](std::size_t i) { gentle[i] = descent.descend_from(from[i], few, {10, 6}, 4); });
    all.insert(all.end(), gentle.begin(), gentle.end());
  }
  keep_best(all, cad.center_part, free_count >= 2 ? 300 : 120);
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) { all[i] = descent.descend_from(all[i].T_base_part, some, {20, 14, 10, 7, 5}, 3); });
  keep_best(all, cad.center_part, 60);
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) { all[i] = descent.descend_from(all[i].T_base_part, many, {5, 3}, 3); });
  keep_best(all, cad.center_part, 60);
  return all;
}

void settle_turn(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture, const std::vector<Vec3>& sensor_base, std::size_t rays_max,
                 Candidate& candidate) {
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  const Descent descent{cad, scene, nominal, fixture.play_mm, fixture.play_rad};
  const std::size_t some = std::min<std::size_t>(scene.points.size(), 1000);
  for (int axis = 0; axis < 3; ++axis) {
    if (fixture.play_rad[static_cast<std::size_t>(axis)].value_or(kPi) < rad_from_deg(4.0)) continue;
    const auto turned = [&](double angle) {
      const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, Vec3::Unit(axis)));
      return candidate.T_base_part * Pose<frame::Part, frame::Part>(q, cad.center_part - q * cad.center_part);
    };
    const double here = descent.score(candidate.T_base_part, some);
    const double beside = std::max(descent.score(turned(rad_from_deg(1.5)), some), descent.score(turned(rad_from_deg(-1.5)), some));
    if (beside < here - 0.004) continue;  // faces hold it
    Candidate best = candidate;
    for (int i = -8; i <= 8; ++i) {
      Candidate other = candidate;
      other.T_base_part = turned(rad_from_deg(0.5 * i));
      look_along_rays(cad, scene, sensor_base, rays_max, other);
      if (other.log_likelihood > best.log_likelihood) best = other;
    }
    candidate = best;
  }
}

namespace {

constexpr double kInside = 0.9, kFront = 0.09, kBehind = 0.01, kRangeMm = 150.0;  // shares of a reading, and its width

enum class RayEnd { outside, known, on, front, behind };

/// What one ray says about the part at a pose.
struct RayReading {
  RayEnd end = RayEnd::outside;
  double log_likelihood = 0;  // zero where the fixture explains the ray whatever the pose
  double distance_mm = 0;     // of the reading from the part
  Vec3 place_part = Vec3::Zero();  // where it speaks about: the reading, or the surface it went through
  Vec3 way_part = Vec3::Zero();    // unit, of the ray
};

class RayLooker {
 public:
  RayLooker(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, const Pose<frame::Base, frame::Part>& T_base_part)
      : cad_(cad), scene_(scene), sensor_base_(sensor_base), inverse_(T_base_part.inverse()), R_(inverse_.rotation()), box_(cad.brep->mesh.box()) {}

  RayReading look(std::size_t i) const {
    const ScenePoint& s = scene_.rays[i];
    const Vec3 p = R_ * s.p_base + inverse_.p_mm, o = R_ * sensor_base_[static_cast<std::size_t>(s.capture)] + inverse_.p_mm;
    const double sigma = std::max(3 * s.sigma_mm, 1.0), range = (p - o).norm();
    const Vec3 d = (p - o) / range;
    RayReading out;
    out.distance_mm = cad_.grid.distance(p);
    out.place_part = p, out.way_part = d;
    const auto hit = comes_near(o, d) ? cad_.query.first_hit(o, d) : std::nullopt;
    const double hidden = hit ? range - hit->distance_mm : 0.0;
    if (out.distance_mm < 4 * sigma && (!s.is_known || hidden > -4 * sigma)) {  // on the surface, unless hidden behind another one
      if (hidden > 4 * sigma + 6.0) return behind(out, o + hit->distance_mm * d);
      const double u = out.distance_mm / sigma;
      out.end = RayEnd::on;
      out.log_likelihood = std::log(kInside * std::exp(-0.5 * u * u) / (sigma * 2.5066282746310002) + kFront / kRangeMm);
      return out;
    }
    if (hit && hidden > 4 * sigma) return behind(out, o + hit->distance_mm * d);  // looked through where the part should be
    if (s.is_known) {
      out.end = RayEnd::known;
      return out;
    }
    out.end = hit ? RayEnd::front : RayEnd::outside;
    out.log_likelihood = std::log(kFront / kRangeMm);
    return out;
  }

 private:
  static RayReading behind(RayReading out, const Vec3& place) {
    out.end = RayEnd::behind, out.log_likelihood = std::log(kBehind / kRangeMm), out.place_part = place;
    return out;
  }

  bool comes_near(const Vec3& o, const Vec3& d) const {
    double enter = 0, leave = 1e9;
    for (int a = 0; a < 3; ++a) {
      if (std::abs(d[a]) < 1e-12) {
        if (o[a] < box_.min_mm[a] || o[a] > box_.max_mm[a]) return false;
        continue;
      }
      const double t0 = (box_.min_mm[a] - o[a]) / d[a], t1 = (box_.max_mm[a] - o[a]) / d[a];
      enter = std::max(enter, std::min(t0, t1)), leave = std::min(leave, std::max(t0, t1));
    }
    return enter <= leave;
  }

  const CadModel& cad_;
  const Scene& scene_;
  const std::vector<Vec3>& sensor_base_;
  Pose<frame::Part, frame::Base> inverse_;
  Mat3 R_;
  Box3 box_;
};

}  // namespace

void look_along_rays(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, std::size_t rays_max, Candidate& candidate) {
  constexpr double kCorrelation = 6.0;  // neighbours that tell the same
  const RayLooker looker(cad, scene, sensor_base, candidate.T_base_part);
  const std::size_t stride = std::max<std::size_t>(1, scene.rays.size() / std::max<std::size_t>(1, rays_max));
  double sum = 0;
  std::size_t on = 0, front = 0, behind = 0;
  for (std::size_t i = 0; i < scene.rays.size(); i += stride) {
    const RayReading r = looker.look(i);
    sum += r.log_likelihood;
    on += r.end == RayEnd::on, front += r.end == RayEnd::front, behind += r.end == RayEnd::behind;
  }
  candidate.log_likelihood = sum / kCorrelation;
  candidate.rays_count = on + front + behind;
  candidate.inlier_ratio = candidate.rays_count > 0 ? static_cast<double>(on) / static_cast<double>(candidate.rays_count) : 0.0;
  candidate.see_through_ratio = candidate.rays_count > 0 ? static_cast<double>(behind) / static_cast<double>(candidate.rays_count) : 0.0;
}

double preference(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, const Candidate& a, const Candidate& b) {
  constexpr double kPlaceMm = 8.0, kOtherDistanceMm = 1.5, kMost = 6.0, kDepthMm = 0.5;
  const RayLooker look_a(cad, scene, sensor_base, a.T_base_part), look_b(cad, scene, sensor_base, b.T_base_part);
  // A ray that only scrapes the part would pass it if the part were a little smaller: that says nothing about the place.
  const auto is_grazing = [&](const RayReading& r) {
    if (r.end != RayEnd::behind) return false;
    const auto out = cad.query.first_hit(r.place_part + 0.05 * r.way_part, r.way_part);
    return !out || cad.query.closest(r.place_part + 0.5 * out->distance_mm * r.way_part).distance_mm < kDepthMm;
  };
  const std::size_t count = scene.rays.size();
  std::vector<std::pair<std::uint64_t, double>> votes(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    const RayReading ra = look_a.look(i), rb = look_b.look(i);
    const bool is_material = (ra.end != rb.end || std::abs(ra.distance_mm - rb.distance_mm) > kOtherDistanceMm) && !is_grazing(ra) && !is_grazing(rb);
    const double vote = is_material ? ra.log_likelihood - rb.log_likelihood : 0.0;
    const RayReading& where = rb.end == RayEnd::behind ? rb : ra;
    votes[i] = {voxel_key((&where == &ra ? a : b).T_base_part.point(where.place_part), kPlaceMm), vote};
  });
  std::erase_if(votes, [](const auto& v) { return v.second == 0; });
  std::sort(votes.begin(), votes.end());
  double sum = 0;
  std::array<double, 2> square{};  // of places for b, for a
  for (std::size_t i = 0; i < votes.size();) {
    std::size_t j = i;
    double mean = 0;
    for (; j < votes.size() && votes[j].first == votes[i].first; ++j) mean += votes[j].second;
    mean = std::clamp(mean / static_cast<double>(j - i), -kMost, kMost);
    sum += mean, square[mean > 0] += mean * mean;
    i = j;
  }
  const double noise = 2 * square[sum < 0] + kMost * kMost;  // as seen where the loser is preferred, never less than one place
  return std::copysign(std::min(0.5 * std::abs(sum), 0.5 * sum * sum / noise), sum);
}

}  // namespace asbuilt
