// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 6's artefact: what stands proud of the fitted faces along each edge. Unseen is never "no burr".
#pragma once

#include <string>
#include <vector>

namespace asbuilt {

/// Arrays are parallel to AdaptedEdge::s_mm; NaN where nothing was seen; 0 only where the absence was seen.
struct EdgeBurr {
  std::string edge_id;
  std::vector<double> height_mm;        // greatest max(f1, f2) in the cross-section (ISO 13715 "passing")
  std::vector<double> height_sd_mm;
  std::vector<double> width_mm;         // thickness at the root
  std::vector<double> area_mm2;         // cross-section
  std::vector<double> height_upper_mm;  // what cannot be ruled out: feeds and clearances use this
  std::vector<double> coverage_ratio;   // 0..1, share of the cross-section's window that was seen
  double detection_limit_mm = 0;        // a burr above this is found in 95 of 100 stations
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edge", s.edge_id), a("height", s.height_mm), a("height_sd", s.height_sd_mm), a("width", s.width_mm), a("area", s.area_mm2);
    a("height_upper", s.height_upper_mm), a("coverage", s.coverage_ratio), a("detection_limit", s.detection_limit_mm);
  }
};

struct Burrs {
  std::vector<EdgeBurr> edges;  // parallel to Features::edges
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edges", s.edges);
  }
};

}  // namespace asbuilt
