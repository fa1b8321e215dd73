// SPDX-License-Identifier: GPL-3.0-or-later
// A face as it really is: its nominal surface moved and resized, plus a smooth bounded offset along the normal (a Gaussian
// process on inducing points, Matern 5/2), which follows bent and shrunk faces and stays zero on true ones.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "planner/fit/surface_model.hpp"
#include "planner/geom/foot_seeds.hpp"

namespace asbuilt::fitting {

struct OffsetField {
  double amplitude_mm = 0, length_mm = 0;      // prior sd and correlation length; amplitude 0: no field
  std::vector<Vec3> inducing;                  // surface points
  Eigen::MatrixXd whitening;                   // inverse Cholesky factor of the kernel among them
  int size() const { return static_cast<int>(inducing.size()); }
};

struct FaceModel {
  int face = -1;                               // index into Brep::faces
  Surface nominal, surface;                    // in part; the second without the field
  bool same_sense = true;
  Vec3 center = Vec3::Zero();                  // of the patch; rotations turn about it
  std::vector<Vec3> prior_points;              // nominal points whose displacement the prior bounds
  std::shared_ptr<const FootSeeds> seeds;      // none where feet have a closed form
  OffsetField field;
  Eigen::VectorXd coefficients;                // of the field, standard normal a priori
  double rms_mm = 0;                           // robust, of single points
  std::size_t points_count = 0;

  double outward() const { return same_sense ? 1.0 : -1.0; }
};

/// An offset field over the given surface points: at most `count_max` inducing points, spread evenly.
OffsetField make_field(const std::vector<Vec3>& points, double amplitude_mm, double length_mm, int count_max);

/// Values of the whitened basis at q; size field.size().
Eigen::VectorXd field_basis(const OffsetField& field, const Vec3& q);
/// Prior variance at q that the inducing points do not explain.
double field_rest_variance(const OffsetField& field, const Eigen::VectorXd& basis);

/// Signed distance from the moved surface, without the field.
double surface_distance(const FaceModel& face, const Vec3& p, Vec3& n);
/// The same for the face as drawn.
double nominal_distance(const FaceModel& face, const Vec3& p, Vec3& n);
/// Signed distance from the face with its field, along the natural normal; n: natural normal of the moved surface at the foot.
double face_distance(const FaceModel& face, const Vec3& p, Vec3& n);
/// The natural normal including the slope of the field.
Vec3 face_normal(const FaceModel& face, const Vec3& p);

/// Amplitude and length of the field by marginal likelihood over a small grid. heights: residuals over the moved surface at
/// surface points q with standard deviations sd; the modes are marginalised with a wide prior.
struct FieldChoice {
  double amplitude_mm = 0, length_mm = 0, log_likelihood_gain = 0;  // against no field
};
FieldChoice choose_field(const FaceModel& face, const std::vector<Vec3>& q, const Eigen::VectorXd& heights, const Eigen::VectorXd& sd);

}  // namespace asbuilt::fitting
