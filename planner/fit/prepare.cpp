// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/prepare.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "planner/base/number.hpp"
#include "planner/fit/edge_curve.hpp"

namespace asbuilt::fitting {

namespace {

/// Nominal points of the face beside the edge: three places along it, three depths.
void add_prior_points(const EdgeModel& edge, FaceModel& face, const FaceModel& other) {
  const std::size_t count = edge.nominal.size();
  for (const double u : {0.1, 0.5, 0.9}) {
    const std::size_t i = static_cast<std::size_t>(std::lround(u * static_cast<double>(count - 1)));
    Vec3 n, n_other;
    nominal_distance(face, edge.nominal[i], n), nominal_distance(other, edge.nominal[i], n_other);
    Vec3 into = n.cross(edge.tangent[i]).normalized();
    if ((into.dot(n_other) * other.outward() > 0) == edge.is_convex) into = -into;
    for (const double depth : {1.0, 5.0, 9.0}) {
      Vec3 q = edge.nominal[i] + into * depth;
      const double d = nominal_distance(face, q, n);
      q -= d * n;
      face.prior_points.push_back(q);
    }
  }
}

/// A flat patch of triangles (a part given as a mesh) is a plane.
Surface plane_if_flat(const Surface& surface) {
  const auto* facets = std::get_if<FacetSurface>(&surface.shape);
  if (!facets || !facets->patch || facets->patch->triangles.empty()) return surface;
  const Mesh& mesh = *facets->patch;
  Vec3 n = Vec3::Zero(), center = Vec3::Zero();
  double area = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    const Vec3 twice = (b - a).cross(c - a);
    n += twice, center += twice.norm() * (a + b + c) / 3, area += twice.norm();
  }
  if (area <= 0 || n.norm() < 0.999 * area) return surface;
  n.normalize(), center /= area;
  for (const auto& t : mesh.triangles)
    for (const int v : t)
      if (std::abs(n.dot(mesh.vertices[v] - center)) > 0.002) return surface;
  const Mat3 m = quat_from_z(n, Vec3::UnitX()).toRotationMatrix();
  Surface plane;
  plane.shape = PlaneSurface{{center, m.col(0), m.col(1), m.col(2)}};
  return plane;
}

Mat6 square_root(const Mat6& covariance) {
  // Scaled first: mm and rad differ by orders of magnitude.
  Vec6 scale;
  for (int i = 0; i < 6; ++i) scale(i) = std::sqrt(std::max(covariance(i, i), 0.0));
  Mat6 c = Mat6::Zero();
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < 6; ++j)
      if (scale(i) > 0 && scale(j) > 0) c(i, j) = 0.5 * (covariance(i, j) + covariance(j, i)) / (scale(i) * scale(j));
  const Eigen::SelfAdjointEigenSolver<Mat6> eigen(c);
  return scale.asDiagonal() * eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
}

}  // namespace

