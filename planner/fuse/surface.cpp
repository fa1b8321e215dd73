// SPDX-License-Identifier: GPL-3.0-or-later
// The field of a stream, and its zero surface: points on the voxels' edges, and a mesh of one vertex a cell (surface nets).
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "planner/base/number.hpp"
#include "planner/fuse/streams.hpp"
#include "planner/fuse/trajectory.hpp"
#include "planner/fuse/voxels.hpp"

namespace asbuilt {
namespace {

using namespace fuse_detail;

struct Sample {
  bool is_known = false;
  double d_mm = 0, sigma_mm = 0;
  int count = 0;
};

class Extraction {
 public:
  Extraction(const Voxels& voxels, const SurfaceRecipe& recipe, FusedSurface& out) : voxels_(voxels), recipe_(recipe), out_(out) {}

  void run() {
    for (const std::uint64_t key : voxels_.keys()) {
      const Eigen::Vector3i corner = Voxels::block_of(key) * kBlock;
      for (int z = 0; z < kBlock; ++z)
        for (int y = 0; y < kBlock; ++y)
          for (int x = 0; x < kBlock; ++x) visit(corner + Eigen::Vector3i(x, y, z));
    }
    for (const auto& [index, axis, is_out] : crossings_) face(index, axis, is_out);
  }

 private:
  struct Crossing {
    Eigen::Vector3i index;
    int axis;
    bool is_out;  // from inside to outside along the axis
  };
  const Voxels& voxels_;
  const SurfaceRecipe& recipe_;
  FusedSurface& out_;
  std::vector<Crossing> crossings_;
  struct Hash {
    std::size_t operator()(const Eigen::Vector3i& i) const {
      return static_cast<std::size_t>(i.x()) * 73856093u ^ static_cast<std::size_t>(i.y()) * 19349663u ^ static_cast<std::size_t>(i.z()) * 83492791u;
    }
  };
  std::unordered_map<Eigen::Vector3i, int, Hash> vertex_of_;  // -1: none

  Sample sample(const Eigen::Vector3i& index) const {
    const Voxel* v = voxels_.voxel(index);
    Sample s;
    if (!v || v->count < recipe_.frames_count_min || v->w == 0 || v->free > 2 * v->count) return s;
    const double t = voxels_.truncation_mm(), mean = static_cast<double>(v->wd) / v->w / 32767, square = static_cast<double>(v->wdd) / v->w / 32767;
    s.is_known = true, s.d_mm = mean * t, s.count = v->count;
    s.sigma_mm = t * std::sqrt(std::max(0.0, square - mean * mean) / v->count);
    return s;
  }
  Vec3 place(const Eigen::Vector3i& index) const { return (index.cast<double>() + Vec3::Constant(0.5)) * voxels_.voxel_mm(); }

  Vec3 gradient(const Eigen::Vector3i& index) const {
    Vec3 g = Vec3::Zero();
    for (int a = 0; a < 3; ++a) {
      const Sample low = sample(index - Eigen::Vector3i::Unit(a)), high = sample(index + Eigen::Vector3i::Unit(a)), here = sample(index);
      if (low.is_known && high.is_known) g[a] = (high.d_mm - low.d_mm) / 2;
      else if (high.is_known) g[a] = high.d_mm - here.d_mm;
      else if (low.is_known) g[a] = here.d_mm - low.d_mm;
    }
    return g.norm() > 0 ? Vec3(g.normalized()) : g;
  }

  void visit(const Eigen::Vector3i& index) {
    const Sample a = sample(index);
    if (!a.is_known) return;
    for (int axis = 0; axis < 3; ++axis) {
      const Sample b = sample(index + Eigen::Vector3i::Unit(axis));
      if (!b.is_known || (a.d_mm < 0) == (b.d_mm < 0)) continue;
      if (std::abs(b.d_mm - a.d_mm) > 2.5 * voxels_.voxel_mm()) continue;  // two surfaces back to back, not one
      const double s = a.d_mm / (a.d_mm - b.d_mm);
      out_.p_base.push_back(place(index) + s * voxels_.voxel_mm() * Vec3::Unit(axis));
      out_.n_base.push_back(((1 - s) * gradient(index) + s * gradient(index + Eigen::Vector3i::Unit(axis))).normalized().cast<float>());
      out_.sigma_mm.push_back(static_cast<float>(std::hypot((1 - s) * a.sigma_mm, s * b.sigma_mm)));
      out_.frames_count.push_back(std::min(a.count, b.count));
      crossings_.push_back({index, axis, a.d_mm < 0});
    }
  }

