// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/clusters.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "planner/locate/robot_prior.hpp"

namespace asbuilt {
namespace {

constexpr double kCosIncidenceMin = 0.3;      // steeper readings are biased
constexpr double kCosNormalMin = 0.75;        // between the scan's own normal and the drawing's
constexpr double kPointsPerReading = 12.0;    // neighbours whose errors move together
constexpr double kCommonRatio = 0.3;          // of a point's sigma: what a whole cell shares
constexpr double kCellsPerPatch = 5.0;
constexpr int kCountMin = 4;                   // of a cell; one where the capture is too coarse for that

struct Reading {
  int face;
  std::uint64_t cell;
  double distance;
  Vec3 p_base, p_part, n_part;
  float sigma;
};

double median_of(std::vector<double>& v) {
  std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
  return v[v.size() / 2];
}

std::vector<Cluster> clusters_of(const ClusterRequest& r, int k) {
  const MeasuredCloud& cloud = *r.cloud;
  const CloudCapture& capture = cloud.captures[static_cast<std::size_t>(k)];
  const Pose<frame::Part, frame::Base> T_part_base = r.T_base_part.inverse();
  const Mat3 R_base_part = r.T_base_part.rotation(), R_part_base = R_base_part.transpose();
  const Vec6& twist = r.twists[static_cast<std::size_t>(k)];
  const double band = std::max(r.edge_band_mm, std::min(3.0, 1.5 * capture.noise_mm));
  std::vector<Reading> readings;
  for (std::size_t i = capture.begin; i < capture.end; ++i) {
    const Vec3& p = cloud.p_base[i];
    const Vec3 p_part = T_part_base.point(moved(twist, r.center_base, p));
    if (r.cad->grid.distance(p_part) > r.gate_mm + 2 * r.cad->grid.step_mm()) continue;
    const auto foot = r.cad->foot(p_part, r.gate_mm);
    if (!foot || foot->face < 0) continue;
    const Vec3 n_base = R_base_part * foot->n_part;
    if (n_base.dot(capture.T_base_sensor.p_mm - p) < kCosIncidenceMin * (capture.T_base_sensor.p_mm - p).norm()) continue;
    const Vec3 n_scan = cloud.n_base[i].cast<double>();
    if (n_scan.squaredNorm() > 0.5 && n_scan.dot(n_base) < kCosNormalMin) continue;
    const Vec3 on_part = p_part - foot->distance_mm * foot->n_part;
    if (r.cad->sharp_edges.any_within(on_part, std::min(4.0, band))) continue;
    readings.push_back({foot->face, voxel_key(on_part, r.cell_mm), foot->distance_mm, p, on_part, foot->n_part, cloud.sigma_mm[i]});
  }
  std::sort(readings.begin(), readings.end(), [](const Reading& a, const Reading& b) {
    return std::tie(a.face, a.cell, a.distance, a.p_base.x(), a.p_base.y(), a.p_base.z()) <
           std::tie(b.face, b.cell, b.distance, b.p_base.x(), b.p_base.y(), b.p_base.z());
  });
  const int count_min = capture.spacing_mm < r.cell_mm / 3 ? kCountMin : 1;
  std::vector<Cluster> out;
  std::vector<double> deviation;
  for (std::size_t b = 0; b < readings.size();) {
    std::size_t e = b;
    while (e < readings.size() && readings[e].face == readings[b].face && readings[e].cell == readings[b].cell) ++e;
    const std::size_t first = b, last = e;
    b = e;
    if (last - first < static_cast<std::size_t>(count_min)) continue;
    const double middle = readings[(first + last) / 2].distance;
    deviation.clear();
    double sigma = 0;
    for (std::size_t i = first; i < last; ++i) deviation.push_back(std::abs(readings[i].distance - middle)), sigma += readings[i].sigma;
    sigma /= static_cast<double>(last - first);
    const double limit = 3.0 * std::max(1.4826 * median_of(deviation), 0.7 * sigma);
    Cluster c;
    c.capture = k, c.face = readings[first].face, c.cell = readings[first].cell;
    c.patch = voxel_key(readings[first].p_part, kCellsPerPatch * r.cell_mm);
    Vec3 n = Vec3::Zero(), moment = Vec3::Zero(), p_part = Vec3::Zero(), p_base = Vec3::Zero();
    double sum = 0, square = 0;
    for (std::size_t i = first; i < last; ++i) {
      if (std::abs(readings[i].distance - middle) > limit) continue;
      const Vec3 n_base = R_base_part * readings[i].n_part;
      n += n_base, moment += (readings[i].p_base - r.center_base).cross(n_base);
      p_part += readings[i].p_part, p_base += readings[i].p_base;
      sum += readings[i].distance, square += readings[i].distance * readings[i].distance;
      ++c.count;
    }
    if (c.count < count_min) continue;
    const double m = c.count;
    c.p_part = p_part / m, c.p_base = p_base / m;
    c.wrench << n / m, moment / m;
    c.n_part = (R_part_base * n).normalized();
    const double mean = sum / m, scatter = std::max(0.0, square / m - mean * mean);
    c.distance_mm = mean - c.wrench.dot(twist);
    const double readings_count = std::max(1.0, m / kPointsPerReading);
    c.variance_mm2 = std::max(sigma * sigma, scatter) / readings_count + kCommonRatio * kCommonRatio * sigma * sigma;
    out.push_back(c);
  }
  return out;
}

}  // namespace

std::vector<Cluster> make_clusters(const ClusterRequest& request) {
  const std::size_t count = request.cloud->captures.size();
  std::vector<std::vector<Cluster>> by_capture(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) { by_capture[k] = clusters_of(request, static_cast<int>(k)); });
  std::vector<Cluster> all;
  for (auto& c : by_capture) all.insert(all.end(), c.begin(), c.end());
  std::stable_sort(all.begin(), all.end(),
                   [](const Cluster& a, const Cluster& b) { return std::tie(a.face, a.patch, a.cell, a.capture) < std::tie(b.face, b.patch, b.cell, b.capture); });
  return all;
}

}  // namespace asbuilt
