// SPDX-License-Identifier: GPL-3.0-or-later
// All faces and all captures together: places and sizes of the faces, their offset fields and the rigid corrections of the
// captures, by robust least squares with the drawing and the location's covariance as priors.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "planner/fit/associate.hpp"
#include "planner/fit/face_model.hpp"

namespace asbuilt::fitting {

struct CaptureModel {
  Pose<frame::Base, frame::Base> prior, correction;  // location's, refined
  Mat6 spread = Mat6::Zero();                        // square root of the prior covariance (child frame)
  Vec6 whitened = Vec6::Zero();                      // correction = prior.disturbed(spread * whitened)
  bool is_free = false;
};

struct BundleOptions {
  int rounds_count = 8;
  double turn_sd_rad = 0.02;  // prior turn of a face beside its edge
  double form_sd_mm = 1.5;  // prior displacement of a face at its prior points
};

struct Bundle {
  std::vector<int> offset;       // first unknown of each face: modes, then field
  int captures_offset = 0;       // then 6 whitened unknowns of each free capture, in order
  std::vector<int> capture_offset;  // -1: fixed
  Eigen::MatrixXd covariance;    // of each face's unknowns, the captures given; zero elsewhere
  double factor = 1;             // variance factor found from the residuals and applied
  std::vector<double> residual_mm, weight;  // parallel to the cells
};

/// Changes faces (surface, coefficients, rms) and captures (whitened, correction).
Bundle solve_bundle(const BundleOptions& options, const std::vector<Cell>& cells, const Pose<frame::Base, frame::Part>& T_base_part,
                    std::vector<FaceModel>& faces, std::vector<CaptureModel>& captures);

/// Gradient of a face's height along its natural normal at q by that face's unknowns (modes, field).
Eigen::VectorXd height_gradient(const FaceModel& face, const Vec3& q, const Vec3& n);

}  // namespace asbuilt::fitting
