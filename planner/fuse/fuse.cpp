// SPDX-License-Identifier: GPL-3.0-or-later
// Each capture on its own: sort along a Morton curve (so that the order in the file does not matter), one search for the
// nearest neighbours (PCL), from it outliers, normals, spacing and the noise that the data themselves show. Captures are
// independent and run in parallel; the result does not depend on the number of threads.
#include "planner/fuse/fuse.hpp"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "planner/base/number.hpp"
#include "planner/fuse/links.hpp"

namespace asbuilt {
namespace {

using Points = std::vector<Eigen::Vector3f>;

// Incidence beyond which a reading says no more about the noise; the sigma of steeper points is held at this value.
constexpr double kCosineMin = 0.26;  // 75 deg
// A point that fewer of its own neighbours than this know as theirs hangs alone in space.
constexpr int kMutualMin = 3;
// Steepest incidence at which a sensor still gives readings, and what it says about flying pixels.
constexpr double kSteepMax_rad = 1.4;  // 80 degrees
constexpr int kImageNeighbours = 8, kSupportMin = 2;

std::uint64_t spread_bits(std::uint64_t x) {
  x &= 0x1fffff;
  x = (x | x << 32) & 0x1f00000000ffffull;
  x = (x | x << 16) & 0x1f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  x = (x | x << 2) & 0x1249249249249249ull;
  return x;
}

/// The points along a Morton curve; equal codes by coordinates, so that the result is the same for any order in the file.
Points morton_sorted(const Points& points) {
  Eigen::Vector3f lo = Eigen::Vector3f::Constant(1e30f), hi = -lo;
  for (const auto& p : points) lo = lo.cwiseMin(p), hi = hi.cwiseMax(p);
  const double scale = 2097151.0 / std::max(1e-6, static_cast<double>((hi - lo).maxCoeff()));
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 u = (points[i] - lo).cast<double>() * scale;
    order[i] = {spread_bits(static_cast<std::uint64_t>(u.x())) | spread_bits(static_cast<std::uint64_t>(u.y())) << 1 |
                    spread_bits(static_cast<std::uint64_t>(u.z())) << 2,
                static_cast<std::uint32_t>(i)};
  }
  std::sort(order.begin(), order.end(), [&](const auto& a, const auto& b) {
    if (a.first != b.first) return a.first < b.first;
    const auto &p = points[a.second], &q = points[b.second];
    return std::lexicographical_compare(p.data(), p.data() + 3, q.data(), q.data() + 3);
  });
  Points sorted(points.size());
  for (std::size_t i = 0; i < order.size(); ++i) sorted[i] = points[order[i].second];
  return sorted;
}

double quantile(std::vector<float> values, double q) {
  if (values.empty()) return 0;
  const std::size_t k = std::min(values.size() - 1, static_cast<std::size_t>(q * static_cast<double>(values.size())));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(k), values.end());
  return values[k];
}

struct Neighbourhood {
  int count = 0;                      // neighbours of each point, itself excluded
  std::vector<int> index;             // count per point, nearest first
  std::vector<float> mean_mm, nearest_mm;
};

Neighbourhood search(const Points& points, int wanted_count) {
  Neighbourhood n;
  n.count = std::min<int>(wanted_count, static_cast<int>(points.size()) - 1);
  n.index.assign(points.size() * static_cast<std::size_t>(n.count), -1);
  n.mean_mm.assign(points.size(), 0), n.nearest_mm.assign(points.size(), 0);
  auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  cloud->resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) (*cloud)[i] = {points[i].x(), points[i].y(), points[i].z()};
  pcl::KdTreeFLANN<pcl::PointXYZ> tree;
  tree.setInputCloud(cloud);
  const std::size_t count = static_cast<std::size_t>(n.count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 2048), [&](const auto& range) {
    pcl::Indices index(count + 1);
    std::vector<float> squared(count + 1);
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const int found = tree.nearestKSearch((*cloud)[i], static_cast<int>(count + 1), index, squared);
      std::size_t used = 0;
      double sum = 0;
      for (int j = 0; j < found && used < count; ++j) {
        if (index[static_cast<std::size_t>(j)] == static_cast<int>(i)) continue;
        n.index[i * count + used] = index[static_cast<std::size_t>(j)];
        const double d = std::sqrt(squared[static_cast<std::size_t>(j)]);
        if (used == 0) n.nearest_mm[i] = static_cast<float>(d);
        sum += d;
        ++used;
      }
      n.mean_mm[i] = static_cast<float>(sum / std::max<double>(1, static_cast<double>(used)));
    }
  });
  return n;
}

