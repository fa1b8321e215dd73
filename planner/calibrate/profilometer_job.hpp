// SPDX-License-Identifier: GPL-3.0-or-later
// `asbuilt calibrate` for a line scanner and a plate with holes: a request's passes -> calibration, in the words of the other targets.
#pragma once

#include <string>
#include <vector>

#include "planner/artefacts/captures.hpp"
#include "planner/calibrate/check.hpp"
#include "planner/calibrate/profilometer.hpp"

namespace asbuilt {

struct ProfilometerResult {
  ProfilometerCalibration solved;
  Pose<frame::Flange, frame::Sensor> T_flange_sensor;  // of a metric device: so that its own x, z are met as well as can be
  Mat6 covariance = Mat6::Zero();                      // of the field's points as a rigid motion, in the sensor's frame
  ProfileMap map;
  double accuracy_mm = 0;                              // held-out holes, rms vector
  double noise_mm = 0;                                 // of a pass's measurement of the plate: place, 1 sd per axis
  std::vector<ReferenceView> references;               // one a pass
};

/// Frames    T_flange_sensor and its covariance as in the calibration file: child frame, translation first.
/// Units     mm, rad, s.
/// Method    profilometer.hpp from raw passes. A device that delivers mm gets a map of the plane close to the identity; one that delivers
///           pixels the camera model of its sheet, or a map without lens.
/// Refuses   calibrate.target_not_supported (no line scanner on the flange), and what calibrate_profilometer refuses.
Result<Done<ProfilometerResult>> calibrate_hole_plate(const CalibrationRequest& request);

/// Where each pass saw the plate, with the calibration given: captures that `check_calibration` can compare. A pass without holes comes
/// back without a pose, and its refusal is said in a note.
/// Refuses   calibrate.target_not_supported, calibrate.no_reference (a calibration without a map of the profiles).
Result<Done<CalibrationRequest>> plate_poses(const CalibrationRequest& request, const EarlierCalibration& calibration);

std::string hole_plate_report(const CalibrationRequest& request, const ProfilometerResult& result);

}  // namespace asbuilt