  /// Vertex of the cell between index and index + (1, 1, 1); -1 where a corner is not known.
  int vertex(const Eigen::Vector3i& index) {
    const auto [it, is_new] = vertex_of_.try_emplace(index, -1);
    if (!is_new) return it->second;
    Sample corner[8];
    for (int c = 0; c < 8; ++c) {
      corner[c] = sample(index + Eigen::Vector3i(c & 1, c >> 1 & 1, c >> 2));
      if (!corner[c].is_known) return -1;
    }
    Vec3 sum = Vec3::Zero();
    int count = 0;
    for (int c = 0; c < 8; ++c)
      for (int axis = 0; axis < 3; ++axis) {
        const int d = c | 1 << axis;
        if (d == c || (corner[c].d_mm < 0) == (corner[d].d_mm < 0)) continue;
        const double s = corner[c].d_mm / (corner[c].d_mm - corner[d].d_mm);
        sum += Vec3(c & 1, c >> 1 & 1, c >> 2) + s * Vec3::Unit(axis);
        ++count;
      }
    if (count == 0) return -1;
    out_.mesh_base.vertices.push_back(place(index) + sum / count * voxels_.voxel_mm());
    return vertex_of_[index] = static_cast<int>(out_.mesh_base.vertices.size()) - 1;
  }

  void face(const Eigen::Vector3i& index, int axis, bool is_out) {
    const Eigen::Vector3i u = Eigen::Vector3i::Unit((axis + 1) % 3), v = Eigen::Vector3i::Unit((axis + 2) % 3);
    const int q[4] = {vertex(index - u - v), vertex(index - v), vertex(index), vertex(index - u)};
    if (*std::min_element(q, q + 4) < 0) return;
    if (is_out) out_.mesh_base.triangles.push_back({q[0], q[1], q[2]}), out_.mesh_base.triangles.push_back({q[0], q[2], q[3]});
    else out_.mesh_base.triangles.push_back({q[0], q[2], q[1]}), out_.mesh_base.triangles.push_back({q[0], q[3], q[2]});
  }
};

}  // namespace

Result<Done<FusedSurface>> fuse_surface(const SurfaceRecipe& recipe, const StreamRecipe& stream_recipe, const Capture& capture, const SensorSpec& sensor, double offset_s,
                                        const FrameSource& source) {
  must(capture.stream && capture.stream->camera && source, "fuse_surface: the capture is no stream of images");
  const SensorStream& stream = *capture.stream;
  const Trajectory robot(stream.robot, stream_recipe.gap_max_s);
  const CameraRays rays(*stream.camera);
  Voxels voxels(recipe.voxel_mm, std::max(recipe.truncation_voxels_ratio * recipe.voxel_mm, 3 * sensor.noise_mm));
  struct Place {
    std::size_t frame;
    Pose<frame::Base, frame::Sensor> T_base_sensor;
  };
  std::vector<Place> places;
  for (std::size_t i = 0; i < stream.frames.size(); ++i)
    if (const PoseAt at = robot.at(stream.frames[i].t_s + offset_s); at.is_known) places.push_back({i, at.T_base_flange * sensor.T_flange_sensor});
  constexpr std::size_t together = 4;
  std::size_t frame_bytes = 0;
  for (std::size_t begin = 0; begin < places.size(); begin += together) {
    const std::size_t n = std::min(together, places.size() - begin);
    std::vector<DepthFrame> frames(n);
    std::vector<std::vector<std::uint64_t>> keys(n);
    std::vector<Refusals> refused(n);
    tbb::parallel_for(std::size_t{0}, n, [&](std::size_t i) {
      auto image = source(stream.frames[places[begin + i].frame]);
      if (!image) {
        refused[i] = image.error();
        return;
      }
      frames[i] = frame_of(*image, rays, sensor, {}, 1);
      keys[i] = voxels.touched(frames[i], rays, places[begin + i].T_base_sensor);
    });
    std::vector<Voxels::Seen> seen;
    for (std::size_t i = 0; i < n; ++i) {
      if (!refused[i].empty()) return refuse_all(std::move(refused[i]));
      if (!voxels.allocate(keys[i], recipe.blocks_count_max))
        return refuse({.code = "fuse.surface_too_large",
                       .where = "capture " + capture.name,
                       .message = "With voxels of " + fixed_number(recipe.voxel_mm, 3) + " mm the surface takes more than " + std::to_string(recipe.blocks_count_max) + " blocks of 8 x 8 x 8 voxels; take larger voxels, or a smaller range of the sensor.",
                       .measured = static_cast<double>(recipe.blocks_count_max + 1),
                       .limit = static_cast<double>(recipe.blocks_count_max),
                       .unit = "blocks",
                       .stage = "fuse"});
      seen.push_back({&frames[i], places[begin + i].T_base_sensor, &keys[i]});
      frame_bytes = std::max(frame_bytes, n * frames[i].pixels.size() * sizeof(FramePixel));
    }
    voxels.add(seen, rays);
  }
  Done<FusedSurface> done;
  FusedSurface& out = done.artefact;
  out.blocks_count = voxels.blocks_count();
  out.memory_bytes_count = voxels.memory_bytes_count() + frame_bytes;
  Extraction(voxels, recipe, out).run();
  return done;
}

}  // namespace asbuilt
