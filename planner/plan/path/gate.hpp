// SPDX-License-Identifier: GPL-3.0-or-later
// The gate (B11): how likely the chamfer comes out in tolerance at every station, and whether the edge may be cut at all.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/plan/path/chamfer.hpp"

namespace asbuilt {

/// What blurs the place where the cutter meets the edge, beside AdaptedEdge::covariance (which holds the tool's part; it is named
/// here only to be told apart in the budget).
struct GateTerms {
  Mat3 tool = Mat3::Zero();            // of the tip, in part, mm^2
  double scatter_mm = 0;               // 1 sd per axis of the robot between two motions
  double interpolation_mm = 0;         // half range of the path's chord error
  std::vector<Mat3> posture;           // by station: of cutting in another posture than the reference; empty: none
};
GateTerms gate_terms(const Job& job, const ToolSpec& tool, const Mat3& R_part_tool, double path_tolerance_mm);

/// P(both legs within width +- tolerance), the edge's place being normal with the covariance (3x3, part, mm^2).
double leg_probability(const CutterPlacement& at, const Mat3& covariance, double width_mm, double tolerance_mm);
/// P(the cut goes deeper than the deepest chamfer in tolerance by more than damage_mm) along the chamfer's normal.
double gouge_probability(const CutterPlacement& at, const Mat3& covariance, double width_mm, double tolerance_mm, double damage_mm);

struct GateResult {
  std::vector<double> probability_ratio;  // by station
  double share_ratio = 0;                 // expected share of the edge's length in tolerance
  double whole_ratio = 0;                 // P(every station in tolerance), errors taken as common to the edge
  double gouge_worst_ratio = 0;
  std::size_t worst_station = 0;
  // shares of the mean variance along the chamfer's normal
  double share_edge = 0, share_tool = 0, share_scatter = 0, share_interpolation = 0, share_posture = 0, sd_mm = 0;
  double bias_mm = 0;                     // how far the planned legs themselves are from the width, at most
};
GateResult judge_edge(const AdaptedEdge& edge, const std::vector<CutterPlacement>& at, const Recipe& recipe, const GateTerms& terms,
                      double damage_mm);

/// The override of the job that names this edge and has not expired on the day of the scan; none: nullptr.
const Override* override_for(const Job& job, const std::string& edge_id);

}  // namespace asbuilt
