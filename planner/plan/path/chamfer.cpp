// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/plan/path/chamfer.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt {

namespace {

Vec3 perpendicular_to(const Vec3& v, const Vec3& axis) { return v - axis * axis.dot(v); }

struct Legs {
  double leg_1, leg_2;
  Vec3 slope_1, slope_2;
};

/// A foot q (from the envelope's centre, or minus the plane's normal) on the line edge + leg * t: d leg = -(q . d edge) / (q . t).
Vec3 slope_of(const Vec3& q, const Vec3& t) { return -q / q.dot(t); }

void place_ball(const Cutter& cutter, const EdgeStation& s, const Vec3& t_1, const Vec3& t_2, double width, double offset, CutterPlacement& out) {
  const double r = 0.5 * cutter.diameter_mm, half = 0.5 * material_angle_rad(s);
  const Vec3 b = (s.n_1 + s.n_2).normalized();
  const double inside = r * r - std::pow(width * std::sin(half), 2);
  if (inside <= 0) {
    out.fault = "the ball is smaller than the chamfer it has to leave";
    out.fault_measured = r, out.fault_limit = width * std::sin(half), out.fault_unit = "mm";
    return;
  }
  const double d = std::sqrt(inside) - width * std::cos(half) + offset;
  const Vec3 center = s.p + d * b;
  out.m = b;
  out.tip = center - r * out.up;
  out.leg_1_mm = out.leg_2_mm = offset > 0 ? 0.0 : width;
  out.slope_1 = slope_of(width * t_1 - d * b, t_1);
  out.slope_2 = slope_of(width * t_2 - d * b, t_2);
  const double height = r * (1 - b.dot(out.up));
  out.contact_radius_mm = radius_mm(cutter, std::clamp(height, 0.0, r));
  if (b.dot(out.up) < 0.02) {
    out.fault = "the ball would have to cut with its shank: the edge looks away from the spindle";
    out.fault_measured = deg_from_rad(std::acos(std::clamp(b.dot(out.up), -1.0, 1.0))), out.fault_limit = 89, out.fault_unit = "deg";
  }
}

void place_flank(const Cutter& cutter, const EdgeStation& s, const Vec3& t_1, const Vec3& t_2, double width, double offset, double ratio,
                 CutterPlacement& out) {
  const Vec3& a = out.up;
  const double al = cutter.shape == CutterShape::cone ? 0.5 * cutter.included_angle_rad : 0.0;
  // The plane swept by the flank contains the tangent: the radial direction rho of the contact obeys rho . tau = tan(al) (a . tau).
  const Vec3 across = perpendicular_to(s.tau, a);
  const double length = across.norm(), k = std::tan(al) * a.dot(s.tau);
  if (length < 1e-6 || std::abs(k) >= 0.98 * length) {
    out.fault = "the tool axis runs along the edge: the flank sweeps no chamfer";
    out.fault_measured = deg_from_rad(std::asin(std::clamp(std::abs(a.dot(s.tau)), 0.0, 1.0)));
    out.fault_limit = deg_from_rad(kPi / 2 - al), out.fault_unit = "deg";
    return;
  }
  const Vec3 e_1 = across / length;
  Vec3 e_2 = a.cross(e_1);
  if (e_2.dot(s.n_1 + s.n_2) > 0) e_2 = -e_2;  // towards the material
  const double c = k / length;
  const Vec3 rho = c * e_1 + std::sqrt(1 - c * c) * e_2;
  const Vec3 m = -std::cos(al) * rho + std::sin(al) * a;
  const double sin_1 = -m.dot(t_1), sin_2 = -m.dot(t_2);
  out.m = m;
  if (sin_1 < 0.05 || sin_2 < 0.05) {
    out.fault = "the flank does not look at both faces of the edge";
    out.fault_measured = deg_from_rad(std::asin(std::clamp(std::min(sin_1, sin_2), -1.0, 1.0)));
    out.fault_limit = deg_from_rad(std::asin(0.05)), out.fault_unit = "deg";
    return;
  }
  const double depth = 2 * width / (1 / sin_1 + 1 / sin_2);
  out.leg_1_mm = offset > 0 ? 0.0 : depth / sin_1, out.leg_2_mm = offset > 0 ? 0.0 : depth / sin_2;
  out.slope_1 = m / sin_1, out.slope_2 = m / sin_2;
  const double flank = flank_mm(cutter), height = ratio * flank;
  const Vec3 foot = s.p - (depth - offset) * m;
  out.contact_radius_mm = radius_mm(cutter, height);
  out.tip = foot - out.contact_radius_mm * rho - height * a;
  // both ends of the chamfer have to lie on the flank
  const Vec3 along = std::sin(al) * rho + std::cos(al) * a;
  double low = 1e9, high = -1e9;
  for (const Vec3& t : {Vec3(depth / sin_1 * t_1), Vec3(depth / sin_2 * t_2)}) {
    // t + depth m lies in the plane; the swept plane is spanned by tau and the generator `along`
    const Vec3 in_plane = t + depth * m;
    const Vec3 normal_to_tau = perpendicular_to(along, s.tau);
    const double beta = in_plane.dot(normal_to_tau) / std::max(normal_to_tau.squaredNorm(), 1e-9);
    low = std::min(low, height + beta * std::cos(al)), high = std::max(high, height + beta * std::cos(al));
  }
  if (low < 0 || high > flank) {
    out.fault = "the chamfer is longer than what the flank offers at this contact height";
    out.fault_measured = low < 0 ? low : high, out.fault_limit = low < 0 ? 0 : flank, out.fault_unit = "mm";
  }
}

}  // namespace

