// SPDX-License-Identifier: GPL-3.0-or-later
// A cell, random neutral programs and the comparison of two neutral programs, for the tests of the posts.
#pragma once

#include <string>

#include "planner/base/random.hpp"
#include "postprocessors/post.hpp"

namespace asbuilt::support {

/// A six-axis cell with two tools (poses with odd digits) and every controller value given.
PostContext post_context();

struct ProgramMix {
  int sections = 3;             // joint move, spindle, work, spindle off
  int points = 12;              // path points a section
  bool has_arcs = true;         // in a plane of the work frame
  bool has_events = true;       // outputs, waits, comments
  bool has_two_tools = true;
  bool has_new_frames = true;
  bool has_equipment = true;    // coolant, arc, weave, recording, tool check
  bool has_splines = true;
  bool has_triggers = false;    // outputs at a place on the path; not every dialect
  bool is_upright = false;      // the tool's angles stay away from their wrap, arcs lie in planes of base
};
/// A program that every dialect can say; the same seed gives the same program.
Program random_program(std::uint64_t seed, const ProgramMix& mix = {});

/// The mix without what the dialect cannot say.
ProgramMix mix_for(const Post& post, ProgramMix mix = {});
/// Whether the dialect prints its points in base, whatever frame was set.
bool prints_in_base(const Post& post, const PostContext& context);

/// A rotation drawn evenly; one in eight has an axis turned by a multiple of 90 degrees (poles of the angle conventions).
Eigen::Quaterniond random_rotation(Random& random);

/// What a dialect's printed digits allow.
struct Tolerance {
  double position_mm = 0.0005, angle_rad = 0, speed_mm_s = 0, speed_ratio = 0.005, rpm = 2, time_s = 0.005, blend_mm = 0.0005;
  JointVector joint_rad{};
  bool is_rounding_kept = true;  // a dialect without rounding stops at every point
  bool is_via_printed = true;  // G02 and G03 print a centre: any point of the arc stands for it
};
Tolerance tolerance_of(const Post& post, const PostContext& context);

/// Empty where `got` says the same as `wanted`: the same motions in the same order with the same events between them, every
/// coordinate in the wanted frame (`is_in_base`: in base) within the tolerance. Frames are compared by what they do to the points.
std::string difference(const Program& wanted, const Program& got, const Tolerance& tolerance, bool is_in_base);

/// The text of all refusals, for a failing test.
std::string text_of(const Refusals& refusals);

}  // namespace asbuilt::support
