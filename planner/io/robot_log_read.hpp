// SPDX-License-Identifier: GPL-3.0-or-later
// Between the readers of robot logs: packets and rows as written, before order is made of them.
#pragma once

#include "planner/io/robot_log.hpp"

namespace asbuilt::robot_log_detail {

struct RawSample {
  double clock_s = 0;  // as written
  RobotLogSample value;
  double flash = 0;
};
struct RawLog {
  std::vector<RawSample> samples;
  double wrap_s = 0;   // the clock starts again after this much; 0: never
  RobotLog facts;      // everything but samples, cycle, flash and the counts of order
};

Result<RawLog> read_rsi(std::string_view bytes, const std::string& name, const std::string& flash);
Result<RawLog> read_table(std::string_view bytes, const std::string& name, const std::string& flash);

}  // namespace asbuilt::robot_log_detail