Result<Setup> prepare(const FitRecipe& recipe, const Job& job, const MeasuredCloud& cloud, const Location& location) {
  Setup out;
  Refusals refusals;
  const Brep& brep = job.part.brep;
  std::map<int, int> slot_of_face;
  const auto slot_for = [&](int face) {
    const auto [it, is_new] = slot_of_face.try_emplace(face, static_cast<int>(out.faces.size()));
    if (is_new) {
      FaceModel f;
      f.face = face;
      f.nominal = f.surface = plane_if_flat(brep.faces[face].surface);
      const bool has_closed_form = std::visit(
          [](const auto& shape) {
            using S = std::decay_t<decltype(shape)>;
            return !std::is_same_v<S, BSplineSurface> && !std::is_same_v<S, RevolutionSurface> && !std::is_same_v<S, ExtrusionSurface> &&
                   !std::is_same_v<S, OffsetSurface>;
          },
          f.nominal.shape);
      if (!has_closed_form) f.seeds = std::make_shared<FootSeeds>(f.nominal);
      f.same_sense = brep.faces[face].same_sense;
      out.faces.push_back(std::move(f));
    }
    return it->second;
  };

  double burr_max_mm = 0;
  for (const FeatureSpec& feature : job.part.features) {
    if (const Recipe* r = job.recipe(feature.recipe)) burr_max_mm = std::max(burr_max_mm, r->burr_max_height_mm);
    for (const int index : feature.edges) {
      must(index >= 0 && index < static_cast<int>(brep.edges.size()), "fit: edge index");
      const BrepEdge& edge = brep.edges[index];
      const std::string where = "edge " + edge.id + " of " + feature.id;
      if (edge.face_1 < 0 || edge.face_2 < 0 || edge.p.size() < 2) {
        refusals.push_back({.code = "fit.no_face", .where = where,
                            .message = "The edge has only one face in the drawing; an edge is found as the meeting of two. Choose another edge or repair the CAD file.",
                            .measured = 1, .limit = 2, .unit = "faces", .stage = "fit"});
        continue;
      }
      const double dihedral_deg = deg_from_rad(edge.dihedral_rad);
      if ((edge.kind != EdgeKind::sharp_convex && edge.kind != EdgeKind::sharp_concave && edge.kind != EdgeKind::mixed) ||
          dihedral_deg < 10) {
        refusals.push_back({.code = "fit.tangent", .where = where,
                            .message = "The faces of the edge meet at " + fixed_number(dihedral_deg, 1) +
                                       " degrees only; below 10 degrees the place of an edge is not determined by its faces. Take the edge out of the feature.",
                            .measured = dihedral_deg, .limit = 10, .unit = "deg", .stage = "fit"});
        continue;
      }
      EdgeModel m;
      m.edge = index, m.feature = feature.id, m.is_closed = edge.is_closed;
      m.is_convex = edge.kind != EdgeKind::sharp_concave;
      m.slot_1 = slot_for(edge.face_1), m.slot_2 = slot_for(edge.face_2);
      place_stations(edge, out.faces[m.slot_1], out.faces[m.slot_2], recipe.station_mm, m);
      out.edges.push_back(std::move(m));
    }
  }
  if (!refusals.empty()) return refuse_all(std::move(refusals));
  for (const EdgeModel& e : out.edges) {
    add_prior_points(e, out.faces[e.slot_1], out.faces[e.slot_2]);
    add_prior_points(e, out.faces[e.slot_2], out.faces[e.slot_1]);
  }
  for (FaceModel& f : out.faces) {
    for (const Vec3& q : f.prior_points) f.center += q / static_cast<double>(f.prior_points.size());
    Vec3 n;
    f.center -= nominal_distance(f, f.center, n) * n;
    f.coefficients.resize(0);
  }

  double finest_mm = 1e300, spacing_mm = 0;
  for (const CloudCapture& c : cloud.captures)
    if (c.end > c.begin) finest_mm = std::min(finest_mm, std::max(c.noise_mm, 1e-4));
  for (std::size_t k = 0; k < cloud.captures.size(); ++k) {
    const CloudCapture& c = cloud.captures[k];
    const bool is_fine = c.end > c.begin && c.noise_mm <= 4 * finest_mm;
    out.is_fine.push_back(is_fine);
    if (is_fine) spacing_mm = std::max(spacing_mm, c.spacing_mm);
    CaptureModel m;
    if (k < location.corrections.size()) m.prior = location.corrections[k];
    m.correction = m.prior;
    if (k < location.correction_covariances.size()) m.spread = square_root(location.correction_covariances[k]);
    m.is_free = m.spread.norm() > 0;
    out.captures.push_back(m);
  }
  // A burr's root is a few tenths wide; what leans over a face stands off it and is gated out. Two pitches for mixed pixels.
  out.band_mm = std::clamp(0.3 * burr_max_mm, 0.4, 1.2) + 2 * std::clamp(spacing_mm, 0.05, 0.5);

  std::vector<std::vector<Vec3>> lines;
  for (std::size_t i = 0; i < brep.edges.size(); ++i) {
    const BrepEdge& e = brep.edges[i];
    if (e.is_seam || e.kind == EdgeKind::smooth || e.p.size() < 2) continue;
    lines.push_back(e.p);
    out.all_edges_index.push_back(static_cast<int>(i));
  }
  out.all_edges = PolylineIndex(std::move(lines), out.band_mm + recipe.deviation_max_mm);
  return out;
}

}  // namespace asbuilt::fitting
