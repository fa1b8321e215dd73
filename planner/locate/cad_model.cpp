// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/locate/cad_model.hpp"

#include <algorithm>
#include <cmath>

#include "planner/base/random.hpp"

namespace asbuilt {
namespace {

constexpr int kSamplesWanted = 6000;

bool is_closed_form(const Surface& s) { return s.shape.index() <= 4; }  // plane, cylinder, cone, sphere, torus

std::vector<Vec3> sharp_edge_points(const Brep& brep) {
  std::vector<Vec3> points;
  for (const BrepEdge& e : brep.edges) {
    if (e.kind == EdgeKind::smooth || e.is_seam) continue;
    for (std::size_t i = 0; i + 1 < e.p.size(); ++i) {
      const int parts = std::max(1, static_cast<int>(std::ceil((e.p[i + 1] - e.p[i]).norm() / 0.5)));
      for (int j = 0; j < parts; ++j) points.push_back(e.p[i] + (static_cast<double>(j) / parts) * (e.p[i + 1] - e.p[i]));
    }
    if (!e.p.empty()) points.push_back(e.p.back());
  }
  return points;
}

}  // namespace

std::optional<CadFoot> CadModel::foot(const Vec3& p_part, double reach_mm) const {
  const auto hit = grid.closest(p_part);
  if (!hit || std::abs(hit->distance_mm) > reach_mm) return std::nullopt;
  CadFoot out;
  out.face = brep->triangle_face.empty() ? 0 : brep->triangle_face[static_cast<std::size_t>(hit->triangle)];
  out.distance_mm = hit->distance_mm, out.n_part = hit->n;
  if (out.face >= 0 && out.face < static_cast<int>(brep->faces.size())) {
    const BrepFace& face = brep->faces[static_cast<std::size_t>(out.face)];
    if (face.fault.empty() && is_closed_form(face.surface)) {
      const SurfaceFoot exact = project(face.surface, p_part);
      const double sign = face.same_sense ? 1.0 : -1.0;
      if (std::abs(exact.signed_distance_mm) <= 1.5 * reach_mm && sign * exact.n.dot(hit->n) > 0.8)
        out.distance_mm = sign * exact.signed_distance_mm, out.n_part = sign * exact.n;
    } else if (face.fault.empty() && face.surface.shape.index() != 9) {
      // Along the triangle's normal from a foot on a chord: one step of Newton's method from there is enough.
      const auto& feet = this->feet[static_cast<std::size_t>(out.face)];
      const SurfaceFoot exact = feet ? feet->foot(p_part) : project(face.surface, p_part);
      const double sign = face.same_sense ? 1.0 : -1.0;
      if ((exact.p - hit->p_mm).norm() < 1.0 && sign * exact.n.dot(hit->n) > 0.8)
        out.distance_mm = sign * exact.signed_distance_mm, out.n_part = sign * exact.n;
    }
  }
  return out;
}

CadModel make_cad_model(const PartSpec& part, double margin_mm) {
  const Brep& brep = part.brep;
  CadModel cad;
  cad.brep = &brep;
  const Box3 box = brep.mesh.box();
  cad.size_mm = box.diagonal_mm();
  cad.center_part = box.center_mm();
  cad.grid = DistanceGrid(brep.mesh, std::clamp(cad.size_mm / 150, 0.5, 4.0), margin_mm);
  cad.query = MeshQuery(brep.mesh);
  cad.sharp_edges = PointGrid(sharp_edge_points(brep), 4.0);

  for (const BrepFace& face : brep.faces)
    cad.feet.push_back(face.fault.empty() && !is_closed_form(face.surface) && face.surface.shape.index() != 9 ? std::make_shared<FootSeeds>(face.surface) : nullptr);

  double area = 0;
  std::vector<double> sums;
  for (const auto& t : brep.mesh.triangles) {
    area += 0.5 * (brep.mesh.vertices[t[1]] - brep.mesh.vertices[t[0]]).cross(brep.mesh.vertices[t[2]] - brep.mesh.vertices[t[0]]).norm();
    sums.push_back(area);
  }
  cad.face_centers.assign(std::max<std::size_t>(1, brep.faces.size()), Vec3::Zero());
  cad.face_radii_mm.assign(cad.face_centers.size(), 1.0);
  if (sums.empty() || area <= 0) return cad;
  cad.sample_spacing_mm = std::sqrt(area / kSamplesWanted);
  Random random(1);
  std::vector<int> counts(cad.face_centers.size(), 0);
  for (int i = 0; i < kSamplesWanted; ++i) {  // stratified along the running area
    const double at = (i + random.uniform()) / kSamplesWanted * area;
    const std::size_t t = std::min<std::size_t>(sums.size() - 1, static_cast<std::size_t>(std::lower_bound(sums.begin(), sums.end(), at) - sums.begin()));
    double u = random.uniform(), v = random.uniform();
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const auto& f = brep.mesh.triangles[t];
    const Vec3 a = brep.mesh.vertices[f[0]];
    const int face = brep.triangle_face.empty() ? 0 : brep.triangle_face[t];
    cad.samples.push_back({a + u * (brep.mesh.vertices[f[1]] - a) + v * (brep.mesh.vertices[f[2]] - a),
                           brep.mesh.triangle_normal(static_cast<int>(t)), face});
    if (face >= 0) cad.face_centers[static_cast<std::size_t>(face)] += cad.samples.back().p_part, ++counts[static_cast<std::size_t>(face)];
  }
  for (std::size_t f = 0; f < brep.faces.size(); ++f) {
    Box3 face_box = brep.faces[f].box;
    if (counts[f] > 0)
      cad.face_centers[f] /= counts[f];
    else if (!face_box.is_empty())
      cad.face_centers[f] = face_box.center_mm();
    if (!face_box.is_empty()) cad.face_radii_mm[f] = std::max(1.0, 0.5 * face_box.diagonal_mm());
  }
  return cad;
}

}  // namespace asbuilt
