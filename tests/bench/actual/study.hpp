// SPDX-License-Identifier: GPL-3.0-or-later
// One virtual part through the measuring stages and the gate, in this process, and how far every number is from the truth.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/cloud.hpp"
#include "planner/artefacts/features.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/artefacts/tool_path.hpp"
#include "planner/simulate/simulate.hpp"

namespace asbuilt::study {

struct TruthEdge {
  std::string id, feature;
  std::vector<double> s_mm, burr_mm, width_mm;
  std::vector<Vec3> p, n_1, n_2, touch;  // in base; touch: the command that brings the tip to p
  std::vector<Vec3> seen;                // where a perfect sensor and fit would put p under the calibration and poses given
};
struct Truth {
  double width_mm = 0, tolerance_mm = 0;
  std::vector<TruthEdge> edges;
};

/// One true station away from the edges' ends.
struct Station {
  int edge = 0;
  double error_mm = 0, floor_mm = 0, drawn_mm = 0;        // distance of the real place from the adapted, perfect, drawn line
  double z2 = 0, z_m = 0;                                 // error against its covariance: 2 degrees of freedom, and along the bisector
  double leg_1_mm = 0, leg_2_mm = 0;                      // the ideal chamfer's legs along the adapted line
  bool is_seen = false, is_within = false, is_within_floor = false, is_within_drawn = false;
  double e_1 = 0, e_2 = 0, sd_1 = 0, sd_2 = 0;            // error and claimed sd along the two normals
  double z2_1 = 0, z2_2 = 0;                              // along the two normals
  double burr_true_mm = 0, burr_mm = 0, burr_upper_mm = 0, burr_sd_mm = 0, width_true_mm = 0, width_mm = 0, detection_mm = 0;
  bool is_burr_near = false;                              // true burr within 1.5 mm along the edge
};

struct Run {
  std::string stage, code, message;   // of the refusal; empty: the path was planned
  std::vector<Station> stations;
  std::map<std::string, double> time_s;
  std::vector<double> share_ratio;    // by edge: what the gate expected
  bool is_planned() const { return code.empty(); }
};

struct Options {
  std::filesystem::path cache;        // clouds and locations are kept here: only fit, burr and path run again
  bool is_kept = true;                // false: the folder is removed after the run
  std::function<void(Location&)> disturb;  // a fault between locate and fit
};

Run run(const Scenario& scenario, const Options& options);

double quantile(std::vector<double> v, double q);

}  // namespace asbuilt::study
