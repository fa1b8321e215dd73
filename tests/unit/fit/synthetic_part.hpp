// SPDX-License-Identifier: GPL-3.0-or-later
// Parts built by hand for the tests of fit and burr: a plate whose top meets its four sides, a disc whose top meets a cylinder;
// scanned by ideal or noisy sensors, with faces and edges moved at will. Truth is known by construction.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/random.hpp"

namespace asbuilt::synthetic {

inline Placement placed(const Vec3& origin, const Vec3& z, const Vec3& x) {
  const Mat3 m = quat_from_z(z, x).toRotationMatrix();
  return {origin, m.col(0), m.col(1), m.col(2)};
}

/// Face 0: the top, z = 0, looking up. Faces 1..4: sides at y = 0 (looking -y), x = length (+x), y = width (+y), x = 0 (-x).
/// Edges 0..3: top with face 1..4. Edges 4..7: the vertical ones between neighbouring sides.
struct Plate {
  double length = 80, width = 50, height = 20;
};

inline BrepFace plane_face(const std::string& id, const Vec3& origin, const Vec3& n, const Vec3& x) {
  BrepFace f;
  f.id = id;
  f.surface.shape = PlaneSurface{placed(origin, n, x)};
  return f;
}

inline BrepEdge line_edge(const std::string& id, int face_1, int face_2, const Vec3& a, const Vec3& b, const Vec3& n_1, const Vec3& n_2) {
  BrepEdge e;
  e.id = id, e.face_1 = face_1, e.face_2 = face_2;
  e.kind = EdgeKind::sharp_convex;
  e.curve_type = "line";
  e.length_mm = (b - a).norm();
  e.dihedral_rad = std::acos(std::clamp(n_1.dot(n_2), -1.0, 1.0));
  e.p = {a, b}, e.s_mm = {0, e.length_mm};
  e.tangent.assign(2, (b - a).normalized());
  e.n_1.assign(2, n_1), e.n_2.assign(2, n_2);
  e.curve.shape = LineCurve{a, (b - a).normalized()};
  return e;
}

inline void put_job(Job& job) {
  job.batch_id = "test", job.item_id = "item";
  Recipe r;
  r.id = "r", r.tool = "t", r.width_mm = 0.4, r.tolerance_mm = 0.1, r.burr_max_height_mm = 1.5;
  job.recipes = {r};
  ToolSpec t;
  t.id = "t";
  job.cell.tools = {t};
  SensorSpec s;
  s.id = "fine", s.noise_mm = 0.006;
  job.cell.sensors = {s};
}

inline Job plate_job(const Plate& plate = {}, std::vector<int> edges = {0, 1, 2, 3}) {
  Job job;
  put_job(job);
  const double l = plate.length, w = plate.width, h = plate.height;
  Brep& b = job.part.brep;
  const Vec3 up(0, 0, 1), c[4] = {{0, 0, 0}, {l, 0, 0}, {l, w, 0}, {0, w, 0}}, n[4] = {{0, -1, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  b.faces.push_back(plane_face("#10", {0, 0, 0}, up, Vec3::UnitX()));
  for (int i = 0; i < 4; ++i) b.faces.push_back(plane_face("#1" + std::to_string(i + 1), c[i], n[i], up));
  for (int i = 0; i < 4; ++i) b.edges.push_back(line_edge("#2" + std::to_string(i), 0, i + 1, c[i], c[(i + 1) % 4], up, n[i]));
  for (int i = 0; i < 4; ++i)
    b.edges.push_back(line_edge("#3" + std::to_string(i), 1 + (i + 3) % 4, 1 + i, c[i], c[i] - h * up, n[(i + 3) % 4], n[i]));
  job.part.features = {{.id = "rim", .recipe = "r", .edges = std::move(edges)}};
  return job;
}

/// A disc of the given radius, top at z = 0; edge 0: the closed circle between top (face 0) and cylinder (face 1).
inline Job disc_job(double radius) {
  Job job;
  put_job(job);
  Brep& b = job.part.brep;
  b.faces.push_back(plane_face("#10", {0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()));
  BrepFace side;
  side.id = "#11";
  side.surface.shape = CylinderSurface{placed({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()), radius};
  b.faces.push_back(side);
  BrepEdge e;
  e.id = "#20", e.face_1 = 0, e.face_2 = 1, e.kind = EdgeKind::sharp_convex, e.is_closed = true, e.curve_type = "circle";
  e.dihedral_rad = kPi / 2, e.length_mm = 2 * kPi * radius;
  constexpr int kCount = 240;
  for (int i = 0; i <= kCount; ++i) {
    const double a = 2 * kPi * (i % kCount) / kCount;
    e.p.emplace_back(radius * std::cos(a), radius * std::sin(a), 0);
    e.tangent.emplace_back(-std::sin(a), std::cos(a), 0);
    e.n_1.push_back(Vec3::UnitZ()), e.n_2.emplace_back(std::cos(a), std::sin(a), 0);
    e.s_mm.push_back(2 * kPi * radius * i / kCount);
  }
  b.edges = {e};
  job.part.features = {{.id = "rim", .recipe = "r", .edges = {0}}};
  return job;
}

struct Scan {  // one capture in the making: points in part (true places), their normals, the ray they came along
  std::string name;
  Pose<frame::Base, frame::Base> error;  // what the capture's points are moved by (to be corrected)
  std::vector<Vec3> p_part, n_part;
  double noise_mm = 0.006;
  Vec3 from = Vec3(0, 0, 1);               // where the sensor stands, as seen from the middle of the points, in part
};

/// Points on a face around an edge piece: `place(s, d)` gives the true point at s along, d inside; every pitch_mm.
inline void sample_strip(Scan& scan, const std::function<Vec3(double, double)>& place, const Vec3& n, double from, double to, double depth,
                         double pitch_mm) {
  for (double s = from + pitch_mm / 2; s < to; s += pitch_mm)
    for (double d = pitch_mm / 2; d < depth; d += pitch_mm) scan.p_part.push_back(place(s, d)), scan.n_part.push_back(n);
}

/// A cloud and a location (exact unless changed) from scans; the sensors stand 200 mm off.
struct Measured {
  MeasuredCloud cloud;
  Location location;
};
inline Measured measure(const std::vector<Scan>& scans, const Pose<frame::Base, frame::Part>& T_base_part, std::uint64_t seed,
                        double correction_sd_mm = 0) {
  Measured out;
  out.location.T_base_part = T_base_part;
  Random random(seed);
  for (const Scan& scan : scans) {
    CloudCapture c;
    c.name = scan.name, c.sensor = 0, c.noise_mm = scan.noise_mm, c.spacing_mm = 0.25;
    Vec3 middle = Vec3::Zero();
    for (const Vec3& p : scan.p_part) middle += p / static_cast<double>(std::max<std::size_t>(1, scan.p_part.size()));
    c.T_base_sensor = {T_base_part.q * quat_from_z(-scan.from.normalized(), Vec3::UnitX()),
                       T_base_part.point(middle + 200 * scan.from.normalized())};
    c.begin = out.cloud.p_base.size();
    const int index = static_cast<int>(out.cloud.captures.size());
    for (std::size_t i = 0; i < scan.p_part.size(); ++i) {
      const Vec3 p = scan.p_part[i] + scan.noise_mm * random.normal() * scan.n_part[i];
      out.cloud.p_base.push_back(scan.error.point(T_base_part.point(p)));
      out.cloud.n_base.push_back((T_base_part.q * scan.n_part[i]).cast<float>());
      out.cloud.sigma_mm.push_back(static_cast<float>(scan.noise_mm));
      out.cloud.capture.push_back(index);
    }
    c.end = out.cloud.p_base.size();
    out.cloud.captures.push_back(c);
    out.location.corrections.emplace_back();
    Mat6 covariance = Mat6::Zero();
    if (correction_sd_mm > 0) {
      covariance.topLeftCorner<3, 3>() = Mat3::Identity() * correction_sd_mm * correction_sd_mm;
      covariance.bottomRightCorner<3, 3>() = Mat3::Identity() * 1e-14;
    }
    out.location.correction_covariances.push_back(covariance);
  }
  return out;
}

/// How the true plate differs from the drawing: outward shift of face k at a point of the part.
using Deviation = std::function<double(int face, const Vec3& p)>;

/// The top and the four sides of a plate near its upper rim, with `deviation`; corners are left ragged (strips overlap the drawing's ends).
inline Scan scan_plate(const Plate& plate, const Deviation& deviation, double pitch_mm = 0.3, double depth_mm = 14,
                       const std::vector<int>& sides = {0, 1, 2, 3}, bool with_top = true) {
  Scan scan;
  scan.name = "a.ply";
  const double l = plate.length, w = plate.width;
  const Vec3 c[4] = {{0, 0, 0}, {l, 0, 0}, {l, w, 0}, {0, w, 0}}, n[4] = {{0, -1, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  const Vec3 up(0, 0, 1);
  for (const int k : sides) {
    const Vec3 t = (c[(k + 1) % 4] - c[k]).normalized();
    const double length = (c[(k + 1) % 4] - c[k]).norm();
    const auto side = [&](double s, double d) {
      const Vec3 p = c[k] + t * s - up * d;
      return Vec3(p + n[k] * deviation(k + 1, p));
    };
    const auto top = [&](double s, double d) {
      const Vec3 p = c[k] + t * s - n[k] * d;
      return Vec3(p + up * deviation(0, p));
    };
    sample_strip(scan, side, n[k], 0, length, depth_mm, pitch_mm);
    if (with_top) sample_strip(scan, top, up, 0, length, depth_mm, pitch_mm);
  }
  return scan;
}

inline Scan scan_disc(double radius, const std::function<double(int, double)>& deviation, double pitch_mm = 0.4, double depth_mm = 12) {
  Scan scan;
  scan.name = "a.ply";
  const int count = static_cast<int>(2 * kPi * radius / pitch_mm);
  for (int i = 0; i < count; ++i) {
    const double a = 2 * kPi * i / count;
    const Vec3 r(std::cos(a), std::sin(a), 0);
    for (double d = pitch_mm / 2; d < depth_mm; d += pitch_mm) {
      if (d < radius) scan.p_part.push_back(r * (radius - d) + Vec3(0, 0, deviation(0, a))), scan.n_part.push_back(Vec3::UnitZ());
      scan.p_part.push_back(r * (radius + deviation(1, a)) - Vec3(0, 0, d)), scan.n_part.push_back(r);
    }
  }
  return scan;
}

inline Pose<frame::Base, frame::Part> some_place() {
  return {quat_from_zyx(0.7, 0.02, -0.03), Vec3(1200, -80, 640)};
}

}  // namespace asbuilt::synthetic
