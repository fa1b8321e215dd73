// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 5's artefact: every edge to be worked as it really is, with the two fitted surfaces it is the intersection of.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "planner/geom/surface.hpp"

namespace asbuilt {

struct SurfaceFit {
  int face = -1;                          // index into Brep::faces
  std::string face_id, type;              // "#417", "plane"
  std::map<std::string, double> nominal, fitted;  // parameters in part, mm and degree as a person reads them
  Surface surface_part;                   // the fitted surface, in part (base points mapped by inverse(T_base_part))
  bool same_sense = true;                 // outward normal = natural normal, negated when false
  double rms_mm = 0;
  std::size_t points_count = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("face", s.face), a("face_id", s.face_id), a("type", s.type), a("nominal", s.nominal), a("fitted", s.fitted);
    a("surface", s.surface_part), a("same_sense", s.same_sense), a("rms", s.rms_mm), a("points", s.points_count);
  }
};

/// measured: both faces have points beside the station; extrapolated: within the fit's reach; nominal: nothing was seen.
enum class StationStatus { measured, extrapolated, nominal };
inline std::string_view name_of(StationStatus s) {
  return s == StationStatus::measured ? "measured" : s == StationStatus::extrapolated ? "extrapolated" : "nominal";
}

/// Arrays are parallel to s_mm. Frame: part; mapped by Location::T_base_part they are what the controller has to be told.
struct AdaptedEdge {
  int edge = -1;                 // index into Brep::edges
  std::string id, feature;       // "#88", "lug1"
  bool is_closed = false;        // then the last station repeats the first
  std::vector<double> s_mm;      // arc length along the adapted edge; stations at most 0.5 mm apart
  std::vector<Vec3> nominal, adapted, tangent;
  std::vector<Vec3> n_1, n_2;    // outward unit normals of the fitted faces at the station
  std::vector<double> sigma_mm;  // 1 sd across the edge: root of the larger eigenvalue of the cross-section covariance
  std::vector<Mat3> covariance;  // of the adapted point relative to where the tool will really go, mm^2
  std::vector<StationStatus> status;
  std::vector<double> rigid_mm, feature_mm, local_mm;  // parts of |adapted - nominal at the drawing's place| (for the report)
  SurfaceFit surface_1, surface_2;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edge", s.edge), a("id", s.id), a("feature", s.feature), a("is_closed", s.is_closed), a("s", s.s_mm), a("nominal", s.nominal);
    a("adapted", s.adapted), a("tangent", s.tangent), a("n_1", s.n_1), a("n_2", s.n_2), a("sigma", s.sigma_mm);
    a("covariance", s.covariance), a("status", s.status), a("rigid", s.rigid_mm), a("feature_part", s.feature_mm);
    a("local", s.local_mm), a("surface_1", s.surface_1), a("surface_2", s.surface_2);
  }
};

struct Features {
  std::vector<AdaptedEdge> edges;  // in order of feature, then of Brep edge
  /// Refined in the fit: p_base_true = corrections[k].point(p_base) for capture k (starts from Location::corrections).
  std::vector<Pose<frame::Base, frame::Base>> corrections;
  /// By feature: the tool pose (at the middle of the feature) for which adapted points are true commands. The robot's error
  /// differs from posture to posture; motion stays near this turn about the tool axis, or says what leaving it costs.
  std::map<std::string, Pose<frame::Base, frame::Tool>> T_base_tool_reference;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("edges", s.edges), a("corrections", s.corrections), a("tool_reference", s.T_base_tool_reference);
  }
};

}  // namespace asbuilt
