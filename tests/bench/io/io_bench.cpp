// SPDX-License-Identifier: GPL-3.0-or-later
// Reading clouds from disk, file to points, against PCL on the same files in the same run; the ratio is the counter "ratio".
#include <benchmark/benchmark.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>
#include <pcl/point_types.h>

#include <chrono>
#include <filesystem>
#include <functional>

#include "planner/io/cloud_file.hpp"
#include "planner/io/file.hpp"
#include "planner/io/mesh_file.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

constexpr int kPoints = 2'000'000;

double seconds(const std::function<void()>& work) {
  const auto t = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - t).count();
}

/// The same points in every format.
const fs::path& folder() {
  static const fs::path made = [] {
    const fs::path f = fs::temp_directory_path() / "asbuilt_bench_io";
    fs::create_directories(f);
    std::vector<Eigen::Vector3f> points;
    pcl::PointCloud<pcl::PointXYZ> cloud;
    std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(kPoints) +
                       "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (int i = 0; i < kPoints; ++i) {
      points.emplace_back(0.001f * float(i), 0.37f * float(i % 1000), 500.f + 0.01f * float(i % 77));
      cloud.emplace_back(points.back().x(), points.back().y(), points.back().z());
      for (int k = 0; k < 3; ++k) text += std::to_string(points.back()[k]) + (k == 2 ? "\n" : " ");
    }
    (void)write_file(f / "binary.ply", write_cloud_ply(points));
    (void)write_file(f / "ascii.ply", text);
    pcl::io::savePCDFileBinary((f / "binary.pcd").string(), cloud);
    pcl::io::savePCDFileBinaryCompressed((f / "compressed.pcd").string(), cloud);
    return f;
  }();
  return made;
}

void read_file_of(benchmark::State& state, const char* name) {
  const std::string file = (folder() / name).string();
  double own_s = 0, peer_s = 0;
  for (auto _ : state) {
    std::size_t own = 0, peer = 0;
    const double a = seconds([&] { own = read_cloud(*read_file(file, file), file)->points.size(); });
    const double b = seconds([&] {
      pcl::PointCloud<pcl::PointXYZ> cloud;
      if (file.ends_with(".ply")) pcl::io::loadPLYFile(file, cloud);
      else pcl::io::loadPCDFile(file, cloud);
      peer = cloud.size();
    });
    if (own != peer) state.SkipWithError("the readers disagree");
    state.SetIterationTime(a);
    own_s += a, peer_s += b;
  }
  state.counters["ratio"] = peer_s / own_s;
  state.counters["points/s"] = double(kPoints) * double(state.iterations()) / own_s;
}
BENCHMARK_CAPTURE(read_file_of, ply_binary, "binary.ply")->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_file_of, ply_ascii, "ascii.ply")->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_file_of, pcd_binary, "binary.pcd")->UseManualTime()->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_file_of, pcd_compressed, "compressed.pcd")->UseManualTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace asbuilt

BENCHMARK_MAIN();
