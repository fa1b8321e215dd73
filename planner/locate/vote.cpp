// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/vote.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

namespace asbuilt {
namespace {

constexpr int kSide = 5, kDirections = 6 * kSide * kSide;  // a cube map
constexpr double kSoftRad = rad_from_deg(24.0);
constexpr std::size_t kBallotPoints = 1500;
constexpr int kSelfRotations = 1200;
constexpr std::size_t kSelfPoints = 300, kSelfMost = 40;
constexpr double kOverlapMin = 0.55, kExactMin = 0.995;

int direction_of(const Vec3& n) {
  int axis;
  n.cwiseAbs().maxCoeff(&axis);
  const double u = n[(axis + 1) % 3] / std::abs(n[axis]), v = n[(axis + 2) % 3] / std::abs(n[axis]);
  const auto part = [](double x) { return std::clamp(static_cast<int>((x + 1) * 0.5 * kSide), 0, kSide - 1); };
  return ((2 * axis + (n[axis] > 0)) * kSide + part(u)) * kSide + part(v);
}

Vec3 middle_of(int direction) {
  const int v = direction % kSide, u = direction / kSide % kSide, side = direction / (kSide * kSide), axis = side / 2;
  Vec3 n = Vec3::Zero();
  n[axis] = side % 2 ? 1 : -1;
  n[(axis + 1) % 3] = (u + 0.5) * 2 / kSide - 1, n[(axis + 2) % 3] = (v + 0.5) * 2 / kSide - 1;
  return n.normalized();
}

/// Counts by cell of shifts; forgets everything at once.
class Accumulator {
 public:
  Accumulator() : slots_(kSlots) {}
  void clear() { ++epoch_, used_.clear(); }
  void add(const Vec3& t, double cell) {
    const std::int32_t x = static_cast<std::int32_t>(std::floor(t.x() / cell)), y = static_cast<std::int32_t>(std::floor(t.y() / cell)),
                       z = static_cast<std::int32_t>(std::floor(t.z() / cell));
    std::uint32_t at = (static_cast<std::uint32_t>(x) * 73856093u ^ static_cast<std::uint32_t>(y) * 19349663u ^ static_cast<std::uint32_t>(z) * 83492791u) & (kSlots - 1);
    for (int probe = 0; probe < 64; ++probe, at = (at + 1) & (kSlots - 1)) {
      Slot& s = slots_[at];
      if (s.epoch != epoch_) {
        s = {epoch_, 1, x, y, z};
        used_.push_back(at);
        return;
      }
      if (s.x == x && s.y == y && s.z == z) {
        ++s.count;
        return;
      }
    }
  }
  /// Middles of the fullest cells, no two of them neighbours.
  std::vector<Vec3> peaks(double cell, std::size_t most) {
    std::sort(used_.begin(), used_.end(), [&](std::uint32_t a, std::uint32_t b) {
      const Slot &p = slots_[a], &q = slots_[b];
      return std::tie(q.count, p.x, p.y, p.z) < std::tie(p.count, q.x, q.y, q.z);
    });
    std::vector<Vec3> out;
    std::vector<const Slot*> kept;
    for (const std::uint32_t at : used_) {
      const Slot& s = slots_[at];
      const bool is_near = std::any_of(kept.begin(), kept.end(), [&](const Slot* k) {
        return std::abs(k->x - s.x) <= 1 && std::abs(k->y - s.y) <= 1 && std::abs(k->z - s.z) <= 1;
      });
      if (is_near) continue;
      kept.push_back(&s);
      out.push_back(cell * Vec3(s.x + 0.5, s.y + 0.5, s.z + 0.5));
      if (out.size() == most) break;
    }
    return out;
  }

