// SPDX-License-Identifier: GPL-3.0-or-later
// One joint adjustment of the part's pose, the robot's error, hand-eye, and the part's own imperfection, with the covariance of
// everything. Captures are tied to each other through the cells they share, not only to the drawing.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "planner/locate/cad_model.hpp"
#include "planner/locate/clusters.hpp"
#include "planner/locate/robot_prior.hpp"

namespace asbuilt {

struct AdjustState {
  Pose<frame::Base, frame::Part> T_base_part;    // where the part is in the coordinates of a perfect robot
  Eigen::VectorXd robot;                         // RobotPrior's parameters
  Eigen::VectorXd faces;                         // 7 by face: offset, turn about the face's center (3), shift (3); part frame
  double form_sd_mm = 0.3, patch_sd_mm = 0.1, cell_sd_mm = 0.05;  // the part's imperfection: of whole faces, of patches, of cells
  std::vector<double> sensor_factor;             // by sensor: how much larger the cells' variances are than foretold, >= 1
  Eigen::MatrixXd covariance;                    // of (part twist in base about the center, robot parameters)
  Mat6 data_information = Mat6::Zero();          // about the part's twist, everything else eliminated, prior of the part left out
  double step_mm = 0;                            // last change of the part's pose at its corners
  double rms_mm = 0;                             // of what the cells leave over after faces
  double shared_rms_mm = 0;                      // between captures in shared cells, after the adjustment
  std::size_t shared_count = 0, cell_count = 0, cluster_count = 0;
  double inlier_ratio = 1;                       // of the clusters by robust weight

  Vec6 capture_twist(const RobotPrior& prior, int k) const { return prior.capture[static_cast<std::size_t>(k)] * robot; }
};

struct AdjustRequest {
  const MeasuredCloud* cloud = nullptr;
  const CadModel* cad = nullptr;
  const RobotPrior* prior = nullptr;
  Pose<frame::Base, frame::Part> start;
  Mat6 part_prior_information = Mat6::Zero();    // about the part's twist in base about the center; zero: none
  double gate_mm = 4.0;                          // of the first round; it narrows
  double edge_band_mm = 1.0;
};

struct Adjusted {
  AdjustState state;
  std::vector<Cluster> clusters;                 // of the last round
  std::vector<double> residual_mm;               // by cluster, after faces and cell
  std::vector<double> weight;                    // robust, 0..1
  bool is_converged = false;
};

/// Method: Gauss-Newton; robust weights (Geman and McClure) with a scale that shrinks; cell offsets eliminated in closed form;
/// sizes of the imperfections estimated from the data between rounds.
Adjusted adjust(const AdjustRequest& request);

/// How a face's seven numbers move its surface along the normal at p (part frame); rows for the adjustment.
Eigen::Matrix<double, 7, 1> face_row(const CadModel& cad, int face, const Vec3& p_part, const Vec3& n_part);

}  // namespace asbuilt
