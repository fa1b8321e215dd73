// SPDX-License-Identifier: GPL-3.0-or-later
// One virtual part of any kind, as drawn and as made: what the cell scans, what the STEP file says, which edges are worked and
// where they really are. Frame: part. mm.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "planner/base/random.hpp"
#include "planner/simulate/solid.hpp"

namespace asbuilt::simulate_detail {

/// What stands on an edge and how the recipe treats it.
struct BurrStyle {
  bool is_flash = false;           // a fin in the parting plane instead of one that leans from the bisector
  double mean_min_mm = 0.12, mean_max_mm = 0.45, height_max_mm = 1.2;
  double root_mm = 0.12, root_ratio = 0.25;  // thickness at the root = root + ratio * height
};

struct PartModel {
  std::string step;
  Mesh drawn, made;                   // for ray casting; outward
  std::vector<std::string> features;
  std::vector<TrueEdge> drawn_edges, made_edges;  // same ids, same order
  std::optional<Vec3> axis;           // of rotational symmetry, through the origin
  Vec3 pivot = Vec3::Zero();          // middle of the underside: what sits on the fixture
  Vec3 look_at = Vec3::Zero();        // where the wide views aim
  Vec3 support_mm = Vec3(55, 35, 0);  // half size of the fixture's block (x, y); a ring's is a disc of radius x
  bool is_round_support = false;
  BurrStyle burr;
  std::string recipe_id = "deburr-0.4";
  double width_mm = 0.4, tolerance_mm = 0.1, burr_max_mm = 1.5, removal_max_mm3_s = 3;
  std::string burr_zone;              // lines for part.yaml
  std::string material = "1.4545";
};

const std::vector<std::string>& known_parts();

/// ring | bracket | casting | freeform; `made_of`: another kind whose made part is put on the fixture ("": the same).
/// `with_lugs`: of the ring that is made.
PartModel make_part(const std::string& kind, std::uint64_t seed, const std::string& made_of = "", bool with_lugs = true);

PartModel make_casting(Random& random);
PartModel make_freeform(Random& random);

}  // namespace asbuilt::simulate_detail