double flank_mm(const Cutter& c) {
  if (c.shape == CutterShape::cone) return 0.5 * (c.diameter_mm - c.tip_diameter_mm) / std::tan(0.5 * c.included_angle_rad);
  if (c.shape == CutterShape::ball) return 0.5 * c.diameter_mm;
  return c.length_mm > 0 ? std::min(c.length_mm, c.diameter_mm) : c.diameter_mm;
}

double radius_mm(const Cutter& c, double u) {
  const double r = 0.5 * c.diameter_mm;
  if (c.shape == CutterShape::cone)
    return u <= flank_mm(c) ? 0.5 * c.tip_diameter_mm + u * std::tan(0.5 * c.included_angle_rad)
                            : (c.shank_diameter_mm > 0 ? 0.5 * c.shank_diameter_mm : r);
  if (c.shape == CutterShape::ball) return u < r ? std::sqrt(std::max(r * r - (r - u) * (r - u), 0.0)) : r;
  return r;
}

double gap_mm(const Cutter& c, const Vec3& p_tool) {
  const double u = -p_tool.z(), rho = std::hypot(p_tool.x(), p_tool.y()), r = 0.5 * c.diameter_mm;
  const double top = c.length_mm > 0 ? u - c.length_mm : -1e9;
  if (c.shape == CutterShape::ball) return u > r ? std::max(rho - r, top) : std::hypot(rho, u - r) - r;
  if (c.shape == CutterShape::cylinder) return std::max({-u, rho - r, top});
  const double al = 0.5 * c.included_angle_rad;
  const double side = u <= flank_mm(c) ? (rho - (0.5 * c.tip_diameter_mm + u * std::tan(al))) * std::cos(al) : rho - radius_mm(c, u);
  return std::max({-u, side, top});
}

double material_angle_rad(const EdgeStation& s) { return kPi - std::acos(std::clamp(s.n_1.dot(s.n_2), -1.0, 1.0)); }

Vec3 into_face(const EdgeStation& s, int face) {
  const Vec3& n = face == 1 ? s.n_1 : s.n_2;
  const Vec3& other = face == 1 ? s.n_2 : s.n_1;
  Vec3 t = n.cross(s.tau).normalized();
  return t.dot(other) > 0 ? Vec3(-t) : t;
}

CutterPlacement place_cutter(const Cutter& cutter, const EdgeStation& station, const Vec3& up, double width_mm, double offset_mm, double ratio) {
  CutterPlacement out;
  out.up = up.normalized();
  const Vec3 t_1 = into_face(station, 1), t_2 = into_face(station, 2);
  if (cutter.shape == CutterShape::ball)
    place_ball(cutter, station, t_1, t_2, width_mm, offset_mm, out);
  else
    place_flank(cutter, station, t_1, t_2, width_mm, offset_mm, ratio, out);
  out.area_mm2 = 0.5 * out.leg_1_mm * out.leg_2_mm * std::sin(material_angle_rad(station));
  return out;
}

Vec3 tilted_up(const Cutter& cutter, const EdgeStation& station, const Vec3& wanted_up, double cone_rad) {
  const Vec3 b = (station.n_1 + station.n_2).normalized(), wanted = wanted_up.normalized();
  if (cutter.shape == CutterShape::ball) {  // contact away from the tip, where the cutting speed is not zero: 45 degrees if it can be had
    const Vec3 e = perpendicular_to(wanted, b);
    if (e.norm() < 1e-6) return wanted;
  }
  const double al = cutter.shape == CutterShape::cone ? 0.5 * cutter.included_angle_rad : cutter.shape == CutterShape::ball ? kPi / 4 : 0.0;
  Vec3 e = perpendicular_to(wanted, b);
  if (e.norm() < 1e-6) e = perpendicular_to(std::abs(b.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX(), b);
  const Vec3 best = std::sin(al) * b + std::cos(al) * e.normalized();  // angle to the chamfer's normal: 90 degrees minus al
  const double angle = std::acos(std::clamp(best.dot(wanted), -1.0, 1.0));
  if (angle <= cone_rad || angle < 1e-9) return best;
  const Vec3 turn = wanted.cross(best).normalized();
  return Eigen::AngleAxisd(cone_rad, turn) * wanted;
}

}  // namespace asbuilt
