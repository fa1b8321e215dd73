// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/depth_camera.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::simulate_detail {
namespace {

/// Nearest hit of a ray with a body in its own frame.
std::optional<RayHit> hit_body(const Body& b, const Vec3& o, const Vec3& d) {
  constexpr double tiny = 1e-9;
  if (b.kind == Body::Kind::floor) {
    if (!(d.z() < -tiny) || o.z() < 0) return std::nullopt;
    return RayHit{-o.z() / d.z(), Vec3::UnitZ()};
  }
  if (b.kind == Body::Kind::sphere) {
    const double r = b.size_mm.x(), h = o.dot(d), q = h * h - o.squaredNorm() + r * r;
    if (q < 0) return std::nullopt;
    const double t = -h - std::sqrt(q);
    if (t < 0) return std::nullopt;
    return RayHit{t, (o + t * d) / r};
  }
  std::optional<RayHit> best;
  const auto offer = [&](double t, const Vec3& n) {
    if (t > 0 && n.dot(d) < 0 && (!best || t < best->distance_mm)) best = RayHit{t, n};
  };
  if (b.kind == Body::Kind::cylinder) {
    const double r = b.size_mm.x(), height = b.size_mm.z(), a = d.head<2>().squaredNorm();
    if (a > tiny) {
      const double h = o.head<2>().dot(d.head<2>()) / a, q = h * h - (o.head<2>().squaredNorm() - r * r) / a;
      if (q >= 0) {
        const double t = -h - std::sqrt(q);
        const Vec3 p = o + t * d;
        if (p.z() >= 0 && p.z() <= height) offer(t, Vec3(p.x() / r, p.y() / r, 0));
      }
    }
    if (std::abs(d.z()) > tiny)
      for (const double z : {0.0, height}) {
        const double t = (z - o.z()) / d.z();
        if ((o + t * d).head<2>().squaredNorm() <= r * r) offer(t, z > 0 ? Vec3(0, 0, 1) : Vec3(0, 0, -1));
      }
    return best;
  }
  const Vec3 low(-b.size_mm.x() / 2, -b.size_mm.y() / 2, 0), high(b.size_mm.x() / 2, b.size_mm.y() / 2, b.size_mm.z());
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) < tiny) continue;
    for (const bool is_high : {false, true}) {
      const double t = ((is_high ? high : low)[axis] - o[axis]) / d[axis];
      const Vec3 p = o + t * d;
      bool is_on = true;
      for (int k = 0; k < 3; ++k) is_on = is_on && (k == axis || (p[k] >= low[k] - tiny && p[k] <= high[k] + tiny));
      if (is_on) offer(t, (is_high ? 1.0 : -1.0) * Vec3::Unit(axis));
    }
  }
  return best;
}

std::vector<float> patches(int w, int h, double s, Random& random) {
  std::vector<float> a(static_cast<std::size_t>(w) * static_cast<std::size_t>(h)), b(a.size());
  for (float& v : a) v = static_cast<float>(random.normal());
  if (s < 0.2) return a;
  const int r = static_cast<int>(std::ceil(2.5 * s));
  std::vector<float> k;
  double square = 0;
  for (int i = -r; i <= r; ++i) k.push_back(static_cast<float>(std::exp(-0.5 * i * i / (s * s)))), square += k.back() * k.back();
  for (float& v : k) v /= static_cast<float>(std::sqrt(square));
  const auto size = [&](int u, int n) { return (u % n + n) % n; };  // wraps around: the same variance everywhere
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      float v = 0;
      for (int i = -r; i <= r; ++i) v += k[static_cast<std::size_t>(i + r)] * a[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(size(x + i, w))];
      b[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)] = v;
    }
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      float v = 0;
      for (int i = -r; i <= r; ++i) v += k[static_cast<std::size_t>(i + r)] * b[static_cast<std::size_t>(size(y + i, h)) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)];
      a[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)] = v;
    }
  return a;
}

}  // namespace

RayScene scene_of(std::vector<Body> bodies) {
  struct Placed {
    Body body;
    Mat3 R;  // base to body
    Vec3 t;
  };
  std::vector<Placed> placed;
  for (Body& b : bodies) {
    const auto back = b.T_base_body.inverse();
    placed.push_back({b, back.rotation(), back.p_mm});
  }
  return [placed = std::move(placed)](const Vec3& p, const Vec3& d) -> std::optional<RayHit> {
    std::optional<RayHit> best;
    for (const Placed& b : placed)
      if (auto hit = hit_body(b.body, b.R * p + b.t, b.R * d); hit && (!best || hit->distance_mm < best->distance_mm)) best = RayHit{hit->distance_mm, b.R.transpose() * hit->n};
    return best;
  };
}

RayScene scene_of(const MeshQuery& mesh) {
  return [&mesh](const Vec3& p, const Vec3& d) -> std::optional<RayHit> {
    const auto hit = mesh.first_hit(p, d, 5000);
    if (!hit) return std::nullopt;
    return RayHit{hit->distance_mm, mesh.mesh().triangle_normal(hit->triangle)};
  };
}

