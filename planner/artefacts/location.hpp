// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 4's artefact: where the part sits, as the controller has to be told, and how well the data say so.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

struct Hypothesis {
  Pose<frame::Base, frame::Part> T_base_part;
  double log_likelihood_ratio = 0;  // best minus this one; 0 for the winner
  double inlier_ratio = 0;
  std::string note;                 // "rotated 45.0 deg about the symmetry axis"
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("base_part", s.T_base_part), a("log_likelihood_ratio", s.log_likelihood_ratio), a("inlier_ratio", s.inlier_ratio), a("note", s.note);
  }
};

struct Location {
  Pose<frame::Base, frame::Part> T_base_part;
  Mat6 covariance = Mat6::Zero();             // child frame (part): t mm, r rad
  double rms_mm = 0, inlier_ratio = 0;
  std::vector<double> singular_values;        // of the data's information against the prior, descending (1: prior and data alike)
  std::vector<std::string> weak_directions;   // in words: "rotation about the part's z axis: 0.4 deg (1 sd)"
  std::vector<Hypothesis> hypotheses;         // best first
  /// One per capture: p_base_corrected = correction.point(p_base). Robot pose error of that capture relative to the
  /// working orientation, found jointly with the part under the robot's error as prior.
  std::vector<Pose<frame::Base, frame::Base>> corrections;
  std::vector<Mat6> correction_covariances;   // child frame
  /// By feature ("" for what belongs to none): the tool pose for which corrected points are true commands; see Features.
  std::map<std::string, Pose<frame::Base, frame::Tool>> T_base_tool_reference;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("base_part", s.T_base_part), a("covariance", s.covariance), a("rms", s.rms_mm), a("inlier_ratio", s.inlier_ratio);
    a("singular_values", s.singular_values), a("weak_directions", s.weak_directions), a("hypotheses", s.hypotheses);
    a("corrections", s.corrections), a("correction_covariances", s.correction_covariances);
    a("tool_reference", s.T_base_tool_reference);
  }
};

}  // namespace asbuilt
