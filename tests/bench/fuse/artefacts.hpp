// SPDX-License-Identifier: GPL-3.0-or-later
// Sphere, cylinder and cube on a floor, a depth camera on a moving robot over them, and how far what was fused is from them.
// Shared by the study and the small version of it that runs with the tests.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "planner/fuse/streams.hpp"
#include "planner/simulate/stream_scan.hpp"

namespace asbuilt::artefact_study {

using namespace simulate_detail;

struct Scene {
  std::vector<Body> bodies;  // sphere, cylinder, cube, floor
  Vec3 center = Vec3::Zero();
  RayScene rays;
};
inline Scene scene(double turn_rad) {
  Scene s;
  const Pose<frame::Base, frame::Obstacle> floor(Eigen::Quaterniond(Eigen::AngleAxisd(turn_rad, Vec3::UnitZ())), Vec3(900, 50, 120));
  const auto put = [&](Body::Kind kind, const Vec3& at, const Vec3& size) {
    s.bodies.push_back({kind, floor * Pose<frame::Obstacle, frame::Obstacle>(Eigen::Quaterniond::Identity(), at), size});
  };
  put(Body::Kind::sphere, Vec3(-32, 0, 15), Vec3(15, 0, 0));      // 30 mm
  put(Body::Kind::cylinder, Vec3(0, 14, 0), Vec3(10, 0, 25));     // 20 mm
  put(Body::Kind::box, Vec3(30, -4, 0), Vec3(25, 25, 25));        // 25 mm
  put(Body::Kind::floor, Vec3(0, 0, 0), Vec3::Zero());
  s.center = floor.point(Vec3(0, 0, 10));
  s.rays = scene_of(s.bodies);
  return s;
}

struct Setup {
  SensorSpec sensor;
  DepthCameraModel model;
};
inline Setup setup(int width_px, int height_px, double focal_px) {
  Setup s;
  s.model = stereo_camera(width_px, height_px);
  s.model.camera.fx_px = s.model.camera.fy_px = focal_px;
  s.sensor.id = "d405", s.sensor.kind = SensorKind::depth_stream, s.sensor.is_calibrated = true;
  s.sensor.T_flange_sensor = {Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Vec3(0.1, -0.2, 1).normalized())), Vec3(40, -25, 90)};
  s.sensor.range_mm = {70, 400}, s.sensor.working_distance_mm = 150, s.sensor.field_of_view_mm = {160, 90};
  s.sensor.noise_mm = 150.0 * 150.0 / (focal_px * s.model.baseline_mm) * s.model.disparity_sd_px;
  for (int i = 0; i < 3; ++i) s.sensor.covariance(i, i) = 0.05 * 0.05, s.sensor.covariance(i + 3, i + 3) = 1e-7;
  return s;
}

struct Scan {
  Capture capture;
  std::vector<DepthImage> images;
  double true_offset_s = 0;  // t_robot - t_sensor
  FrameSource source() const {
    return [this](const StreamFrame& f) -> Result<DepthPixels> {
      const DepthImage& i = images[static_cast<std::size_t>(std::stoul(f.file))];
      return DepthPixels{i.width_px, i.height_px, i.depth_count};
    };
  }
};
struct ScanSettings {
  double speed_mm_s = 50, offset_s = 0, scale_ratio = 1;
  std::size_t frames_count_max = 90;
  std::uint64_t seed = 1;
  double dip_mm = 60;
};
inline Scan scan(const Scene& scene, Setup setup, const ScanSettings& s) {
  Random random = Random::stream(s.seed, "artefacts");
  setup.model.scale_ratio = s.scale_ratio * (1 + 0.0005 * random.uniform(-1, 1));
  setup.model.bowl_mm *= random.uniform() < 0.5 ? -1 : 1;
  const Motion motion(scan_poses(scene.center, 150, Vec2(45, 25), 0.5, s.dip_mm, setup.sensor.T_flange_sensor), s.speed_mm_s, 800);
  Scan out;
  StreamSettings settings;
  settings.frames_count_max = s.frames_count_max;
  settings.jitter_s = 2e-4;
  SimulatedStream stream = simulate_stream(scene.rays, setup.model, motion, setup.sensor.T_flange_sensor, settings, random);
  const LoggedMotion log = log_of(motion, 0.004, 1.0, s.offset_s - 1.0);
  out.capture.name = "scan", out.capture.sensor = 0;
  out.capture.stream = std::move(stream.stream);
  out.images = std::move(stream.images);
  RobotTrack& track = out.capture.stream->robot;
  track.cycle_s = 0.004;
  out.capture.stream->clock.sigma_s = 0.002;
  for (std::size_t i = 0; i < log.t_s.size(); ++i) track.samples.push_back({log.t_s[i], log.T_base_flange[i], {}});
  out.true_offset_s = s.offset_s;
  return out;
}

