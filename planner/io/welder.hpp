// SPDX-License-Identifier: GPL-3.0-or-later
// Triangles given corner by corner become triangles with shared vertices: corners at exactly the same place are one vertex, in the
// order in which they first come.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <unordered_map>

#include "planner/io/mesh_file.hpp"

namespace asbuilt {

class Welder {
 public:
  /// Adds one triangle, or counts why not.
  void add(const std::array<Vec3, 3>& corner, MeshFile& out) {
    if (!corner[0].allFinite() || !corner[1].allFinite() || !corner[2].allFinite()) {
      ++out.dropped_count;
      return;
    }
    std::array<int, 3> t{};
    for (std::size_t k = 0; k < 3; ++k) t[k] = at(corner[k], out.mesh);
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) ++out.degenerate_count;
    else out.mesh.triangles.push_back(t);
  }

 private:
  struct Key {
    std::uint64_t x, y, z;
    bool operator==(const Key&) const = default;
  };
  struct Hash {
    std::size_t operator()(const Key& k) const {
      std::uint64_t h = k.x * 0x9E3779B97F4A7C15ull;
      h = (h ^ (h >> 29) ^ k.y) * 0xBF58476D1CE4E5B9ull;
      h = (h ^ (h >> 32) ^ k.z) * 0x94D049BB133111EBull;
      return std::size_t(h ^ (h >> 31));
    }
  };
  std::unordered_map<Key, int, Hash> index_;

  int at(const Vec3& p, Mesh& mesh) {
    const auto bits = [](double d) { return std::bit_cast<std::uint64_t>(d == 0 ? 0.0 : d); };
    const auto [it, is_new] = index_.try_emplace(Key{bits(p.x()), bits(p.y()), bits(p.z())}, int(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(p);
    return it->second;
  }
};

}  // namespace asbuilt
