// SPDX-License-Identifier: GPL-3.0-or-later
// The virtual cell: an imperfect part, burrs, two sensors with correlated noise, a robot whose real arm differs. It writes a
// batch as a user would and, in another folder, the truth. The planner never sees the truth.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt {

/// A view that was planned: taken as it stands instead of the simulator's own detail views.
struct PlannedCapture {
  std::string sensor, cloud, feature;
  std::array<double, 6> q_rad{};
};

struct Scenario {
  std::string part = "ring";       // ring | bracket | casting | freeform
  std::uint64_t seed = 1;
  double turn_rad = -1;            // of the ring about its axis; negative: random
  double tilt_rad = -1;            // negative: random within the fixture's play
  std::string trap;                // "", or the fault to build in (see docs/formats.md)
  double trap_size = 1;            // of a fault that has a size: 1 is gross
  bool is_light = false;           // fewer pixels
  double width_mm = 0, tolerance_mm = 0;  // of the recipe; 0: the part's usual ones
  std::string item_id;             // "": part and seed
  std::vector<PlannedCapture> captures;  // of a scans file (as `asbuilt inspect` writes it); empty: the simulator's own
};

/// Writes out/batch (a complete batch) and out/truth. Refuses input.bad_scenario.
Result<Done<std::filesystem::path>> simulate(const Scenario& scenario, const std::filesystem::path& out);

/// A scenario file ("asbuilt: scenario/1") -> Scenario.
Result<Done<Scenario>> load_scenario(const std::filesystem::path& file);

/// How far a finished run is from the truth: named numbers (edge_p95_mm, chamfer_within_ratio, burr_rms_mm, ...).
Result<Done<std::map<std::string, double>>> compare_with_truth(const std::filesystem::path& out_item, const std::filesystem::path& truth);

}  // namespace asbuilt
