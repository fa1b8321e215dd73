// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/depth_frame.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::fuse_detail {
namespace {

/// Brown's lens: straight ray -> where it falls.
Vec2 distorted(const std::array<double, 5>& k, const Vec2& n) {
  const double r2 = n.squaredNorm(), radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  return n * radial + Vec2(2 * k[2] * n.x() * n.y() + k[3] * (r2 + 2 * n.x() * n.x()), k[2] * (r2 + 2 * n.y() * n.y()) + 2 * k[3] * n.x() * n.y());
}

}  // namespace

CameraRays::CameraRays(const DepthCamera& camera) : camera_(camera) {
  for (const double k : camera.distortion_ratio) has_lens_ = has_lens_ || k != 0;
  ray_.resize(static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px));
  for (int v = 0; v < camera.height_px; ++v)
    for (int u = 0; u < camera.width_px; ++u) {
      const Vec2 seen((u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px);
      Vec2 n = seen;
      for (int i = 0; has_lens_ && i < 15; ++i) n += seen - distorted(camera.distortion_ratio, n);
      ray_[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width_px) + static_cast<std::size_t>(u)] = n.cast<float>();
    }
}

std::ptrdiff_t CameraRays::pixel_of(const Eigen::Vector3f& p) const {
  if (!(p.z() > 1e-3f)) return -1;
  Vec2 n(p.x() / p.z(), p.y() / p.z());
  if (has_lens_) n = distorted(camera_.distortion_ratio, n);
  const int u = static_cast<int>(std::floor(camera_.fx_px * n.x() + camera_.cx_px + 0.5)), v = static_cast<int>(std::floor(camera_.fy_px * n.y() + camera_.cy_px + 0.5));
  if (u < 0 || v < 0 || u >= camera_.width_px || v >= camera_.height_px) return -1;
  return static_cast<std::ptrdiff_t>(v) * camera_.width_px + u;
}

double depth_sigma_mm(const SensorSpec& sensor, double z_mm) {
  const double at = sensor.working_distance_mm > 0 ? z_mm / sensor.working_distance_mm : 1;
  return sensor.noise_mm * at * at;
}

