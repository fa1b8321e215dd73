// SPDX-License-Identifier: GPL-3.0-or-later
// The centre of a hole as the fit of a cone and the plate around it, in the plate's frame by the calibration at hand, and back to a pixel
// and a fraction of a profile. A dip's centroid is off under oblique light; axis x face is not.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "planner/calibrate/profilometer_holes.hpp"

namespace asbuilt {
namespace {

FlangePose flange_at(const ProfileScan& scan, double profile) {
  const double last = double(scan.T_base_flange.size()) - 1, x = std::clamp(profile, 0.0, last);
  const std::size_t i = std::min<std::size_t>(std::size_t(x), scan.T_base_flange.size() - 2);
  const FlangePose &a = scan.T_base_flange[i], &b = scan.T_base_flange[i + 1];
  const double t = profile - double(i);  // outside: as the last step goes on
  FlangePose out(a.q, a.p_mm + t * (b.p_mm - a.p_mm));
  if (a.q.coeffs() != b.q.coeffs()) out.q = (a.q * quat_exp(t * quat_log(a.q.conjugate() * b.q))).normalized();
  return out;
}

struct Sample {
  Vec3 p;  // about the hole, plate's frame
  std::uint32_t profile;
};

struct ConeFit {
  Vec3 center = Vec3::Zero(), sd = Vec3::Zero();
  double depth_ratio = 1;
  bool is_good = false;
};

/// z = h + tx x + ty y - k max(0, (R - rho) / tan(half angle)); parameters cx, cy, h, tx, ty, k.
ConeFit fit_cone(const std::vector<Sample>& samples, double radius, double slope) {
  ConeFit out;
  using V6 = Eigen::Matrix<double, 6, 1>;
  V6 x = V6::Zero();
  x[5] = 1;
  double scale = 1e9;
  Mat6 N;
  std::vector<double> r(samples.size()), a(samples.size());
  std::size_t inside = 0;
  for (int round = 0; round < 14; ++round) {
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const Vec3& p = samples[i].p;
      const double rho = std::hypot(p.x() - x[0], p.y() - x[1]);
      r[i] = p.z() - (x[2] + x[3] * p.x() + x[4] * p.y() - x[5] * std::max(0.0, (radius - rho) * slope));
      a[i] = std::abs(r[i]);
    }
    std::nth_element(a.begin(), a.begin() + std::ptrdiff_t(a.size() / 2), a.end());
    scale = std::max(1e-4, 1.4826 * a[a.size() / 2]);
    N.setZero();
    V6 rhs = V6::Zero();
    inside = 0;
    const double c = 4.7 * scale * (round < 3 ? 3 : 1);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double z = r[i] / c;
      if (std::abs(z) >= 1) continue;
      const double w = (1 - z * z) * (1 - z * z);
      const Vec3& p = samples[i].p;
      const Vec2 d(p.x() - x[0], p.y() - x[1]);
      const double rho = std::max(1e-6, d.norm());
      if (round > 2 && (std::abs(rho - radius) < 0.12 * radius || rho < 0.12 * radius)) continue;  // rim and tip are rounded by the line's width
      V6 J;
      J << 0, 0, 1, p.x(), p.y(), 0;
      if (rho < radius) {
        // by the centre: the wall's slope points away from it
        J[0] = -x[5] * slope * d.x() / rho, J[1] = -x[5] * slope * d.y() / rho, J[5] = -(radius - rho) * slope;
        ++inside;
      }
      N += w * J * J.transpose(), rhs += w * J * r[i];
    }
    if (inside < 10) return out;
    Mat6 M = N;
    M.diagonal() += 1e-9 * N.diagonal();
    const V6 step = M.ldlt().solve(rhs);
    x += step;
    if (!x.allFinite() || x.head<2>().norm() > 0.6 * radius) return out;
    if (round > 4 && step.head<3>().norm() < 1e-6) break;
  }
  // neighbours on a profile err alike: the sum of their correlations widens the sd
  double s0 = 0, s[3] = {}, n0 = 0, n[3] = {};
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (std::abs(r[i]) > 4.7 * scale) continue;
    s0 += r[i] * r[i], ++n0;
    for (std::size_t lag = 1; lag <= 3; ++lag)
      if (i + lag < samples.size() && samples[i + lag].profile == samples[i].profile && std::abs(r[i + lag]) < 4.7 * scale) s[lag - 1] += r[i] * r[i + lag], ++n[lag - 1];
  }
  double widen = 1;
  for (int lag = 0; lag < 3; ++lag)
    if (n[lag] > 20) widen += 2 * std::max(0.0, s[lag] / n[lag] / (s0 / n0));
  const Mat6 C = N.ldlt().solve(Mat6::Identity()) * (s0 / n0) * std::clamp(widen, 1.0, 6.0);
  out.center = Vec3(x[0], x[1], x[2] + x[3] * x[0] + x[4] * x[1]);
  for (int k = 0; k < 3; ++k) out.sd[k] = std::sqrt(std::max(0.0, C(k, k)));
  out.depth_ratio = x[5];
  out.is_good = out.sd.allFinite() && out.sd.head<2>().maxCoeff() < 0.1 * radius && x[5] > 0.4;
  return out;
}

}  // namespace

