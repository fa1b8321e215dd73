// SPDX-License-Identifier: GPL-3.0-or-later
// Order in a robot log: one clock that runs on, packets in their order, each once.
#include "planner/io/robot_log.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/io/robot_log_read.hpp"

namespace asbuilt {
namespace {

using robot_log_detail::RawLog;
using robot_log_detail::RawSample;

constexpr double kLateCyclesMax = 25;    // a packet that comes this much too late is late, not a clock that was set back
constexpr double kWrapSlack_s = 60;      // around the end of a counter
constexpr std::size_t kResetsMax = 8;

double median_step(const std::vector<RawSample>& samples) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const double d = samples[i].clock_s - samples[i - 1].clock_s;
    if (d > 0) steps.push_back(d);
  }
  if (steps.empty()) return 0;
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

/// How far the counter fell where it is one that starts again at 2^31 or 2^32 ms; 0 where it is not that.
double wrap_of(double before_s, double after_s, bool is_counter) {
  if (!is_counter) return 0;
  for (const double end_s : {2147483.648, 4294967.296})
    if (std::abs(before_s - end_s) < kWrapSlack_s && after_s >= 0 && after_s < kWrapSlack_s) return end_s;
  if (std::abs(before_s - 2147483.648) < kWrapSlack_s && std::abs(after_s + 2147483.648) < kWrapSlack_s) return 4294967.296;
  return 0;
}

}  // namespace

Result<RobotLog> read_robot_log(std::string_view bytes, const std::string& name, const std::string& flash) {
  const bool is_xml = bytes.substr(0, 4096).find('<') != std::string_view::npos;
  auto raw = is_xml ? robot_log_detail::read_rsi(bytes, name, flash) : robot_log_detail::read_table(bytes, name, flash);
  if (!raw) return refuse_all(raw.error());
  RobotLog log = std::move(raw->facts);
  const auto refused = [&](const char* code, const std::string& message, double measured, double limit, const char* unit) {
    return refuse({.code = code, .where = name, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "input"});
  };
  if (raw->samples.size() < 2)
    return refused("input.log_empty", fmt::format("found {} samples, allowed at least two; was the log switched on?", raw->samples.size()),
                   static_cast<double>(raw->samples.size()), 2, "samples");
  for (const RawSample& s : raw->samples)
    if (!std::isfinite(s.clock_s) || std::abs(s.clock_s) > 1e12)
      return refused("input.log_clock", "found a time that is no number, allowed seconds that ascend", 0, 0, "");
  log.cycle_s = median_step(raw->samples);
  if (!(log.cycle_s > 0))
    return refused("input.log_clock", "found a clock that never moves on; the log holds one moment only", 0, 0, "s");

  std::vector<std::pair<double, std::size_t>> order;
  order.reserve(raw->samples.size());
  double shift = 0, latest = raw->samples[0].clock_s, before = latest;
  for (std::size_t i = 0; i < raw->samples.size(); ++i) {
    const double clock = raw->samples[i].clock_s;
    double t = clock + shift;
    if (t < latest - 0.01 * log.cycle_s) {
      const double wrap = wrap_of(before, clock, raw->wrap_s > 0);
      if (wrap > 0) {
        shift += wrap, t += wrap;
        ++log.wrap_count;
      } else if (latest - t <= kLateCyclesMax * log.cycle_s) {
        ++log.late_count;
      } else {
        const double jump = t - latest;
        shift += log.cycle_s - jump, t = latest + log.cycle_s;
        log.resets.push_back({t, -jump});
        if (log.resets.size() > kResetsMax)
          return refused("input.log_clock", fmt::format("found the clock set back {} times, allowed {} at most; time cannot be told from this log", log.resets.size(), kResetsMax),
                         static_cast<double>(log.resets.size()), static_cast<double>(kResetsMax), "resets");
      }
    }
    latest = std::max(latest, t), before = clock;
    order.emplace_back(t, i);
  }
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  log.samples.reserve(order.size());
  double flash_before = 0;
  for (const auto& [t, i] : order) {
    if (!log.samples.empty() && t - log.samples.back().t_s < 0.01 * log.cycle_s) {
      ++log.repeated_count;
      continue;
    }
    const RawSample& s = raw->samples[i];
    if (!log.samples.empty() && s.flash > 0.5 && flash_before <= 0.5) log.flash_s.push_back({log.samples.back().t_s, t});
    flash_before = s.flash;
    log.samples.push_back(s.value);
    log.samples.back().t_s = t;
  }
  if (log.samples.size() < 2)
    return refused("input.log_empty", "found one moment only, allowed at least two; was the log switched on?", 1, 2, "samples");
  return log;
}

}  // namespace asbuilt
