// SPDX-License-Identifier: GPL-3.0-or-later
// Both models of the map pixel -> plane of light with their derivatives: the camera's by hand through the chain lens, ray, plane.
#include "planner/geom/profilometer_model.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "planner/base/result.hpp"

namespace asbuilt {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::infinity();

struct Term {
  int axis, i, j;  // 0: x, 1: z; u^i v^j
};

/// Terms of the polynomial: degree 2 and above, without the two that the projectivity brings (z: u v and v v).
const std::vector<Term>& terms_of(int degree_count) {
  static const std::vector<std::vector<Term>> all = [] {
    std::vector<std::vector<Term>> t(8);
    for (int degree = 0; degree < 8; ++degree)
      for (int axis = 0; axis < 2; ++axis)
        for (int n = 2; n <= degree; ++n)
          for (int j = 0; j <= n; ++j)
            if (!(axis == 1 && n == 2 && j >= 1)) t[std::size_t(degree)].push_back({axis, n - j, j});
    return t;
  }();
  must(degree_count >= 0 && degree_count < 8, "the polynomial of a plane map has a degree from 0 to 7");
  return all[std::size_t(degree_count)];
}

Vec2 camera_point(const Eigen::VectorXd& k, const Vec2& uv, MapJacobian* J) {
  const double f = k[0], dU = k[1], dV = k[2], k1 = k[5], k2 = k[6], p1 = k[7], p2 = k[8], L = k[9];
  const double pu = uv.x() - k[3], pv = uv.y() - k[4];
  const double a = pu * dU / f, b = pv * dV / f, r2 = a * a + b * b, radial = 1 + r2 * (k1 + r2 * k2);
  // Brown's correction, measured -> ideal
  const double x = a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a), y = b * radial + 2 * p2 * a * b + p1 * (r2 + 2 * b * b);
  const double ca = std::cos(k[10]), sa = std::sin(k[10]), ct = std::cos(k[11]), st = std::sin(k[11]);
  // the ray in axes turned back by theta: the plane is then tilted about X alone
  const double xt = ct * x + st * y, yt = -st * x + ct * y;
  // ray (xt, yt, 1) meets the plane with normal (0, ca, sa) through (0, 0, D)
  const double tana = sa / ca, D = L / tana, den = ca * yt + sa;
  const double lambda = sa * D / den;
  const double s_x = lambda * xt;
  // z axis of the sensor (0, -sa, ca): z = -sa lambda yt + ca (lambda - D)
  const double s_z = -sa * lambda * yt + ca * (lambda - D);
  if (J) {
    J->resize(2, 12);
    // by xt, yt
    const double l_yt = -lambda * ca / den;
    const double x_xt = lambda, x_yt = l_yt * xt;
    const double z_yt = -sa * (l_yt * yt + lambda) + ca * l_yt;
    // by x, y
    const double x_x = x_xt * ct - x_yt * st, x_y = x_xt * st + x_yt * ct, z_x = -z_yt * st, z_y = z_yt * ct;
    // by a, b
    const double g = k1 + 2 * k2 * r2;  // d radial / d r2
    const double xa = radial + 2 * a * a * g + 2 * p1 * b + 6 * p2 * a, xb = 2 * a * b * g + 2 * p1 * a + 2 * p2 * b;
    const double ya = 2 * a * b * g + 2 * p2 * b + 2 * p1 * a, yb = radial + 2 * b * b * g + 2 * p2 * a + 6 * p1 * b;
    const double X_a = x_x * xa + x_y * ya, X_b = x_x * xb + x_y * yb, Z_a = z_x * xa + z_y * ya, Z_b = z_x * xb + z_y * yb;
    auto put = [&](int c, double da, double db) { (*J)(0, c) = X_a * da + X_b * db, (*J)(1, c) = Z_a * da + Z_b * db; };
    put(0, -a / f, -b / f), put(1, pu / f, 0), put(2, 0, pv / f), put(3, -dU / f, 0), put(4, 0, -dV / f);
    auto lens = [&](int c, double dx, double dy) { (*J)(0, c) = x_x * dx + x_y * dy, (*J)(1, c) = z_x * dx + z_y * dy; };
    lens(5, a * r2, b * r2), lens(6, a * r2 * r2, b * r2 * r2), lens(7, 2 * a * b, r2 + 2 * b * b), lens(8, r2 + 2 * a * a, 2 * a * b);
    // L: D = L ca / sa, lambda = L ca / den
    const double l_L = ca / den, D_L = 1 / tana;
    (*J)(0, 9) = l_L * xt, (*J)(1, 9) = -sa * l_L * yt + ca * (l_L - D_L);
    // alpha
    const double l_alpha = L * (-sa * den - ca * (-sa * yt + ca)) / (den * den), D_alpha = -L / (sa * sa);
    (*J)(0, 10) = l_alpha * xt, (*J)(1, 10) = -ca * lambda * yt - sa * l_alpha * yt - sa * (lambda - D) + ca * (l_alpha - D_alpha);
    // theta turns (xt, yt)
    (*J)(0, 11) = x_xt * yt - x_yt * xt, (*J)(1, 11) = -z_yt * xt;
  }
  return {s_x, s_z};
}

