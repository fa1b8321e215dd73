// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/finish.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace asbuilt::fitting {

namespace {

constexpr double kBeside_mm = 4, kWithinReach_mm = 10;

/// Best rigid motion a -> b (Kabsch).
Eigen::Isometry3d best_rigid(const std::vector<Vec3>& a, const std::vector<Vec3>& b) {
  Vec3 ca = Vec3::Zero(), cb = Vec3::Zero();
  for (std::size_t i = 0; i < a.size(); ++i) ca += a[i], cb += b[i];
  ca /= static_cast<double>(a.size()), cb /= static_cast<double>(a.size());
  Mat3 h = Mat3::Zero();
  for (std::size_t i = 0; i < a.size(); ++i) h += (a[i] - ca) * (b[i] - cb).transpose();
  const Eigen::JacobiSVD<Mat3> svd(h, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Mat3 d = Mat3::Identity();
  d(2, 2) = (svd.matrixV() * svd.matrixU().transpose()).determinant() < 0 ? -1 : 1;
  Eigen::Isometry3d t = Eigen::Isometry3d::Identity();
  t.linear() = svd.matrixV() * d * svd.matrixU().transpose();
  t.translation() = cb - t.linear() * ca;
  return t;
}

SurfaceFit describe(const FaceModel& face, const Brep& brep) {
  SurfaceFit out;
  out.face = face.face;
  out.face_id = brep.faces[face.face].id;
  out.type = std::string(surface_type(face.nominal));
  out.nominal = readable_parameters(face.nominal);
  out.fitted = readable_parameters(face.surface);
  // What a person compares is the patch, not the axis: its shift along the normal and its tilt.
  Vec3 n, n_nominal;
  const double d = -surface_distance(face, face.center, n);
  nominal_distance(face, face.center, n_nominal);
  out.fitted["shift"] = d * face.outward();
  out.fitted["tilt"] = deg_from_rad(std::atan2(n.cross(n_nominal).norm(), n.dot(n_nominal)));
  out.nominal["shift"] = 0, out.nominal["tilt"] = 0;
  if (face.field.size() > 0) {
    double most = 0;
    for (const Vec3& q : face.field.inducing) most = std::max(most, std::abs(field_basis(face.field, q).dot(face.coefficients)));
    out.nominal["form"] = 0, out.fitted["form"] = most;
  }
  out.surface_part = face.surface;
  out.same_sense = face.same_sense;
  out.rms_mm = face.rms_mm;
  out.points_count = face.points_count;
  return out;
}

/// What all points of a place have in common and no fit can see: the captures' corrections relative to the cut (as located; not
/// averaged down over captures, for most of it is shared), the sensor's place on the flange where the location carries no
/// such covariance, and the tool's tip.
Mat3 common_covariance(const Solved& s, const std::vector<double>& capture_weight, const std::string& feature, const Vec3& p_part) {
  Mat3 c = Mat3::Zero();
  const Vec3 p_base = s.location.T_base_part.point(p_part);
  double total = 0;
  for (std::size_t k = 0; k < capture_weight.size(); ++k) {
    if (capture_weight[k] <= 0) continue;
    const CloudCapture& capture = s.cloud.captures[k];
    Mat3 own;
    const bool is_located = k < s.location.correction_covariances.size() && s.location.correction_covariances[k].norm() > 0;
    if (is_located) {
      const auto& T = s.location.corrections[k];
      Eigen::Matrix<double, 3, 6> j;
      j << Mat3::Identity(), -skew(T.inverse().point(p_base));
      j = T.rotation() * j;
      own = j * s.location.correction_covariances[k] * j.transpose();
    } else {
      Eigen::Matrix<double, 3, 6> j;
      j << Mat3::Identity(), -skew(capture.T_base_sensor.inverse().point(p_base));
      j = capture.T_base_sensor.rotation() * j;
      own = j * capture.covariance_sensor * j.transpose();
    }
    // A capture known better counts for more, as it does in the solution.
    const double w = capture_weight[k] / std::max(1e-8, own.trace());
    c += w * own;
    total += w;
  }
  if (total > 0) c /= total;
  for (const FeatureSpec& f : s.job.part.features) {
    if (f.id != feature) continue;
    const Recipe* recipe = s.job.recipe(f.recipe);
    const ToolSpec* tool = recipe ? s.job.tool(recipe->tool) : nullptr;
    if (!tool) continue;
    const Mat3 r = quat_from_z(recipe->axis_base.normalized(), Vec3::UnitX()).toRotationMatrix();
    c += r * tool->covariance.topLeftCorner<3, 3>() * r.transpose();
  }
  const Mat3 to_part = s.location.T_base_part.rotation().transpose();
  return to_part * c * to_part.transpose();
}

}  // namespace

StationStatus station_status(double nearest_1_mm, double nearest_2_mm) {
  const double worst = std::max(nearest_1_mm, nearest_2_mm);
  return worst <= kBeside_mm ? StationStatus::measured : worst <= kWithinReach_mm ? StationStatus::extrapolated : StationStatus::nominal;
}

Features finish(const Solved& s) {
  Features out;
  for (const CaptureModel& c : s.setup.captures) out.corrections.push_back(c.correction);
  out.T_base_tool_reference = s.location.T_base_tool_reference;
  const Pose<frame::Base, frame::Part> T_drawing = s.job.fixture.T_base_fixture * s.job.fixture.T_fixture_part;
  const Brep& brep = s.job.part.brep;

  for (std::size_t e = 0; e < s.setup.edges.size(); ++e) {
    const EdgeModel& model = s.setup.edges[e];
    const FaceModel &face_1 = s.setup.faces[model.slot_1], &face_2 = s.setup.faces[model.slot_2];
    AdaptedEdge edge;
    edge.edge = model.edge, edge.id = brep.edges[model.edge].id, edge.feature = model.feature, edge.is_closed = model.is_closed;
    edge.nominal = s.traced[e].nominal, edge.adapted = s.traced[e].adapted;
    const std::size_t count = edge.adapted.size();
    edge.s_mm.assign(count, 0);
    for (std::size_t i = 1; i < count; ++i) edge.s_mm[i] = edge.s_mm[i - 1] + (edge.adapted[i] - edge.adapted[i - 1]).norm();
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t a = i > 0 ? i - 1 : (model.is_closed ? count - 2 : 0);
      const std::size_t b = i + 1 < count ? i + 1 : (model.is_closed ? 1 : count - 1);
      edge.tangent.push_back((edge.adapted[b] - edge.adapted[a]).normalized());
      edge.n_1.push_back(face_1.outward() * face_normal(face_1, edge.adapted[i]));
      edge.n_2.push_back(face_2.outward() * face_normal(face_2, edge.adapted[i]));
    }

    // What was seen: the cells found beside this edge, by face, along its nominal arc length.
    std::vector<double> seen_1, seen_2, capture_weight(s.cloud.captures.size(), 0);
    for (std::size_t i = 0; i < s.cells.size(); ++i) {
      const Cell& c = s.cells[i];
      if (c.edge != static_cast<int>(e) || s.bundle.weight[i] <= 0) continue;
      (c.slot == model.slot_1 ? seen_1 : seen_2).push_back(c.s_mm);
      capture_weight[c.capture] += s.bundle.weight[i] / (c.sd_mm * c.sd_mm);
    }
    std::sort(seen_1.begin(), seen_1.end()), std::sort(seen_2.begin(), seen_2.end());
    const auto nearest = [&](const std::vector<double>& seen, double at) {
      const auto it = std::lower_bound(seen.begin(), seen.end(), at);
      double best = 1e300;
      if (it != seen.end()) best = std::min(best, *it - at);
      if (it != seen.begin()) best = std::min(best, at - *std::prev(it));
      return best;
    };
    for (std::size_t i = 0; i < count; ++i)
      edge.status.push_back(station_status(nearest(seen_1, edge.s_mm[i]), nearest(seen_2, edge.s_mm[i])));

    // Covariance at a few stations, between them by interpolation: it is smooth.
    const std::size_t every = std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(4.0 / s.recipe.station_mm)));
    std::vector<std::size_t> at;
    for (std::size_t i = 0; i < count; i += every) at.push_back(i);
    if (at.back() != count - 1) at.push_back(count - 1);
    std::vector<Mat3> known;
    for (const std::size_t i : at)
      known.push_back(edge_covariance(s.bundle, s.setup.faces, model, edge.adapted[i], edge.tangent[i]) +
                      common_covariance(s, capture_weight, model.feature, edge.adapted[i]));
    for (std::size_t i = 0, k = 0; i < count; ++i) {
      while (k + 2 < at.size() && at[k + 1] <= i) ++k;
      const double gap = at.size() > 1 ? static_cast<double>(at[k + 1] - at[k]) : 1.0;
      const double t = at.size() > 1 ? std::clamp((static_cast<double>(i) - static_cast<double>(at[k])) / gap, 0.0, 1.0) : 0.0;
      Mat3 c = at.size() > 1 ? Mat3((1 - t) * known[k] + t * known[k + 1]) : known[0];
      const Mat3 across = Mat3::Identity() - edge.tangent[i] * edge.tangent[i].transpose();
      edge.covariance.push_back(0.5 * (c + c.transpose()));
      const Eigen::SelfAdjointEigenSolver<Mat3> eigen(across * c * across);
      edge.sigma_mm.push_back(std::sqrt(std::max(0.0, eigen.eigenvalues()(2))));
    }
    edge.surface_1 = describe(face_1, brep), edge.surface_2 = describe(face_2, brep);
    out.edges.push_back(std::move(edge));
  }

  // How far from the drawing, and by what: place of the part, of the feature, and the rest. The three add up along the whole.
  for (const FeatureSpec& feature : s.job.part.features) {
    std::vector<Vec3> a, b;
    for (const AdaptedEdge& e : out.edges)
      if (e.feature == feature.id) a.insert(a.end(), e.nominal.begin(), e.nominal.end()), b.insert(b.end(), e.adapted.begin(), e.adapted.end());
    if (a.size() < 3) continue;
    const Eigen::Isometry3d move = best_rigid(a, b);
    for (AdaptedEdge& e : out.edges) {
      if (e.feature != feature.id) continue;
      for (std::size_t i = 0; i < e.adapted.size(); ++i) {
        const Vec3 whole = s.location.T_base_part.point(e.adapted[i]) - T_drawing.point(e.nominal[i]);
        const double length = whole.norm();
        const Vec3 u = length > 1e-12 ? Vec3(whole / length) : Vec3::Zero();
        const Vec3 rigid = s.location.T_base_part.point(e.nominal[i]) - T_drawing.point(e.nominal[i]);
        const Vec3 moved_by_feature = s.location.T_base_part.direction(move * e.nominal[i] - e.nominal[i]);
        e.rigid_mm.push_back(u.dot(rigid));
        e.feature_mm.push_back(u.dot(moved_by_feature));
        e.local_mm.push_back(length - u.dot(rigid) - u.dot(moved_by_feature));
      }
    }
  }
  return out;
}

}  // namespace asbuilt::fitting