double distance_mm(const Body& b, const Vec3& p_base) {
  const Vec3 p = b.T_base_body.inverse().point(p_base);
  if (b.kind == Body::Kind::floor) return p.z();
  if (b.kind == Body::Kind::sphere) return p.norm() - b.size_mm.x();
  if (b.kind == Body::Kind::cylinder) {
    const double side = p.head<2>().norm() - b.size_mm.x(), cap = std::abs(p.z() - b.size_mm.z() / 2) - b.size_mm.z() / 2;
    return side > 0 && cap > 0 ? std::hypot(side, cap) : std::max(side, cap);
  }
  const Vec3 q(std::abs(p.x()) - b.size_mm.x() / 2, std::abs(p.y()) - b.size_mm.y() / 2, std::abs(p.z() - b.size_mm.z() / 2) - b.size_mm.z() / 2);
  return q.maxCoeff() > 0 ? q.cwiseMax(0.0).norm() : q.maxCoeff();
}

DepthCameraModel stereo_camera(int width_px, int height_px) {
  DepthCameraModel m;
  m.camera.fx_px = m.camera.fy_px = 650;
  m.camera.cx_px = 0.5 * width_px - 0.7, m.camera.cy_px = 0.5 * height_px + 0.4;
  m.camera.width_px = width_px, m.camera.height_px = height_px;
  m.camera.depth_unit_mm = 0.1;
  return m;
}

DepthImage depth_image(const RayScene& scene, const DepthCameraModel& m, const Pose<frame::Base, frame::Sensor>& T, Random& random) {
  const DepthCamera& c = m.camera;
  const int w = c.width_px, h = c.height_px;
  const auto at = [w](int u, int v) { return static_cast<std::size_t>(v) * static_cast<std::size_t>(w) + static_cast<std::size_t>(u); };
  std::vector<float> depth(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), 0), cosine(depth.size(), 0);
  const Mat3 R = T.rotation();
  const double cosine_min = std::cos(m.incidence_max_rad);
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const Vec3 ray((u - c.cx_px) / c.fx_px, (v - c.cy_px) / c.fy_px, 1);
      const double length = ray.norm();
      const Vec3 d = R * ray / length;
      const auto hit = scene(T.p_mm, d);
      if (!hit) continue;
      depth[at(u, v)] = static_cast<float>(hit->distance_mm / length);
      cosine[at(u, v)] = static_cast<float>(std::abs(hit->n.dot(d)));
    }
  const std::vector<float> noise = patches(w, h, m.correlation_px, random), holes = patches(w, h, 6.0, random);
  const double fb = c.fx_px * m.baseline_mm;
  DepthImage out;
  out.width_px = w, out.height_px = h;
  out.depth_count.assign(depth.size(), 0);
  const float hole_limit = m.hole_ratio > 0 ? static_cast<float>(m.hole_ratio < 0.04 ? 1.9 : m.hole_ratio < 0.08 ? 1.6 : 1.2) : 1e9f;
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const double lottery = random.uniform(), mix = random.uniform();
      // half a matching window: what is nearest within it wins
      float z = depth[at(u, v)], front = z > 0 ? z : 1e9f, back = z;
      float facing = cosine[at(u, v)];
      for (const auto& [du, dv] : {std::pair{-m.fatten_px, 0}, {m.fatten_px, 0}, {0, -m.fatten_px}, {0, m.fatten_px}}) {
        if (u + du < 0 || v + dv < 0 || u + du >= w || v + dv >= h) continue;
        const float other = depth[at(u + du, v + dv)];
        if (other <= 0) continue;
        if (other < front) {
          if (z <= 0 || z - other > 0.02f * z) facing = cosine[at(u + du, v + dv)];
          front = other;
        }
        back = std::max(back, other);
      }
      if (!(front < 1e8f)) continue;
      const bool is_step = z <= 0 || z - front > 0.02f * z || back - z > 0.02f * z;
      if (z <= 0 || z - front > 0.02f * z) z = front;
      if (is_step && lottery < m.flying_ratio) z = front + static_cast<float>(mix) * (back - front);
      if (facing < cosine_min || holes[at(u, v)] > hole_limit) continue;
      const double x = 2.0 * u / w - 1, y = 2.0 * v / h - 1;
      double disparity = fb / z;
      disparity += m.disparity_sd_px / std::max(0.35f, facing) * noise[at(u, v)] + m.ripple_px * std::sin(2 * kPi * disparity);
      double seen = fb / std::max(1e-3, disparity);
      seen = m.scale_ratio * seen + m.bowl_mm * (x * x + y * y) / 2;
      if (seen < m.range_min_mm || seen > m.range_max_mm) continue;
      out.depth_count[at(u, v)] = static_cast<std::uint16_t>(std::clamp(std::lround(seen / c.depth_unit_mm), 0l, 65535l));
    }
  return out;
}

}  // namespace asbuilt::simulate_detail
