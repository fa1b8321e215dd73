// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 3's artefact: all captures placed in base by calibration and commanded robot pose, with normals and sigma.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

/// One capture of a cloud. Its points are [begin, end) of the cloud's arrays.
struct CloudCapture {
  std::string name;
  int sensor = -1;                       // index into CellSpec::sensors
  std::optional<std::string> feature;
  Pose<frame::Base, frame::Flange> T_base_flange;  // as commanded
  Pose<frame::Base, frame::Sensor> T_base_sensor;  // commanded flange times calibrated sensor
  Mat6 covariance_sensor = Mat6::Zero(); // of the hand-eye, child frame (sensor): common to all captures of one sensor
  double noise_mm = 0;                   // 1 sd of a point along its ray, measured from the data where it exceeds the sheet
  double spacing_mm = 0;                 // median distance to the nearest neighbour
  std::size_t begin = 0, end = 0;
  std::size_t dropped_count = 0, outlier_count = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("sensor", s.sensor), a("feature", s.feature), a("T_base_flange", s.T_base_flange);
    a("T_base_sensor", s.T_base_sensor), a("covariance_sensor", s.covariance_sensor), a("noise", s.noise_mm);
    a("spacing", s.spacing_mm), a("begin", s.begin), a("end", s.end), a("dropped", s.dropped_count), a("outliers", s.outlier_count);
  }
};

struct MeasuredCloud {
  std::vector<CloudCapture> captures;      // in file order
  std::vector<Vec3> p_base;                // mm; raw points that passed the outlier test (edges and burrs are kept)
  std::vector<Eigen::Vector3f> n_base;     // unit, towards the sensor; zero where no normal could be estimated
  std::vector<float> sigma_mm;             // 1 sd along the ray
  std::vector<std::int32_t> capture;       // index into captures
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("captures", s.captures), a("p", s.p_base), a("n", s.n_base), a("sigma", s.sigma_mm), a("capture", s.capture);
  }
};

}  // namespace asbuilt
