// SPDX-License-Identifier: GPL-3.0-or-later
// Robot logs as tables: poses or joints against time. Columns of zeros are encoders that are not there.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "planner/io/csv_table.hpp"
#include "planner/io/robot_log_read.hpp"
#include "planner/io/text_scan.hpp"

namespace asbuilt::robot_log_detail {
namespace {

struct Column {
  int index = -1;
  double unit = 1;
};

Column time_column(const CsvTable& t) {
  if (const int i = t.column({"t", "t_s", "time", "time_s", "timestamp", "timestamp_s"}); i >= 0) return {i, 1};
  if (const int i = t.column({"ipoc", "ipoc_ms", "t_ms", "time_ms", "timestamp_ms"}); i >= 0) return {i, 1e-3};
  if (const int i = t.column({"t_us", "time_us", "timestamp_us"}); i >= 0) return {i, 1e-6};
  if (const int i = t.column({"ticks_100ns", "t_100ns", "time_100ns"}); i >= 0) return {i, 1e-7};
  return {t.column({"t_ns", "time_ns", "timestamp_ns"}), 1e-9};
}

/// Six columns whose names are `before` + 1..6 + `after`.
std::array<int, 6> six(const CsvTable& t, const std::string& before, const std::string& after) {
  std::array<int, 6> all{};
  for (int i = 0; i < 6; ++i) all[static_cast<std::size_t>(i)] = t.column({before + std::to_string(i + 1) + after});
  return all;
}
bool is_there(const std::array<int, 6>& all) { return std::all_of(all.begin(), all.end(), [](int i) { return i >= 0; }); }

bool is_zero(const CsvTable& t, int column) {
  for (std::size_t r = 0; r < t.rows_count; ++r)
    if (t.at(r, column) != 0) return false;
  return true;
}

double sd_of_difference(const CsvTable& t, int a, int b) {
  double mean = 0, square = 0;
  for (std::size_t r = 0; r < t.rows_count; ++r) mean += t.at(r, a) - t.at(r, b);
  mean /= static_cast<double>(t.rows_count);
  for (std::size_t r = 0; r < t.rows_count; ++r) {
    const double d = t.at(r, a) - t.at(r, b) - mean;
    square += d * d;
  }
  return std::sqrt(square / static_cast<double>(t.rows_count));
}

}  // namespace

Result<RawLog> read_table(std::string_view bytes, const std::string& name, const std::string& flash) {
  auto read = read_csv_table(bytes, name);
  if (!read) return refuse_all(read.error());
  const CsvTable& t = *read;
  const auto refused = [&](const char* code, const std::string& message, double measured = 0, double limit = 0, const char* unit = "") {
    return refuse({.code = code, .where = name, .message = message, .measured = measured, .limit = limit, .unit = unit, .stage = "input"});
  };
  RawLog log;
  RobotLog& facts = log.facts;
  facts.nul_count = t.nul_count, facts.broken_count = t.broken_count;
  const Column time = time_column(t);
  if (time.index < 0)
    return refused("input.log_columns", "found no column of time, allowed t, t_s, time_s, t_ms, ipoc (ms), t_us, ticks_100ns, t_ns");
  log.wrap_s = t.columns[static_cast<std::size_t>(time.index)].starts_with("ipoc") ? 1 : 0;

  // poses
  std::array<int, 3> xyz{t.column({"x", "x_mm"}), t.column({"y", "y_mm"}), t.column({"z", "z_mm"})};
  double length = 1;
  if (const std::array<int, 3> m{t.column({"x_m"}), t.column({"y_m"}), t.column({"z_m"})}; xyz[0] < 0 && m[0] >= 0) xyz = m, length = 1000;
  const std::array<int, 4> wxyz{t.column({"qw"}), t.column({"qx"}), t.column({"qy"}), t.column({"qz"})};
  const std::array<int, 3> abc{t.column({"a", "a_deg"}), t.column({"b", "b_deg"}), t.column({"c", "c_deg"})};
  const std::array<int, 3> rpy{t.column({"rx", "rx_deg"}), t.column({"ry", "ry_deg"}), t.column({"rz", "rz_deg"})};
  const auto all = [](const auto& a) { return std::all_of(a.begin(), a.end(), [](int i) { return i >= 0; }); };
  facts.has_poses = all(xyz) && (all(wxyz) || all(abc) || all(rpy));

  // joints
  std::array<int, 6> joints{-1, -1, -1, -1, -1, -1};
  for (const auto& [before, after] : {std::pair<const char*, const char*>{"act_pos_motor_deg_a", ""}, {"act_pos_deg_a", ""}, {"act_pos_deg_j", ""}, {"a", "_deg"}, {"a", ""}, {"j", "_deg"},
                                      {"j", ""}, {"q", "_deg"}, {"q", ""}, {"joint_", ""}, {"joint", "_deg"}, {"joint", ""}})
    if (const auto found = six(t, before, after); is_there(found)) {
      joints = found;
      facts.joints_source = std::string(before) + "1.." + after;
      break;
    }
  facts.has_joints = is_there(joints);
  if (!facts.has_poses && !facts.has_joints) {
    const bool is_commanded = t.column({"ref_pos_deg_a1", "rsol_x", "ref_x"}) >= 0;
    return refused("input.log_columns", is_commanded ? std::string("found commanded positions only, allowed actual ones: a robot is not where it was told to be while it moves")
                                                     : std::string("found neither a pose (x y z with qw qx qy qz, a b c or rx ry rz) nor six joints (a1.. j1.. q1..)"));
  }
  if (facts.has_joints) {
    for (std::size_t i = 0; i < 6; ++i) {
      facts.has_joint[i] = !is_zero(t, joints[i]);
      if (!facts.has_joint[i]) facts.absent_columns.push_back(t.columns[static_cast<std::size_t>(joints[i])]);
    }
    if (const auto second = six(t, "act_pos_secondary_encoder_deg_a", ""); is_there(second))
      for (std::size_t i = 0; i < 6; ++i) {
        facts.has_secondary[i] = !is_zero(t, second[i]);
        if (!facts.has_secondary[i]) facts.absent_columns.push_back(t.columns[static_cast<std::size_t>(second[i])]);
        else facts.secondary_sd_deg[i] = sd_of_difference(t, second[i], joints[i]);
      }
  }
  const int flash_column = flash.empty() ? -1 : [&] {
    std::string lower;
    for (const char c : flash) lower += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return t.column({lower});
  }();
  if (!flash.empty() && flash_column < 0)
    return refused("input.log_channel", "found no column " + text_scan::shown_word(flash) + " in the log, allowed the name of one of its columns");
  facts.has_flash_channel = flash_column >= 0;

  log.samples.resize(t.rows_count);
  for (std::size_t r = 0; r < t.rows_count; ++r) {
    RawSample& s = log.samples[r];
    s.clock_s = t.at(r, time.index) * time.unit;
    bool is_number = true;
    const auto value = [&](int column) {
      const double v = t.at(r, column);
      is_number = is_number && std::isfinite(v) && std::abs(v) < 1e9;
      return v;
    };
    if (facts.has_poses) {
      s.value.T_base_tool.p_mm = length * Vec3(value(xyz[0]), value(xyz[1]), value(xyz[2]));
      if (all(wxyz)) {
        Eigen::Quaterniond q(value(wxyz[0]), value(wxyz[1]), value(wxyz[2]), value(wxyz[3]));
        is_number = is_number && std::abs(q.norm() - 1) < 0.01;
        s.value.T_base_tool.q = is_number ? q.normalized() : Eigen::Quaterniond::Identity();
      } else {
        const auto& e = all(abc) ? abc : rpy;
        std::array<double, 3> w{rad_from_deg(value(e[0])), rad_from_deg(value(e[1])), rad_from_deg(value(e[2]))};
        if (!all(abc)) std::swap(w[0], w[2]);
        s.value.T_base_tool.q = quat_from_zyx(w[0], w[1], w[2]);
      }
    }
    if (facts.has_joints)
      for (std::size_t i = 0; i < 6; ++i) s.value.joints_deg[i] = value(joints[i]);
    if (!is_number)
      return refused("input.log_value", fmt::format("found no pose in row {} (an empty field, or a quaternion that is not of length 1), allowed numbers in every row", r + 1));
    if (flash_column >= 0) s.flash = std::isfinite(t.at(r, flash_column)) ? t.at(r, flash_column) : 0;
  }

  // the log's own speeds against the derivative of its positions
  const auto speeds = six(t, "act_vel_motor_deg_s_a", "");
  if (facts.has_joints && is_there(speeds) && t.rows_count > 20) {
    for (std::size_t i = 0; i < 6; ++i) {
      double square = 0, vv = 0, dv = 0;
      std::size_t used = 0;
      for (std::size_t r = 1; r + 1 < t.rows_count; ++r) {
        const double dt = log.samples[r + 1].clock_s - log.samples[r - 1].clock_s;
        if (!(dt > 0)) continue;
        const double d = (t.at(r + 1, joints[i]) - t.at(r - 1, joints[i])) / dt, v = t.at(r, speeds[i]);
        if (!std::isfinite(v)) continue;
        square += (d - v) * (d - v), vv += v * v, dv += d * v;
        ++used;
      }
      if (used == 0) continue;
      facts.speed_rms_deg_s[i] = std::sqrt(square / static_cast<double>(used));
      if (vv > static_cast<double>(used)) facts.speed_slope_ratio[i] = dv / vv;  // rms speed above 1 degree/s
      if (facts.speed_slope_ratio[i] != 0 && std::abs(facts.speed_slope_ratio[i] - 1) > 0.05)
        return refused("input.log_time_base", fmt::format("found the positions of joint {} moving {:.3f} times as fast as the log's own speeds say, allowed 0.95 to 1.05: the time or the unit of a column is wrong", i + 1, facts.speed_slope_ratio[i]),
                       facts.speed_slope_ratio[i], 1.05, "");
    }
  }
  return log;
}

}  // namespace asbuilt::robot_log_detail
