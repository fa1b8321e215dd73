// SPDX-License-Identifier: GPL-3.0-or-later
// Where to scan from before an item is worked: poses of the sensor for every edge, a short tour over them, and what they will see.
#pragma once

#include <optional>

#include "planner/artefacts/inspection.hpp"
#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct InspectRecipe {
  double station_mm = 1.0;              // between the stations of an edge
  double cone_rad = rad_from_deg(30);   // alternatives lie this far about a wanted direction at most
  int cone_count = 37;                  // directions in the cone, the wanted one first
  int turns_count = 24;                 // about the tool's axis or the line of sight
  double stretch_ratio = 0.62;          // longest stretch of an edge for one view, of the field's smaller side
  double points_min_count = 6;          // on each face in a station's window (one station long, to 2.6 mm from the edge): fewer is not seen
  double points_reserve_ratio = 1.5;    // a view counts where it is expected to give this much more than the least
  double coverage_min_ratio = 0.95;     // of an edge's stations
  double aim_margin_mm = 1.5;           // kept inside the field and the range, beside what is not known of the part's place
  double clearance_mm = 3.0;
  double joint_margin_rad = 0.02;
  double singularity_min_ratio = 0.02;  // of the posture at the stop
  double transfer_speed_ratio = 0.3;
  double correlation_count = 4;         // neighbouring points share their noise: so many count as one
  int short_move_count = 160;           // moves that BIT* tries where the straight one is blocked
  int planner_iterations_count = 4000;  // of the search where neither it nor a raised way was found
  template <class S, class A>
  static void visit(S& s, A&& a) {
    a("station", s.station_mm), a("cone", s.cone_rad), a("cone_count", s.cone_count), a("turns", s.turns_count), a("stretch", s.stretch_ratio);
    a("points_min", s.points_min_count), a("points_reserve", s.points_reserve_ratio), a("coverage_min", s.coverage_min_ratio);
    a("aim_margin", s.aim_margin_mm), a("clearance", s.clearance_mm), a("joint_margin", s.joint_margin_rad);
    a("singularity_min", s.singularity_min_ratio), a("transfer_speed", s.transfer_speed_ratio), a("correlation", s.correlation_count);
    a("short_move", s.short_move_count), a("planner_iterations", s.planner_iterations_count);
  }
};

/// For every stretch of every worked edge two views: the flange in the working orientation (free to turn about the tool's axis), and
/// the sensor along the mean normal of the two faces. What is unreachable, touches something or does not see enough is looked for
/// in a cone about the wanted direction, then nearer and farther. The fewest views that see every station and face from both kinds,
/// as far as any view can, are kept and joined to a short tour from home to home, every move certified.
///
/// Frames    base; the part stands at `location` (its covariance widens the margin at the field's rim).
/// Units     mm, rad.
/// Method    rays from points on both faces beside every station to the sensor's two eyes, past part, fixture, obstacles, arm and what
///           hangs on the flange; expected points from the density of pixels on the face. Greedy set cover and removal of what
///           became superfluous. Order: exact up to 11 views, else 2-opt and moving of runs, by joint time. Moves: straight, else
///           BIT* (Gammell, Srinivasa, Barfoot 2015), else raised or RRTConnect; certificates after Schwarzer, Saha, Latombe (2005).
///           sd: both faces as fitted locally (algorithms B6.4), mount, arm's error between scan and working posture, tool.
/// Refuses   inspect.nothing_to_do, inspect.sensor (none that takes pictures), inspect.tool, inspect.part_not_located, inspect.not_covered (which
///           edge, where, how much, what would help), inspect.budget, inspect.no_transfer, inspect.home, robot.bad_kinematics.
Result<Done<Inspection>> plan_inspection(const InspectRecipe& recipe, const Job& job, const Location& location);

/// The location that the fixture alone gives: its nominal pose, the play as standard deviation (half range / sqrt 3).
/// Refuses inspect.part_not_located where an angle is free.
Result<Location> location_of_fixture(const Job& job);

}  // namespace asbuilt
