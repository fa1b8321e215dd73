// SPDX-License-Identifier: GPL-3.0-or-later
// The edges to be worked as stations, with places on both faces beside each, in base.
#pragma once

#include <vector>

#include "planner/artefacts/job.hpp"
#include "planner/artefacts/location.hpp"
#include "planner/plan/inspect/sensor_view.hpp"

namespace asbuilt::inspecting {

struct Station {
  double s_mm = 0;
  Vec3 p = Vec3::Zero(), tangent = Vec3::UnitX();  // base
  std::array<Vec3, 2> n, into;                     // outward normals, and the direction into each face across the edge
  std::array<std::vector<Patch>, 2> patches;       // up to four on each face, 0.4 to 2.6 mm from the edge
};

struct EdgeStations {
  int edge = -1;                 // index into Brep::edges
  std::string id, feature;
  const Recipe* recipe = nullptr;
  std::vector<Station> stations;
};

/// A stretch of an edge that one view can take in.
struct Stretch {
  int edge = 0;                  // index into the edges
  std::size_t begin = 0, end = 0;  // stations
  Vec3 middle = Vec3::Zero(), mean_normal = Vec3::UnitZ();  // base
};

constexpr double kBandFrom_mm = 0.4, kBandTo_mm = 2.6;

/// In order of feature id, then edge id (as numbers where they are): the same for any order in the files.
std::vector<EdgeStations> stations_of(const Job& job, const Location& location, double station_mm);
std::vector<Stretch> stretches_of(const std::vector<EdgeStations>& edges, double longest_mm);

}  // namespace asbuilt::inspecting
