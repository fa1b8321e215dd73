// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/surface_model.hpp"

#include "planner/geom/mesh_query.hpp"

#include <algorithm>
#include <cmath>

namespace asbuilt::fitting {

namespace {

struct Axial {  // cylindrical coordinates of a point about a placement's axis
  double rho, h;
  Vec3 e_rho;
};
Axial axial(const Placement& at, const Vec3& p) {
  const Vec3 d = p - at.origin;
  const double h = d.dot(at.z);
  const Vec3 r = d - h * at.z;
  const double rho = r.norm();
  return {rho, h, rho > 1e-12 ? Vec3(r / rho) : at.x};
}

struct Motion {
  Mat3 rotation;
  Vec3 translation, center;
  Vec3 point(const Vec3& p) const { return center + rotation * (p - center) + translation; }
  void apply(Placement& at) const {
    at.origin = point(at.origin);
    at.x = rotation * at.x, at.y = rotation * at.y, at.z = rotation * at.z;
  }
  void apply(Curve& curve) const {
    std::visit(
        [&](auto& c) {
          using C = std::decay_t<decltype(c)>;
          if constexpr (std::is_same_v<C, LineCurve>) {
            c.origin = point(c.origin), c.direction = rotation * c.direction;
          } else if constexpr (std::is_same_v<C, BSplineCurve>) {
            for (Vec3& p : c.poles) p = point(p);
          } else if constexpr (std::is_same_v<C, PolylineCurve>) {
            for (Vec3& p : c.points) p = point(p);
          } else {
            apply(c.at);
          }
        },
        curve.shape);
  }
};

void move_rigidly(Surface& surface, const Motion& m) {
  std::visit(
      [&](auto& s) {
        using S = std::decay_t<decltype(s)>;
        if constexpr (std::is_same_v<S, BSplineSurface>) {
          for (Vec3& p : s.poles) p = m.point(p);
        } else if constexpr (std::is_same_v<S, RevolutionSurface>) {
          m.apply(s.profile);
          s.axis_point = m.point(s.axis_point), s.axis = m.rotation * s.axis;
        } else if constexpr (std::is_same_v<S, ExtrusionSurface>) {
          m.apply(s.profile);
          s.direction = m.rotation * s.direction;
        } else if constexpr (std::is_same_v<S, OffsetSurface>) {
          if (s.basis) {
            auto basis = std::make_shared<Surface>(*s.basis);
            move_rigidly(*basis, m);
            s.basis = basis;
          }
        } else if constexpr (std::is_same_v<S, FacetSurface>) {
          if (s.patch) {
            auto patch = std::make_shared<Mesh>(*s.patch);
            for (Vec3& v : patch->vertices) v = m.point(v);
            s.patch = patch;
            if (s.query) s.query = std::make_shared<MeshQuery>(*patch);
          }
        } else {
          m.apply(s.at);
        }
      },
      surface.shape);
}

double degrees(double rad) { return deg_from_rad(rad); }

void put_axis(std::map<std::string, double>& out, const Placement& at) {
  out["axis_x"] = at.z.x(), out["axis_y"] = at.z.y(), out["axis_z"] = at.z.z();
}
void put_origin(std::map<std::string, double>& out, const Placement& at) {
  out["x"] = at.origin.x(), out["y"] = at.origin.y(), out["z"] = at.origin.z();
}

}  // namespace

double signed_distance(const Surface& surface, const Vec3& p, Vec3& n) {
  if (const auto* s = std::get_if<PlaneSurface>(&surface.shape)) {
    n = s->at.z;
    return n.dot(p - s->at.origin);
  }
  if (const auto* s = std::get_if<CylinderSurface>(&surface.shape)) {
    const Axial a = axial(s->at, p);
    n = a.e_rho;
    return a.rho - s->radius_mm;
  }
  if (const auto* s = std::get_if<ConeSurface>(&surface.shape)) {
    const Axial a = axial(s->at, p);
    const double c = std::cos(s->half_angle_rad), g = std::sin(s->half_angle_rad);
    n = c * a.e_rho - g * s->at.z;
    return (a.rho - s->radius_mm) * c - a.h * g;
  }
  if (const auto* s = std::get_if<SphereSurface>(&surface.shape)) {
    const Vec3 d = p - s->at.origin;
    const double r = d.norm();
    n = r > 1e-12 ? Vec3(d / r) : s->at.z;
    return r - s->radius_mm;
  }
  if (const auto* s = std::get_if<TorusSurface>(&surface.shape); s && s->major_mm > s->minor_mm) {
    const Axial a = axial(s->at, p);
    const double u = a.rho - s->major_mm, r = std::hypot(u, a.h);
    n = r > 1e-12 ? Vec3((u * a.e_rho + a.h * s->at.z) / r) : a.e_rho;
    return r - s->minor_mm;
  }
  const SurfaceFoot foot = project(surface, p);
  n = foot.n;
  return foot.signed_distance_mm;
}

int modes_count(const Surface& surface) {
  if (std::holds_alternative<CylinderSurface>(surface.shape) || std::holds_alternative<SphereSurface>(surface.shape)) return 7;
  if (std::holds_alternative<ConeSurface>(surface.shape)) return 8;
  if (const auto* s = std::get_if<TorusSurface>(&surface.shape)) return s->major_mm > s->minor_mm ? 8 : 6;
  return 6;
}

ModeRow mode_heights(const Surface& surface, const Vec3& q, const Vec3& n, const Vec3& center) {
  ModeRow row = ModeRow::Zero();
  row.head<3>() = n;
  row.segment<3>(3) = (q - center).cross(n);
  if (std::holds_alternative<CylinderSurface>(surface.shape) || std::holds_alternative<SphereSurface>(surface.shape)) {
    row(6) = 1;
  } else if (const auto* cone = std::get_if<ConeSurface>(&surface.shape)) {
    const Axial a = axial(cone->at, q);
    row(6) = std::cos(cone->half_angle_rad);
    row(7) = (a.rho - cone->radius_mm) * std::sin(cone->half_angle_rad) + a.h * std::cos(cone->half_angle_rad);
  } else if (const auto* torus = std::get_if<TorusSurface>(&surface.shape); torus && torus->major_mm > torus->minor_mm) {
    const Axial a = axial(torus->at, q);
    row(6) = n.dot(a.e_rho);
    row(7) = 1;
  }
  return row;
}

Surface moved(const Surface& surface, const ModeRow& theta, const Vec3& center) {
  Surface out = surface;
  move_rigidly(out, {quat_exp(theta.segment<3>(3)).toRotationMatrix(), theta.head<3>(), center});
  if (auto* cylinder = std::get_if<CylinderSurface>(&out.shape)) cylinder->radius_mm = std::max(1e-3, cylinder->radius_mm + theta(6));
  if (auto* sphere = std::get_if<SphereSurface>(&out.shape)) sphere->radius_mm = std::max(1e-3, sphere->radius_mm + theta(6));
  if (auto* cone = std::get_if<ConeSurface>(&out.shape)) cone->radius_mm += theta(6), cone->half_angle_rad += theta(7);
  if (auto* torus = std::get_if<TorusSurface>(&out.shape); torus && torus->major_mm > torus->minor_mm)
    torus->major_mm += theta(6), torus->minor_mm = std::max(1e-3, torus->minor_mm + theta(7));
  return out;
}

std::map<std::string, double> readable_parameters(const Surface& surface) {
  std::map<std::string, double> out;
  if (const auto* s = std::get_if<PlaneSurface>(&surface.shape)) {
    out["normal_x"] = s->at.z.x(), out["normal_y"] = s->at.z.y(), out["normal_z"] = s->at.z.z();
    out["distance"] = s->at.z.dot(s->at.origin);
  } else if (const auto* c = std::get_if<CylinderSurface>(&surface.shape)) {
    put_axis(out, c->at), put_origin(out, c->at);
    out["radius"] = c->radius_mm;
  } else if (const auto* k = std::get_if<ConeSurface>(&surface.shape)) {
    put_axis(out, k->at), put_origin(out, k->at);
    out["radius"] = k->radius_mm, out["half_angle"] = degrees(k->half_angle_rad);
  } else if (const auto* b = std::get_if<SphereSurface>(&surface.shape)) {
    put_origin(out, b->at);
    out["radius"] = b->radius_mm;
  } else if (const auto* t = std::get_if<TorusSurface>(&surface.shape)) {
    put_axis(out, t->at), put_origin(out, t->at);
    out["major"] = t->major_mm, out["minor"] = t->minor_mm;
  }
  return out;
}

}  // namespace asbuilt::fitting
