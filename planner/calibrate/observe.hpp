// SPDX-License-Identifier: GPL-3.0-or-later
// From captures to the observations of a network and its starts, by kind of target. Internal to the room.
#pragma once

#include "planner/calibrate/calibrate.hpp"

namespace asbuilt {

struct Observed {
  Network network;
  NetworkState base;                 // constants of the sensor to start from
  std::vector<MotionView> motions;   // views with a whole pose of the target
  std::vector<std::size_t> motion_view;  // which view of the network each belongs to
  std::vector<MotionStart> starts;   // of targets that give no whole pose
  std::vector<SeenLine> seen;
  std::vector<Note> notes;
  double sensor_sd = 0;              // of one coordinate of one observation
  std::optional<double> length_ratio, length_sd_ratio;
};

Result<Observed> observe(const CalibrationRequest& request);

// surfaces.cpp: planes and circles in points
struct PlaneFit {
  Vec3 normal = Vec3::UnitZ();  // towards the sensor
  double distance_mm = 0;       // normal . p = distance
  double rms_mm = 0;
  std::vector<std::size_t> inliers;
};
/// The plane with most points within 4 sigma; none below `min_count`.
std::optional<PlaneFit> find_plane(const std::vector<Vec3>& points, double sigma_mm, std::size_t min_count, std::uint64_t seed);

struct ArcFit {
  Vec3 center = Vec3::Zero();  // in the profile's plane y = const
  double radius_mm = 0, rms_mm = 0;
  std::vector<std::size_t> inliers;
};
/// The circular arc of a radius up to `radius_max_mm` with most points within 4 sigma, on the side that faces the sensor.
std::optional<ArcFit> find_arc(const std::vector<Vec3>& points, double radius_max_mm, double sigma_mm, std::uint64_t seed);

/// All points lie in the plane y = const of the sensor: a laser line.
bool is_profile(const std::vector<Vec3>& points);

/// Starts for one ball, seen whole or by laser lines: a grid of orientations, each refined on the centres (of the arcs).
std::vector<MotionStart> ball_line_starts(const Network& network, double radius_mm, double sigma_mm, const std::optional<Pose<frame::Flange, frame::Sensor>>& nominal);

}  // namespace asbuilt
