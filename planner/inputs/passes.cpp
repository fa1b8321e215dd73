// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/inputs/passes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "planner/io/cloud_file.hpp"
#include "planner/io/robot_log.hpp"
#include "planner/io/stream_files.hpp"

namespace asbuilt::inputs {

namespace fs = std::filesystem;

namespace {

constexpr double kLogGapMax_s = 0.1;  // between two samples of the log around a profile

struct Bytes {
  std::string bytes, name;
};
std::optional<Bytes> bytes_of(Sources& sources, Readout& out, const fs::path& file, const std::string& field, const std::string& text) {
  const auto path = sources.resolve(out, field, file, text);
  if (!path) return std::nullopt;
  auto b = sources.read(out, field, *path);
  if (!b) return std::nullopt;
  return Bytes{std::move(*b), sources.name_of(*path)};
}

/// Points of a cloud as profiles: those of one y belong together, in the order of the file.
std::optional<ProfileFile> profiles_of_cloud(Readout& out, const std::string& field, const std::string& name, const std::vector<Eigen::Vector3f>& points, double speed_mm_s) {
  ProfileFile f;
  for (const Eigen::Vector3f& p : points) {
    const double t = double(p.y()) / speed_mm_s;
    if (!f.lines.empty() && t < f.lines.back().t_s - 1e-9) {
      out.fault("input.profile_clock", field, "found in " + name + " a y smaller than the one before, allowed profiles in the order they were taken: y is the way gone since base_flange");
      return std::nullopt;
    }
    if (f.lines.empty() || t > f.lines.back().t_s + 1e-9) f.lines.push_back({t, f.points.size(), f.points.size()});
    f.points.emplace_back(p.x(), 0.f, p.z());
    f.lines.back().end = f.points.size();
  }
  return f;
}

}  // namespace

std::optional<ProfileScan> read_pass(Sources& sources, Readout& out, Refusals& faults, const fs::path& file, const std::string& at, const TargetCaptureText& text, TargetCapture& capture,
                                     const std::optional<Robot>& robot, bool& is_metric) {
  const auto take = [&](const Refusals& r) { faults.insert(faults.end(), r.begin(), r.end()); };
  if (!text.profiles == !text.cloud) {
    out.fault("input.capture_empty", at, "found profiles and cloud, or neither, allowed one of them: a pass over the plate");
    return std::nullopt;
  }
  if (!text.robot_log && !(text.base_flange && text.velocity_mm_s)) {
    out.fault("input.pass_without_way", at, "found neither robot_log nor base_flange with velocity, allowed one of them: where the flange was at each profile");
    return std::nullopt;
  }
  if (text.cloud && !text.velocity_mm_s) {
    out.fault("input.pass_without_way", at + ".velocity", "found a cloud without velocity, which is required: its y is a way, and the trigger's latency needs the time");
    return std::nullopt;
  }
  const std::string field = at + (text.profiles ? ".profiles" : ".cloud");
  const auto b = bytes_of(sources, out, file, field, text.profiles ? *text.profiles : *text.cloud);
  if (!b) return std::nullopt;
  ProfileFile profiles;
  if (text.profiles) {
    auto read = read_profiles(b->bytes, b->name, std::nullopt, true);
    if (!read) return take(read.error()), std::nullopt;
    profiles = std::move(*read);
  } else {
    auto cloud = read_cloud(b->bytes, b->name);
    if (!cloud) return take(cloud.error()), std::nullopt;
    auto made = profiles_of_cloud(out, field, b->name, cloud->points, text.velocity_mm_s->norm());
    if (!made) return std::nullopt;
    profiles = std::move(*made);
  }
  is_metric = !profiles.is_pixel;

  ProfileScan scan;
  scan.name = capture.name, scan.is_held_out = capture.is_held_out;
  std::vector<double> t_log;
  std::vector<Pose<frame::Base, frame::Flange>> T_log;
  if (text.robot_log) {
    const auto l = bytes_of(sources, out, file, at + ".robot_log", *text.robot_log);
    if (!l) return std::nullopt;
    const auto log = read_robot_log(l->bytes, l->name, "");
    if (!log) return take(log.error()), std::nullopt;
    if (!log->has_poses && !robot) {
      out.fault("input.log_columns", at + ".robot_log", "found joints and no poses in " + l->name + ", and no arm to place the flange by; allowed poses of the flange");
      return std::nullopt;
    }
    for (const RobotLogSample& s : log->samples) {
      t_log.push_back(s.t_s);
      if (log->has_poses) {
        T_log.push_back(s.T_base_tool * Pose<frame::Tool, frame::Flange>());
      } else {
        std::array<double, 6> q{};
        for (std::size_t i = 0; i < 6; ++i) q[i] = rad_from_deg(s.joints_deg[i]);
        T_log.push_back(robot->forward(q));
      }
    }
  }
  std::size_t outside = 0;
  scan.begin.push_back(0);
  for (const ProfileFile::Line& line : profiles.lines) {
    Pose<frame::Base, frame::Flange> T;
    if (text.robot_log) {
      const auto next = std::upper_bound(t_log.begin(), t_log.end(), line.t_s);
      const auto i = next - t_log.begin();
      if (i == 0 || next == t_log.end() || *next - *(next - 1) > kLogGapMax_s) {
        ++outside;
        continue;
      }
      const double share = (line.t_s - t_log[std::size_t(i - 1)]) / (t_log[std::size_t(i)] - t_log[std::size_t(i - 1)]);
      const auto &a = T_log[std::size_t(i - 1)], &c = T_log[std::size_t(i)];
      T = {a.q.slerp(share, c.q), (1 - share) * a.p_mm + share * c.p_mm};
    } else {
      T = {capture.T_base_flange.q, capture.T_base_flange.p_mm + *text.velocity_mm_s * (line.t_s - profiles.first_s)};
    }
    scan.t_s.push_back(line.t_s), scan.T_base_flange.push_back(T);
    for (std::size_t k = line.begin; k < line.end; ++k) scan.uv.emplace_back(profiles.points[k].x(), profiles.points[k].z());
    scan.begin.push_back(std::uint32_t(scan.uv.size()));
  }
  if (outside * 10 > profiles.lines.size() || scan.t_s.size() < 2) {
    out.fault("input.log_does_not_cover", at + ".robot_log", fmt::format("found {} of {} profiles outside the log or in its gaps, allowed a tenth; log before the first profile until after the last, by one clock", outside, profiles.lines.size()),
              double(outside), double(profiles.lines.size()) / 10, "profiles");
    return std::nullopt;
  }
  capture.T_base_flange = scan.T_base_flange[scan.t_s.size() / 2];
  return scan;
}

}  // namespace asbuilt::inputs
