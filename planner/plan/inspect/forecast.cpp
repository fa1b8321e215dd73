// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/inspect/forecast.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::inspecting {

namespace {

constexpr double kFitLength_mm = 10, kPoseStep_mm = 10;

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::sqrt(2.0)); }

/// x with P(|N(0, 1)| <= x) = p.
double two_sided_quantile(double p) {
  double lo = 0, hi = 10;
  for (int i = 0; i < 60; ++i) {
    const double mid = 0.5 * (lo + hi);
    (2 * normal_cdf(mid) - 1 < p ? lo : hi) = mid;
  }
  return 0.5 * (lo + hi);
}

/// Displacement of the point p (base) carried by the flange at q, per unit of each of the arm's parameters.
Eigen::MatrixXd shift_of(const RobotErrorModel& errors, const Pose<frame::Base, frame::Flange>& T, const JointVector& q, const Vec3& p_base) {
  const Eigen::MatrixXd twist = errors.twist(q);
  return T.rotation() * (twist.topRows(3) - skew(T.inverse().point(p_base)) * twist.bottomRows(3));
}
Mat3 scatter_of(const RobotErrorModel& errors, const Pose<frame::Base, frame::Flange>& T, const JointVector& q, const Vec3& p_base) {
  Eigen::Matrix<double, 3, 6> j;
  j.leftCols<3>() = T.rotation(), j.rightCols<3>() = -T.rotation() * skew(T.inverse().point(p_base));
  return j * errors.scatter(q) * j.transpose();
}
Mat3 mount_of(const SensorSpec& sensor, const Pose<frame::Base, frame::Flange>& T, const Vec3& p_base) {
  const auto T_base_sensor = T * sensor.T_flange_sensor;
  Eigen::Matrix<double, 3, 6> j;
  j.leftCols<3>() = T_base_sensor.rotation(), j.rightCols<3>() = -T_base_sensor.rotation() * skew(T_base_sensor.inverse().point(p_base));
  return j * sensor.covariance * j.transpose();
}

}  // namespace

