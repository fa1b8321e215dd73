// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "planner/geom/point_grid.hpp"

namespace asbuilt {
namespace {

struct Keyed {
  std::uint64_t cell;
  std::int32_t capture;
  std::uint32_t index;
};

Mesh known_mesh(const Job& job) {
  Mesh all;
  const auto add = [&](const Mesh& m) {
    const int first = static_cast<int>(all.vertices.size());
    all.vertices.insert(all.vertices.end(), m.vertices.begin(), m.vertices.end());
    for (const auto& t : m.triangles) all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
  };
  add(transformed(job.fixture.T_base_fixture, job.fixture.mesh_fixture));
  for (const Obstacle& o : job.cell.obstacles) add(o.mesh_base);
  return all;
}

template <class Same>
std::vector<ScenePoint> means(const MeasuredCloud& cloud, const std::vector<Keyed>& keyed, const Same& same) {
  std::vector<ScenePoint> out;
  for (std::size_t i = 0; i < keyed.size();) {
    std::size_t j = i;
    ScenePoint s;
    Vec3 sum = Vec3::Zero(), normal = Vec3::Zero();
    double sigma = 0;
    for (; j < keyed.size() && same(keyed[i], keyed[j]); ++j) {
      sum += cloud.p_base[keyed[j].index], normal += cloud.n_base[keyed[j].index].cast<double>();
      sigma += cloud.sigma_mm[keyed[j].index];
    }
    const double n = static_cast<double>(j - i);
    // The point nearest the mean is a real one: means round edges off.
    const Vec3 mean = sum / n;
    std::size_t best = i;
    for (std::size_t m = i; m < j; ++m)
      if ((cloud.p_base[keyed[m].index] - mean).squaredNorm() < (cloud.p_base[keyed[best].index] - mean).squaredNorm()) best = m;
    s.p_base = cloud.p_base[keyed[best].index];
    s.n_base = cloud.n_base[keyed[best].index].cast<double>();
    s.capture = keyed[best].capture;
    s.sigma_mm = sigma / n;
    out.push_back(s);
    i = j;
  }
  return out;
}

int direction_bin(const Vec3& n) {  // a cube map of 3 x 3 per face
  if (n.squaredNorm() < 0.5) return 54;
  int axis;
  n.cwiseAbs().maxCoeff(&axis);
  const double u = n[(axis + 1) % 3] / std::abs(n[axis]), v = n[(axis + 2) % 3] / std::abs(n[axis]);
  const auto third = [](double x) { return std::clamp(static_cast<int>((x + 1) * 1.5), 0, 2); };
  return (2 * axis + (n[axis] > 0)) * 9 + third(u) * 3 + third(v);
}

}  // namespace

Scene make_scene(const Job& job, const MeasuredCloud& cloud, double cell_mm, double known_reach_mm) {
  Scene scene;
  scene.known = MeshQuery(known_mesh(job));
  std::vector<Keyed> keyed(cloud.p_base.size());
  for (std::size_t i = 0; i < keyed.size(); ++i)
    keyed[i] = {voxel_key(cloud.p_base[i], cell_mm), cloud.capture[i], static_cast<std::uint32_t>(i)};
  std::sort(keyed.begin(), keyed.end(), [](const Keyed& a, const Keyed& b) {
    return std::tie(a.cell, a.capture, a.index) < std::tie(b.cell, b.capture, b.index);
  });
  scene.rays = means(cloud, keyed, [](const Keyed& a, const Keyed& b) { return a.cell == b.cell && a.capture == b.capture; });
  std::vector<ScenePoint> single = means(cloud, keyed, [](const Keyed& a, const Keyed& b) { return a.cell == b.cell; });
  const auto mark = [&](std::vector<ScenePoint>& points) {
    if (scene.known.is_empty()) return;
    for (ScenePoint& s : points)
      s.is_known = scene.known.closest(s.p_base).distance_mm < known_reach_mm + 3 * s.sigma_mm;
  };
  mark(single), mark(scene.rays);
  // Round robin over directions of normals, within a direction in the order of a mixed key, so that any beginning of the list
  // covers the whole scene.
  std::array<std::vector<std::pair<std::uint64_t, std::uint32_t>>, 55> bins;
  for (std::size_t i = 0; i < single.size(); ++i) {
    if (single[i].is_known) continue;
    const std::uint64_t mixed = voxel_key(single[i].p_base, cell_mm) * 0x9E3779B97F4A7C15ull;
    bins[static_cast<std::size_t>(direction_bin(single[i].n_base))].emplace_back(mixed ^ (mixed >> 29), static_cast<std::uint32_t>(i));
  }
  std::size_t longest = 0;
  for (auto& b : bins) std::sort(b.begin(), b.end()), longest = std::max(longest, b.size());
  for (std::size_t i = 0; i < longest; ++i)
    for (const auto& b : bins)
      if (i < b.size()) scene.points.push_back(single[b[i].second]);
  return scene;
}

}  // namespace asbuilt