HoleSighting sighting_of(const ProfileScan& scan, double profile, const Vec2& uv, int column, int row) {
  HoleSighting h;
  h.column = column, h.row = row, h.uv = uv, h.profile = profile;
  h.T_base_flange = flange_at(scan, profile);
  const std::size_t last = scan.t_s.size() - 1, i = std::size_t(std::clamp(profile, 0.0, double(last)));
  const std::size_t a = i > 2 ? i - 2 : 0, b = std::min(last, i + 3);
  h.velocity_base_mm_s = (scan.T_base_flange[b].p_mm - scan.T_base_flange[a].p_mm) / (scan.t_s[b] - scan.t_s[a]);
  return h;
}

HoleView rough_view(const ProfileScan& scan, const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::vector<NumberedHole>& holes) {
  HoleView view;
  view.name = scan.name, view.is_held_out = scan.is_held_out;
  for (const NumberedHole& h : holes) {
    const HoleBlob& b = blobs[h.blob];
    view.holes.push_back(sighting_of(scan, b.profile, {b.u, b.v}, h.column, h.row));
    view.holes.back().sd_target_mm.setConstant(0.06 * plate.diameter_mm);
  }
  return view;
}

ConeFits fit_cones(const ProfileScan& scan, const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::vector<NumberedHole>& holes,
                   const ProfilometerState& s) {
  ConeFits out;
  out.view.name = scan.name, out.view.is_held_out = scan.is_held_out;
  const double slope = 1 / std::tan(0.5 * plate.cone_rad);
  const auto T_target_base = s.T_base_target.inverse();
  std::vector<Sample> samples;
  for (const NumberedHole& h : holes) {
    const HoleBlob& b = blobs[h.blob];
    const double radius = 0.5 * (is_large_hole(plate, h.column, h.row) ? plate.large_diameter_mm : plate.diameter_mm);
    const double reach = std::max(1.25 * radius, 0.5 * plate.pitch_mm) / radius;  // in radii of the dip
    const double half_u = 2 * reach / b.rim_ratio * std::sqrt(b.moment(0, 0)), half_p = 2 * reach / b.rim_ratio * std::sqrt(b.moment(1, 1));
    auto to_target = [&](double profile, const Vec2& uv) {
      HoleSighting at = sighting_of(scan, profile, uv, 0, 0);
      const Vec2 xz = plane_point(s.intrinsics, uv);
      return T_target_base.point(at.T_base_flange.point(s.T_flange_sensor.point(Vec3(xz.x(), 0, xz.y()))) + at.velocity_base_mm_s * s.latency_s);
    };
    const Vec3 middle = to_target(b.profile, {b.u, b.v});
    samples.clear();
    const int first = std::max(0, int(b.profile - half_p)), last = std::min(int(scan.begin.size()) - 2, int(b.profile + half_p) + 1);
    const Vec3 velocity = sighting_of(scan, b.profile, {b.u, b.v}, 0, 0).velocity_base_mm_s;
    const double window = std::max(1.3 * radius, 0.5 * plate.pitch_mm);
    for (int i = first; i <= last; ++i) {
      const auto from = scan.uv.begin() + scan.begin[std::size_t(i)], to = scan.uv.begin() + scan.begin[std::size_t(i) + 1];
      auto it = std::lower_bound(from, to, float(b.u - half_u), [](const Eigen::Vector2f& p, float u) { return p.x() < u; });
      const FlangePose& F = scan.T_base_flange[std::size_t(i)];
      const auto T_target_sensor = T_target_base * FlangePose(F.q, F.p_mm + velocity * s.latency_s) * s.T_flange_sensor;
      for (; it != to && it->x() <= b.u + half_u; ++it) {
        if (!std::isfinite(it->y())) continue;
        const Vec2 xz = plane_point(s.intrinsics, it->cast<double>());
        const Vec3 p = T_target_sensor.point(Vec3(xz.x(), 0, xz.y())) - middle;
        if (std::abs(p.x()) < window && std::abs(p.y()) < window && std::abs(p.z()) < 3 * plate.large_diameter_mm) samples.push_back({p, std::uint32_t(i)});
      }
    }
    if (samples.size() < 40) continue;
    const ConeFit fit = fit_cone(samples, radius, slope);
    if (!fit.is_good) continue;
    // back to the profile that crosses the centre, and the pixel there
    const Vec3 p_base = s.T_base_target.point(middle + fit.center);
    double profile = b.profile;
    Vec3 p_sensor = Vec3::Zero();
    for (int i = 0; i < 6; ++i) {
      auto to_sensor = [&](double at) {
        const HoleSighting f = sighting_of(scan, at, {0, 0}, 0, 0);
        return (FlangePose(f.T_base_flange.q, f.T_base_flange.p_mm + f.velocity_base_mm_s * s.latency_s) * s.T_flange_sensor).inverse().point(p_base);
      };
      p_sensor = to_sensor(profile);
      const double rate = to_sensor(profile + 0.5).y() - to_sensor(profile - 0.5).y();
      if (!(std::abs(rate) > 1e-9)) break;
      profile -= p_sensor.y() / rate;
    }
    Vec2 uv;
    if (!(std::abs(profile - b.profile) < half_p) || !pixel_of(s.intrinsics, {p_sensor.x(), p_sensor.z()}, {b.u, b.v}, uv)) continue;
    HoleSighting found = sighting_of(scan, profile, uv, h.column, h.row);
    found.sd_target_mm = fit.sd.cwiseMax(0.0015);
    out.view.holes.push_back(found);
    out.depth_ratios.push_back(fit.depth_ratio);
  }
  return out;
}

}  // namespace asbuilt