/// An outlier is far from its neighbours by their own measure and is not a neighbour of theirs: flying pixels and lone
/// readings. The points of an edge or of a burr, however thin, have each other.
std::vector<char> outliers(const Neighbourhood& n, std::size_t points_count, double ratio) {
  std::vector<char> is_outlier(points_count, 0);
  const std::size_t count = static_cast<std::size_t>(n.count);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points_count, 4096), [&](const auto& range) {
    std::vector<float> d(count);
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      int mutual = 0;
      for (std::size_t j = 0; j < count; ++j) {
        const int other = n.index[i * count + j];
        if (other < 0) return;
        const int* theirs = &n.index[static_cast<std::size_t>(other) * count];
        mutual += std::find(theirs, theirs + count, static_cast<int>(i)) != theirs + count;
        d[j] = n.mean_mm[static_cast<std::size_t>(other)];
      }
      if (mutual >= kMutualMin) continue;
      const double median = quantile(d, 0.5);
      for (float& x : d) x = std::abs(x - static_cast<float>(median));
      const double spread = 1.4826 * quantile(d, 0.5);
      is_outlier[i] = n.mean_mm[i] > median + ratio * std::max(spread, 0.1 * median);
    }
  });
  return is_outlier;
}

/// Flying pixels hang along their rays between a front and a back surface. On a surface that is seen at no more than kSteepMax a point
/// and its neighbours in the image differ in range by no more than their angle allows, however sparse they are: a steep wall with most
/// of its readings missing still passes, since the allowance grows with the distance to the neighbour. A point that not even
/// kSupportMin of its neighbours in the image bear out, and that is farther from everything than its own pixel's spacing, is none.
void mark_flying(const Points& points, const Neighbourhood& n, double noise_mm, std::vector<char>& is_outlier) {
  for (const Eigen::Vector3f& p : points)
    if (!(p.z() > 1e-3f)) return;  // no image in front of a camera
  auto image = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  image->resize(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) (*image)[i] = {points[i].x() / points[i].z(), points[i].y() / points[i].z(), 0.f};
  pcl::KdTreeFLANN<pcl::PointXYZ> tree;
  tree.setInputCloud(image);
  const double steep = std::tan(kSteepMax_rad);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 2048), [&](const auto& range) {
    pcl::Indices index(kImageNeighbours + 1);
    std::vector<float> squared(kImageNeighbours + 1);
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      if (is_outlier[i]) continue;
      const int found = tree.nearestKSearch((*image)[i], kImageNeighbours + 1, index, squared);
      const double r = points[i].norm();
      int support = 0;
      double spacing = 0;  // of the pixels here: the median angle to a neighbour
      for (int j = 0; j < found; ++j) {
        const std::size_t k = static_cast<std::size_t>(index[static_cast<std::size_t>(j)]);
        if (k == i) continue;
        const double across = std::sqrt(static_cast<double>(squared[static_cast<std::size_t>(j)])) * points[i].z();
        if (j <= kImageNeighbours / 2) spacing = across;
        support += std::abs(points[k].norm() - r) <= steep * across + 6 * noise_mm;
      }
      is_outlier[i] = support < kSupportMin && n.nearest_mm[i] > 2 * spacing;
    }
  });
}

