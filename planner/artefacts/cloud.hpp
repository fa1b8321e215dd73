// SPDX-License-Identifier: GPL-3.0-or-later
// Stage 3's artefact: all captures placed in base by calibration and commanded robot pose, with normals and sigma.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "planner/base/frames.hpp"

namespace asbuilt {

/// One capture of a cloud, or what a stream saw from about one place. Its points are [begin, end) of the cloud's arrays.
struct CloudCapture {
  std::string name;
  int sensor = -1;                       // index into CellSpec::sensors
  std::optional<std::string> feature;
  Pose<frame::Base, frame::Flange> T_base_flange;  // as commanded
  Pose<frame::Base, frame::Sensor> T_base_sensor;  // commanded flange times calibrated sensor
  std::optional<std::array<double, 6>> q_rad;      // the joints, where the capture names them
  Mat6 covariance_sensor = Mat6::Zero(); // of the hand-eye, child frame (sensor): common to all captures of one sensor
  double noise_mm = 0;                   // 1 sd of a point along its ray, measured from the data where it exceeds the sheet
  double spacing_mm = 0;                 // median distance to the nearest neighbour
  std::size_t begin = 0, end = 0;
  std::size_t dropped_count = 0, outlier_count = 0;
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("sensor", s.sensor), a("feature", s.feature), a("T_base_flange", s.T_base_flange);
    a("T_base_sensor", s.T_base_sensor), a("q", s.q_rad), a("covariance_sensor", s.covariance_sensor), a("noise", s.noise_mm);
    a("spacing", s.spacing_mm), a("begin", s.begin), a("end", s.end), a("dropped", s.dropped_count), a("outliers", s.outlier_count);
  }
};

/// What was found out about one stream while it was fused.
struct StreamSummary {
  std::string name;
  double offset_s = 0, offset_sigma_s = 0;               // t_robot = t_sensor + offset, as used
  double motion_offset_s = 0, motion_sigma_s = -1;       // from the motion alone; sigma negative: not seen
  std::array<double, 2> flash_offset_s{};                // the interval the flashes leave
  int flash_count = 0;
  double scale_ratio = 1, scale_sigma_ratio = -1;        // true depth / stated depth; sigma negative: not seen
  int frames_count = 0, frames_cut_count = 0;            // cut: the robot's place is not known well enough
  int lost_count = 0, late_count = 0, repeated_count = 0, reset_count = 0;  // packets of the robot log
  double gap_max_s = 0, interpolation_sigma_mm = 0;      // worst gap bridged, and what it may cost
  double speed_max_mm_s = 0;
  std::uint64_t points_count = 0;                        // readings used
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("name", s.name), a("offset", s.offset_s), a("offset_sigma", s.offset_sigma_s), a("motion_offset", s.motion_offset_s);
    a("motion_sigma", s.motion_sigma_s), a("flash_offset", s.flash_offset_s), a("flashes", s.flash_count), a("scale", s.scale_ratio);
    a("scale_sigma", s.scale_sigma_ratio), a("frames", s.frames_count), a("frames_cut", s.frames_cut_count), a("lost", s.lost_count);
    a("late", s.late_count), a("repeated", s.repeated_count), a("resets", s.reset_count), a("gap_max", s.gap_max_s);
    a("interpolation_sigma", s.interpolation_sigma_mm), a("speed_max", s.speed_max_mm_s), a("points", s.points_count);
  }
};

struct MeasuredCloud {
  std::vector<CloudCapture> captures;      // in file order, the views of a stream one after the other
  std::vector<Vec3> p_base;                // mm; raw points that passed the outlier test (edges and burrs are kept)
  std::vector<Eigen::Vector3f> n_base;     // unit, towards the sensor; zero where no normal could be estimated
  std::vector<float> sigma_mm;             // 1 sd along the ray
  std::vector<std::int32_t> capture;       // index into captures
  std::vector<StreamSummary> streams;      // one for each capture that was a stream
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("captures", s.captures), a("p", s.p_base), a("n", s.n_base), a("sigma", s.sigma_mm), a("capture", s.capture);
    a("streams", s.streams);
  }
};

}  // namespace asbuilt
