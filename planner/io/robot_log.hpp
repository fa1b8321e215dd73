// SPDX-License-Identifier: GPL-3.0-or-later
// Where a robot was and when, as its controller wrote it down: KUKA RSI packets (XML, clock IPOC in ms), or a table of poses or joints.
// The clock is made to run on (wraps of IPOC, a restart), packets are put in order, repeated ones are counted once.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

struct RobotLogSample {
  double t_s = 0;
  Pose<frame::Base, frame::Tool> T_base_tool;  // actual; of the tool that was active when the log was written
  std::array<double, 6> joints_deg{};          // actual
};
struct LogReset {
  double t_s = 0, jump_s = 0;  // the clock as written fell by this much; the log goes on one cycle later
};
struct RobotLog {
  std::vector<RobotLogSample> samples;         // times ascend
  bool has_poses = false, has_joints = false;
  std::array<bool, 6> has_joint{};             // joints with a reading
  std::string joints_source;                   // which columns or tags the joints came from
  std::array<bool, 6> has_secondary{};         // second encoders; columns of zeros are no encoders
  std::array<double, 6> secondary_sd_deg{};    // scatter of second against first encoder
  std::array<double, 6> speed_rms_deg_s{};     // derivative of position against the log's own speed, rms
  std::array<double, 6> speed_slope_ratio{};   // and the slope between them; 0 where there is nothing to compare
  double cycle_s = 0;                          // median step
  std::vector<std::array<double, 2>> flash_s;  // rising edges of the flash channel: off at the first time, on at the second
  bool has_flash_channel = false;
  std::size_t repeated_count = 0, late_count = 0, wrap_count = 0, broken_count = 0, nul_count = 0;
  std::vector<LogReset> resets;
  std::vector<std::string> absent_columns;     // columns that hold nothing but zeros
};

/// `flash`: name of the channel that shows the flash ("FLASH", "Digin.o1"), or empty.
/// Units     in: mm, degree; s unless the column says otherwise (_ms, _us, _ns, ipoc: ms, ticks_100ns). metres where a column says _m.
/// Refuses   input.log_format (neither packets nor a table), input.log_columns (no time, or neither pose nor joints),
///           input.log_value, input.log_empty (fewer than two samples), input.log_clock (time stands still, runs backwards, is no
///           number), input.log_time_base (positions and speeds of the log contradict each other), input.log_channel (no such
///           channel), input.table_*.
Result<RobotLog> read_robot_log(std::string_view bytes, const std::string& name, const std::string& flash);

}  // namespace asbuilt
