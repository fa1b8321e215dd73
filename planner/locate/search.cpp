// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/search.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "planner/base/result.hpp"
#include "planner/locate/descent.hpp"

namespace asbuilt {
namespace {

constexpr int kFreeRotations = 2000;
constexpr std::size_t kVoters = 60, kShifts = 3, kDescents = 400;
constexpr std::size_t kRaysRough = 1500, kRaysFine = 8000, kFineHypotheses = 12, kLookedAt = 60;
constexpr double kCloseMargin = 40.0, kCloseMarginAnywhere = 120.0;  // of a log-likelihood by kRaysFine rays
// Where any place is allowed, material that the drawing lacks may look like some face of it: it has to lie on the drawing closely and
// along it, and a look through the drawing is hardly forgiven.
constexpr RayRules kAnywhere{0.7, true, 3e-4, 0.7};

Descent descent_of(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  const bool is_held = !is_free(fixture) || fixture.play_mm.maxCoeff() < 0.5 * cad.size_mm;
  return {cad, scene, fixture.T_base_fixture * fixture.T_fixture_part, fixture.play_mm, fixture.play_rad, is_held};
}

template <class F>
void for_all(std::vector<Candidate>& all, const F& f) {
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) { f(all[i]); });
}

}  // namespace

bool is_free(const FixtureSpec& fixture) {
  int free_count = 0;
  for (const auto& p : fixture.play_rad) free_count += !p || *p > rad_from_deg(175);
  return free_count >= 2;
}

FixtureSpec opened(FixtureSpec fixture, double room_mm) {
  fixture.play_mm = Vec3::Constant(room_mm);
  fixture.play_rad = {};
  return fixture;
}

std::vector<Pose<frame::Base, frame::Part>> starts(const FixtureSpec& fixture) {
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  std::vector<Pose<frame::Base, frame::Part>> out;
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

namespace {

/// For each of many rotations the shifts that the readings vote for, within the fixture's room.
std::vector<Pose<frame::Base, frame::Part>> voted_starts(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  must(cad.free_search != nullptr, "search: prepare_free_search first");
  const Ballot& ballot = cad.free_search->ballot;
  std::vector<Vec3> p, n;
  for (const ScenePoint& s : scene.points) {  // in an order that spreads over directions
    if (s.n_base.squaredNorm() < 0.5) continue;
    p.push_back(s.p_base), n.push_back(s.n_base);
    if (p.size() == kVoters) break;
  }
  const Pose<frame::Base, frame::Part> nominal = fixture.T_base_fixture * fixture.T_fixture_part;
  const Vec3 center = nominal.point(cad.center_part);
  const Vec3 room = fixture.play_mm + Vec3::Constant(ballot.cell_mm() + 0.25 * cad.size_mm);
  const auto rotations = even_rotations(kFreeRotations);
  std::vector<std::vector<Pose<frame::Base, frame::Part>>> by_rotation(rotations.size());
  tbb::parallel_for(std::size_t{0}, rotations.size(), [&](std::size_t i) {
    const Eigen::Quaterniond q = nominal.q * rotations[i];
    for (const Vec3& t : ballot.shifts(p, n, q.toRotationMatrix(), kShifts)) {
      const Pose<frame::Base, frame::Part> T(q, t);
      const Vec3 off = fixture.T_base_fixture.rotation().transpose() * (T.point(cad.center_part) - center);
      if ((off.cwiseAbs().array() < room.array()).all()) by_rotation[i].push_back(T);
    }
  });
  std::vector<Pose<frame::Base, frame::Part>> out;
  for (const auto& some : by_rotation) out.insert(out.end(), some.begin(), some.end());
  return out;
}

/// Adds what the part's pseudo-symmetries make of the first `count` candidates.
void add_images(const CadModel& cad, std::size_t count, std::vector<Candidate>& all) {
  const std::size_t best = std::min(count, all.size());
  for (std::size_t i = 0; i < best; ++i)
    for (const SelfMotion& m : cad.free_search->motions) {
      Candidate c;
      c.T_base_part = all[i].T_base_part * m.motion;
      all.push_back(c);
    }
}

std::vector<Candidate> descend_anywhere(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  const Descent descent = descent_of(cad, scene, fixture);
  const std::size_t points = scene.points.size(), few = std::min<std::size_t>(points, 200), some = std::min<std::size_t>(points, 1000);
  const double s = std::min(1.0, cad.size_mm / 150);
  const auto from = voted_starts(cad, scene, fixture);
  std::vector<Candidate> all(from.size());
  for (std::size_t i = 0; i < from.size(); ++i) all[i].T_base_part = from[i];
  for_all(all, [&](Candidate& c) { c.score = descent.score(c.T_base_part, few); });
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  if (all.size() > kDescents) all.resize(kDescents);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, few, {30 * s, 20 * s, 14 * s, 10 * s}, 5); });
  keep_best(all, cad.center_part, 120);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, some, {10 * s, 7 * s, 5 * s}, 4); });
  keep_best(all, cad.center_part, kLookedAt);
  add_images(cad, 6, all);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, some, {7 * s, 5 * s}, 4); });
  keep_best(all, cad.center_part, kLookedAt);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, some, {5 * s, 3 * s}, 3); });
  keep_best(all, cad.center_part, kLookedAt);
  return all;
}