struct Prepared {
  Points points;                        // in the sensor's frame
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> sigma_mm;
  double noise_mm = 0, spacing_mm = 0;
  std::size_t outlier_count = 0;
};

/// What gives points: a capture of the job, or a view of a stream with the noise that averaging left it.
struct Source {
  const Capture* capture;
  SensorSpec sensor;
  bool is_one_view = true;
};

double sigma_factor(const Eigen::Vector3f& p, const Eigen::Vector3f& n, double working_distance_mm) {
  const double range = p.norm();
  const double at = working_distance_mm > 0 ? range / working_distance_mm : 1.0;
  const double cosine = n.squaredNorm() > 0 ? std::abs(n.dot(p)) / std::max(1e-9, range) : 1.0;
  return at * at / std::max(kCosineMin, cosine);
}

/// `is_one_view`: all points were seen from the origin at once.
Prepared prepare(const Points& raw, const SensorSpec& sensor, const FuseRecipe& recipe, bool is_one_view) {
  Prepared out;
  Points points = morton_sorted(raw);
  const Neighbourhood n = search(points, std::max(6, recipe.normal_neighbours_count));
  std::vector<char> is_outlier = outliers(n, points.size(), recipe.outlier_ratio);
  if (is_one_view) mark_flying(points, n, sensor.noise_mm, is_outlier);
  const std::size_t count = static_cast<std::size_t>(n.count);
  std::vector<Eigen::Vector3f> normals(points.size(), Eigen::Vector3f::Zero());
  std::vector<float> rms(points.size(), -1);  // off the local plane, only where the neighbourhood is flat
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points.size(), 2048), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      if (is_outlier[i]) continue;
      Vec3 mean = Vec3::Zero();
      Mat3 square = Mat3::Zero();
      int used = 0;
      const auto add = [&](std::size_t k) {
        const Vec3 d = (points[k] - points[i]).cast<double>();
        mean += d;
        square += d * d.transpose();
        ++used;
      };
      add(i);
      for (std::size_t j = 0; j < count; ++j) {
        const std::size_t k = static_cast<std::size_t>(n.index[i * count + j]);
        if (!is_outlier[k]) add(k);
      }
      if (used < 6) continue;
      mean /= used;
      const Mat3 covariance = square / used - mean * mean.transpose();
      Eigen::SelfAdjointEigenSolver<Mat3> eigen;
      eigen.computeDirect(covariance);
      const Vec3 values = eigen.eigenvalues();
      if (!(values(1) > 1e-4 * values(2)) || !(values(0) < 0.3 * values(1))) continue;  // a line or a ball has no normal
      Eigen::Vector3f normal = eigen.eigenvectors().col(0).cast<float>().normalized();
      if (normal.dot(points[i]) > 0) normal = -normal;
      normals[i] = normal;
      if (values(0) < 0.02 * values(1)) rms[i] = static_cast<float>(std::sqrt(std::max(0.0, values(0)) * used / (used - 3.0)));
    }
  });
  std::vector<float> measured;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (rms[i] >= 0) measured.push_back(rms[i] / static_cast<float>(sigma_factor(points[i], normals[i], sensor.working_distance_mm)));
  // The second quintile: curvature and edges only ever add to what a plane leaves over.
  const double seen_mm = measured.size() >= 100 ? quantile(measured, 0.4) : 0.0;
  out.noise_mm = std::max(sensor.noise_mm, seen_mm);
  std::vector<float> nearest;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (is_outlier[i]) {
      ++out.outlier_count;
      continue;
    }
    out.points.push_back(points[i]);
    out.normals.push_back(normals[i]);
    out.sigma_mm.push_back(static_cast<float>(out.noise_mm * sigma_factor(points[i], normals[i], sensor.working_distance_mm)));
    nearest.push_back(n.nearest_mm[i]);
  }
  out.spacing_mm = quantile(nearest, 0.5);
  return out;
}

