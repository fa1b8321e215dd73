// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/voxels.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace asbuilt::fuse_detail {
namespace {

constexpr int kBits = 20;
constexpr int kBias = 1 << (kBits - 1);
constexpr double kDistanceCounts = 32767;

int floor_div(int a, int b) { return a >= 0 ? a / b : -((-a + b - 1) / b); }

}  // namespace

std::uint64_t Voxels::key_of(const Eigen::Vector3i& b) {
  std::uint64_t key = 0;
  for (int i = 0; i < 3; ++i) key = key << kBits | static_cast<std::uint64_t>((b[i] + kBias) & ((1 << kBits) - 1));
  return key;
}

Eigen::Vector3i Voxels::block_of(std::uint64_t key) {
  const auto part = [&](int shift) { return static_cast<int>(key >> shift & ((1u << kBits) - 1)) - kBias; };
  return {part(2 * kBits), part(kBits), part(0)};
}

std::vector<std::uint64_t> Voxels::touched(const DepthFrame& frame, const CameraRays& rays, const Pose<frame::Base, frame::Sensor>& T) const {
  std::vector<std::uint64_t> keys;
  const double block = h_ * kBlock;
  const Mat3 R = T.rotation();
  const auto& camera = rays.camera();
  std::uint64_t last = 0;
  double z_near = 1e30;
  for (const FramePixel& p : frame.pixels)
    if (p.weight > 0) z_near = std::min(z_near, static_cast<double>(p.z_mm));
  const int stride = std::max(1, static_cast<int>(0.4 * block * std::min(camera.fx_px, camera.fy_px) / std::max(1.0, 3 * z_near)));
  for (int v = 0; v < frame.height_px; v += stride)
    for (int u = 0; u < frame.width_px; u += stride) {
      const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(frame.width_px) + static_cast<std::size_t>(u);
      const FramePixel& pixel = frame.pixels[i];
      if (!(pixel.weight > 0)) continue;
      const Vec3 ray(rays.ray(i).x(), rays.ray(i).y(), 1);
      const Vec3 n = R * pixel.n_sensor.cast<double>(), p = R * (ray * static_cast<double>(pixel.z_mm)) + T.p_mm;
      const int steps = std::max(1, static_cast<int>(std::ceil(2 * truncation_ / (0.5 * block))));
      for (int s = 0; s <= steps; ++s) {
        const Vec3 x = p + n * truncation_ * (2.0 * s / steps - 1);
        const Eigen::Vector3i b(static_cast<int>(std::floor(x.x() / block)), static_cast<int>(std::floor(x.y() / block)), static_cast<int>(std::floor(x.z() / block)));
        if (b.cwiseAbs().maxCoeff() >= kBias - 1) continue;
        const std::uint64_t key = key_of(b);
        if (key != last) keys.push_back(key), last = key;
      }
    }
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  return keys;
}

bool Voxels::allocate(const std::vector<std::uint64_t>& keys, std::size_t count_max) {
  for (const std::uint64_t key : keys) {
    if (index_.count(key)) continue;
    if (blocks_.size() >= count_max) return false;
    index_.emplace(key, blocks_.size());
    blocks_.push_back(std::make_unique<Block>());
  }
  return true;
}

void Voxels::add(const std::vector<Seen>& frames, const CameraRays& rays) {
  std::vector<std::uint64_t> all;
  for (const Seen& f : frames) all.insert(all.end(), f.keys->begin(), f.keys->end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t k) {
    Block& block = *blocks_[index_.at(all[k])];
    const Eigen::Vector3i corner = block_of(all[k]) * kBlock;
    for (const Seen& f : frames) {
      if (!std::binary_search(f.keys->begin(), f.keys->end(), all[k])) continue;
      const auto back = f.T_base_sensor.inverse();
      const Eigen::Matrix3f R = back.rotation().cast<float>();
      const Eigen::Vector3f first = back.point((corner.cast<double>() + Vec3::Constant(0.5)) * h_).cast<float>();
      const Eigen::Matrix3f step = R * static_cast<float>(h_);
      const float truncation = static_cast<float>(truncation_);
      int at = 0;
      for (int z = 0; z < kBlock; ++z)
        for (int y = 0; y < kBlock; ++y)
          for (int x = 0; x < kBlock; ++x, ++at) {
            const Eigen::Vector3f p = first + step * Eigen::Vector3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
            const std::ptrdiff_t i = rays.pixel_of(p);
            if (i < 0) continue;
            const FramePixel& pixel = f.frame->pixels[static_cast<std::size_t>(i)];
            if (!(pixel.weight > 0)) continue;
            const Eigen::Vector2f& ray = rays.ray(static_cast<std::size_t>(i));
            const Eigen::Vector3f q(ray.x() * pixel.z_mm, ray.y() * pixel.z_mm, pixel.z_mm);
            const float d = pixel.n_sensor.dot(p - q);
            Voxel& voxel = block.voxel[at];
            if (d < -truncation) continue;
            if (d > truncation) {
              if (voxel.free != UINT16_MAX) ++voxel.free;
              continue;
            }
            const float behind = d < 0 ? 1 + d / truncation : 1.f;  // what lies behind a surface is known less and less
            const auto weight = static_cast<std::int64_t>(std::lround(64 * std::min(16.f, pixel.weight) * behind));
            if (weight <= 0) continue;
            const auto counts = static_cast<std::int64_t>(std::lround(kDistanceCounts * static_cast<double>(d / truncation)));
            voxel.wd += weight * counts;
            voxel.wdd += weight * (counts * counts / static_cast<std::int64_t>(kDistanceCounts));
            voxel.w = static_cast<std::uint32_t>(std::min<std::uint64_t>(UINT32_MAX, std::uint64_t{voxel.w} + static_cast<std::uint64_t>(weight)));
            if (voxel.count != UINT16_MAX) ++voxel.count;
          }
    }
  });
}

std::vector<std::uint64_t> Voxels::keys() const {
  std::vector<std::uint64_t> all;
  for (const auto& [key, i] : index_) all.push_back(key);
  std::sort(all.begin(), all.end());
  return all;
}

const Voxel* Voxels::voxel(const Eigen::Vector3i& i) const {
  const Eigen::Vector3i b(floor_div(i.x(), kBlock), floor_div(i.y(), kBlock), floor_div(i.z(), kBlock));
  const auto it = index_.find(key_of(b));
  if (it == index_.end()) return nullptr;
  const Eigen::Vector3i l = i - b * kBlock;
  return &blocks_[it->second]->voxel[(l.z() * kBlock + l.y()) * kBlock + l.x()];
}

}  // namespace asbuilt::fuse_detail