DepthFrame frame_of(const DepthPixels& image, const CameraRays& rays, const SensorSpec& sensor, const FrameRecipe& recipe, int stride) {
  const int w = image.width_px, h = image.height_px;
  const DepthCamera& camera = rays.camera();
  DepthFrame out;
  out.width_px = w, out.height_px = h, out.stride_px = stride;
  out.pixels.resize(image.depth_count.size());
  const float unit = static_cast<float>(camera.depth_unit_mm);
  const float near = sensor.range_mm[1] > 0 ? static_cast<float>(sensor.range_mm[0]) : 0.f, far = sensor.range_mm[1] > 0 ? static_cast<float>(sensor.range_mm[1]) : 1e9f;
  for (std::size_t i = 0; i < image.depth_count.size(); ++i) {
    const float z = static_cast<float>(image.depth_count[i]) * unit;
    out.pixels[i].z_mm = z >= near && z <= far ? z : 0;
  }
  const auto at = [&](int u, int v) -> std::size_t { return static_cast<std::size_t>(v) * static_cast<std::size_t>(w) + static_cast<std::size_t>(u); };
  const auto jump_mm = [&](float z) {
    return static_cast<float>(recipe.jump_sigma_ratio * std::max(depth_sigma_mm(sensor, z), z / std::min(camera.fx_px, camera.fy_px)) + camera.depth_unit_mm);
  };
  // steps, then all that lies within the mask's reach of one (square, in two passes)
  std::vector<std::uint8_t> mask(image.depth_count.size(), 0), wide(image.depth_count.size(), 0);
  for (int v = 0; v < h; ++v)
    for (int u = 0; u < w; ++u) {
      const float z = out.pixels[at(u, v)].z_mm;
      if (z <= 0) continue;
      for (const auto& [du, dv] : {std::pair{1, 0}, {0, 1}}) {
        if (u + du >= w || v + dv >= h) continue;
        const float other = out.pixels[at(u + du, v + dv)].z_mm;
        if (other > 0 && std::abs(other - z) > jump_mm(std::min(z, other))) mask[at(u, v)] = mask[at(u + du, v + dv)] = 1;
      }
    }
  const int r = recipe.edge_mask_px;
  for (int v = 0; v < h; ++v) {
    int last = -1000000;
    for (int u = 0; u < w; ++u) {
      if (mask[at(u, v)]) last = u;
      if (u - last <= r) wide[at(u, v)] = 1;
    }
    last = 1000000;
    for (int u = w; u-- > 0;) {
      if (mask[at(u, v)]) last = u;
      if (last - u <= r) wide[at(u, v)] = 1;
    }
  }
  std::fill(mask.begin(), mask.end(), 0);
  for (int u = 0; u < w; ++u) {
    int last = -1000000;
    for (int v = 0; v < h; ++v) {
      if (wide[at(u, v)]) last = v;
      if (v - last <= r) mask[at(u, v)] = 1;
    }
    last = 1000000;
    for (int v = h; v-- > 0;) {
      if (wide[at(u, v)]) last = v;
      if (last - v <= r) mask[at(u, v)] = 1;
    }
  }
  const float cosine_min = static_cast<float>(std::cos(recipe.incidence_max_rad));
  const int window = recipe.normal_window_px, step = std::max(1, window / 2);
  for (int v = 0; v < h; v += stride)
    for (int u = 0; u < w; u += stride) {
      FramePixel& pixel = out.pixels[at(u, v)];
      const float z = pixel.z_mm;
      if (z <= 0) continue;
      if (mask[at(u, v)]) {
        ++out.masked_count;
        continue;
      }
      // 1 / z is linear in the ray's x and y on a plane: A dx + B dy + C
      const Eigen::Vector2f& ray = rays.ray(at(u, v));
      const float jump = 2 * jump_mm(z);
      float n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0, sq = 0, sxq = 0, syq = 0;
      const float q0 = 1 / z;
      for (int dv = -window; dv <= window; dv += step)
        for (int du = -window; du <= window; du += step) {
          if (u + du < 0 || v + dv < 0 || u + du >= w || v + dv >= h) continue;
          const std::size_t k = at(u + du, v + dv);
          const float other = out.pixels[k].z_mm;
          if (other <= 0 || std::abs(other - z) > jump) continue;
          const Eigen::Vector2f d = (rays.ray(k) - ray) * 1000.f;
          const float q = (1 / other - q0) * 1000.f;
          n += 1, sx += d.x(), sy += d.y(), sxx += d.x() * d.x(), sxy += d.x() * d.y(), syy += d.y() * d.y();
          sq += q, sxq += d.x() * q, syq += d.y() * q;
        }
      if (n < 8) continue;
      const float xx = sxx - sx * sx / n, xy = sxy - sx * sy / n, yy = syy - sy * sy / n, xq = sxq - sx * sq / n, yq = syq - sy * sq / n;
      const float determinant = xx * yy - xy * xy;
      if (!(determinant > 1e-3f * (xx + yy) * (xx + yy))) continue;
      const float a = (xq * yy - yq * xy) / determinant, b = (yq * xx - xq * xy) / determinant;
      const float c = q0 + (sq - a * sx - b * sy) / n / 1000.f;
      const Eigen::Vector3f m(a, b, c - a * ray.x() - b * ray.y());
      const float length = m.norm();
      if (!(length > 0)) continue;
      pixel.n_sensor = m / -length;
      const Eigen::Vector3f p(ray.x() * z, ray.y() * z, z);
      const float cosine = -pixel.n_sensor.dot(p) / p.norm();
      if (cosine < cosine_min) continue;
      const double sigma = depth_sigma_mm(sensor, z), reference = std::max(1e-9, sensor.noise_mm);
      pixel.weight = cosine * static_cast<float>((reference / sigma) * (reference / sigma));
      ++out.used_count;
    }
  return out;
}

}  // namespace asbuilt::fuse_detail
