// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/fit/bundle.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <variant>
#include <cstdlib>
#include <variant>

namespace asbuilt::fitting {

namespace {

struct Row {
  double residual;
  Vec3 q, n;
  Eigen::VectorXd face;  // gradient of the residual by the face's unknowns (negative heights)
  Vec6 capture;          // by the whitened unknowns of the capture
};

/// h x = g, where faces are coupled through the captures only: each face is eliminated on its own, then the captures are solved.
Eigen::VectorXd solve_by_faces(const Eigen::MatrixXd& h, const Eigen::VectorXd& g, const std::vector<FaceModel>& faces, const Bundle& layout) {
  const int size = static_cast<int>(h.rows()), c = layout.captures_offset, captures = size - c;
  Eigen::MatrixXd reduced = h.bottomRightCorner(captures, captures);
  Eigen::VectorXd right = g.tail(captures), x(size);
  std::vector<Eigen::MatrixXd> coupling(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const int a = layout.offset[f], m = modes_count(faces[f].surface) + faces[f].field.size();
    const Eigen::LLT<Eigen::MatrixXd> llt(h.block(a, a, m, m));
    x.segment(a, m) = llt.solve(g.segment(a, m));
    if (captures == 0) continue;
    const Eigen::MatrixXd h_fc = h.block(a, c, m, captures);
    coupling[f] = llt.solve(h_fc);
    reduced.noalias() -= h_fc.transpose() * coupling[f];
    right.noalias() -= h_fc.transpose() * x.segment(a, m);
  }
  if (captures == 0) return x;
  x.tail(captures) = reduced.llt().solve(right);
  for (std::size_t f = 0; f < faces.size(); ++f) x.segment(layout.offset[f], coupling[f].rows()) -= coupling[f] * x.tail(captures);
  return x;
}

/// A short strip of a cylinder hardly tells its axis and radius: what it cannot tell stays near the drawing. Axes turn by turn_sd_rad,
/// sizes change by shrinkage and a tolerance.
template <class H, class G>
void add_shape_prior(const BundleOptions& options, const FaceModel& face, H&& h, G&& g) {
  const double w_turn = 1 / (options.turn_sd_rad * options.turn_sd_rad);
  const auto size = [&](int mode, double now, double nominal, double sd) { h(mode, mode) += 1 / (sd * sd), g(mode) += (now - nominal) / (sd * sd); };
  const auto radius = [&](int mode, double now, double nominal) { size(mode, now, nominal, 0.3 + 0.01 * nominal); };
  std::visit(
      [&](const auto& now) {
        using S = std::decay_t<decltype(now)>;
        const S* nominal = std::get_if<S>(&face.nominal.shape);
        if (!nominal) return;
        if constexpr (requires { now.at; }) {
          for (const Vec3& t : {now.at.x, now.at.y}) {
            const Vec3 row = now.at.z.cross(t);  // how a turn moves the axis along t
            h.template block<3, 3>(3, 3) += w_turn * row * row.transpose();
            g.template segment<3>(3) += w_turn * (now.at.z - nominal->at.z).dot(t) * row;
          }
        }
        if constexpr (std::is_same_v<S, CylinderSurface> || std::is_same_v<S, SphereSurface>) radius(6, now.radius_mm, nominal->radius_mm);
        if constexpr (std::is_same_v<S, ConeSurface>) size(7, now.half_angle_rad, nominal->half_angle_rad, options.turn_sd_rad);
        if constexpr (std::is_same_v<S, TorusSurface>)
          if (g.size() == 8) radius(6, now.major_mm, nominal->major_mm), radius(7, now.minor_mm, nominal->minor_mm);
      },
      face.surface.shape);
}

constexpr double kTurnStep_rad = 0.03, kSettled_mm = 2e-4;

double tukey(double u) { return std::abs(u) < 1 ? (1 - u * u) * (1 - u * u) : 0.0; }

}  // namespace

Eigen::VectorXd height_gradient(const FaceModel& face, const Vec3& q, const Vec3& n) {
  const int modes = modes_count(face.surface);
  Eigen::VectorXd g(modes + face.field.size());
  g.head(modes) = mode_heights(face.surface, q, n, face.center).head(modes);
  if (face.field.size() > 0) g.tail(face.field.size()) = field_basis(face.field, q);
  return g;
}

Bundle solve_bundle(const BundleOptions& options, const std::vector<Cell>& cells, const Pose<frame::Base, frame::Part>& T_base_part,
                    std::vector<FaceModel>& faces, std::vector<CaptureModel>& captures) {
  Bundle out;
  int size = 0;
  for (FaceModel& f : faces) {
    out.offset.push_back(size);
    size += modes_count(f.surface) + f.field.size();
    if (f.coefficients.size() != f.field.size()) f.coefficients = Eigen::VectorXd::Zero(f.field.size());
  }
  out.captures_offset = size;
  for (const CaptureModel& c : captures) {
    out.capture_offset.push_back(c.is_free ? size : -1);
    if (c.is_free) size += 6;
  }
  const Pose<frame::Part, frame::Base> T_part_base = T_base_part.inverse();
  std::vector<Row> rows(cells.size());
  out.residual_mm.assign(cells.size(), 0);
  out.weight.assign(cells.size(), 1);

  const auto linearise = [&] {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const Cell& c = cells[i];
      const FaceModel& face = faces[c.slot];
      const CaptureModel& capture = captures[c.capture];
      Row& row = rows[i];
      const Vec3 p = T_part_base.point(capture.correction.point(c.p_base));
      const double d = surface_distance(face, p, row.n);
      row.q = p - d * row.n;
      row.face = -height_gradient(face, row.q, row.n);
      row.residual = d + row.face.tail(face.field.size()).dot(face.coefficients);
      // Moving the capture by a twist in its child frame moves the point by R (v + w x p).
      const Vec3 n_child = capture.correction.q.conjugate() * (T_base_part.q * row.n);
      Vec6 twist;
      twist.head<3>() = n_child;
      twist.tail<3>() = c.p_base.cross(n_child);
      row.capture = capture.spread.transpose() * twist;
      out.residual_mm[i] = row.residual;
    }
  };

