// SPDX-License-Identifier: GPL-3.0-or-later
// Holes of a plate in a raw pass of a profilometer: found as dips of the surface without any calibration, numbered on the raster by the
// three large ones, then placed to a fraction of a pixel by a fit of cone and plate. Units: pixels (or mm of the device) and profiles.
#pragma once

#include <vector>

#include "planner/calibrate/profilometer.hpp"

namespace asbuilt {

/// A dip: where in the profile (u) and in which profile, the face of the plate there (v), its size.
struct HoleBlob {
  double u = 0, v = 0, profile = 0;
  double area_count = 0;                           // samples
  double rim_ratio = 1;                            // radius of the dip as cut out over that of the rim, by its own mean depth
  Eigen::Matrix2d moment = Eigen::Matrix2d::Zero();  // second moments over (u, profile)
};

/// Method    the plate's face as a polynomial of degree 4 over (u, profile), fitted to the largest surface (least 35th percentile of 300
///           planes, then trimmed); connected dips below it. Holes cut by the border of the scan are left out.
/// Refuses   calibrate.holes_not_found.
Result<std::vector<HoleBlob>> find_holes(const ProfileScan& scan);

struct NumberedHole {
  std::size_t blob = 0;
  int column = 0, row = 0;
};

/// Method    centres whitened by the holes' own shape; neighbours on the raster from hole to hole with a local basis; a smooth map of the
///           raster takes in what was left and throws out what is off; all 8 turns and reflections and all shifts against the large holes.
/// Refuses   calibrate.holes_off_raster, calibrate.plate_mismatch, calibrate.plate_ambiguous.
Result<std::vector<NumberedHole>> number_holes(const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::string& scan_name);

/// The sighting of a hole at a profile between two others: flange and velocity interpolated.
HoleSighting sighting_of(const ProfileScan& scan, double profile, const Vec2& uv, int column, int row);

/// Sightings as found, with an sd that covers what a dip's middle is off by.
HoleView rough_view(const ProfileScan& scan, const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::vector<NumberedHole>& holes);

struct ConeFits {
  HoleView view;
  std::vector<double> depth_ratios;  // each cone's depth against the plate's file
};
/// Each hole's cone and the plate around it fitted in the plate's frame with the calibration `state`: centre = axis x face.
/// Method    Gauss-Newton over centre, height, tilt, depth; Tukey weights; sd from the residuals, widened by their correlation along a profile.
ConeFits fit_cones(const ProfileScan& scan, const HolePlate& plate, const std::vector<HoleBlob>& blobs, const std::vector<NumberedHole>& holes,
                   const ProfilometerState& state);

}  // namespace asbuilt
