// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/measured_covariance.hpp"

#include <Eigen/Dense>

#include "planner/calibrate/network_detail.hpp"

namespace asbuilt {

Mat6 measured_covariance(const Network& n, const NetworkView& v, const NetworkState& s, const Pose<frame::Sensor, frame::Target>& T, double sensor_sd, double sensor_sd_rad) {
  Mat6 C = Mat6::Zero();
  if (n.sight == Sight::pose) {
    C.diagonal() << Vec3::Constant(sensor_sd * sensor_sd), Vec3::Constant(sensor_sd_rad * sensor_sd_rad);
    return C;
  }
  Network plain = n;
  plain.is_sensor_fixed = false;
  NetworkView at = v;
  at.T_base_flange = {};
  const network::Bench bench(plain, at, {}, {T.q, T.p_mm}, Vec6::Zero(), s.sensor.data());
  Mat6 H = Mat6::Zero();
  const int rows = network::rows_of(n.sight);
  for (const Observation& o : v.observations) {
    double r[6];
    network::Derivatives d;
    network::residual_of(bench, o, {}, r, &d);
    H += d.target.topRows(rows).transpose() * d.target.topRows(rows) / (sensor_sd * sensor_sd);
  }
  H.diagonal().array() += 1e-2;  // what a ball or a plane does not tell stays as good as unknown: 10 mm, 10 rad
  return H.ldlt().solve(Mat6::Identity());
}

}  // namespace asbuilt