std::vector<Candidate> descend_in_play(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  const Descent descent = descent_of(cad, scene, fixture);
  const auto from = starts(fixture);
  const std::size_t points = scene.points.size(), few = std::min<std::size_t>(points, from.size() > 60 ? 200 : 2000);
  const std::size_t some = std::min<std::size_t>(points, 1000), many = std::min<std::size_t>(points, 4000);
  std::vector<Candidate> all(2 * from.size());
  tbb::parallel_for(std::size_t{0}, from.size(), [&](std::size_t i) {
    all[i] = descent.descend_from(from[i], few, {30, 20}, 4);
    // And gently: on a low part a long reach can pull a start that was nearly right off sideways.
    all[from.size() + i] = descent.descend_from(from[i], few, {10, 6}, 4);
  });
  keep_best(all, cad.center_part, 120);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, some, {20, 14, 10, 7, 5}, 3); });
  keep_best(all, cad.center_part, kLookedAt);
  for_all(all, [&](Candidate& c) { c = descent.descend_from(c.T_base_part, many, {5, 3}, 3); });
  keep_best(all, cad.center_part, kLookedAt);
  return all;
}

}  // namespace

std::vector<Candidate> descend(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture) {
  return is_free(fixture) ? descend_anywhere(cad, scene, fixture) : descend_in_play(cad, scene, fixture);
}

void settle_turn(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture, const std::vector<Vec3>& sensor_base, std::size_t rays_max,
                 Candidate& candidate) {
  const Descent descent = descent_of(cad, scene, fixture);
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

std::vector<Candidate> find_candidates(const CadModel& cad, const Scene& scene, const FixtureSpec& fixture, const std::vector<Vec3>& sensor_base) {
  std::vector<Candidate> all = descend(cad, scene, fixture);
  const auto by_likelihood = [](const Candidate& a, const Candidate& b) { return a.log_likelihood > b.log_likelihood; };
  for_all(all, [&](Candidate& c) { look_along_rays(cad, scene, sensor_base, kRaysRough, c); });
  std::stable_sort(all.begin(), all.end(), by_likelihood);
  if (all.size() > kFineHypotheses) all.resize(kFineHypotheses);
  if (is_free(fixture)) {
    const Descent descent = descent_of(cad, scene, fixture);
    const double s = std::min(1.0, cad.size_mm / 150);
    const std::size_t before = all.size(), many = std::min<std::size_t>(scene.points.size(), 4000);
    add_images(cad, 2, all);
    tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
      if (i >= before) all[i] = descent.descend_from(all[i].T_base_part, many / 4, {5 * s, 3 * s}, 3);
      all[i] = descent.descend_from(all[i].T_base_part, many, {3 * s}, 3);
    });
    keep_best(all, cad.center_part, 2 * kFineHypotheses);
  } else {
    for_all(all, [&](Candidate& c) { settle_turn(cad, scene, fixture, sensor_base, kRaysRough, c); });
  }
  for_all(all, [&](Candidate& c) { look_along_rays(cad, scene, sensor_base, kRaysFine, c); });
  std::stable_sort(all.begin(), all.end(), by_likelihood);
  const RayRules rules = is_free(fixture) ? kAnywhere : RayRules{};
  const double close_margin = is_free(fixture) ? kCloseMarginAnywhere : kCloseMargin;
  // What is close to the best by a sample of the rays is compared with it by all of them.
  const auto is_close = [&](const Candidate& c) { return all.front().log_likelihood - c.log_likelihood < close_margin; };
  for (std::size_t i = 1; i < all.size() && is_close(all[i]); ++i)
    if (preference(cad, scene, sensor_base, all.front(), all[i], rules) < 0) std::swap(all.front(), all[i]);
  for (std::size_t i = 1; i < all.size(); ++i)
    if (std::abs(all.front().log_likelihood - all[i].log_likelihood) < close_margin)
      all[i].log_likelihood = all.front().log_likelihood - preference(cad, scene, sensor_base, all.front(), all[i], rules);
  std::stable_sort(all.begin() + (all.empty() ? 0 : 1), all.end(), by_likelihood);
  return all;
}

}  // namespace asbuilt