Vec2 map_point(const ProfilometerIntrinsics& m, const Vec2& uv, MapJacobian* J) {
  const Eigen::VectorXd& k = m.values;
  const double u = (uv.x() - m.uv_center.x()) / m.uv_half, v = (uv.y() - m.uv_center.y()) / m.uv_half;
  const double w = 1 + k[3] * u + k[4] * v, px = (k[0] * u + k[1] * v) / w, pz = k[2] * v / w;
  Vec2 s(px, pz);
  if (J) {
    J->setZero(2, k.size());
    (*J)(0, 0) = u / w, (*J)(0, 1) = v / w, (*J)(1, 2) = v / w;
    (*J)(0, 3) = -px * u / w, (*J)(1, 3) = -pz * u / w, (*J)(0, 4) = -px * v / w, (*J)(1, 4) = -pz * v / w;
  }
  double up[8], vp[8];
  up[0] = vp[0] = 1;
  for (int i = 1; i < 8; ++i) up[i] = up[i - 1] * u, vp[i] = vp[i - 1] * v;
  int c = 5;
  for (const Term& t : terms_of(m.degree_count)) {
    const double phi = up[t.i] * vp[t.j];
    s[t.axis] += k[c] * phi;
    if (J) (*J)(t.axis, c) = phi;
    ++c;
  }
  return s;
}

}  // namespace

std::vector<ModelParameter> camera_parameters(const ProfilometerSheet& s) {
  return {{"f", "mm", s.focal_mm, s.focal_sd_ratio * s.focal_mm, s.focal_mm},
          {"dU", "mm", s.pixel_mm, s.pixel_sd_ratio * s.pixel_mm, s.pixel_mm},
          {"dV", "mm", s.pixel_mm, s.pixel_sd_ratio * s.pixel_mm, s.pixel_mm},
          {"cU", "px", (s.width_px - 1) / 2.0, s.center_sd_px, 100},
          {"cV", "px", (s.height_px - 1) / 2.0, s.center_sd_px, 100},
          {"k1", "", 0, s.radial_sd, 0.1},
          {"k2", "", 0, s.radial_sd, 0.1},
          {"p1", "", 0, s.tangential_sd, 0.01},
          {"p2", "", 0, s.tangential_sd, 0.01},
          {"L", "mm", s.baseline_mm, s.baseline_sd_ratio * s.baseline_mm, s.baseline_mm},
          {"alpha", "rad", s.triangulation_rad, s.triangulation_sd_rad, s.triangulation_rad},
          {"theta", "rad", 0, s.theta_sd_rad, 0.1}};
}

std::vector<ModelParameter> plane_map_parameters(int degree_count, double bend_sd_mm) {
  std::vector<ModelParameter> p{{"width scale", "mm", 0, kUnknown, 10},
                                {"shear", "mm", 0, kUnknown, 10},
                                {"depth scale", "mm", 0, kUnknown, 10},
                                {"keystone u", "", 0, kUnknown, 0.1},
                                {"keystone v", "", 0, kUnknown, 0.1}};
  for (const Term& t : terms_of(degree_count))
    p.push_back({fmt::format("bend {} u{} v{}", t.axis ? "z" : "x", t.i, t.j), "mm", 0, bend_sd_mm, 0.05});
  return p;
}

ProfilometerIntrinsics camera_of(const ProfilometerSheet& sheet) {
  ProfilometerIntrinsics m;
  const auto p = camera_parameters(sheet);
  m.values.resize(Eigen::Index(p.size()));
  for (std::size_t i = 0; i < p.size(); ++i) m.values[Eigen::Index(i)] = p[i].prior;
  return m;
}

Vec2 plane_point(const ProfilometerIntrinsics& map, const Vec2& uv, MapJacobian* J) {
  return map.model == ProfilometerModel::camera ? camera_point(map.values, uv, J) : map_point(map, uv, J);
}

Vec3 profile_point(const ProfileMap& map, const Vec2& pair) {
  const Vec2 xz = plane_point(map.map, pair);
  return map.T_sensor_map.point(Vec3(xz.x(), 0, xz.y()));
}

bool pixel_of(const ProfilometerIntrinsics& map, const Vec2& xz, const Vec2& start, Vec2& uv) {
  const double step = map.model == ProfilometerModel::camera ? 0.5 : 1e-3 * map.uv_half;
  uv = start;
  for (int i = 0; i < 20; ++i) {
    const Vec2 e = plane_point(map, uv) - xz;
    Eigen::Matrix2d J;
    for (int c = 0; c < 2; ++c) {
      Vec2 h = Vec2::Zero();
      h[c] = step;
      J.col(c) = (plane_point(map, uv + h) - plane_point(map, uv - h)) / (2 * step);
    }
    if (!(std::abs(J.determinant()) > 1e-300)) return false;
    const Vec2 d = J.inverse() * e;
    uv -= d;
    if (!uv.allFinite()) return false;
    if (d.norm() < 1e-8 * map.uv_half) return true;
  }
  return false;
}

Mat3 rotation_camera_sensor(double alpha_rad, double theta_rad) {
  return (Eigen::AngleAxisd(theta_rad, Vec3::UnitZ()) * Eigen::AngleAxisd(alpha_rad, Vec3::UnitX())).toRotationMatrix();
}

}  // namespace asbuilt
