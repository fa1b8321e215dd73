// SPDX-License-Identifier: GPL-3.0-or-later
// What the writers of all dialects need: printed frames, angles, checks of the neutral program, splitting at safe points.
// Never included by a reader.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "postprocessors/post.hpp"

namespace asbuilt::writing {

/// Angles (a, b, c) in rad with R = Rz(a) * Ry(b) * Rx(c), b in [-90, 90] degrees; at the pole a takes the whole turn and c is 0.
std::array<double, 3> zyx_angles(const Mat3& R);

/// The six numbers of a pose as they are printed: mm and degrees, rounded.
struct Printed {
  std::array<double, 3> xyz_mm{}, abc_deg{};  // abc: a about z first, then b about y, c about x
};
Printed print_pose(const Mat3& R, const Vec3& p_mm, int mm_decimals, int deg_decimals);

/// Rounds angles of R = Rz(a) Ry(b) Rx(c) one after the other: what rounding a turns about x is taken back by c, so that the
/// printed rotation is off by at most sqrt(3)/2 of the last digit, at the poles too. Degrees.
std::array<double, 3> round_zyx(std::array<double, 3> abc_deg, int decimals);

/// The frame that the printed numbers name.
Pose<frame::Base, frame::Work> frame_of(const Printed& printed);

/// Which parts of the neutral program a dialect can say, and within which limits.
struct Limits {
  int name_length = 24;
  double speed_min_mm_s = 0, speed_max_mm_s = 3000;
  double wait_min_s = 0, wait_max_s = 1e6;
  bool has_outputs = true;
  bool has_path_events = false;  // outputs at a place on the path
};

/// Everything about a program that no dialect can print: order, names, numbers, tools, spindle signals.
///
/// Frames    in: base.
/// Refuses   post.name, post.not_ascii, post.order, post.not_finite, post.speed, post.joint_speed, post.wait, post.tool,
///           post.spindle, post.output, post.arc, post.spline, post.trigger, post.equipment, post.missing_value.
Refusals check(const Program& program, const PostContext& context, const Limits& limits);

Refusal fault(std::string code, std::string where, std::string message, double measured = 0, double limit = 0, std::string unit = "");

const ToolSpec* find_tool(const PostContext& context, int number);
std::optional<std::string> option(const PostContext& context, const std::string& key);

/// The whole number in an option; refuses (post.option) what is none or outside [lo, hi].
Result<int> option_int(const PostContext& context, const std::string& key, int otherwise, int lo, int hi);

/// Words between blanks; a whole number, or nothing.
std::vector<std::string> words_of(std::string_view text);
std::optional<int> whole_number(std::string_view text);

/// What the program switches besides the spindle, with the numbers of the data, each once, in order.
std::vector<std::pair<Equipment, int>> equipment_of(const Program& program);

/// A refusal (post.option) for every key of the controller's block that this dialect does not know; a known key that ends with a
/// point stands for all that begin with it.
void check_options(const PostContext& context, std::string_view block, const std::vector<std::string_view>& known, Refusals& faults);

/// Where a program may be cut into modules: [begin, end) runs of instructions, each beginning with a joint move, so that every
/// cut is at a joint target away from the work. `weight` lines an instruction may take; a run holds at most `limit` where it can.
std::vector<std::pair<std::size_t, std::size_t>> split(const Program& program, int weight, int limit);

/// Text collected line by line with the controller's line end.
class Lines {
 public:
  explicit Lines(std::string_view line_end) : end_(line_end) {}
  void add(std::string_view line) {
    bytes.append(line);
    bytes.append(end_);
    ++count;
  }
  std::string bytes;
  int count = 0;

 private:
  std::string_view end_;
};

/// The name of module k of a program that is cut: NAME_k; where that grows too long the name is cut and told apart by its hash.
/// Empty where even that does not fit.
std::string module_name(const std::string& name, std::size_t k, int limit);

std::string upper(std::string_view text);
/// Text cut into pieces of at most `width` characters; at least one piece.
std::vector<std::string> pieces(std::string_view text, std::size_t width);

}  // namespace asbuilt::writing