EdgeForecast forecast_edge(const Workshop& shop, const RobotErrorModel& errors, const std::vector<const ViewCandidate*>& views, std::size_t e) {
  const InspectRecipe& recipe = *shop.recipe;
  const EdgeStations& edge = shop.edges[e];
  EdgeForecast f;
  f.edge = edge.edge, f.id = edge.id, f.feature = edge.feature;
  const std::size_t n = edge.stations.size();
  f.points_1_count.assign(n, 0), f.points_2_count.assign(n, 0), f.views_count.assign(n, 0), f.seen_working.assign(n, 0), f.seen_normal.assign(n, 0);
  f.sd_mm.assign(n, std::numeric_limits<double>::quiet_NaN());
  const double tolerance = edge.recipe != nullptr ? edge.recipe->tolerance_mm : 0;
  const double gate = edge.recipe != nullptr ? edge.recipe->gate_probability_ratio : 0;
  f.sd_limit_mm = tolerance > 0 && gate > 0 ? tolerance / two_sided_quantile(gate) : 0;
  // the posture the edge will be worked in: that of the working view that sees most of it
  const ViewCandidate* reference = nullptr;
  std::size_t most = 0;
  for (const ViewCandidate* v : views) {
    std::size_t count = 0;
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t face = 0; face < 2; ++face) count += is_enough(recipe, v->points[2 * (shop.first_station[e] + k) + face]);
    if (v->kind == ViewKind::working && count > most) most = count, reference = v;
  }
  struct Common {  // of each view, at the stations where it is worked out
    std::size_t station;
    std::vector<Mat3> covariance;
    Mat3 tool;
  };
  std::vector<Common> common;
  const std::size_t stride = std::max<std::size_t>(1, static_cast<std::size_t>(kPoseStep_mm / recipe.station_mm));
  for (std::size_t k = std::min(n - 1, stride / 2); n > 0 && k < n; k += stride) {
    const Vec3 p = edge.stations[k].p;
    const Vec3 axis = edge.recipe != nullptr ? Vec3(edge.recipe->axis_base.normalized()) : Vec3(-Vec3::UnitZ());
    Common c{k, {}, Mat3::Zero()};
    const JointVector near = reference != nullptr ? reference->q : shop.robot->spec().home_rad;
    Eigen::Quaterniond q_tool = quat_from_z(axis, Vec3::UnitX());
    if (reference != nullptr) {  // turned as for that picture, but upright where the picture was taken leaning
      const Eigen::Quaterniond q_seen = (reference->T_base_flange * shop.tool->T_flange_tool).q;
      q_tool = (Eigen::Quaterniond::FromTwoVectors(q_seen * Vec3::UnitZ(), axis) * q_seen).normalized();
    }
    const auto T_work = Pose<frame::Base, frame::Tool>(q_tool, p) * shop.tool->T_flange_tool.inverse();
    const auto q_work = shop.robot->inverse_like(T_work, near);
    const Mat3 R_tool = q_tool.toRotationMatrix();
    c.tool = R_tool * shop.tool->covariance.topLeftCorner<3, 3>() * R_tool.transpose();
    const double axis_error = shop.cell_spec->robot.accuracy.absolute.mean_mm;
    for (const ViewCandidate* v : views) {
      const SensorSpec& sensor = shop.cell_spec->sensors[static_cast<std::size_t>(v->sensor)];
      Mat3 cov = mount_of(sensor, v->T_base_flange, p) + scatter_of(errors, v->T_base_flange, v->q, p);
      if (q_work) {
        const Eigen::MatrixXd d = shift_of(errors, v->T_base_flange, v->q, p) - shift_of(errors, T_work, *q_work, p);
        cov += d * d.transpose() + scatter_of(errors, T_work, *q_work, p);
      } else {
        cov += 2.0 / 3.0 * axis_error * axis_error * Mat3::Identity();  // not reached when it is worked: nothing cancels
      }
      c.covariance.push_back(cov);
    }
    common.push_back(std::move(c));
  }
  double covered = 0, covered_working = 0, covered_normal = 0, share = 0;
  for (std::size_t k = 0; k < n; ++k) {
    const Station& st = edge.stations[k];
    f.s_mm.push_back(st.s_mm), f.p_part.push_back(st.p);
    const std::size_t g = shop.first_station[e] + k;
    std::array<double, 2> information{}, points{};
    std::array<std::array<bool, 2>, 2> seen{};  // kind, face
    const Vec3 sum = st.n[0] + st.n[1];
    const Vec3 m = -sum.normalized();
    const Common* at = nullptr;
    for (const Common& c : common)
      if (at == nullptr || std::abs(static_cast<double>(c.station) - static_cast<double>(k)) < std::abs(static_cast<double>(at->station) - static_cast<double>(k))) at = &c;
    std::array<double, 2> pose_variance{1e300, 1e300};
    for (std::size_t i = 0; i < views.size(); ++i) {
      const ViewCandidate& v = *views[i];
      const SensorEye& eye = shop.eyes[static_cast<std::size_t>(v.sensor)];
      const double z = (v.T_base_flange * shop.cell_spec->sensors[static_cast<std::size_t>(v.sensor)].T_flange_sensor).inverse().point(st.p).z();
      const double sigma = eye.noise_mm * (z / eye.working_distance_mm) * (z / eye.working_distance_mm);
      bool sees_both = true;
      for (std::size_t face = 0; face < 2; ++face) {
        const float expected = v.points[2 * g + face];
        points[face] += static_cast<double>(expected);
        const bool is_seen = is_enough(recipe, expected);
        sees_both &= is_seen;
        if (!is_seen) continue;
        seen[v.kind == ViewKind::working ? 0 : 1][face] = true;
        const double w = kBandTo_mm - kBandFrom_mm, reach = kBandFrom_mm + 0.5 * w;
        const double count = static_cast<double>(expected) * kFitLength_mm / recipe.station_mm / recipe.correlation_count;
        information[face] += count / (sigma * sigma * (1 + 12 * reach * reach / (w * w)));
        if (at != nullptr) pose_variance[face] = std::min(pose_variance[face], m.dot(at->covariance[i] * m));
      }
      f.views_count[k] += sees_both;
    }
    f.points_1_count[k] = points[0], f.points_2_count[k] = points[1];
    f.seen_working[k] = seen[0][0] && seen[0][1], f.seen_normal[k] = seen[1][0] && seen[1][1];
    const bool is_seen = information[0] > 0 && information[1] > 0;
    covered += is_seen, covered_working += f.seen_working[k], covered_normal += f.seen_normal[k];
    if (!is_seen || at == nullptr) continue;
    const double noise = (1 / information[0] + 1 / information[1]) / std::max(1e-9, sum.squaredNorm());
    const double variance = noise + std::max(pose_variance[0], pose_variance[1]) + m.dot(at->tool * m);
    const double slope = std::min(std::abs(st.into[0].dot(m)), std::abs(st.into[1].dot(m)));
    f.sd_mm[k] = std::sqrt(variance) / std::max(slope, 1e-3);
    f.sd_worst_mm = std::max(f.sd_worst_mm, f.sd_mm[k]);
    if (tolerance > 0) share += 2 * normal_cdf(tolerance / f.sd_mm[k]) - 1;
  }
  if (n > 0) {
    const double count = static_cast<double>(n);
    f.coverage_ratio = covered / count, f.coverage_working_ratio = covered_working / count, f.coverage_normal_ratio = covered_normal / count;
    f.share_ratio = covered > 0 ? share / covered : 0;  // of what is seen: what is not seen is told by the coverage
  }
  return f;
}

std::vector<EdgeForecast> forecast(const Workshop& shop, const RobotErrorModel& errors, const std::vector<const ViewCandidate*>& views) {
  std::vector<EdgeForecast> out;
  for (std::size_t e = 0; e < shop.edges.size(); ++e) out.push_back(forecast_edge(shop, errors, views, e));
  return out;
}

}  // namespace asbuilt::inspecting