/// Best-fit error of points on a body: rms of their distances after the body is moved (and its size changed) to fit them best.
struct BestFit {
  std::size_t points_count = 0;
  double rms_mm = 0, p95_mm = 0, size_error_mm = 0, shift_mm = 0, mean_abs_mm = 0;
};
inline BestFit best_fit(const Body& body, const std::vector<Vec3>& points, double reach_mm) {
  std::vector<Vec3> mine;
  const double bottom = body.kind == Body::Kind::sphere ? -0.35 * body.size_mm.x() : 3.0;
  for (const Vec3& p : points) {
    const Vec3 q = body.T_base_body.inverse().point(p);
    if (q.z() > bottom && std::abs(distance_mm(body, p)) < reach_mm) mine.push_back(p);
  }
  BestFit out;
  out.points_count = mine.size();
  if (mine.size() < 50) return out;
  // shift of the body and its size (radius, or half edge), by Gauss-Newton with numeric derivatives and bounded weights
  Eigen::Vector4d x = Eigen::Vector4d::Zero();
  const auto distance = [&](const Eigen::Vector4d& at, const Vec3& p) {
    Body b = body;
    b.T_base_body.p_mm += at.head<3>();
    if (b.kind == Body::Kind::box) b.size_mm += Vec3(2 * at(3), 2 * at(3), at(3));
    else if (b.kind == Body::Kind::cylinder) b.size_mm.x() += at(3), b.size_mm.z() += at(3);
    else b.size_mm.x() += at(3);
    return distance_mm(b, p);
  };
  for (int iteration = 0; iteration < 12; ++iteration) {
    Eigen::Matrix4d H = Eigen::Matrix4d::Identity() * 1e-9;
    Eigen::Vector4d g = Eigen::Vector4d::Zero();
    for (std::size_t i = 0; i < mine.size(); i += 1 + mine.size() / 20000) {
      const double r = distance(x, mine[i]);
      Eigen::Vector4d J;
      for (int k = 0; k < 4; ++k) J(k) = (distance(x + 1e-4 * Eigen::Vector4d::Unit(k), mine[i]) - r) / 1e-4;
      const double w = 1 / (1 + r * r / 0.25);
      H += w * J * J.transpose(), g += w * r * J;
    }
    x -= H.ldlt().solve(g);
  }
  std::vector<double> d;
  for (const Vec3& p : mine) d.push_back(std::abs(distance(x, p)));
  for (const double v : d) out.rms_mm += v * v, out.mean_abs_mm += v;
  out.rms_mm = std::sqrt(out.rms_mm / static_cast<double>(d.size())), out.mean_abs_mm /= static_cast<double>(d.size());
  std::nth_element(d.begin(), d.begin() + static_cast<std::ptrdiff_t>(d.size() * 95 / 100), d.end());
  out.p95_mm = d[d.size() * 95 / 100];
  out.size_error_mm = x(3), out.shift_mm = x.head<3>().norm();
  return out;
}

