// SPDX-License-Identifier: GPL-3.0-or-later
// A truncated signed distance field in blocks of 8 x 8 x 8 voxels, only where a surface was seen. Integer sums: order and threads do
// not matter. Frame: base. mm.
#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "planner/fuse/depth_frame.hpp"

namespace asbuilt::fuse_detail {

struct Voxel {
  std::int64_t wd = 0;       // sum of weight x distance, in 1/32767 of the truncation
  std::int64_t wdd = 0;      // sum of weight x distance squared, the square in 1/32767 of the truncation squared
  std::uint32_t w = 0;       // sum of weights
  std::uint16_t count = 0;   // readings near the surface, held at 65535
  std::uint16_t free = 0;    // readings that saw past it
};
constexpr int kBlock = 8;
struct Block {
  Voxel voxel[kBlock * kBlock * kBlock];
};

class Voxels {
 public:
  Voxels(double voxel_mm, double truncation_mm) : h_(voxel_mm), truncation_(truncation_mm) {}
  double voxel_mm() const { return h_; }
  double truncation_mm() const { return truncation_; }

  /// Keys of the blocks a frame's surface touches, ascending.
  std::vector<std::uint64_t> touched(const DepthFrame& frame, const CameraRays& rays, const Pose<frame::Base, frame::Sensor>& T_base_sensor) const;
  /// Makes room for the blocks. False when there would be more than `count_max`.
  bool allocate(const std::vector<std::uint64_t>& keys, std::size_t count_max);
  struct Seen {
    const DepthFrame* frame;
    Pose<frame::Base, frame::Sensor> T_base_sensor;
    const std::vector<std::uint64_t>* keys;
  };
  /// Adds frames to the blocks they touch; blocks in parallel.
  void add(const std::vector<Seen>& frames, const CameraRays& rays);

  std::size_t blocks_count() const { return blocks_.size(); }
  std::size_t memory_bytes_count() const { return blocks_.size() * (sizeof(Block) + 48); }
  /// Keys of all blocks, ascending.
  std::vector<std::uint64_t> keys() const;
  static Eigen::Vector3i block_of(std::uint64_t key);
  static std::uint64_t key_of(const Eigen::Vector3i& block);
  /// The voxel with these indices; null where there is none.
  const Voxel* voxel(const Eigen::Vector3i& index) const;

 private:
  double h_, truncation_;
  std::unordered_map<std::uint64_t, std::size_t> index_;
  std::vector<std::unique_ptr<Block>> blocks_;
};

}  // namespace asbuilt::fuse_detail
