// SPDX-License-Identifier: GPL-3.0-or-later
// study_fuse speeds [SEEDS] | faults [SEEDS]: what streams of a simulated depth camera on a moving robot give, against the truth.
// Fixed seeds; a table on standard output. docs/how_to/measure_fuse.md says what each column is.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "planner/fuse/fuse.hpp"
#include "tests/bench/fuse/artefacts.hpp"

using namespace asbuilt;
using namespace asbuilt::artefact_study;

namespace {

std::vector<Vec3> cloud_of(const FusedStream& f, const SensorSpec& sensor) {
  std::vector<Vec3> all;
  for (const FusedStream::View& v : f.views) {
    const auto T = v.capture.T_base_flange * sensor.T_flange_sensor;
    for (const auto& p : v.capture.points_sensor) all.push_back(T.point(p.cast<double>()));
  }
  return all;
}

void speeds(int seeds) {
  std::printf("best-fit error (mm): rms and mean of |distance| of the fused points to the body fitted to them; dR: error of its radius or half edge\n");
  std::printf("edge: cube's upper edges, as fitted faces meet (mean, max); cloud and TSDF: how far points at the edge stand out over the cube, 95 %%\n");
  std::printf("%6s %4s | %8s %7s | %22s %22s %22s | %13s %7s %7s | %6s\n", "mm/s", "seed", "tau ms", "sd ms", "sphere rms mean dR", "cylinder rms mean dR", "cube rms mean dR", "edge mean max", "cloud", "TSDF", "s");
  for (const double speed : {5.0, 10.0, 50.0, 100.0, 150.0})
    for (int seed = 1; seed <= seeds; ++seed) {
      const auto begin = std::chrono::steady_clock::now();
      const Scene world = scene(0.2 * seed);
      const Setup s = setup(640, 400, 650);
      ScanSettings settings;
      settings.speed_mm_s = speed, settings.seed = static_cast<std::uint64_t>(seed) + 100, settings.offset_s = 0.0073, settings.frames_count_max = 60;
      const Scan recorded = scan(world, s, settings);
      const auto fused = fuse_stream({}, recorded.capture, s.sensor, recorded.source());
      if (!fused) {
        std::printf("%6.0f %4d | refused %s: %s\n", speed, seed, fused.error()[0].code.c_str(), fused.error()[0].message.c_str());
        continue;
      }
      const std::vector<Vec3> points = cloud_of(fused->artefact, s.sensor);
      const auto& sum = fused->artefact.summary;
      const auto surface = fuse_surface({.voxel_mm = 0.7}, {}, recorded.capture, s.sensor, sum.offset_s, recorded.source());
      BestFit f[3];
      for (int k = 0; k < 3; ++k) f[k] = best_fit(world.bodies[static_cast<std::size_t>(k)], points, 2.5);
      const EdgeError e = edge_error(world.bodies[2], points);
      const EdgeError t = surface ? edge_error(world.bodies[2], surface->artefact.p_base) : EdgeError{};
      std::printf("%6.0f %4d | %8.3f %7.3f | %7.3f %6.3f %7.3f  %7.3f %6.3f %7.3f  %7.3f %6.3f %7.3f | %6.3f %6.3f %7.3f %7.3f | %6.1f\n", speed, seed, 1000 * (sum.motion_offset_s - settings.offset_s), 1000 * sum.motion_sigma_s,
                  f[0].rms_mm, f[0].mean_abs_mm, f[0].size_error_mm, f[1].rms_mm, f[1].mean_abs_mm, f[1].size_error_mm, f[2].rms_mm, f[2].mean_abs_mm, f[2].size_error_mm, e.faces_mean_mm, e.faces_max_mm,
                  e.bubble_p95_mm, t.bubble_p95_mm, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
      std::fflush(stdout);
    }
}

/// Offset, scale and their bands on many seeds: does the band cover the truth?
void clocks(int seeds) {
  std::printf("%6s %5s | %9s %8s %6s | %9s %8s %6s | %7s %7s | %s\n", "mm/s", "seed", "offset ms", "sd ms", "ratio", "scale %%", "sd %%", "ratio", "misfit", "scatter", "refused");
  for (const double speed : {10.0, 50.0, 150.0})
    for (int seed = 1; seed <= seeds; ++seed) {
      const Scene world = scene(0.2 * seed);
      const Setup s = setup(320, 200, 325);
      ScanSettings settings;
      settings.speed_mm_s = speed, settings.seed = static_cast<std::uint64_t>(seed) + 500, settings.offset_s = 0.0123, settings.frames_count_max = 200, settings.scale_ratio = 1.02;
      const Scan recorded = scan(world, s, settings);
      StreamRecipe recipe;
      recipe.scale_max_ratio = 1, recipe.motion_error_max_mm = 100;
      const auto fused = fuse_stream(recipe, recorded.capture, s.sensor, recorded.source());
      if (!fused) {
        std::printf("%6.0f %5d | %s: %s\n", speed, seed, fused.error()[0].code.c_str(), fused.error()[0].message.c_str());
        continue;
      }
      const auto& sum = fused->artefact.summary;
      const double e = sum.motion_offset_s - settings.offset_s, b = sum.scale_ratio - 1 / settings.scale_ratio;
      std::printf("%6.0f %5d | %9.3f %8.3f %6.2f | %9.4f %8.4f %6.2f |\n", speed, seed, 1000 * e, 1000 * sum.motion_sigma_s, e / sum.motion_sigma_s, 100 * b, 100 * sum.scale_sigma_ratio, b / sum.scale_sigma_ratio);
      std::fflush(stdout);
    }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 2;
  if (what == "speeds") speeds(seeds);
  else if (what == "clock") clocks(seeds);
  else return std::printf("study_fuse speeds|faults [SEEDS]\n"), 2;
  return 0;
}