  std::vector<std::vector<std::size_t>> cells_of(faces.size());
  for (std::size_t i = 0; i < cells.size(); ++i) cells_of[cells[i].slot].push_back(i);
  // A face takes its part of the step, or half of it and half again while its residuals would grow. Returns how far it moved.
  const auto take_step = [&](const Eigen::VectorXd& step, int f) {
    FaceModel& face = faces[f];
    const Surface surface = face.surface;
    const Eigen::VectorXd coefficients = face.coefficients;
    const int a = out.offset[f], modes = modes_count(surface);
    ModeRow theta = ModeRow::Zero();
    theta.head(modes) = step.segment(a, modes);
    Eigen::VectorXd field = step.segment(a + modes, face.field.size());
    const double most = std::min(1.0, kTurnStep_rad / std::max(1e-12, theta.segment<3>(3).norm()));  // a strip's axis is far from linear
    theta *= most, field *= most;
    double before = 0;
    for (const std::size_t i : cells_of[f]) before += out.weight[i] * std::pow(rows[i].residual / cells[i].sd_mm, 2);
    for (int halves = 0;; ++halves, theta *= 0.5, field *= 0.5) {
      face.surface = moved(surface, theta, face.center);
      face.coefficients = coefficients + field;
      double after = 0;
      for (const std::size_t i : cells_of[f]) {
        const Vec3 p = T_part_base.point(captures[cells[i].capture].correction.point(cells[i].p_base));
        Vec3 n;
        after += out.weight[i] * std::pow(face_distance(face, p, n) / cells[i].sd_mm, 2);
      }
      if (after <= before * 1.01 + 1 || halves == 5) break;
    }
    double moved_most = face.field.size() > 0 ? face.field.amplitude_mm * field.lpNorm<Eigen::Infinity>() : 0.0;
    for (const Vec3& q : face.prior_points) {
      Vec3 n;
      surface_distance(face, q, n);
      moved_most = std::max(moved_most, std::abs(mode_heights(face.surface, q, n, face.center).dot(theta)));
    }
    return moved_most;
  };

