// SPDX-License-Identifier: GPL-3.0-or-later
// From raw passes to a calibration: holes found and numbered without one, a rough solve, cones fitted with it, the solve; once more with
// the better calibration.
#include <fmt/format.h>

#include <algorithm>

#include "planner/base/number.hpp"
#include "planner/calibrate/profilometer_holes.hpp"
#include "planner/calibrate/profilometer_start.hpp"

namespace asbuilt {

Result<Done<ProfilometerCalibration>> calibrate_profilometer(const ProfilometerRecipe& recipe, const HolePlate& plate, const std::vector<ProfileScan>& scans,
                                                             const std::optional<ProfilometerSheet>& sheet) {
  Refusals refusals;
  std::vector<const ProfileScan*> used;
  std::vector<std::vector<HoleBlob>> blobs;
  std::vector<std::vector<NumberedHole>> numbers;
  std::vector<HoleView> rough;
  for (const ProfileScan& scan : scans) {
    if (scan.T_base_flange.size() < 2 || scan.t_s.size() != scan.T_base_flange.size() || scan.begin.size() != scan.t_s.size() + 1) {
      refusals.push_back({.code = "calibrate.holes_not_found", .where = scan.name, .message = "fewer than two profiles with a time and a pose each; scan the plate again", .stage = "input"});
      continue;
    }
    auto found = find_holes(scan);
    if (!found) {
      refusals.insert(refusals.end(), found.error().begin(), found.error().end());
      continue;
    }
    auto numbered = number_holes(plate, *found, scan.name);
    if (!numbered) {
      refusals.insert(refusals.end(), numbered.error().begin(), numbered.error().end());
      continue;
    }
    used.push_back(&scan), blobs.push_back(std::move(*found)), numbers.push_back(std::move(*numbered));
    rough.push_back(rough_view(scan, plate, blobs.back(), numbers.back()));
  }
  // a few bad passes are named and left out; most of them bad is another matter
  if (refusals.size() * 4 > scans.size() || used.size() < 4) {
    if (refusals.empty())
      return refuse({.code = "calibrate.too_few_poses", .where = "captures", .message = fmt::format("found {} passes, 4 poses are the least: add passes", used.size()), .measured = double(used.size()),
                     .limit = 4, .unit = "poses", .stage = "input"});
    return refuse_all(refusals);
  }

  ProfilometerRecipe local = recipe;
  if (!sheet && !recipe.is_metric && recipe.bend_sd_mm < 0.5) local.bend_sd_mm = 1, local.degree_count = std::max(5, recipe.degree_count);  // an unknown lens
  const bool is_camera = local.model == ProfilometerModel::camera && sheet;
  ProfilometerProblem problem{&local, &plate, grouped(rough), is_camera ? camera_parameters(*sheet) : plane_map_parameters(local.degree_count, local.bend_sd_mm)};
  const auto linear = linear_start(plate, problem.groups, local.degree_count);
  const Vec2 scale = linear_plate_scale(plate, problem.groups);
  if (linear && (std::abs(scale.x() - 1) > 0.05 || std::abs(scale.y() - 1) > 0.05))  // said with its number there
    return calibrate_profilometer(local, plate, rough, sheet);
  if (!linear)
    return refuse({.code = "calibrate.not_converged", .where = "captures", .message = "no start can be found: the poses are not numbers or all alike; check the poses of the captures", .limit = 1,
                   .unit = "starts", .stage = "input"});
  // without the robot's error as a cause: the dips' middles are off by more
  ProfilometerState state = solve_joint(problem, is_camera ? camera_from_plane_map(*linear, *sheet) : *linear).state;

  std::vector<HoleView> views;
  for (int round = 0; round < 2; ++round) {
    views.clear();
    std::vector<double> depths;
    for (std::size_t i = 0; i < used.size(); ++i) {
      ConeFits fits = fit_cones(*used[i], plate, blobs[i], numbers[i], state);
      views.push_back(std::move(fits.view));
      depths.insert(depths.end(), fits.depth_ratios.begin(), fits.depth_ratios.end());
    }
    if (depths.size() < 50)
      return refuse({.code = "calibrate.holes_not_found", .where = "captures", .message = fmt::format("{} holes could be fitted as cones, 50 are the least: finer profiles, or another plate's file", depths.size()),
                     .measured = double(depths.size()), .limit = 50, .unit = "holes", .stage = "input"});
    std::nth_element(depths.begin(), depths.begin() + std::ptrdiff_t(depths.size() / 2), depths.end());
    const double depth = depths[depths.size() / 2];
    if (depth < 0.7 || depth > 1.3)
      return refuse({.code = "calibrate.plate_mismatch", .where = plate.name,
                     .message = fmt::format("the holes are {} times as deep as cones of {} degrees: another plate, or its cone angle or diameter is wrong", fixed_number(depth, 2),
                                            fixed_number(deg_from_rad(plate.cone_rad), 0)),
                     .measured = depth, .limit = depth < 1 ? 0.7 : 1.3, .unit = "ratio", .stage = "input"});
    problem.groups = grouped(views);
    if (round == 0) state = solve_joint(problem, state).state;
  }
  auto done = calibrate_profilometer(local, plate, views, sheet, state);
  if (!done) return done;
  for (const Refusal& r : refusals) done->notes.push_back({Note::Level::warning, "calibrate.pass_left_out", r.code + ": " + r.message, r.where});
  return done;
}

}  // namespace asbuilt
