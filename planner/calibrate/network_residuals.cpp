// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/calibrate/network_detail.hpp"

namespace asbuilt {

const char* name_of(SensorConstant c) {
  static const char* names[] = {"scale", "radius", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"};
  return names[c];
}

namespace network {

Mat3 right_jacobian(const Vec3& w) {
  const double a = w.norm();
  const Mat3 K = skew(w);
  if (a < 1e-5) return Mat3::Identity() - 0.5 * K + K * K / 6;
  return Mat3::Identity() - (1 - std::cos(a)) / (a * a) * K + (a - std::sin(a)) / (a * a * a) * K * K;
}

Mat3 right_jacobian_inverse(const Vec3& w) {
  const double a = w.norm();
  const Mat3 K = skew(w);
  if (a < 1e-5) return Mat3::Identity() + 0.5 * K + K * K / 12;
  return Mat3::Identity() + 0.5 * K + (1 / (a * a) - (1 + std::cos(a)) / (2 * a * std::sin(a))) * K * K;
}

Bench::Bench(const Network& network, const NetworkView& view, const Pose<frame::Mount, frame::Sensor>& X, const Pose<frame::Place, frame::Target>& Y,
             const Vec6& e, const double* sensor)
    : sight(network.sight),
      is_sensor_fixed(network.is_sensor_fixed),
      R_x(X.rotation()),
      R_y(Y.rotation()),
      R_f(view.T_base_flange.rotation()),
      R_e(quat_exp(e.tail<3>()).toRotationMatrix()),
      J_e(right_jacobian(e.tail<3>())),
      t_x(X.p_mm),
      t_y(Y.p_mm),
      t_f(view.T_base_flange.p_mm),
      t_e(e.head<3>()) {
  std::copy(sensor, sensor + kSensorConstants, k.begin());
}

Vec3 Bench::out_of_flange(const Vec3& p, Mat3& d_point, Jac36& d_robot) const {
  d_point = R_f * R_e;
  d_robot.leftCols<3>() = R_f;
  d_robot.rightCols<3>() = -d_point * skew(p) * J_e;
  return d_point * p + R_f * t_e + t_f;
}

Vec3 Bench::into_flange(const Vec3& p, Mat3& d_point, Jac36& d_robot) const {
  const Vec3 q = R_e.transpose() * (R_f.transpose() * (p - t_f) - t_e);
  d_point = R_e.transpose() * R_f.transpose();
  d_robot.leftCols<3>() = -R_e.transpose();
  d_robot.rightCols<3>() = skew(q) * J_e;
  return q;
}

int rows_of(Sight sight) { return sight == Sight::point ? 3 : sight == Sight::pixel ? 2 : sight == Sight::pose ? 6 : 1; }

namespace {

/// Pinhole with Brown's distortion; derivative by the point and by the constants.
Vec2 project(const std::array<double, kSensorConstants>& k, const Vec3& s, Eigen::Matrix<double, 2, 3>* d_point, Eigen::Matrix<double, 6, kSensorConstants>* d_sensor) {
  const double iz = 1 / s.z(), x = s.x() * iz, y = s.y() * iz, r2 = x * x + y * y, r4 = r2 * r2, r6 = r4 * r2;
  const double g = 1 + k[kK1] * r2 + k[kK2] * r4 + k[kK3] * r6, dg = k[kK1] + 2 * k[kK2] * r2 + 3 * k[kK3] * r4;
  const double xd = x * g + 2 * k[kP1] * x * y + k[kP2] * (r2 + 2 * x * x), yd = y * g + k[kP1] * (r2 + 2 * y * y) + 2 * k[kP2] * x * y;
  if (d_point) {
    Eigen::Matrix2d D;
    D(0, 0) = g + 2 * x * x * dg + 2 * k[kP1] * y + 6 * k[kP2] * x, D(0, 1) = 2 * x * y * dg + 2 * k[kP1] * x + 2 * k[kP2] * y;
    D(1, 0) = 2 * x * y * dg + 2 * k[kP1] * x + 2 * k[kP2] * y, D(1, 1) = g + 2 * y * y * dg + 6 * k[kP1] * y + 2 * k[kP2] * x;
    Eigen::Matrix<double, 2, 3> N;
    N << iz, 0, -x * iz, 0, iz, -y * iz;
    *d_point = Vec2(k[kFx], k[kFy]).asDiagonal() * D * N;
  }
  if (d_sensor) {
    auto& J = *d_sensor;
    J.topRows<2>().setZero();
    J(0, kFx) = xd, J(0, kCx) = 1, J(1, kFy) = yd, J(1, kCy) = 1;
    const double b[] = {r2, r4, r6};
    const int at[] = {kK1, kK2, kK3};
    for (int i = 0; i < 3; ++i) J(0, at[i]) = k[kFx] * x * b[i], J(1, at[i]) = k[kFy] * y * b[i];
    J(0, kP1) = k[kFx] * 2 * x * y, J(1, kP1) = k[kFy] * (r2 + 2 * y * y);
    J(0, kP2) = k[kFx] * (r2 + 2 * x * x), J(1, kP2) = k[kFy] * 2 * x * y;
  }
  return {k[kFx] * xd + k[kCx], k[kFy] * yd + k[kCy]};
}

/// The target's point in the sensor's frame: s, and its derivatives.
Vec3 in_sensor(const Bench& c, const Vec3& a, Jac36* d_x, Jac36* d_y, Jac36* d_e, Vec3* d_scale) {
  Mat3 d_point;
  Jac36 d_robot;
  const Vec3 m = c.place_to_mount(c.R_y * a + c.t_y, d_point, d_robot);
  const Mat3 back = c.R_x.transpose();
  const Vec3 s = back * (m - c.t_x);
  if (d_x) {
    d_x->leftCols<3>() = -Mat3::Identity(), d_x->rightCols<3>() = skew(s);
    const Mat3 B = back * d_point * c.R_y;
    d_y->leftCols<3>() = B, d_y->rightCols<3>() = -B * skew(a);
    *d_e = back * d_robot;
    if (d_scale) *d_scale = B * a;
  }
  return s;
}

}  // namespace

void residual_of(const Bench& c, const Observation& o, const std::optional<Pose<frame::Sensor, frame::Target>>& T, double* r, Derivatives* d) {
  if (d) d->sensor.setZero();
  switch (c.sight) {
    case Sight::point: {
      Jac36 x, y, e;
      const Vec3 s = in_sensor(c, o.p_target, d ? &x : nullptr, &y, &e, nullptr);
      Eigen::Map<Vec3>{r} = o.z - (1 + c.k[kScale]) * s;
      if (!d) return;
      const double f = -(1 + c.k[kScale]);
      d->mount.topRows<3>() = f * x, d->target.topRows<3>() = f * y, d->robot.topRows<3>() = f * e;
      d->sensor.block<3, 1>(0, kScale) = -s;
      return;
    }
    case Sight::pixel: {
      Jac36 x, y, e;
      Vec3 by_scale;
      const Vec3 s = in_sensor(c, (1 + c.k[kScale]) * o.p_target, d ? &x : nullptr, &y, &e, &by_scale);
      if (!(s.z() > 1e-6)) {  // behind the camera: far off, and no slope that leads on
        r[0] = r[1] = 1e4;
        if (d) d->mount.setZero(), d->target.setZero(), d->robot.setZero();
        return;
      }
      Eigen::Matrix<double, 2, 3> P;
      const Vec2 u = project(c.k, s, d ? &P : nullptr, d ? &d->sensor : nullptr);
      r[0] = o.z.x() - u.x(), r[1] = o.z.y() - u.y();
      if (!d) return;
      d->mount.topRows<2>() = -P * x, d->target.topRows<2>() = -P * y, d->robot.topRows<2>() = -P * e;
      d->sensor.topRows<2>() *= -1;
      d->sensor.block<2, 1>(0, kScale) = -P * by_scale / (1 + c.k[kScale]);
      return;
    }
    case Sight::pose: {
      Jac36 x, y, e;
      const Vec3 s = in_sensor(c, Vec3::Zero(), d ? &x : nullptr, &y, &e, nullptr);
      Mat3 d_point;
      Jac36 d_robot;
      c.place_to_mount(c.t_y, d_point, d_robot);
      const Mat3 R = c.R_x.transpose() * d_point * c.R_y;  // target in sensor, predicted
      const Vec3 w = quat_log(Eigen::Quaterniond(Mat3(R.transpose() * T->rotation())));
      Eigen::Map<Vec3>{r} = T->p_mm - (1 + c.k[kScale]) * s;
      Eigen::Map<Vec3>{r + 3} = w;
      if (!d) return;
      const double f = -(1 + c.k[kScale]);
      d->mount.topRows<3>() = f * x, d->target.topRows<3>() = f * y, d->robot.topRows<3>() = f * e;
      d->sensor.block<3, 1>(0, kScale) = -s;
      // R' = exp(left) R exp(right): log(R'^T M) = log(exp(-right) exp(-R^T left) R^T M); left inverse jacobian of the logarithm
      const Mat3 L = right_jacobian_inverse(-w);
      d->mount.bottomRows<3>().setZero(), d->target.bottomRows<3>().setZero(), d->robot.bottomRows<3>().setZero();
      d->mount.block<3, 3>(3, 3) = L * R.transpose();
      d->target.block<3, 3>(3, 3) = -L;
      // a turn of the flange by J_e dw: out of the flange it turns what is outside, into it the other way
      const Mat3 turn = c.J_e;
      if (c.is_sensor_fixed) d->robot.block<3, 3>(3, 3) = -L * c.R_y.transpose() * turn;
      else d->robot.block<3, 3>(3, 3) = L * R.transpose() * c.R_x.transpose() * turn;
      return;
    }
    case Sight::sphere:
    case Sight::plane: {
      const double f = 1 / (1 + c.k[kScale]);
      const Vec3 p = f * o.z;
      Mat3 d_point;
      Jac36 d_robot;
      const Vec3 b = c.mount_to_place(c.R_x * p + c.t_x, d_point, d_robot);
      const Mat3 B = d_point * c.R_x;
      Vec3 u = b - c.t_y;
      Eigen::RowVector3d n;
      if (c.sight == Sight::sphere) {
        const double distance = std::max(1e-9, u.norm());
        n = u.transpose() / distance;
        r[0] = distance - c.k[kRadius];
      } else {
        n = c.R_y.col(o.id).transpose();
        r[0] = n.dot(u);
      }
      if (!d) return;
      d->mount.block<1, 3>(0, 0) = n * B, d->mount.block<1, 3>(0, 3) = -n * B * skew(p);
      d->robot.topRows<1>() = n * d_robot;
      d->target.row(0).setZero();
      d->target.block<1, 3>(0, 0) = -n * c.R_y;
      if (c.sight == Sight::plane) {
        // the axis turns with the target: d(R_y e) = -R_y skew(e) dw
        d->target.block<1, 3>(0, 3) = u.transpose() * (-c.R_y * skew(Vec3::Unit(o.id)));
      } else {
        d->sensor(0, kRadius) = -1;
      }
      d->sensor(0, kScale) = -f * n.dot(B * p);
      return;
    }
  }
}

}  // namespace network
}  // namespace asbuilt