/// The four upper edges of the cube. faces: distance of the edges where fitted faces meet from the true ones (what planning uses).
/// bubble: how far the points nearest to the edges stand out over the true cube (95 %) and fall short of it.
struct EdgeError {
  double faces_mean_mm = 0, faces_max_mm = 0;
  double bubble_p95_mm = 0, short_p95_mm = 0;
  std::size_t points_count = 0;
};
inline EdgeError edge_error(const Body& cube, const std::vector<Vec3>& points) {
  EdgeError out;
  const double half = cube.size_mm.x() / 2, height = cube.size_mm.z();
  const auto back = cube.T_base_body.inverse();
  std::vector<Vec3> face_points[5];
  std::vector<double> over, under;
  for (const Vec3& p_base : points) {
    const Vec3 p = back.point(p_base);
    const double outside = distance_mm(cube, p_base);
    if (std::abs(outside) > 3 || p.z() < 4) continue;
    const double to_side = half - std::max(std::abs(p.x()), std::abs(p.y())), to_top = height - p.z();
    if (std::abs(to_side) < 1.5 && std::abs(to_top) < 1.5) {
      if (outside >= 0) over.push_back(outside);
      else under.push_back(-outside);
    }
    if (std::abs(to_top) < 1.5 && to_side > 2.5) face_points[4].push_back(p);
    for (int f = 0; f < 4; ++f) {
      const double s = f % 2 == 0 ? 1 : -1;
      const int axis = f / 2;
      if (std::abs(s * p[axis] - half) < 1.5 && to_top > 2.5 && half - std::abs(p[1 - axis]) > 2.5) face_points[f].push_back(p);
    }
  }
  Vec3 n[5];
  double d[5];
  for (int f = 0; f < 5; ++f) {
    if (face_points[f].size() < 20) continue;
    std::vector<double> weight(face_points[f].size(), 1);
    for (int pass = 0; pass < 6; ++pass) {
      Vec3 mean = Vec3::Zero();
      double sum = 0;
      for (std::size_t i = 0; i < weight.size(); ++i) mean += weight[i] * face_points[f][i], sum += weight[i];
      mean /= sum;
      Mat3 C = Mat3::Zero();
      for (std::size_t i = 0; i < weight.size(); ++i) C += weight[i] * (face_points[f][i] - mean) * (face_points[f][i] - mean).transpose();
      Eigen::SelfAdjointEigenSolver<Mat3> eigen(C);
      n[f] = eigen.eigenvectors().col(0), d[f] = n[f].dot(mean);
      for (std::size_t i = 0; i < weight.size(); ++i) {
        const double r = n[f].dot(face_points[f][i]) - d[f];
        weight[i] = 1 / (1 + r * r / 0.01);
      }
    }
  }
  int count = 0;
  for (int f = 0; f < 4; ++f) {
    if (face_points[f].size() < 20 || face_points[4].size() < 20) continue;
    const double s = f % 2 == 0 ? 1 : -1;
    const int axis = f / 2;
    for (double along = -0.8 * half; along <= 0.8 * half; along += 0.2 * half) {
      // where the two fitted planes meet at this place along the edge
      Mat3 A;
      A.row(0) = n[f].transpose(), A.row(1) = n[4].transpose(), A.row(2) = Vec3::Unit(1 - axis).transpose();
      const Vec3 p = A.inverse() * Vec3(d[f], d[4], along);
      const double e = std::hypot(p[axis] - s * half, p.z() - height);
      out.faces_mean_mm += e, out.faces_max_mm = std::max(out.faces_max_mm, e);
      ++count;
    }
  }
  if (count) out.faces_mean_mm /= count;
  const auto p95 = [](std::vector<double>& v) {
    if (v.empty()) return 0.0;
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() * 95 / 100), v.end());
    return v[v.size() * 95 / 100];
  };
  out.points_count = over.size() + under.size();
  out.bubble_p95_mm = p95(over), out.short_p95_mm = p95(under);
  return out;
}

}  // namespace asbuilt::artefact_study
