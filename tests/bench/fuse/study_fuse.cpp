// SPDX-License-Identifier: GPL-3.0-or-later
// study_fuse speeds [SEEDS] | clock [SEEDS] | logs | memory: streams of a simulated depth camera on a moving robot against the truth, the
// real logs of ../shared/data, and time and memory beside a plain dense field and PCL's voxel filter.
// Fixed seeds; a table on standard output. docs/how_to/measure_fuse.md says what each column is.
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include <fstream>
#include <sstream>

#include "planner/fuse/clock.hpp"
#include "planner/fuse/fuse.hpp"
#include "planner/fuse/voxels.hpp"
#include "planner/fuse/cells.hpp"
#include "planner/io/csv_table.hpp"
#include "planner/io/file.hpp"
#include "planner/io/robot_log.hpp"
#include "planner/io/zip_file.hpp"
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

double seconds_since(std::chrono::steady_clock::time_point begin) { return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count(); }

double peak_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024;
  return 0;
}

/// 1280 x 720 images of one part from a moving camera: readings, cells and blocks, time and memory.
void memory() {
  const Scene world = scene(0.2);
  Setup s = setup(1280, 720, 650);
  Random random(5);
  const Motion motion(scan_poses(world.center, 170, Vec2(45, 25), 0.3, 30, s.sensor.T_flange_sensor), 100, 800);
  StreamSettings settings;
  settings.frames_count_max = 6;
  SimulatedStream base = simulate_stream(world.rays, s.model, motion, s.sensor.T_flange_sensor, settings, random);
  Capture c;
  c.name = "long", c.sensor = 0;
  c.stream = base.stream;
  c.stream->clock.sigma_s = 1e-4;
  const LoggedMotion log = log_of(motion, 0.004, 1.0, -1.0);
  c.stream->robot.cycle_s = 0.004;
  for (std::size_t i = 0; i < log.t_s.size(); ++i) c.stream->robot.samples.push_back({log.t_s[i], log.T_base_flange[i], {}});
  const FrameSource source = [&](const StreamFrame& f) -> Result<DepthPixels> {
    const DepthImage& i = base.images[static_cast<std::size_t>(std::stoul(f.file)) % base.images.size()];
    return DepthPixels{i.width_px, i.height_px, i.depth_count};
  };
  StreamRecipe recipe;
  recipe.pairs_count = 8, recipe.motion_error_max_mm = 1e6, recipe.scale_max_ratio = 1e6, recipe.contradiction_noise_ratio = 1e6, recipe.jump_max_s = 1e6, recipe.offset_max_s = 1e6;
  std::printf("%8s %12s %10s %14s %12s %10s\n", "frames", "readings", "s a frame", "cells+frames", "peak MiB", "cell mm");
  for (const std::size_t times : {1u, 4u, 8u}) {
    c.stream->frames.clear();
    for (std::size_t k = 0; k < times; ++k)
      for (std::size_t i = 0; i < base.stream.frames.size(); ++i) {
        StreamFrame f = base.stream.frames[i];
        f.t_s += 1e-6 * static_cast<double>(k);
        c.stream->frames.push_back(f);
      }
    const auto begin = std::chrono::steady_clock::now();
    const auto fused = fuse_stream(recipe, c, s.sensor, source);
    if (!fused) {
      std::printf("refused %s: %s\n", fused.error()[0].code.c_str(), fused.error()[0].message.c_str());
      return;
    }
    const auto& f = fused->artefact;
    std::printf("%8zu %12llu %10.3f %10.1f MiB %12.1f %10.3f\n", c.stream->frames.size(), static_cast<unsigned long long>(f.summary.points_count), seconds_since(begin) / static_cast<double>(c.stream->frames.size()),
                static_cast<double>(f.memory_bytes_count) / 1048576, peak_mib(), f.cell_mm);
    std::fflush(stdout);
  }
  // the surface beside a plain dense field of the same voxels over the same box
  const double h = 1.0;
  auto begin = std::chrono::steady_clock::now();
  const auto surface = fuse_surface({.voxel_mm = h}, {}, c, s.sensor, 0, source);
  const double own = seconds_since(begin) / static_cast<double>(c.stream->frames.size());
  Box3 box;
  for (const Vec3& p : surface->artefact.p_base) box.extend(p);
  const Vec3 size = box.max_mm - box.min_mm + Vec3::Constant(8 * h);
  const auto nx = static_cast<std::size_t>(size.x() / h), ny = static_cast<std::size_t>(size.y() / h), nz = static_cast<std::size_t>(size.z() / h);
  std::vector<float> d(nx * ny * nz, 0), w(nx * ny * nz, 0);
  const fuse_detail::CameraRays rays(*c.stream->camera);
  const fuse_detail::Trajectory robot(c.stream->robot, 0.02);
  begin = std::chrono::steady_clock::now();
  for (const StreamFrame& f : base.stream.frames) {
    const auto frame = fuse_detail::frame_of(*source(f), rays, s.sensor, {}, 1);
    const auto back = (robot.at(f.t_s).T_base_flange * s.sensor.T_flange_sensor).inverse();
    const Mat3 R = back.rotation();
    for (std::size_t z = 0, at = 0; z < nz; ++z)
      for (std::size_t y = 0; y < ny; ++y)
        for (std::size_t x = 0; x < nx; ++x, ++at) {
          const Eigen::Vector3f p = (R * (box.min_mm + h * Vec3(double(x) - 4, double(y) - 4, double(z) - 4)) + back.p_mm).cast<float>();
          const auto i = rays.pixel_of(p);
          if (i < 0 || !(frame.pixels[static_cast<std::size_t>(i)].weight > 0)) continue;
          const float e = frame.pixels[static_cast<std::size_t>(i)].z_mm - p.z();
          if (e < -4) continue;
          d[at] = (d[at] * w[at] + std::min(e, 4.f)) / (w[at] + 1), w[at] += 1;
        }
  }
  const double dense = seconds_since(begin) / static_cast<double>(base.stream.frames.size());
  std::printf("surface, 1 mm voxels: %.3f s a frame, %.1f MiB; plain dense field: %.3f s a frame, %.1f MiB; ratio of time %.2f\n", own, static_cast<double>(surface->artefact.memory_bytes_count) / 1048576, dense,
              static_cast<double>(d.size() * 8) / 1048576, dense / own);
  // thinning 16 M readings beside PCL's filter, which holds them all
  pcl::PointCloud<pcl::PointXYZ>::Ptr all(new pcl::PointCloud<pcl::PointXYZ>);
  const auto frame = fuse_detail::frame_of(*source(base.stream.frames[2]), rays, s.sensor, {}, 1);
  while (all->size() < 16'000'000)
    for (std::size_t i = 0; i < frame.pixels.size() && all->size() < 16'000'000; ++i)
      if (frame.pixels[i].weight > 0) all->emplace_back(rays.ray(i).x() * frame.pixels[i].z_mm, rays.ray(i).y() * frame.pixels[i].z_mm, frame.pixels[i].z_mm + 1e-7f * static_cast<float>(all->size()));
  begin = std::chrono::steady_clock::now();
  fuse_detail::Cells cells(0.26, 3000000);
  for (const auto& p : *all) cells.add(0, p.getVector3fMap().cast<double>(), Eigen::Vector3f(0, 0, -1), 64);
  const double cells_s = seconds_since(begin);
  begin = std::chrono::steady_clock::now();
  pcl::VoxelGrid<pcl::PointXYZ> filter;
  pcl::PointCloud<pcl::PointXYZ> thin;
  filter.setInputCloud(all), filter.setLeafSize(0.26f, 0.26f, 0.26f), filter.filter(thin);
  const double pcl_s = seconds_since(begin);
  std::printf("16 M readings to cells: %.2f s, %.1f MiB, %zu cells; PCL VoxelGrid: %.2f s, %.1f MiB of points held, %zu cells; ratio %.2f\n", cells_s, static_cast<double>(cells.memory_bytes_count()) / 1048576, cells.count(), pcl_s,
              static_cast<double>(all->size() * sizeof(pcl::PointXYZ)) / 1048576, thin.size(), pcl_s / cells_s);
}

