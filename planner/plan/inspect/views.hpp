// SPDX-License-Identifier: GPL-3.0-or-later
// Views that can be had: poses of the arm with the sensor on a stretch of an edge, reachable, clear of everything, and what each sees of
// all edges.
#pragma once

#include <vector>

#include "planner/artefacts/inspection.hpp"
#include "planner/plan/inspect/cover.hpp"
#include "planner/plan/inspect/inspect.hpp"
#include "planner/plan/inspect/stations.hpp"
#include "planner/plan/motion/cell_scene.hpp"

namespace asbuilt::inspecting {

/// Everything views are looked for with.
struct Workshop {
  const InspectRecipe* recipe = nullptr;
  const CellSpec* cell_spec = nullptr;
  const Robot* robot = nullptr;
  const Robot* free_robot = nullptr;      // the same arm without joint limits, to tell why there is no solution
  const CellScene* cell = nullptr;
  std::vector<Watch> watches;
  std::vector<int> sensors;               // usable ones, the quietest first
  std::vector<SensorEye> eyes;            // parallel to CellSpec::sensors
  Blockers blockers;
  const ToolSpec* tool = nullptr;
  double margin_mm = 0;                   // of the aim
  std::vector<EdgeStations> edges;
  std::vector<std::size_t> first_station; // of each edge in the list of all
  std::size_t stations_count = 0;
};

struct ViewCandidate {
  int stretch = 0, sensor = 0;
  ViewKind kind = ViewKind::working;
  double tilt_rad = 0, turn_rad = 0, distance_mm = 0, share_ratio = 0, clearance_mm = 0;
  JointVector q{};
  Pose<frame::Base, frame::Flange> T_base_flange;
  std::vector<float> points;              // expected, two for each station of all edges: face 1, face 2
};

/// Expected points of every station and face from a stand. Stations outside [begin, end) of the list of all are left at 0.
std::vector<float> expected_points(const Workshop& shop, const Stand& stand, std::size_t begin, std::size_t end);
/// The station and face gives as many points as are asked for, with the reserve.
bool is_enough(const InspectRecipe& recipe, float points);

/// The sensor's pose for a stretch: the flange's orientation kept and moved so that the middle is at the distance (working), or the sensor
/// along `look` (normal), turned about it.
Pose<frame::Base, frame::Flange> aimed_working(const SensorSpec& sensor, const Vec3& tool_axis_base, double turn_rad,
                                               const Pose<frame::Flange, frame::Tool>& T_flange_tool, const Vec3& target_base, double distance_mm);
Pose<frame::Base, frame::Flange> aimed_normal(const SensorSpec& sensor, const Vec3& look_base, double turn_rad, const Vec3& target_base, double distance_mm);

/// Directions in the cone about an axis, the axis first, then by tilt; spread evenly (sunflower).
std::vector<Vec3> cone_directions(const Vec3& axis, double half_angle_rad, int count);

/// The views of one kind for a stretch: of the wanted direction where that sees enough, else with the best of the cone about it.
/// What was tried is appended.
std::vector<ViewCandidate> views_for(const Workshop& shop, const Stretch& stretch, int stretch_index, ViewKind kind, std::vector<TriedView>& tried);

}  // namespace asbuilt::inspecting
