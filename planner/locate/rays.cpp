// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/rays.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace asbuilt {
namespace {

constexpr double kInside = 0.9, kFront = 0.09, kRangeMm = 150.0;  // shares of a reading, and its width

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
  RayLooker(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, const Pose<frame::Base, frame::Part>& T_base_part, const RayRules& rules)
      : cad_(cad), scene_(scene), sensor_base_(sensor_base), rules_(rules), inverse_(T_base_part.inverse()), R_(inverse_.rotation()), box_(cad.brep->mesh.box()) {}

  RayReading look(std::size_t i) const {
    const ScenePoint& s = scene_.rays[i];
    const Vec3 p = R_ * s.p_base + inverse_.p_mm, o = R_ * sensor_base_[static_cast<std::size_t>(s.capture)] + inverse_.p_mm;
    const double sigma = std::max(3 * s.sigma_mm, rules_.form_mm), range = (p - o).norm();
    const Vec3 d = (p - o) / range;
    RayReading out;
    out.distance_mm = cad_.grid.distance(p);
    out.place_part = p, out.way_part = d;
    const auto hit = comes_near(o, d) ? cad_.query.first_hit(o, d) : std::nullopt;
    const double hidden = hit ? range - hit->distance_mm : 0.0;
    const bool is_near = out.distance_mm < 4 * sigma && (!rules_.has_normals || is_along(R_ * s.n_base, p, hit));
    if (is_near && (!s.is_known || hidden > -4 * sigma)) {  // on the surface, unless hidden behind another one
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
  RayReading behind(RayReading out, const Vec3& place) const {
    out.end = RayEnd::behind, out.log_likelihood = std::log(rules_.behind_ratio / kRangeMm), out.place_part = place;
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

  /// Whether the reading's own normal is that of the surface beside it, or of the one that its ray should meet.
  bool is_along(const Vec3& n_part, const Vec3& p, const std::optional<MeshHit>& hit) const {
    constexpr double kAlong = 0.85;
    if (n_part.squaredNorm() < 0.5) return true;
    if (hit && n_part.dot(cad_.brep->mesh.triangle_normal(hit->triangle)) > kAlong) return true;
    const auto foot = cad_.grid.closest(p);
    return foot && n_part.dot(foot->n) > kAlong;
  }

  const CadModel& cad_;
  const Scene& scene_;
  const std::vector<Vec3>& sensor_base_;
  RayRules rules_;
  Pose<frame::Part, frame::Base> inverse_;
  Mat3 R_;
  Box3 box_;
};

}  // namespace

void look_along_rays(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, std::size_t rays_max, Candidate& candidate) {
  constexpr double kCorrelation = 6.0;  // neighbours that tell the same
  const RayLooker looker(cad, scene, sensor_base, candidate.T_base_part, {});
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

double preference(const CadModel& cad, const Scene& scene, const std::vector<Vec3>& sensor_base, const Candidate& a, const Candidate& b,
                  const RayRules& rules) {
  constexpr double kPlaceMm = 8.0, kOtherDistanceMm = 1.5, kMost = 6.0;
  const RayLooker look_a(cad, scene, sensor_base, a.T_base_part, rules), look_b(cad, scene, sensor_base, b.T_base_part, rules);
  // A ray that only scrapes the part would pass it if the part were a little smaller: that says nothing about the place.
  const auto is_grazing = [&](const RayReading& r) {
    if (r.end != RayEnd::behind) return false;
    const auto out = cad.query.first_hit(r.place_part + 0.05 * r.way_part, r.way_part);
    return !out || cad.query.closest(r.place_part + 0.5 * out->distance_mm * r.way_part).distance_mm < rules.grazing_mm;
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
