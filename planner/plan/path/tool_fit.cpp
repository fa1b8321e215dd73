// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/tool_fit.hpp"

#include <algorithm>
#include <cmath>

#include "planner/plan/path/chamfer.hpp"

namespace asbuilt {

ToolFit::ToolFit(const MeshQuery& part, const Cutter& cutter, std::vector<Vec3> worked, double width, double tolerance, double elsewhere)
    : part_(part), cutter_(cutter), worked_(std::move(worked)), near_mm_(1.6 * (width + tolerance)),
      near_allowed_mm_(0.5 * (width + tolerance) + 0.05), elsewhere_mm_(elsewhere) {
  std::sort(worked_.begin(), worked_.end(), [](const Vec3& a, const Vec3& b) { return std::tie(a.x(), a.y(), a.z()) < std::tie(b.x(), b.y(), b.z()); });
  const double flank = flank_mm(cutter);
  for (int i = 0; i <= 8; ++i) rings_mm_.push_back(flank * i / 8);
  const double top = cutter.length_mm > 0 ? cutter.length_mm : 4 * cutter.diameter_mm;
  for (double u = flank + 2; u < top; u += 4) rings_mm_.push_back(u);
  rings_mm_.push_back(top);
}

bool ToolFit::is_near_worked(const Vec3& p) const {
  const double reach = near_mm_ + 0.3;  // stations are points of a line, up to 0.5 mm apart
  auto it = std::lower_bound(worked_.begin(), worked_.end(), p.x() - reach, [](const Vec3& a, double x) { return a.x() < x; });
  for (; it != worked_.end() && it->x() <= p.x() + reach; ++it)
    if ((*it - p).squaredNorm() < reach * reach) return true;
  return false;
}

Intrusion ToolFit::check(const CutterPose& pose) const {
  Intrusion worst;
  worst.depth_mm = -1e9;
  const Eigen::Quaterniond q = quat_from_z(pose.up, Vec3::UnitX());
  const Vec3 x = q * Vec3::UnitX(), y = q * Vec3::UnitY();
  constexpr int kAround = 24;
  for (double u : rings_mm_) {
    const Vec3 center = pose.tip + u * pose.up - pose.shift;
    const double r = radius_mm(cutter_, u);
    const MeshHit hit = part_.closest(center);
    // a centre that far outside keeps its whole ring outside
    const bool is_outside = (center - hit.p_mm).dot(part_.mesh().triangle_normal(hit.triangle)) > 0;
    if (hit.distance_mm > r && (is_outside || !part_.contains(center))) {
      worst.depth_mm = std::max(worst.depth_mm, r - hit.distance_mm - elsewhere_mm_);
      continue;
    }
    for (int k = 0; k < kAround; ++k) {
      const double a = 2 * kPi * k / kAround;
      const Vec3 p = center + r * (std::cos(a) * x + std::sin(a) * y);
      const MeshHit h = part_.closest(p);
      const double side = (p - h.p_mm).dot(part_.mesh().triangle_normal(h.triangle));
      double depth = -h.distance_mm;
      if (side < 0 && h.distance_mm > elsewhere_mm_ && part_.contains(p)) depth = h.distance_mm;
      const double allowed = depth > elsewhere_mm_ && is_near_worked(p) ? near_allowed_mm_ : elsewhere_mm_;
      if (depth - allowed > worst.depth_mm) worst.depth_mm = depth - allowed, worst.p_part = p + pose.shift;
    }
  }
  return worst;
}

}  // namespace asbuilt
