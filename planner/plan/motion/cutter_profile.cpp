// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/motion/cutter_profile.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

CutterProfile profile_of(const Cutter& c) {
  CutterProfile p;
  const double radius = c.diameter_mm / 2, shank = (c.shank_diameter_mm > 0 ? c.shank_diameter_mm : c.diameter_mm) / 2;
  p.length_mm = c.length_mm;
  p.outline.emplace_back(0, 0);
  if (c.shape == CutterShape::cone) {
    const double tip = c.tip_diameter_mm / 2, slope = std::tan(c.included_angle_rad / 2);
    const double flank = slope > 1e-9 ? std::max(radius - tip, 0.0) / slope : 0.0;
    if (tip > 0) p.outline.emplace_back(tip, 0);
    p.outline.emplace_back(radius, flank);
    p.cutting_height_mm = flank;
  } else if (c.shape == CutterShape::ball) {
    constexpr int kChords = 16;
    for (int k = 1; k <= kChords; ++k) {
      const double a = kPi / 2 * k / kChords;
      p.outline.emplace_back(radius * std::sin(a), radius * (1 - std::cos(a)));
    }
    p.cutting_height_mm = radius;
  } else {
    p.outline.emplace_back(radius, 0);
    p.cutting_height_mm = std::min(c.diameter_mm, c.length_mm);
    p.outline.emplace_back(radius, p.cutting_height_mm);
  }
  if (std::abs(shank - radius) > 1e-9) p.outline.emplace_back(shank, p.cutting_height_mm);
  if (p.length_mm > p.cutting_height_mm) p.outline.emplace_back(shank, p.length_mm);
  p.length_mm = std::max(p.length_mm, p.cutting_height_mm);
  p.outline.emplace_back(0, p.length_mm);
  for (const Vec2& v : p.outline) p.radius_max_mm = std::max(p.radius_max_mm, v.x());
  return p;
}

double cutter_distance(const CutterProfile& profile, const Vec3& p_tool) {
  const Vec2 p(std::hypot(p_tool.x(), p_tool.y()), -p_tool.z());
  double d2 = 1e300;
  bool is_inside = false;
  for (std::size_t i = 0; i + 1 < profile.outline.size(); ++i) {
    const Vec2 &a = profile.outline[i], &b = profile.outline[i + 1];
    const Vec2 e = b - a;
    const double l2 = e.squaredNorm(), t = l2 > 0 ? std::clamp((p - a).dot(e) / l2, 0.0, 1.0) : 0.0;
    d2 = std::min(d2, (p - a - t * e).squaredNorm());
    if ((a.y() > p.y()) != (b.y() > p.y()) && p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * e.x()) is_inside = !is_inside;
  }
  return is_inside ? -std::sqrt(d2) : std::sqrt(d2);
}

CutterProfile shrunk(const CutterProfile& profile, double by_mm) {
  CutterProfile out;
  std::vector<double> heights;
  for (const Vec2& v : profile.outline) heights.push_back(std::clamp(v.y(), by_mm, std::max(by_mm, profile.length_mm - by_mm)));
  for (int k = 0; k <= 12; ++k) heights.push_back(by_mm + k / 12.0 * std::max(0.0, profile.cutting_height_mm + profile.radius_max_mm - by_mm));
  std::sort(heights.begin(), heights.end());
  const auto radius_at = [&](double u) {  // the widest place at this height that is deep enough inside; negative: none
    if (u > profile.length_mm - by_mm + 1e-9 || cutter_distance(profile, {0, 0, -u}) > -by_mm + 1e-9) return -1.0;
    double in = 0, beyond = profile.radius_max_mm;
    for (int k = 0; k < 40; ++k) {
      const double r = 0.5 * (in + beyond);
      (cutter_distance(profile, {r, 0, -u}) <= -by_mm ? in : beyond) = r;
    }
    return in;
  };
  for (const double u : heights) {
    const double r = radius_at(u);
    if (r < 0 || (!out.outline.empty() && std::abs(out.outline.back().y() - u) < 1e-9)) continue;
    if (!out.outline.empty()) {  // a neck between two heights: no chord across it
      const Vec2 before = out.outline.back();
      const double middle = radius_at(0.5 * (before.y() + u));
      if (middle < 0.5 * (before.x() + r) - 1e-6) {
        const double least = std::max(0.0, std::min({before.x(), middle, r}));
        out.outline.emplace_back(least, before.y());
        out.outline.emplace_back(least, u);
      }
    }
    out.outline.emplace_back(r, u);
    out.radius_max_mm = std::max(out.radius_max_mm, r), out.length_mm = u;
  }
  if (out.outline.size() < 2) return {};
  out.cutting_height_mm = std::min(profile.cutting_height_mm, out.length_mm);
  out.outline.insert(out.outline.begin(), Vec2(0, out.outline.front().y()));
  out.outline.emplace_back(0, out.outline.back().y());
  return out;
}

Mesh cutter_mesh(const CutterProfile& profile, double from_mm, double to_mm) {
  Mesh m;
  if (!(to_mm > from_mm)) return m;
  // Outline clipped to the heights; it runs upward, so each piece is clipped on its own.
  std::vector<Vec2> rings;
  double lowest = 1e300, highest = -1e300;
  for (std::size_t i = 0; i + 1 < profile.outline.size(); ++i) {
    Vec2 a = profile.outline[i], b = profile.outline[i + 1];
    if (b.y() < from_mm || a.y() > to_mm) continue;
    const Vec2 e = b - a;
    if (a.y() < from_mm) a += e * ((from_mm - a.y()) / e.y());
    if (b.y() > to_mm) b = profile.outline[i] + e * ((to_mm - profile.outline[i].y()) / e.y());
    lowest = std::min(lowest, a.y()), highest = std::max(highest, b.y());
    for (const Vec2& v : {a, b})
      if (v.x() > 0 && (rings.empty() || (rings.back() - v).norm() > 1e-9)) rings.push_back(v);
  }
  if (rings.empty() || !(highest > lowest)) return m;
  constexpr int kSides = 24;
  const double outer = 1 / std::cos(kPi / kSides);
  for (const Vec2& r : rings)
    for (int k = 0; k < kSides; ++k) {
      const double a = 2 * kPi * k / kSides;
      m.vertices.emplace_back(outer * r.x() * std::cos(a), outer * r.x() * std::sin(a), -r.y());
    }
  const int bottom = static_cast<int>(m.vertices.size()), top = bottom + 1, n = static_cast<int>(rings.size());
  m.vertices.emplace_back(0, 0, -lowest);
  m.vertices.emplace_back(0, 0, -highest);
  for (int k = 0; k < kSides; ++k) {
    const int j = (k + 1) % kSides;
    m.triangles.push_back({bottom, k, j});
    m.triangles.push_back({top, (n - 1) * kSides + j, (n - 1) * kSides + k});
    for (int i = 0; i + 1 < n; ++i) {
      m.triangles.push_back({i * kSides + k, (i + 1) * kSides + k, (i + 1) * kSides + j});
      m.triangles.push_back({i * kSides + k, (i + 1) * kSides + j, i * kSides + j});
    }
  }
  return m;
}

}  // namespace asbuilt
