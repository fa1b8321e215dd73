// SPDX-License-Identifier: GPL-3.0-or-later
// The parameters of the arm's error and how large each typically is on a calibrated industrial arm, before they are stretched
// to the cell's figures. Internal to the room.
#pragma once

#include <array>

#include "planner/base/frames.hpp"

namespace asbuilt {

constexpr int kParametersPerJoint = 10;
constexpr int kErrorParameters = 6 * kParametersPerJoint + 2;

/// Order within a joint: shift x, y, z; tilt about two lines across the axis; zero; sin q, cos q, sin 2q, cos 2q.
struct JointErrorScale {
  double shift_mm, tilt_rad, zero_rad, wave_rad;  // 1 sd
};
/// The heavy axes carry long castings between them; the wrist is one small housing.
inline constexpr std::array<JointErrorScale, 6> kJointErrorScale{{{0.15, rad_from_deg(0.004), rad_from_deg(0.008), rad_from_deg(0.0022)},
                                                                  {0.15, rad_from_deg(0.004), rad_from_deg(0.008), rad_from_deg(0.0022)},
                                                                  {0.15, rad_from_deg(0.004), rad_from_deg(0.008), rad_from_deg(0.0022)},
                                                                  {0.12, rad_from_deg(0.002), rad_from_deg(0.004), rad_from_deg(0.001)},
                                                                  {0.06, rad_from_deg(0.001), rad_from_deg(0.003), rad_from_deg(0.001)},
                                                                  {0.06, rad_from_deg(0.001), rad_from_deg(0.004), rad_from_deg(0.001)}}};
inline constexpr double kSag_rad = rad_from_deg(0.004);  // at full reach
/// Scatter of single motions, joint by joint, in proportion: the small drives at the wrist are coarser.
inline constexpr std::array<double, 6> kScatterRatio{1.0, 1.0, 1.2, 2.0, 2.0, 3.0};

}  // namespace asbuilt
