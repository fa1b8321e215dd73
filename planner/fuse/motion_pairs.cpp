// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fuse/motion_pairs.hpp"

#include <Eigen/Dense>
#include <cmath>

namespace asbuilt::fuse_detail {
namespace {

constexpr double kSeenRatio = 3e-3;  // of the best-seen direction's information

struct Equations {
  Eigen::Matrix<double, 7, 7> A = Eigen::Matrix<double, 7, 7>::Zero();
  Eigen::Matrix<double, 7, 1> g = Eigen::Matrix<double, 7, 1>::Zero();
  double c = 0;
  int count = 0;
};

/// Points of `second` seen from `first`: n . (M p - q) with M = motion exp(xi), both depths scaled by 1 + b.
Equations equations(const DepthFrame& first, const DepthFrame& second, const CameraRays& rays, const Eigen::Isometry3d& motion, double reach_mm, double bound_mm) {
  Equations e;
  const Mat3 R = motion.rotation();
  const Vec3 t = motion.translation();
  for (std::size_t i = 0; i < second.pixels.size(); ++i) {
    const FramePixel& s = second.pixels[i];
    if (!(s.weight > 0)) continue;
    const Vec3 p = Vec3(rays.ray(i).x(), rays.ray(i).y(), 1) * static_cast<double>(s.z_mm);
    const Vec3 seen = R * p + t;
    const std::ptrdiff_t k = rays.pixel_of(seen.cast<float>());
    if (k < 0) continue;
    const int w = first.width_px, step = first.stride_px;  // the nearest pixel of the first frame that carries a normal
    const int u = (static_cast<int>(k % w) + step / 2) / step * step, v = (static_cast<int>(k / w) + step / 2) / step * step;
    if (u >= w || v >= first.height_px) continue;
    const std::size_t at = static_cast<std::size_t>(v) * static_cast<std::size_t>(w) + static_cast<std::size_t>(u);
    const FramePixel* f = &first.pixels[at];
    if (!(f->weight > 0)) continue;
    const Vec3 q = Vec3(rays.ray(at).x(), rays.ray(at).y(), 1) * static_cast<double>(f->z_mm);
    const Vec3 n = f->n_sensor.cast<double>();
    const double r = n.dot(seen - q);
    if (std::abs(r) > reach_mm || (R * s.n_sensor.cast<double>()).dot(n) < 0.85) continue;
    const double weight = std::sqrt(static_cast<double>(f->weight) * s.weight) / (1 + r * r / (bound_mm * bound_mm));
    Eigen::Matrix<double, 7, 1> J;
    const Vec3 nR = R.transpose() * n;
    J.head<3>() = nR;
    J.segment<3>(3) = p.cross(nR);
    J(6) = -n.dot(t);  // d/db of n . (R (1+b) p + t - (1+b) q) = n . (R p - q), without the reading's own noise, which would pull b down
    e.A += weight * J * J.transpose();
    e.g += weight * J * r;
    e.c += weight * r * r;
    ++e.count;
  }
  return e;
}

}  // namespace

MotionPair motion_pair(const DepthFrame& first, const DepthFrame& second, const CameraRays& rays, double sigma_mm, const Eigen::Isometry3d& start) {
  MotionPair pair;
  pair.motion = start;
  double reach = std::max(start.isApprox(Eigen::Isometry3d::Identity()) ? 12.0 : 3.0, 25 * sigma_mm);  // from rest the way may be long
  for (int iteration = 0; iteration < 12; ++iteration) {
    const Equations e = equations(first, second, rays, pair.motion, reach, 3 * sigma_mm + 0.2 * reach);
    if (e.count < 60) return pair;
    Mat6 A = e.A.topLeftCorner<6, 6>();
    Eigen::SelfAdjointEigenSolver<Mat6> eigen;
    Vec6 scale = A.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
    eigen.compute(scale.asDiagonal() * A * scale.asDiagonal());
    Vec6 step = Vec6::Zero();
    for (int k = 0; k < 6; ++k)  // directions the frames do not tell stay where they are
      if (eigen.eigenvalues()(k) > kSeenRatio * eigen.eigenvalues()(5)) step -= eigen.eigenvectors().col(k) * (eigen.eigenvectors().col(k).dot(Vec6(scale.asDiagonal() * e.g.head<6>())) / eigen.eigenvalues()(k));
    step = scale.asDiagonal() * step;
    pair.motion = pair.motion * screw_exp(step);
    reach = std::max(std::max(1.0, 5 * sigma_mm), 0.6 * reach);
    if (step.head<3>().norm() < 1e-4 && step.tail<3>().norm() < 1e-6 && iteration > 5) break;
  }
  const Equations e = equations(first, second, rays, pair.motion, std::max(1.0, 5 * sigma_mm), 1e9);
  pair.A = e.A, pair.g = e.g, pair.c = e.c, pair.points_count = e.count;
  // noisy normals make directions look seen that are not: those are taken out
  const Mat6 A = e.A.topLeftCorner<6, 6>();
  const Vec6 scale = A.diagonal().cwiseMax(1e-12).cwiseSqrt();
  const Eigen::SelfAdjointEigenSolver<Mat6> eigen(Mat6(scale.cwiseInverse().asDiagonal() * A * scale.cwiseInverse().asDiagonal()));
  Mat6 seen = Mat6::Zero();
  for (int k = 0; k < 6; ++k)
    if (eigen.eigenvalues()(k) > kSeenRatio * eigen.eigenvalues()(5)) seen += eigen.eigenvectors().col(k) * eigen.eigenvectors().col(k).transpose();
  const Mat6 P = scale.asDiagonal() * seen * scale.cwiseInverse().asDiagonal();
  pair.A.topLeftCorner<6, 6>() = P * A * P.transpose();
  pair.A.topRightCorner<6, 1>() = P * e.A.topRightCorner<6, 1>();
  pair.A.bottomLeftCorner<1, 6>() = pair.A.topRightCorner<6, 1>().transpose();
  pair.g.head<6>() = P * e.g.head<6>();
  return pair;
}

}  // namespace asbuilt::fuse_detail
