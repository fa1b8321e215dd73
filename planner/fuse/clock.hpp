// SPDX-License-Identifier: GPL-3.0-or-later
// The offset between the clocks of sensor and robot: t_robot = t_sensor + offset. Three ways that do not know of each other.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <vector>

#include "planner/fuse/trajectory.hpp"

namespace asbuilt::fuse_detail {

struct OffsetInterval {
  double low_s = 0, high_s = 0;
  int flash_count = 0;
  double sigma_s() const { return (high_s - low_s) / 3.4641016151377544; }
  double middle_s() const { return 0.5 * (low_s + high_s); }
};
/// Flashes: frames that are suddenly bright against the log's edges. A frame is bright when the light came on before its exposure
/// ended, and the frame before is not: every pair leaves an interval, all intervals are intersected.
/// Nothing when no flash is seen, or when the intervals of the flashes have no time in common.
std::optional<OffsetInterval> flash_offset(const std::vector<StreamFrame>& frames, const std::vector<std::array<double, 2>>& log_flash_s);
/// Frames in which a flash begins: brighter than the frames around by 6 robust sd and by a twentieth of the range.
std::vector<std::size_t> bright_frames(const std::vector<StreamFrame>& frames);

/// What two frames say about the sensor's motion between them: sum of squared point-to-plane distances as a quadratic form in
/// (xi, b) around `motion`; T_first_second = motion * exp(xi), depth scaled by 1 + b.
struct MotionPair {
  double t_first_s = 0, t_second_s = 0;  // sensor's clock
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 7, 7> A = Eigen::Matrix<double, 7, 7>::Zero();
  Eigen::Matrix<double, 7, 1> g = Eigen::Matrix<double, 7, 1>::Zero();
  double c = 0;
  int points_count = 0;
};

struct MotionOffset {
  double offset_s = 0, sigma_s = 0;      // sandwich over pairs
  double scale_ratio = 1, scale_sigma_ratio = 0;
  double misfit_mm = 0;                  // median over pairs of what the robot's motion leaves over beyond the frames' own best, rms a point
  double scatter_mm = 0;                 // median rms of a point at the frames' own best
  int pairs_count = 0;
  struct Window {
    double t_s = 0, offset_s = 0, sigma_s = 0;
  };
  std::vector<Window> windows;           // the offset by time, where enough pairs see it
};
/// Gauss-Newton in offset (and depth scale, when `with_scale`) with weights that bound a pair's say; `prior_sigma_s` <= 0: no prior.
/// Nothing when no pair can be used.
std::optional<MotionOffset> solve_offset(const std::vector<MotionPair>& pairs, const Trajectory& robot, const Pose<frame::Flange, frame::Sensor>& T_flange_sensor, double start_s,
                                         bool with_scale);

struct OffsetSearch {
  double offset_s = 0;
  double second_ratio = 0;               // how near the second-best minimum comes: 0 far, 1 equally good
};
/// The best offset in [low, high] by the pairs' equations; steps of `step_s`.
std::optional<OffsetSearch> search_offset(const std::vector<MotionPair>& pairs, const Trajectory& robot, const Pose<frame::Flange, frame::Sensor>& T_flange_sensor, double low_s, double high_s,
                                          double step_s);

/// Streams of poses of any two bodies on one rigid link (hand and eye): the offset for which the turns of the one are those of the
/// other, seen from a frame turned by a fixed rotation. Needs no calibration. (Rotation rates; Kabsch for the rotation.)
struct TimedRotation {
  double t_s = 0;
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  // body in its fixed frame
};
struct RateOffset {
  double offset_s = 0, sigma_s = 0;      // t_hand = t_eye + offset
  Eigen::Quaterniond q_hand_eye = Eigen::Quaterniond::Identity();
  double residual_rms_rad = 0;           // of a turn over the window
  double second_ratio = 0;
};
std::optional<RateOffset> rotation_rate_offset(const std::vector<TimedRotation>& hand, const std::vector<TimedRotation>& eye, double low_s, double high_s, double window_s);

}  // namespace asbuilt::fuse_detail
