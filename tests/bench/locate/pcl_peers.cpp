// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/locate/pcl_peers.hpp"

#include <pcl/features/fpfh.h>
#include <pcl/point_types.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/sample_consensus_prerejective.h>
#include <pcl/search/kdtree.h>

#include <ctime>
#include <map>
#include <tuple>

namespace asbuilt::peers {
namespace {

using Pcl = pcl::PointCloud<pcl::PointNormal>;

Pcl::Ptr to_pcl(const Cloud& cloud) {
  Pcl::Ptr out(new Pcl);
  for (std::size_t i = 0; i < cloud.p.size(); ++i) {
    pcl::PointNormal q;
    q.getVector3fMap() = cloud.p[i].cast<float>();
    q.getNormalVector3fMap() = cloud.n[i].cast<float>();
    out->push_back(q);
  }
  return out;
}

Motion to_motion(const Eigen::Matrix4f& m) {
  const Mat3 R = m.topLeftCorner<3, 3>().cast<double>();
  return {Eigen::Quaterniond(R).normalized(), m.topRightCorner<3, 1>().cast<double>()};
}

Eigen::Matrix4f to_matrix(const Motion& m) { return m.matrix().matrix().cast<float>(); }

double process_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

template <class Icp>
Fine run(Icp& icp, const Cloud& scan, const Cloud& part, const Motion& start, double gate_mm) {
  const Pcl::Ptr source = to_pcl(scan), target = to_pcl(part);
  const double before = process_seconds();
  icp.setInputSource(source), icp.setInputTarget(target);
  icp.setMaxCorrespondenceDistance(gate_mm), icp.setMaximumIterations(60);
  icp.setTransformationEpsilon(1e-10);
  Pcl out;
  icp.align(out, to_matrix(start));
  return {to_motion(icp.getFinalTransformation()), process_seconds() - before};
}

}  // namespace

Cloud thinned(const Cloud& cloud, double cell_mm) {
  std::map<std::tuple<int, int, int>, std::tuple<Vec3, Vec3, int>> cells;
  for (std::size_t i = 0; i < cloud.p.size(); ++i) {
    const auto at = [&](int a) { return static_cast<int>(std::floor(cloud.p[i][a] / cell_mm)); };
    auto& [p, n, count] = cells.try_emplace({at(0), at(1), at(2)}, Vec3::Zero(), Vec3::Zero(), 0).first->second;
    p += cloud.p[i], n += cloud.n[i], ++count;
  }
  Cloud out;
  for (const auto& [key, value] : cells) {
    const auto& [p, n, count] = value;
    if (n.norm() < 1e-9) continue;
    out.p.push_back(p / count), out.n.push_back(n.normalized());
  }
  return out;
}

Motion fpfh_ransac(const Cloud& scan, const Cloud& part, double voxel_mm, int iterations) {
  const Pcl::Ptr source = to_pcl(thinned(scan, voxel_mm)), target = to_pcl(thinned(part, voxel_mm));
  const auto features = [&](const Pcl::Ptr& cloud) {
    pcl::FPFHEstimation<pcl::PointNormal, pcl::PointNormal, pcl::FPFHSignature33> e;
    e.setInputCloud(cloud), e.setInputNormals(cloud), e.setRadiusSearch(5 * voxel_mm);
    pcl::PointCloud<pcl::FPFHSignature33>::Ptr out(new pcl::PointCloud<pcl::FPFHSignature33>);
    e.compute(*out);
    return out;
  };
  pcl::SampleConsensusPrerejective<pcl::PointNormal, pcl::PointNormal, pcl::FPFHSignature33> sac;
  sac.setInputSource(source), sac.setInputTarget(target);
  sac.setSourceFeatures(features(source)), sac.setTargetFeatures(features(target));
  sac.setMaximumIterations(iterations), sac.setNumberOfSamples(3), sac.setCorrespondenceRandomness(5);
  sac.setSimilarityThreshold(0.9f), sac.setMaxCorrespondenceDistance(1.5f * static_cast<float>(voxel_mm)), sac.setInlierFraction(0.25f);
  Pcl out;
  sac.align(out);
  return to_motion(sac.getFinalTransformation());
}

Fine icp_point_to_plane(const Cloud& scan, const Cloud& part, const Motion& start, double gate_mm) {
  pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal> icp;
  return run(icp, scan, part, start, gate_mm);
}

Fine gicp(const Cloud& scan, const Cloud& part, const Motion& start, double gate_mm) {
  pcl::GeneralizedIterativeClosestPoint<pcl::PointNormal, pcl::PointNormal> icp;
  return run(icp, scan, part, start, gate_mm);
}

}  // namespace asbuilt::peers
