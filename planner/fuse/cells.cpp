// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/cells.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt::fuse_detail {
namespace {

constexpr double kCountsPerMm = 4096;  // of the fixed-point sums
constexpr int kCellBits = 18;          // of each coordinate
constexpr std::int64_t kCellBias = std::int64_t{1} << (kCellBits - 1);
constexpr std::uint64_t kCellMask = (std::uint64_t{1} << kCellBits) - 1;

std::uint64_t mixed(std::uint64_t k) {
  k ^= k >> 31, k *= 0x7fb5d329728ea185ull, k ^= k >> 27, k *= 0x81dadef4bc2dd44dull, k ^= k >> 33;
  return k;
}

int direction_of(const Eigen::Vector3f& n) {
  if (!(n.squaredNorm() > 0)) return 6;
  int axis = 0;
  n.cwiseAbs().maxCoeff(&axis);
  return 2 * axis + (n[axis] < 0 ? 1 : 0);
}

}  // namespace

Cells::Cells(double cell_mm, std::size_t count_max) : cell_mm_(cell_mm), count_max_(std::max<std::size_t>(1000, count_max)), slots_(1 << 12) {
  must(cell_mm > 0, "cells need a size");
  memory_most_ = slots_.size() * sizeof(Slot);
}

Cells::Slot& Cells::slot(std::vector<Slot>& slots, std::uint64_t key, bool& is_new) {
  std::size_t i = mixed(key) & (slots.size() - 1);
  while (slots[i].key != 0 && slots[i].key != key) i = (i + 1) & (slots.size() - 1);
  is_new = slots[i].key == 0;
  slots[i].key = key;
  return slots[i];
}

void Cells::add(int view, const Vec3& p, const Eigen::Vector3f& n, int weight) {
  std::uint64_t key = 1;
  key = key << 6 | static_cast<std::uint64_t>(view & 63);
  key = key << 3 | static_cast<std::uint64_t>(direction_of(n));
  for (int i = 0; i < 3; ++i) {
    const std::int64_t c = static_cast<std::int64_t>(std::floor(p[i] / cell_mm_)) + kCellBias;
    if (c < 0 || c > static_cast<std::int64_t>(kCellMask)) return;  // farther away than any robot reaches
    key = key << kCellBits | static_cast<std::uint64_t>(c);
  }
  bool is_new = false;
  Slot& s = slot(slots_, key, is_new);
  s.x += std::llround(p.x() * kCountsPerMm) * weight, s.y += std::llround(p.y() * kCountsPerMm) * weight, s.z += std::llround(p.z() * kCountsPerMm) * weight;
  s.weight += weight;
  if (s.readings != UINT32_MAX) ++s.readings;
  if (!is_new) return;
  if (++count_ > count_max_) coarsen();
  else if (count_ * 10 > slots_.size() * 7) grow();
}

void Cells::grow() {
  std::vector<Slot> larger(slots_.size() * 2);
  memory_most_ = std::max(memory_most_, (slots_.size() + larger.size()) * sizeof(Slot));
  for (const Slot& s : slots_) {
    if (s.key == 0) continue;
    bool is_new = false;
    slot(larger, s.key, is_new) = s;
  }
  slots_.swap(larger);
}

void Cells::coarsen() {
  while (count_ > count_max_) {
    cell_mm_ *= 2;
    std::vector<Slot> coarser(slots_.size());
    memory_most_ = std::max(memory_most_, 2 * slots_.size() * sizeof(Slot));
    count_ = 0;
    for (const Slot& s : slots_) {
      if (s.key == 0) continue;
      std::uint64_t key = s.key >> (3 * kCellBits);
      for (int i = 2; i >= 0; --i) {
        const std::int64_t c = static_cast<std::int64_t>(s.key >> (i * kCellBits) & kCellMask) - kCellBias;
        key = key << kCellBits | static_cast<std::uint64_t>((c >> 1) + kCellBias);  // floor, also of negative ones
      }
      bool is_new = false;
      Slot& to = slot(coarser, key, is_new);
      to.x += s.x, to.y += s.y, to.z += s.z, to.weight += s.weight;
      to.readings = static_cast<std::uint32_t>(std::min<std::uint64_t>(UINT32_MAX, std::uint64_t{to.readings} + s.readings));
      count_ += is_new;
    }
    slots_.swap(coarser);
  }
}

std::vector<Cells::Point> Cells::points() const {
  std::vector<const Slot*> order;
  order.reserve(count_);
  for (const Slot& s : slots_)
    if (s.key != 0) order.push_back(&s);
  std::sort(order.begin(), order.end(), [](const Slot* a, const Slot* b) { return a->key < b->key; });
  std::vector<Point> out;
  out.reserve(order.size());
  for (const Slot* s : order) {
    const double w = static_cast<double>(s->weight) * kCountsPerMm;
    out.push_back({static_cast<int>(s->key >> (3 * kCellBits + 3) & 63), s->readings,
                   Vec3(static_cast<double>(s->x) / w, static_cast<double>(s->y) / w, static_cast<double>(s->z) / w)});
  }
  return out;
}

}  // namespace asbuilt::fuse_detail