 private:
  static constexpr std::uint32_t kSlots = 1u << 15;
  struct Slot {
    std::uint32_t epoch = 0, count = 0;
    std::int32_t x = 0, y = 0, z = 0;
  };
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> used_;
  std::uint32_t epoch_ = 0;
};

}  // namespace

std::vector<Eigen::Quaterniond> even_rotations(int count) {
  const double phi = std::sqrt(2.0), psi = 1.533751168755204288118041;
  std::vector<Eigen::Quaterniond> out;
  for (int i = 0; i < count; ++i) {
    const double s = i + 0.5, t = s / count, d = 2 * kPi * s;
    const double r = std::sqrt(t), R = std::sqrt(1 - t), a = d / phi, b = d / psi;
    out.emplace_back(R * std::cos(b), r * std::sin(a), r * std::cos(a), R * std::sin(b));
  }
  return out;
}

Ballot::Ballot(const CadModel& cad) {
  const std::size_t step = std::max<std::size_t>(1, cad.samples.size() / kBallotPoints);
  for (std::size_t i = 0; i < cad.samples.size(); i += step)
    if (cad.samples[i].n_part.squaredNorm() > 0.5) points_.push_back(cad.samples[i]);
  cell_mm_ = std::clamp(cad.size_mm / 32, 0.5, 16.0);
  by_direction_.resize(kDirections);
  for (int d = 0; d < kDirections; ++d) {
    const Vec3 middle = middle_of(d);
    for (std::size_t i = 0; i < points_.size(); ++i)
      if (points_[i].n_part.dot(middle) > std::cos(kSoftRad)) by_direction_[static_cast<std::size_t>(d)].push_back(static_cast<std::uint32_t>(i));
  }
}

std::vector<Vec3> Ballot::shifts(const std::vector<Vec3>& p, const std::vector<Vec3>& n, const Mat3& R, std::size_t most) const {
  thread_local Accumulator accumulator;
  accumulator.clear();
  std::vector<Vec3> turned(points_.size());
  for (std::size_t i = 0; i < points_.size(); ++i) turned[i] = R * points_[i].p_part;
  for (std::size_t i = 0; i < p.size(); ++i)
    for (const std::uint32_t m : by_direction_[static_cast<std::size_t>(direction_of(R.transpose() * n[i]))]) accumulator.add(p[i] - turned[m], cell_mm_);
  return accumulator.peaks(cell_mm_, most);
}

namespace {

/// Descent of the drawing's own samples onto the drawing; the share that lies on it in the end.
SelfMotion settle(const CadModel& cad, const std::vector<CadSample>& samples, Pose<frame::Part, frame::Part> T, std::size_t count, const std::vector<double>& reaches) {
  const std::size_t stride = std::max<std::size_t>(1, samples.size() / count);
  const double lever = 0.3 * cad.size_mm, on = std::max(0.01 * cad.size_mm, 0.75 * cad.grid.step_mm());
  SelfMotion out;
  for (std::size_t round = 0; round <= reaches.size(); ++round) {
    Mat6 H = 1e-3 * static_cast<double>(count) * Mat6::Identity();
    Vec6 g = Vec6::Zero();
    std::size_t hits = 0, total = 0;
    const double reach = round < reaches.size() ? reaches[round] : on;
    for (std::size_t i = 0; i < samples.size(); i += stride) {
      ++total;
      const Vec3 p = T.point(samples[i].p_part);
      const auto hit = cad.grid.closest_rough(p);
      if (!hit || hit->n.dot(T.direction(samples[i].n_part)) < 0.4) continue;
      const double d = std::abs(hit->distance_mm);
      hits += d < on;
      if (d >= reach) continue;
      const double u = 1 - d * d / (reach * reach), w = u * u, r = (p - hit->p_mm).dot(hit->n);
      Vec6 row;
      row << hit->n, (p - cad.center_part).cross(hit->n) / lever;
      H += w * row * row.transpose(), g += w * r * row;
    }
    out.overlap = static_cast<double>(hits) / static_cast<double>(std::max<std::size_t>(1, total));
    out.motion = T;
    if (round == reaches.size()) break;
    const Vec6 x = -H.ldlt().solve(g);
    const Eigen::Quaterniond q = quat_exp(x.tail<3>() / lever);
    T = Pose<frame::Part, frame::Part>(q, cad.center_part + x.head<3>() - q * cad.center_part) * T;
  }
  return out;
}

}  // namespace

std::vector<SelfMotion> self_motions(const CadModel& cad, const Ballot& ballot) {
  const std::vector<CadSample>& samples = ballot.points();
  std::vector<Vec3> p, n;
  const std::size_t voters = std::max<std::size_t>(1, samples.size() / 60);
  for (std::size_t i = 0; i < samples.size(); i += voters) p.push_back(samples[i].p_part), n.push_back(samples[i].n_part);
  const auto rotations = even_rotations(kSelfRotations);
  const double s = std::min(1.0, cad.size_mm / 200);
  std::vector<SelfMotion> all(rotations.size());
  tbb::parallel_for(std::size_t{0}, rotations.size(), [&](std::size_t i) {
    // p = R m + t takes the part's m to p: the motion is (R, t).
    const auto shifts = ballot.shifts(p, n, rotations[i].toRotationMatrix(), 1);
    if (shifts.empty()) return;
    all[i] = settle(cad, samples, {rotations[i], shifts.front()}, kSelfPoints / 2, {30 * s, 20 * s, 20 * s, 14 * s, 14 * s, 10 * s, 10 * s});
  });
  const auto by_overlap = [](const SelfMotion& a, const SelfMotion& b) { return a.overlap > b.overlap; };
  std::stable_sort(all.begin(), all.end(), by_overlap);
  all.resize(std::min<std::size_t>(all.size(), 250));
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    all[i] = settle(cad, samples, all[i].motion, kSelfPoints, {10 * s, 7 * s, 7 * s, 5 * s, 5 * s, 3 * s, 3 * s, 3 * s});
  });
  std::stable_sort(all.begin(), all.end(), by_overlap);
  std::vector<SelfMotion> kept;
  for (SelfMotion& m : all) {
    if (m.overlap < kOverlapMin) break;
    const auto is_near = [&](const Pose<frame::Part, frame::Part>& k) {
      return k.q.angularDistance(m.motion.q) < rad_from_deg(6.0) && (k.point(cad.center_part) - m.motion.point(cad.center_part)).norm() < 0.04 * cad.size_mm;
    };
    if (is_near(Pose<frame::Part, frame::Part>())) continue;
    if (std::any_of(kept.begin(), kept.end(), [&](const SelfMotion& k) { return is_near(k.motion); })) continue;
    kept.push_back(settle(cad, samples, m.motion, samples.size(), {3 * s, 3 * s, 2 * s, 2 * s}));
    kept.back().is_exact = kept.back().overlap > kExactMin;
    if (kept.size() == kSelfMost) break;
  }
  std::stable_sort(kept.begin(), kept.end(), by_overlap);
  return kept;
}

void prepare_free_search(CadModel& cad) {
  if (cad.free_search) return;
  auto made = std::make_shared<CadFreeSearch>();
  made->ballot = Ballot(cad);
  made->motions = self_motions(cad, made->ballot);
  cad.free_search = std::move(made);
}

}  // namespace asbuilt