  Eigen::MatrixXd h;
  bool is_settled = false;
  for (int round = 0; round <= options.rounds_count; ++round) {
    linearise();
    // Robust weights: the scale of each face from its own residuals, never below what the cells claim.
    std::vector<std::vector<double>> normalised(faces.size());
    for (std::size_t i = 0; i < cells.size(); ++i) normalised[cells[i].slot].push_back(std::abs(rows[i].residual) / cells[i].sd_mm);
    std::vector<double> scale(faces.size(), 1);
    for (std::size_t f = 0; f < faces.size(); ++f) {
      auto& v = normalised[f];
      if (v.size() < 5) continue;
      std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
      scale[f] = std::max(1.0, 1.4826 * v[v.size() / 2]);
    }
    h = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
    double chi2 = 0, freedom = 0;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const Cell& c = cells[i];
      const double normal = rows[i].residual / c.sd_mm;
      // A field that holds nothing yet is what a residual of its size is for.
      const double open_mm = round == 0 && faces[c.slot].coefficients.isZero(0) && faces[c.slot].field.size() > 0 ? faces[c.slot].field.amplitude_mm : 0.0;
      const double width_mm = std::hypot(c.sd_mm * scale[c.slot] * (round == 0 ? 3.0 : 1.0), open_mm);
      const double robust = tukey(rows[i].residual / (4.685 * width_mm));
      out.weight[i] = robust;
      chi2 += robust * normal * normal, freedom += robust;
      const double w = robust / (c.sd_mm * c.sd_mm);
      if (w == 0) continue;
      const int a = out.offset[c.slot], b = out.capture_offset[c.capture], m = static_cast<int>(rows[i].face.size());
      h.block(a, a, m, m).noalias() += w * rows[i].face * rows[i].face.transpose();
      g.segment(a, m) += w * rows[i].residual * rows[i].face;
      if (b < 0) continue;
      h.block<6, 6>(b, b).noalias() += w * rows[i].capture * rows[i].capture.transpose();
      h.block(a, b, m, 6).noalias() += w * rows[i].face * rows[i].capture.transpose();
      g.segment<6>(b) += w * rows[i].residual * rows[i].capture;
    }
    out.factor = std::max(1.0, chi2 / std::max(1.0, freedom - size));
    h /= out.factor, g /= out.factor;
    h.triangularView<Eigen::StrictlyLower>() = h.transpose();
    for (std::size_t f = 0; f < faces.size(); ++f) {
      const FaceModel& face = faces[f];
      const int a = out.offset[f], modes = modes_count(face.surface);
      for (const Vec3& q : face.prior_points) {  // displacement of the patch, not parameters
        Vec3 n;
        const double d = surface_distance(face, q, n);  // height of the surface over q is -d
        const Eigen::VectorXd row = mode_heights(face.surface, q - d * n, n, face.center).head(modes);
        const double w = 1 / (options.form_sd_mm * options.form_sd_mm);
        h.block(a, a, modes, modes) += w * row * row.transpose();
        g.segment(a, modes) += w * -d * row;
      }
      add_shape_prior(options, face, h.block(a, a, modes, modes), g.segment(a, modes));
      // What the patch cannot tell (a plane turned in itself) stays where it is.
      double lever = 1;
      for (const Vec3& q : face.prior_points) lever = std::max(lever, (q - face.center).norm());
      for (int k = 0; k < modes; ++k) h(a + k, a + k) += k >= 3 && k < 6 ? lever * lever / 1e4 : 1 / 1e4;
      for (int k = 0; k < face.field.size(); ++k) h(a + modes + k, a + modes + k) += 1, g(a + modes + k) += face.coefficients(k);
    }
    for (std::size_t k = 0; k < captures.size(); ++k)
      if (const int b = out.capture_offset[k]; b >= 0) {
        h.block<6, 6>(b, b) += Mat6::Identity();
        g.segment<6>(b) += captures[k].whitened;
      }
    if (round == options.rounds_count || is_settled) break;
    const Eigen::VectorXd step = -solve_by_faces(h, g, faces, out);
    for (std::size_t k = 0; k < captures.size(); ++k)
      if (const int b = out.capture_offset[k]; b >= 0) {
        captures[k].whitened += step.segment<6>(b);
        captures[k].correction = captures[k].prior.disturbed(captures[k].spread * captures[k].whitened);
      }
    double moved_most = 0;
    for (std::size_t f = 0; f < faces.size(); ++f) moved_most = std::max(moved_most, take_step(step, static_cast<int>(f)));
    is_settled = round > 0 && moved_most < kSettled_mm;
  }
  // The captures' part is the location's to report: here the faces' given the captures.
  out.covariance = Eigen::MatrixXd::Zero(size, size);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const int a = out.offset[f], m = modes_count(faces[f].surface) + faces[f].field.size();
    out.covariance.block(a, a, m, m) = h.block(a, a, m, m).llt().solve(Eigen::MatrixXd::Identity(m, m));
  }
  std::vector<double> square(faces.size(), 0), weight(faces.size(), 0);
  for (FaceModel& f : faces) f.points_count = 0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Cell& c = cells[i];
    const double w = out.weight[i] * c.points_count;
    square[c.slot] += w * (c.scatter_mm * c.scatter_mm + rows[i].residual * rows[i].residual), weight[c.slot] += w;
    if (out.weight[i] > 0) faces[c.slot].points_count += c.points_count;
  }
  for (std::size_t f = 0; f < faces.size(); ++f) faces[f].rms_mm = weight[f] > 0 ? std::sqrt(square[f] / weight[f]) : 0;
  return out;
}

}  // namespace asbuilt::fitting
