// SPDX-License-Identifier: GPL-3.0-or-later
// The checks themselves, each with the number that decides: what every program has to hold, and what an item's has to hold besides.
#pragma once

#include "planner/verify/clearance.hpp"
#include "planner/verify/cut.hpp"
#include "planner/verify/replay.hpp"
#include "planner/verify/verify.hpp"

namespace asbuilt::verifying {

/// What the verifier insists on. Numbers of the cell and the recipe come on top.
struct Limits {
  double clearance_mm = 1.0;         // tool, sensors and links from everything
  double part_margin_mm = 0;         // on top, from the part: how far the real one may leave the drawing where it lies
  double cutter_fixture_mm = 0.5;    // the cutter from fixture and obstacles
  double rapid_part_mm = 0.3;        // the cutter from part and burr where it does not cut
  double self_mm = 1.0;              // tool and sensors from the arm
  double orientation_step_rad = 0.0873, orientation_rules_rad = 0.0021;  // 5 deg a block; 0.12 deg between the rules
  double jump_rad = 0.0698;          // 4 deg between two samples of a linear move
  double singularity_ratio = 0.01;
  double path_error_mm = 0.02, path_target_mm = 0.005, axis_error_rad = 0.0005;
  double blend_off_mm = 0.015, spline_rules_mm = 0.02;
  double stray_mm = 0.09, mean_leg_mm = 0.04, end_mm = 1.0;
  double removal_ratio = 1.10, removal_share_ratio = 0.01;
  double home_rad = 0.0002, frame_mm = 0.002, frame_rad = 4e-6, tool_mm = 0.002, tool_rad = 4e-6;
  double linear_speed_max_mm_s = 2000;
  double view_mm = 0.1, view_rad = 0.0002;  // a stop for a picture, from where it was planned: printed digits and pulses
};

void add_check(Verdict& v, const std::string& name, double measured, double limit, const std::string& unit, bool is_passed, const std::string& where);

/// Order, tools, spindle, limits, speeds, singularity: what needs no geometry but the arm.
void check_program(Verdict& v, const CellSpec& cell, const Program& program, const Replay& r, const Limits& limits);

/// Collision of everything that moves with the standing bodies.
void check_clearance(Verdict& v, const CellSpec& cell, const Arm& arm, const Program& program, const Replay& r, const std::vector<char>& is_cutting,
                     const Cutter* cutter, const Pose<frame::Flange, frame::Tool>& T_flange_tool, const std::vector<Standing>& world,
                     const Standing* part, const Limits& limits);

/// Angle between two frames that may differ by right angles about their axes besides: a dialect may turn the frame it writes in,
/// to keep its angles off their wrap. What the points mean is compared in base.
double turn_but_right_angles_rad(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);

struct ItemView {
  const Job& job;
  const Location& location;
  const Features& features;
  const Burrs& burrs;
  const ToolPath& path;
};
/// Path, feed, chamfer, gouge, stray cut, rapid motion near burrs.
void check_item(Verdict& v, const ItemView& item, const Program& program, const Replay& r, const std::vector<char>& is_cutting, const Limits& limits);

}  // namespace asbuilt::verifying
