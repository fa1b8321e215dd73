// SPDX-License-Identifier: GPL-3.0-or-later
// How fast the cutter may go: cross-section of chamfer and burr against the removal rate, chip load, and how many passes that takes.
// Source: algorithms B8.1, B8.2, B8.4.
#pragma once

#include <vector>

#include "planner/artefacts/burrs.hpp"
#include "planner/artefacts/job.hpp"

namespace asbuilt {

/// What has to be reckoned with at a station: the upper bound where the burr was seen, what cannot be ruled out where it was not.
struct BurrBound {
  double height_mm = 0, area_mm2 = 0;
};
/// Cross-section per height of the burrs of one recipe, mm: what 85 of 100 measured stations stay under. A single station's
/// thickness is poorly measured, its height well: so the feed follows the height, and the thickness is that of the kind of burr.
double burr_thickness_mm(const std::vector<const EdgeBurr*>& burrs);
/// Parallel to the burr's stations: upper bound of the height, times the thickness or what was measured around the station if that is more.
std::vector<BurrBound> burr_bounds(const EdgeBurr& burr, double burr_max_height_mm, double thickness_mm);

/// Fastest TCP speed by recipe and chip load alone, mm/s.
double feed_ceiling_mm_s(const Recipe& recipe, const Cutter& cutter);

/// Cross-section that a pass takes away at a station: the burr between two planes parallel to the chamfer (outer_mm > inner_mm, both
/// measured outward from the finished chamfer's edge), plus the chamfer itself in the last pass. The fin's direction and profile are
/// unknown: the worst of leaning or upright, even or pointed is returned.
double pass_area_mm2(const BurrBound& burr, double outer_mm, double inner_mm, double chamfer_area_mm2);

struct PassDepths {
  std::vector<double> offsets_mm;  // outward from the chamfer, first pass first; the last is 0. Empty: not within max_passes
  double worst_area_mm2 = 0;       // the largest cross-section any pass takes
};
/// The fewest passes that keep every cross-section under area_max_mm2.
PassDepths choose_passes(const std::vector<BurrBound>& burr, const std::vector<double>& chamfer_area_mm2, double area_max_mm2,
                         int passes_max_count);

/// The least value within +-reach of each position; positions ascending.
std::vector<double> windowed_min(const std::vector<double>& position_mm, const std::vector<double>& value, double reach_mm);

struct FeedBlock {
  std::size_t begin = 0, end = 0;  // indices of the points it starts from and ends at
  double feed_mm_s = 0;            // a multiple of 0.1
};
/// Cuts a polyline into blocks of constant feed: chords within chord_mm of the points, feed never above the limit of any point in it,
/// steps of a few percent, blocks no shorter than three cycles of the controller or 1 mm where the geometry allows. `keep` points are
/// always block ends.
std::vector<FeedBlock> feed_blocks(const std::vector<Vec3>& point, const std::vector<Vec3>& axis, const std::vector<double>& limit_mm_s,
                                   const std::vector<char>& keep, double chord_mm, double feed_min_mm_s);

}  // namespace asbuilt