std::string text_of(const std::string& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream t;
  t << in.rdbuf();
  return t.str();
}

/// The real logs. Where a file is not there, says so.
void logs() {
  const std::string data = "../shared/data/";
  for (const char* name : {"kr300_A.csv", "kr300_B.csv"}) {
    const std::string bytes = text_of(data + "logs/kuka_kr300_250hz/" + name);
    if (bytes.empty()) {
      std::printf("%s: not there, skipped\n", name);
      continue;
    }
    const auto log = read_robot_log(bytes, name, "");
    std::printf("%s: %zu samples, cycle %.4f ms, second encoders on", name, log->samples.size(), 1000 * log->cycle_s);
    for (int j = 0; j < 6; ++j)
      if (log->has_secondary[static_cast<std::size_t>(j)]) std::printf(" A%d (sd %.4f deg)", j + 1, log->secondary_sd_deg[static_cast<std::size_t>(j)]);
    std::printf("; derivative against speed, rms deg/s:");
    for (const double v : log->speed_rms_deg_s) std::printf(" %.3f", v);
    // as RSI packets with bursts of losses, repeats, late packets and one reset, and back
    Random random(7);
    std::string rsi;
    std::size_t lost = 0, repeated = 0, burst = 0;
    std::vector<std::size_t> sent;
    for (std::size_t i = 0; i < log->samples.size(); ++i) {
      if (burst > 0 || (i > 0 && i + 5 < log->samples.size() && random.uniform() < 0.002)) {
        burst = burst > 0 ? burst - 1 : random.below(3);
        ++lost;
        continue;
      }
      std::string p = "<Rob Type=\"KUKA\"><AIPos";
      char text[64];
      for (std::size_t j = 0; j < 6; ++j) std::snprintf(text, sizeof text, " A%zu=\"%.6f\"", j + 1, log->samples[i].joints_deg[j]), p += text;
      p += "/><Delay D=\"0\"/><IPOC>" + std::to_string(4 * (i < 2000 ? i + 500000 : i - 2000)) + "</IPOC></Rob>\n";
      rsi += p, sent.push_back(i);
      if (random.uniform() < 0.003) rsi += p, ++repeated;
    }
    const auto back = read_robot_log(rsi, "rsi.xml", "");
    double worst = 0;
    for (std::size_t k = 0; back && k < std::min(sent.size(), back->samples.size()); ++k)
      for (std::size_t j = 0; j < 6; ++j) worst = std::max(worst, std::abs(back->samples[k].joints_deg[j] - log->samples[sent[k]].joints_deg[j]));
    std::size_t found = 0;
    for (std::size_t k = 1; back && k < back->samples.size(); ++k) found += static_cast<std::size_t>(std::lround((back->samples[k].t_s - back->samples[k - 1].t_s) / 0.004)) - 1;
    if (back)
      std::printf("\n  as RSI and back: %zu of %zu packets, worst joint difference %.1e deg, lost %zu (found %zu), repeated %zu (found %zu), resets 1 (found %zu)\n", back->samples.size(), sent.size(), worst, lost, found, repeated,
                  back->repeated_count, back->resets.size());
  }
  // two pose streams of hand and eye
  const std::string zip = text_of(data + "calibration/eth_handeye/robot_arm_w_color_camera_real.zip");
  if (zip.empty()) std::printf("eth_handeye: not there, skipped\n");
  else {
    std::vector<fuse_detail::TimedRotation> streams[2];
    for (int k = 0; k < 2; ++k) {
      const auto bytes = read_zip_entry(zip, k == 0 ? "base_link_sr300_hinge.csv" : "target_ir.csv", 64 << 20);
      const auto t = read_csv_table("t,x_m,y_m,z_m,qx,qy,qz,qw\n" + bytes.value_or(""), "eth.csv");
      if (!t) continue;
      for (std::size_t r = 0; r < t->rows_count; ++r) streams[k].push_back({t->at(r, 0) - 1487321563.0, Eigen::Quaterniond(t->at(r, 7), t->at(r, 4), t->at(r, 5), t->at(r, 6)).normalized()});
    }
    const auto found = fuse_detail::rotation_rate_offset(streams[0], streams[1], -0.5, 0.5, 0.3);
    if (found)
      std::printf("eth_handeye real: t_hand = t_eye %+.4f s +- %.4f (published magnitude 0.02 s), second minimum at %.0f %%, turns over 0.3 s agree to %.2f deg\n", found->offset_s, found->sigma_s, 100 * found->second_ratio,
                  found->residual_rms_rad * 180 / kPi);
  }
  // five real depth images into a surface
  const std::string poses = text_of(data + "logs/rgbd_5frames_a/pose.txt");
  if (poses.empty()) return (void)std::printf("rgbd_5frames_a: not there, skipped\n");
  Capture c;
  c.name = "rgbd", c.sensor = 0;
  c.stream.emplace();
  c.stream->camera = DepthCamera{518, 519, 325.5, 253.5, 640, 480, {}, 1.0};
  c.stream->robot.cycle_s = 1;
  std::istringstream in(poses);
  double v[7];
  for (int i = 0; in >> v[0] >> v[1] >> v[2] >> v[3] >> v[4] >> v[5] >> v[6]; ++i) {
    c.stream->robot.samples.push_back({double(i), {Eigen::Quaterniond(v[6], v[3], v[4], v[5]).normalized(), 1000 * Vec3(v[0], v[1], v[2])}, {}});
    StreamFrame f;
    f.t_s = i, f.file = data + "logs/rgbd_5frames_a/depth/" + std::to_string(i + 1) + ".png";
    c.stream->frames.push_back(f);
  }
  SensorSpec sensor;
  sensor.noise_mm = 10, sensor.working_distance_mm = 2000, sensor.range_mm = {400, 8000};
  std::size_t valid = 0, count = 0;
  const FrameSource source = [&](const StreamFrame& f) -> Result<DepthPixels> {
    auto image = read_depth_image(*read_file(f.file, f.file), f.file);
    if (!image) return refuse_all(image.error());
    return DepthPixels{image->width_px, image->height_px, std::move(image->depth_count)};
  };
  for (const StreamFrame& f : c.stream->frames) {
    const auto image = source(f);
    for (const auto d : image->depth_count) valid += d > 0, ++count;
  }
  const auto surface = fuse_surface({.voxel_mm = 20, .frames_count_min = 2}, {}, c, sensor, 0, source);
  if (surface) {
    std::vector<float> sigma = surface->artefact.sigma_mm;
    std::nth_element(sigma.begin(), sigma.begin() + static_cast<std::ptrdiff_t>(sigma.size() / 2), sigma.end());
    std::printf("rgbd_5frames_a: %.1f %% valid pixels (published 68 to 73), %zu blocks, %zu points seen by two frames or more, %zu triangles, median sd of the field %.1f mm\n", 100.0 * double(valid) / double(count),
                surface->artefact.blocks_count, surface->artefact.p_base.size(), surface->artefact.mesh_base.triangles.size(), sigma[sigma.size() / 2]);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string what = argc > 1 ? argv[1] : "";
  const int seeds = argc > 2 ? std::atoi(argv[2]) : 2;
  if (what == "speeds") speeds(seeds);
  else if (what == "clock") clocks(seeds);
  else if (what == "logs") logs();
  else if (what == "memory") memory();
  else return std::printf("study_fuse speeds|clock [SEEDS] or logs|memory\n"), 2;
  return 0;
}