/// What ties the captures together, and which hang on the robot's word alone.
void say_links(const MeasuredCloud& cloud, std::vector<Note>& notes) {
  std::vector<CaptureLink> links = capture_links(cloud);
  std::vector<char> is_tied(cloud.captures.size(), 0);
  for (const CaptureLink& l : links) is_tied[static_cast<std::size_t>(l.first)] = is_tied[static_cast<std::size_t>(l.second)] = 1;
  std::stable_sort(links.begin(), links.end(), [](const CaptureLink& a, const CaptureLink& b) { return a.sd_mm[5] > b.sd_mm[5]; });
  std::string text = std::to_string(links.size()) + " pairs of captures share surface";
  for (std::size_t i = 0; i < links.size() && i < 5; ++i) text += (i == 0 ? "; known least by what they share: " : "; ") + links[i].text;
  notes.push_back({Note::Level::note, "fuse.links", text + ".", "captures"});
  for (std::size_t k = 0; k < cloud.captures.size(); ++k)
    if (!is_tied[k] && cloud.captures[k].end > cloud.captures[k].begin)
      notes.push_back({Note::Level::note, "fuse.capture_alone", "The capture shares no surface with another: its place is the robot's word alone.", cloud.captures[k].name});
}

}  // namespace

Result<Done<MeasuredCloud>> fuse(const FuseRecipe& recipe, const Job& job, const FrameSource& frames) {
  if (job.captures.empty())
    return refuse({.code = "fuse.no_points",
                   .where = "item " + job.item_id,
                   .message = "The item has no captures; take the scans that its part and fixture need.",
                   .measured = 0,
                   .limit = 1,
                   .unit = "captures",
                   .stage = "fuse"});
  Refusals refusals;
  std::size_t finite_count = 0, dropped_count = 0;
  for (const Capture& c : job.captures) {
    finite_count += c.points_sensor.size() + (c.stream ? c.stream->frames.size() : 0), dropped_count += c.dropped_count;
    must(c.sensor >= 0 && c.sensor < static_cast<int>(job.cell.sensors.size()), "fuse: a capture names no sensor of the cell");
    const SensorSpec& s = job.cell.sensors[static_cast<std::size_t>(c.sensor)];
    if (!s.is_calibrated)
      refusals.push_back({.code = "fuse.not_calibrated",
                          .where = "capture " + c.name + ", sensor " + s.id,
                          .message = "Sensor " + s.id + " has no calibrated pose; calibrate it and name the calibration in the batch.",
                          .stage = "fuse"});
  }
  if (!refusals.empty()) return refuse_all(std::move(refusals));
  if (finite_count == 0)
    return refuse({.code = "fuse.no_points",
                   .where = "item " + job.item_id,
                   .message = "All " + std::to_string(dropped_count) + " points of the item's " + std::to_string(job.captures.size()) +
                              " captures are invalid (NaN or infinite); scan the part again.",
                   .measured = 0,
                   .limit = static_cast<double>(recipe.min_points_count),
                   .unit = "points",
                   .stage = "fuse"});

  // streams become captures as a standing sensor would have given them; one after the other, each uses all threads by itself
  Done<MeasuredCloud> done;
  MeasuredCloud& cloud = done.artefact;
  std::vector<FusedStream> streams(job.captures.size());
  std::vector<Source> sources;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const Capture& c = job.captures[k];
    const SensorSpec& sensor = job.cell.sensors[static_cast<std::size_t>(c.sensor)];
    if (!c.stream) {
      sources.push_back({&c, sensor});
      continue;
    }
    auto fused = fuse_stream(recipe.stream, c, sensor, frames);
    if (!fused) {
      refusals.insert(refusals.end(), fused.error().begin(), fused.error().end());
      continue;
    }
    done.notes.insert(done.notes.end(), fused->notes.begin(), fused->notes.end());
    cloud.streams.push_back(fused->artefact.summary);
    streams[k] = std::move(fused->artefact);
    for (const FusedStream::View& v : streams[k].views) sources.push_back({&v.capture, sensor}), sources.back().sensor.noise_mm = v.noise_mm, sources.back().is_one_view = false;
    if (streams[k].views.empty())
      done.notes.push_back({Note::Level::warning, "fuse.empty_capture", "The stream holds no usable view.", c.name});
  }
  if (!refusals.empty()) return refuse_all(std::move(refusals));

  std::vector<Prepared> prepared(sources.size());
  tbb::parallel_for(std::size_t{0}, sources.size(), [&](std::size_t k) {
    if (sources[k].capture->points_sensor.size() >= 10) prepared[k] = prepare(sources[k].capture->points_sensor, sources[k].sensor, recipe, sources[k].is_one_view);
  });

  std::size_t total = 0;
  for (const Prepared& p : prepared) total += p.points.size();
  cloud.p_base.reserve(total), cloud.n_base.reserve(total), cloud.sigma_mm.reserve(total), cloud.capture.reserve(total);
  for (std::size_t k = 0; k < sources.size(); ++k) {
    const Capture& c = *sources[k].capture;
    const SensorSpec& sensor = sources[k].sensor;
    CloudCapture out;
    out.name = c.name, out.sensor = c.sensor, out.feature = c.feature, out.T_base_flange = c.T_base_flange, out.q_rad = c.q_rad;
    out.T_base_sensor = c.T_base_flange * sensor.T_flange_sensor;
    out.covariance_sensor = sensor.covariance;
    out.noise_mm = prepared[k].noise_mm, out.spacing_mm = prepared[k].spacing_mm;
    out.dropped_count = c.dropped_count, out.outlier_count = prepared[k].outlier_count;
    out.begin = cloud.p_base.size();
    const Mat3 R = out.T_base_sensor.rotation();
    const Eigen::Matrix3f Rf = R.cast<float>();
    for (std::size_t i = 0; i < prepared[k].points.size(); ++i) {
      cloud.p_base.push_back(R * prepared[k].points[i].cast<double>() + out.T_base_sensor.p_mm);
      cloud.n_base.push_back(Rf * prepared[k].normals[i]);
      cloud.sigma_mm.push_back(prepared[k].sigma_mm[i]);
      cloud.capture.push_back(static_cast<std::int32_t>(k));
    }
    out.end = cloud.p_base.size();
    if (out.begin == out.end)
      done.notes.push_back({Note::Level::warning, "fuse.empty_capture", "The capture holds no usable point.", c.name});
    if (c.dropped_count > 0)
      done.notes.push_back(
          {Note::Level::note, "fuse.points_dropped", std::to_string(c.dropped_count) + " points without a finite coordinate were left out.", c.name});
    if (out.noise_mm > 2 * sensor.noise_mm && sensor.noise_mm > 0)
      done.notes.push_back({Note::Level::warning, "fuse.noise_above_sheet",
                            "The points scatter by " + fixed_number(out.noise_mm, 3) + " mm where the sensor's sheet says " +
                                fixed_number(sensor.noise_mm, 3) + " mm.",
                            c.name});
    cloud.captures.push_back(std::move(out));
  }
  if (total < static_cast<std::size_t>(recipe.min_points_count))
    return refuse({.code = "fuse.too_few_points",
                   .where = "item " + job.item_id,
                   .message = "Only " + std::to_string(total) + " points are left of " + std::to_string(finite_count) + " valid ones in " +
                              std::to_string(job.captures.size()) + " captures; at least " + std::to_string(recipe.min_points_count) +
                              " are needed. Scan the part again, nearer or with less glare.",
                   .measured = static_cast<double>(total),
                   .limit = static_cast<double>(recipe.min_points_count),
                   .unit = "points",
                   .stage = "fuse"});
  if (cloud.captures.size() > 1) say_links(cloud, done.notes);
  return done;
}

}  // namespace asbuilt
