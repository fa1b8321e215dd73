// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/cut.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace asbuilt::verifying {

namespace {

constexpr double kProfileMm = 2.4, kStepMm = 0.04;

/// Poses by cells of a grid, so that a station finds those near it.
class PoseGrid {
 public:
  PoseGrid(const std::vector<CutPose>& poses, double cell_mm) : cell_(cell_mm) {
    for (std::size_t i = 0; i < poses.size(); ++i) cells_[key(poses[i].tip)].push_back(static_cast<int>(i));
  }
  std::vector<int> near(const Vec3& p, double reach, const std::vector<CutPose>& poses) const {
    std::vector<int> out;
    const int k = static_cast<int>(std::ceil(reach / cell_));
    const auto c = key(p);
    for (int x = -k; x <= k; ++x)
      for (int y = -k; y <= k; ++y)
        for (int z = -k; z <= k; ++z) {
          const auto it = cells_.find({c[0] + x, c[1] + y, c[2] + z});
          if (it == cells_.end()) continue;
          for (int i : it->second)
            if ((poses[static_cast<std::size_t>(i)].tip - p).norm() <= reach) out.push_back(i);
        }
    std::sort(out.begin(), out.end());
    return out;
  }

 private:
  double cell_;
  std::map<std::array<int, 3>, std::vector<int>> cells_;
  std::array<int, 3> key(const Vec3& p) const {
    return {static_cast<int>(std::floor(p.x() / cell_)), static_cast<int>(std::floor(p.y() / cell_)), static_cast<int>(std::floor(p.z() / cell_))};
  }
};

double gap_at(const CutterForm& c, const CutPose& pose, const Vec3& p) {
  const Vec3 d = p - pose.tip;
  const double u = -d.dot(pose.axis);
  return c.gap(u, (d + u * pose.axis).norm());
}

/// First place along the profile where the gap opens; 0 when its start is not reached.
double opening(const std::vector<double>& gap) {
  if (gap.front() > 0) return 0;
  for (std::size_t i = 1; i < gap.size(); ++i)
    if (gap[i] > 0) return kStepMm * (static_cast<double>(i) - gap[i] / (gap[i] - gap[i - 1]));
  return kProfileMm;
}

/// One station's cross-section is a poor measurement: the middle one of five.
double middle_area(const EdgeBurr& b, std::size_t i) {
  std::vector<double> v;
  for (std::size_t k = i < 2 ? 0 : i - 2; k < std::min(i + 3, b.area_mm2.size()); ++k)
    if (std::isfinite(b.area_mm2[k])) v.push_back(b.area_mm2[k]);
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

Vec3 into(const Vec3& n, const Vec3& tau, const Vec3& other) {
  Vec3 t = n.cross(tau).normalized();
  return t.dot(other) > 0 ? Vec3(-t) : t;
}

}  // namespace

CutterForm::CutterForm(const Cutter& c)
    : shape_(c.shape), radius_(0.5 * c.diameter_mm), tip_(0.5 * c.tip_diameter_mm),
      shank_(c.shank_diameter_mm > 0 ? 0.5 * c.shank_diameter_mm : radius_), tangent_(std::tan(0.5 * c.included_angle_rad)),
      cosine_(std::cos(0.5 * c.included_angle_rad)), flank_(radius_), top_(c.length_mm > 0 ? c.length_mm : 4 * c.diameter_mm) {
  if (shape_ == CutterShape::cone) flank_ = (radius_ - tip_) / tangent_;
  if (shape_ == CutterShape::cylinder) flank_ = 2 * radius_;
}

double CutterForm::gap(double u, double rho) const {
  const double over = u - top_;
  switch (shape_) {
    case CutterShape::ball:
      return u > radius_ ? std::max(rho - radius_, over) : std::sqrt(rho * rho + (u - radius_) * (u - radius_)) - radius_;
    case CutterShape::cylinder:
      return std::max({-u, rho - radius_, over});
    default:
      return std::max({-u, u <= flank_ ? (rho - tip_ - u * tangent_) * cosine_ : rho - shank_, over});
  }
}

EdgeCut cut_edge(const AdaptedEdge& e, const EdgeBurr* burr, const Pose<frame::Base, frame::Part>& T, const Cutter& cutter,
                 const std::vector<CutPose>& poses, double width, double tolerance) {
  EdgeCut out;
  const std::size_t n = e.s_mm.size(), m = static_cast<std::size_t>(kProfileMm / kStepMm) + 1;
  out.s_mm = e.s_mm;
  out.leg_1_mm.assign(n, 0), out.leg_2_mm.assign(n, 0), out.depth_mm.assign(n, 0), out.beyond_mm.assign(n, -1);
  out.speed_mm_s.assign(n, 0), out.rate_mm3_s.assign(n, 0);
  const CutterForm form(cutter);
  const double reach = 0.5 * cutter.diameter_mm + form.flank_mm() + 2;
  const PoseGrid grid(poses, 4.0);
  for (std::size_t i = 0; i < n; ++i) {
    const Vec3 p = T.point(e.adapted[i]), tau = T.direction(e.tangent[i]), n_1 = T.direction(e.n_1[i]), n_2 = T.direction(e.n_2[i]);
    const Vec3 t_1 = into(n_1, tau, n_2), t_2 = into(n_2, tau, n_1), b = (n_1 + n_2).normalized();
    const double beta = kPi - std::acos(std::clamp(n_1.dot(n_2), -1.0, 1.0));
    const bool has_burr = burr != nullptr && std::isfinite(burr->height_mm[i]) && burr->height_mm[i] > 0.01 && std::isfinite(burr->area_mm2[i]);
    const double burr_length = has_burr ? 1.2 * burr->height_mm[i] : 0, burr_area = has_burr ? middle_area(*burr, i) : 0;
    const std::vector<int> near = grid.near(p, reach + burr_length, poses);
    if (near.empty()) continue;
    std::vector<Vec3> probe;
    for (std::size_t k = 0; k < m; ++k) probe.push_back(p + kStepMm * static_cast<double>(k) * t_1);
    for (std::size_t k = 0; k < m; ++k) probe.push_back(p + kStepMm * static_cast<double>(k) * t_2);
    for (std::size_t k = 0; k < m; ++k) probe.push_back(p - kStepMm * static_cast<double>(k) * b);
    for (int k = 1; k <= 8; ++k) probe.push_back(p + burr_length * k / 8.0 * b);
    std::vector<double> total(probe.size(), 1e9);
    std::vector<char> burr_gone(8, 0);
    double wedge_before = 0;
    // visits: runs of poses that follow each other closely
    for (std::size_t a = 0; a < near.size();) {
      std::size_t z = a + 1;
      while (z < near.size() && near[z] - near[z - 1] <= 60) ++z;
      std::vector<double> gap(probe.size(), 1e9);
      double deepest = 1e9, speed = 0;
      for (std::size_t k = a; k < z; ++k) {
        const CutPose& pose = poses[static_cast<std::size_t>(near[k])];
        for (std::size_t j = 0; j < probe.size(); ++j) {
          const double g = gap_at(form, pose, probe[j]);
          gap[j] = std::min(gap[j], g);
          if (j == 0 && g < deepest) deepest = g, speed = pose.speed_mm_s;
        }
      }
      for (std::size_t j = 0; j < probe.size(); ++j) total[j] = std::min(total[j], gap[j]);
      const double leg_1 = opening({total.begin(), total.begin() + static_cast<std::ptrdiff_t>(m)});
      const double leg_2 = opening({total.begin() + static_cast<std::ptrdiff_t>(m), total.begin() + static_cast<std::ptrdiff_t>(2 * m)});
      const double wedge = 0.5 * leg_1 * leg_2 * std::sin(beta);
      int fresh = 0;
      for (std::size_t k = 0; k < 8; ++k)
        if (gap[3 * m + k] < 0 && !burr_gone[k]) burr_gone[k] = 1, ++fresh;
      const double ordered = 0.5 * width * width * std::sin(beta);  // a leg inside its tolerance is no overload
      const double area = std::min(std::max(wedge - wedge_before, 0.0), ordered) + burr_area * fresh / 8.0;
      if (area > 1e-4) {
        out.rate_mm3_s[i] = std::max(out.rate_mm3_s[i], area * speed);
        out.speed_mm_s[i] = out.speed_mm_s[i] > 0 ? std::min(out.speed_mm_s[i], speed) : speed;
      }
      wedge_before = std::max(wedge_before, wedge);
      a = z;
    }
    out.leg_1_mm[i] = opening({total.begin(), total.begin() + static_cast<std::ptrdiff_t>(m)});
    out.leg_2_mm[i] = opening({total.begin() + static_cast<std::ptrdiff_t>(m), total.begin() + static_cast<std::ptrdiff_t>(2 * m)});
    out.depth_mm[i] = opening({total.begin() + static_cast<std::ptrdiff_t>(2 * m), total.begin() + static_cast<std::ptrdiff_t>(3 * m)});
    out.beyond_mm[i] = out.depth_mm[i] - (width + tolerance) * std::cos(0.5 * beta);
  }
  return out;
}

Stray stray_cut(const Features& features, const MeshQuery& part, const Pose<frame::Base, frame::Part>& T, const Cutter& cutter,
                const std::vector<CutPose>& poses, double width, double tolerance) {
  Stray worst;
  if (part.is_empty()) return worst;
  struct Anchor {
    Vec3 nominal, shift;
  };
  std::vector<Anchor> anchors;
  for (const AdaptedEdge& e : features.edges)
    for (std::size_t i = 0; i < e.s_mm.size(); ++i) anchors.push_back({e.nominal[i], e.adapted[i] - e.nominal[i]});
  if (anchors.empty()) return worst;
  std::sort(anchors.begin(), anchors.end(), [](const Anchor& a, const Anchor& b) { return a.nominal.x() < b.nominal.x(); });
  const auto nearest = [&](const Vec3& p, double reach) {
    const Anchor* best = nullptr;
    double least = reach * reach;
    auto it = std::lower_bound(anchors.begin(), anchors.end(), p.x() - reach, [](const Anchor& a, double x) { return a.nominal.x() < x; });
    for (; it != anchors.end() && it->nominal.x() <= p.x() + reach; ++it) {
      const double d = (it->nominal - p).squaredNorm();
      if (d < least) least = d, best = &*it;
    }
    return best;
  };
  const Pose<frame::Part, frame::Base> T_part_base = T.inverse();
  const CutterForm form(cutter);
  const double flank = form.flank_mm(), top = form.top_mm();
  std::vector<double> heights;
  for (int i = 0; i <= 6; ++i) heights.push_back(flank * i / 6);
  for (double u = flank + 3; u < top; u += 6) heights.push_back(u);
  const auto radius_at = [&](double u) {  // by the gap function: where it vanishes
    double lo = 0, hi = 2 * cutter.diameter_mm;
    for (int k = 0; k < 40; ++k) {
      const double r = 0.5 * (lo + hi);
      (form.gap(std::max(u, 1e-9), r) > 0 ? hi : lo) = r;
    }
    return lo;
  };
  std::vector<double> radii;
  for (double u : heights) radii.push_back(radius_at(u));
  const double near_mm = 1.6 * (width + tolerance) + 0.3, near_allowed = 0.5 * (width + tolerance) + 0.1;
  Vec3 last = Vec3::Constant(1e9);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if ((poses[i].tip - last).norm() < 1.0 && i + 1 < poses.size()) continue;
    last = poses[i].tip;
    const Vec3 tip_part = T_part_base.point(poses[i].tip), axis = T_part_base.direction(poses[i].axis);
    const Anchor* anchor = nearest(tip_part, 12.0);
    const Vec3 shift = anchor != nullptr ? anchor->shift : Vec3::Zero();
    const Eigen::Quaterniond q = quat_from_z(axis, Vec3::UnitX());
    for (std::size_t h = 0; h < heights.size(); ++h) {
      const Vec3 center = tip_part - heights[h] * axis - shift;
      const MeshHit c = part.closest(center);
      if (c.distance_mm > radii[h] && (center - c.p_mm).dot(part.mesh().triangle_normal(c.triangle)) > 0) continue;
      for (int k = 0; k < 20; ++k) {
        const double a = 2 * kPi * k / 20;
        const Vec3 p = center + radii[h] * (q * Vec3(std::cos(a), std::sin(a), 0));
        const MeshHit hit = part.closest(p);
        if ((p - hit.p_mm).dot(part.mesh().triangle_normal(hit.triangle)) > 0 || hit.distance_mm <= worst.depth_mm) continue;
        if (hit.distance_mm < 0.02 || !part.contains(p)) continue;
        const double beyond = nearest(p, near_mm) != nullptr ? hit.distance_mm - near_allowed : hit.distance_mm;
        if (beyond > worst.depth_mm) worst.depth_mm = beyond, worst.p_base = T.point(p + shift), worst.instruction = poses[i].instruction;
      }
    }
  }
  return worst;
}

}  // namespace asbuilt::verifying
