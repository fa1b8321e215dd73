// SPDX-License-Identifier: GPL-3.0-or-later
// What the captures determine: sd of measured points over the field, directions that only the priors hold, named faults by score tests,
// and which poses to add. Frames: base, flange, sensor, target. mm, rad, s.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "planner/calibrate/profilometer_solve.hpp"

namespace asbuilt {

/// 7 x 7 places of the field: over the box of the sightings, or the whole image where the sheet is given.
std::vector<Vec2> field_points(const ProfilometerProblem& problem, const std::optional<ProfilometerSheet>& sheet);

/// Sd of measured points from the covariance of the parameters; the rigid part of their error as a covariance of the hand-eye.
FieldQuality field_quality(const ProfilometerState& state, const Eigen::MatrixXd& covariance, const std::vector<Vec2>& field, Mat6* rigid = nullptr);

/// Directions of the intrinsics and the latency that owe more than `share_max` to the priors; poses are eliminated first.
std::vector<OpenDirection> open_directions(const ProfilometerProblem& problem, const Information& information, const ProfilometerState& state,
                                           const std::vector<Vec2>& field, double share_max_ratio);

/// Directions that nothing holds: sd above 20 mm, 0.2 rad or twice the size of the number. Empty when all is well.
std::vector<std::string> loose_directions(const ProfilometerProblem& problem, const Information& information);

/// What moves together in a direction v (scaled parameters), largest first: "hand-eye z, target z".
std::string direction_name(const std::vector<std::string>& names, const Eigen::VectorXd& v);

/// One more cause added to the model: its best value, its covariance and by how much chi2 falls.
struct ScoreTest {
  Eigen::VectorXd value;
  Eigen::MatrixXd covariance;
  double chi2 = 0;
};
/// The sensor sits elsewhere from group `first` on by a twist (sensor frame, t then r). One test for each first = 1 .. groups - 1.
std::vector<ScoreTest> moved_sensor_tests(const ProfilometerProblem& problem, const ProfilometerState& state);
/// The plate is larger than its file, along its x and y.
ScoreTest plate_scale_test(const ProfilometerProblem& problem, const ProfilometerState& state);

/// A pose that may be added to the captures.
struct PoseCandidate {
  std::string name;
  Pose<frame::Target, frame::Sensor> T_target_sensor;  // half way through the pass
  Vec3 way_target = Vec3::UnitX();                     // direction of the pass
  bool is_both_ways = true;
};
struct PoseSuggestion {
  PoseCandidate candidate;
  FlangePose T_base_flange;        // half way through the pass
  std::size_t hole_count = 0;      // that would be seen
  double field_sd_mm = 0;          // median of the largest axis once this pose and those before it are there
};
/// Three distances, level and tilted by 10, 20, 30 degrees about both axes, turned by 0, 90, 180 and 270 degrees, passed both ways.
std::vector<PoseCandidate> pose_candidates(const HolePlate& plate, const std::vector<double>& offsets_mm);

/// Greedy choice of the poses that lower the field's sd most, until `field_sd_mm` or `count_max`. `is_reachable` may be empty.
/// Method: information of each candidate with its own robot error marginalised; trace of the field's covariance after adding it.
std::vector<PoseSuggestion> poses_to_add(const ProfilometerProblem& problem, const ProfilometerState& state, const std::vector<Vec2>& field,
                                         const std::vector<PoseCandidate>& candidates, double field_sd_mm, std::size_t count_max,
                                         double speed_mm_s, const std::function<bool(const FlangePose&)>& is_reachable = {});

}  // namespace asbuilt
