// SPDX-License-Identifier: GPL-3.0-or-later
// The files of a moving sensor: images or profiles, the camera's numbers, the robot's log. Images are read one after the other and not
// kept: their hashes and times go on, the stage that fuses them reads them again.
#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "planner/base/hash.hpp"
#include "planner/inputs/item.hpp"
#include "planner/io/depth_image.hpp"
#include "planner/io/robot_log.hpp"
#include "planner/io/stream_files.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt::inputs {

namespace fs = std::filesystem;

namespace {

constexpr double kCommonClockSigma_s = 0.002;  // of clocks said to be one, where nothing else is said
constexpr double kLogContradiction_mm = 5.0;   // joints against poses of one log: above, they are not of the same point
constexpr std::size_t kFramesMax = 100000;

/// Bytes of a file named in the scans file, or nothing after a fault.
std::optional<std::string> bytes_at(Item& item, const std::string& field, const std::string& text, std::string& name) {
  const auto file = item.sources.resolve(item.scans.out, field, item.scans.file, text);
  if (!file) return std::nullopt;
  name = item.sources.name_of(*file);
  return item.sources.read(item.scans.out, field, *file);
}

void take_faults(Item& item, const Refusals& refusals) { item.faults.insert(item.faults.end(), refusals.begin(), refusals.end()); }

/// Names in the order a person counts: 2.png before 10.png.
bool is_before(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (std::isdigit(static_cast<unsigned char>(a[i])) && std::isdigit(static_cast<unsigned char>(b[j]))) {
      std::size_t k = i, l = j;
      while (k < a.size() && std::isdigit(static_cast<unsigned char>(a[k]))) ++k;
      while (l < b.size() && std::isdigit(static_cast<unsigned char>(b[l]))) ++l;
      std::string x = a.substr(i, k - i), y = b.substr(j, l - j);
      x.erase(0, std::min(x.find_first_not_of('0'), x.size())), y.erase(0, std::min(y.find_first_not_of('0'), y.size()));
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
      i = k, j = l;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i, ++j;
    }
  }
  return a.size() != b.size() ? a.size() < b.size() : a < b;
}

void read_log(Item& item, const CaptureText& t, const std::string& at, const CellSpec& cell, Capture& c) {
  const std::string field = at + ".robot_log";
  std::string name;
  const auto bytes = bytes_at(item, field, *t.robot_log, name);
  if (!bytes || item.depth == Depth::bytes) return;
  const auto log = read_robot_log(*bytes, name, t.sync && t.sync->flash ? *t.sync->flash : std::string());
  if (!log) return take_faults(item, log.error());
  Readout& out = item.scans.out;
  Pose<frame::Flange, frame::Tool> T_flange_tool;
  if (t.log_tool) {
    const auto tool = std::find_if(cell.tools.begin(), cell.tools.end(), [&](const ToolSpec& s) { return s.id == *t.log_tool; });
    if (tool == cell.tools.end()) {
      if (item.cell.is_read) out.fault("input.unknown_tool", at + ".log_tool", "found the tool '" + *t.log_tool + "', allowed one that " + item.cell.out.name + " has");
      return;
    }
    T_flange_tool = tool->T_flange_tool;
  }
  std::optional<Robot> robot;
  const bool has_all_joints = log->has_joints && std::all_of(log->has_joint.begin(), log->has_joint.end(), [](bool b) { return b; });
  if (log->has_joints && item.has_kinematics && item.cell.out.faults.empty())
    if (auto made = Robot::from(cell.robot)) robot = std::move(*made);
  if (!log->has_poses && !has_all_joints) {
    std::string absent;
    for (const std::string& a : log->absent_columns) absent += (absent.empty() ? "" : ", ") + a;
    return out.fault("input.log_joint_absent", field, "found nothing but zeros in " + absent + ": an encoder that is not there, and no pose beside it; allowed readings of all six joints, or poses");
  }
  if (!log->has_poses && !robot) return;  // the cell's own fault says why
  const auto pose_of = [&](const RobotLogSample& s) {
    std::array<double, 6> q{};
    for (std::size_t i = 0; i < 6; ++i) q[i] = rad_from_deg(s.joints_deg[i]);
    return robot->forward(q);
  };
  RobotTrack& track = c.stream->robot;
  track.cycle_s = log->cycle_s, track.flash_s = log->flash_s;
  track.repeated_count = static_cast<int>(log->repeated_count), track.late_count = static_cast<int>(log->late_count);
  track.reset_count = static_cast<int>(log->resets.size());
  for (const RobotLogSample& s : log->samples) {
    RobotSample& out_sample = track.samples.emplace_back(RobotSample{s.t_s, log->has_poses ? s.T_base_tool * T_flange_tool.inverse() : pose_of(s), {}});
    if (has_all_joints)
      for (std::size_t i = 0; i < 6; ++i) out_sample.q_rad.emplace_back(rad_from_deg(s.joints_deg[i]));
  }
  if (log->has_poses && has_all_joints && robot) {
    double worst = 0;
    for (std::size_t i = 0; i < track.samples.size(); i += 1 + track.samples.size() / 50)
      worst = std::max(worst, (pose_of(log->samples[i]).p_mm - track.samples[i].T_base_flange.p_mm).norm());
    if (worst > kLogContradiction_mm)
      out.fault("input.log_contradicts", field,
                fmt::format("found poses up to {:.4g} mm from where the log's own joints put the {}, allowed {:g} mm: name the tool that was active in log_tool, and log in the robot's base frame", worst,
                            t.log_tool ? "tool" : "flange", kLogContradiction_mm),
                worst, kLogContradiction_mm, "mm");
  }
  const RobotSample& middle = track.samples[track.samples.size() / 2];
  c.T_base_flange = middle.T_base_flange;
  if (has_all_joints) {
    c.q_rad.emplace();
    std::copy_n(middle.q_rad.begin(), 6, c.q_rad->begin());
  }
  if (const double reach = middle.T_base_flange.p_mm.norm(); reach < 30)
    out.fault("input.pose_unit", field, fmt::format("found the flange {:.3g} mm from the origin of base, allowed outside the robot's own foot; lengths are mm unless the column says _m", reach), reach, 30, "mm");
  if (log->repeated_count + log->late_count + log->wrap_count + log->broken_count + log->nul_count > 0)
    item.note("input.log_repaired",
              fmt::format("{} repeated, {} late, {} broken packets, {} wraps of the clock, {} NUL bytes: put in order", log->repeated_count, log->late_count, log->broken_count, log->wrap_count, log->nul_count),
              name, Note::Level::note);
  for (const LogReset& r : log->resets)
    item.note("input.log_clock_reset", fmt::format("the log's clock falls by {:.3f} s at {:.3f} s; taken as going on one cycle later, which the motion must bear out", r.jump_s, r.t_s), name);
  if (!log->absent_columns.empty()) {
    std::string absent;
    for (const std::string& a : log->absent_columns) absent += (absent.empty() ? "" : ", ") + a;
    item.note("input.log_absent", absent + " hold nothing but zeros and are taken as absent", name, Note::Level::note);
  }
  for (std::size_t i = 0; i < 6; ++i)
    if (log->has_secondary[i] && log->secondary_sd_deg[i] > 0.02)
      item.note("input.log_encoders", fmt::format("the second encoder of joint {} scatters by {:.3f} degree against the first", i + 1, log->secondary_sd_deg[i]), name, Note::Level::note);
}

std::optional<CameraFile> read_camera(Item& item, const CaptureText& t, const std::string& at) {
  std::string name;
  const auto bytes = bytes_at(item, at + ".intrinsics", *t.intrinsics, name);
  if (!bytes || item.depth == Depth::bytes) return std::nullopt;
  auto camera = read_camera_file(*bytes, name);
  if (!camera) {
    take_faults(item, camera.error());
    return std::nullopt;
  }
  if (const auto it = item.calibration.value.sensors.find(t.sensor); it != item.calibration.value.sensors.end() && it->second.intrinsics) {
    const IntrinsicsText& given = *it->second.intrinsics;
    DepthCamera& c = camera->camera;
    item.note("input.intrinsics_calibrated", fmt::format("the calibration's focal length of {:.2f} px stands in place of {:.2f} px", given.fx_px, c.fx_px), name, Note::Level::note);
    c.fx_px = given.fx_px, c.fy_px = given.fy_px, c.cx_px = given.cx_px, c.cy_px = given.cy_px;
    c.distortion_ratio = {};
    for (std::size_t i = 0; i < given.distortion.size() && i < 5; ++i) c.distortion_ratio[i] = given.distortion[i];
  }
  return std::move(*camera);
}

void read_frames(Item& item, const CaptureText& t, const std::string& at, const std::optional<CameraFile>& camera, const SensorSpec* sensor, Capture& c) {
  Readout& out = item.scans.out;
  const std::string field = at + ".frames";
  const auto folder = item.sources.resolve(out, field, item.scans.file, *t.frames);
  if (!folder) return;
  std::error_code error;
  if (!fs::is_directory(*folder, error))
    return out.fault("input.frames_missing", field, "found no folder '" + shown(*t.frames) + "', allowed a folder of 16-bit depth images");
  std::vector<FrameTime> times;
  const fs::path table = *folder / "frames.csv";
  const bool has_table = fs::exists(table, error);
  if (has_table) {
    const auto bytes = item.sources.read(out, field, table);
    if (!bytes) return;
    auto read = read_frame_times(*bytes, item.sources.name_of(table));
    if (!read) return take_faults(item, read.error());
    times = std::move(*read);
  } else {
    for (const auto& e : fs::directory_iterator(*folder, error))
      if (e.path().extension() == ".png" && times.size() <= kFramesMax) times.push_back({e.path().filename().string(), 0, 0, -1});
    std::sort(times.begin(), times.end(), [](const FrameTime& a, const FrameTime& b) { return is_before(a.file, b.file); });
    if (item.depth == Depth::all && camera && !camera->rate_hz && !times.empty())
      return out.fault("input.frames_clock", field, "found no times: allowed frames.csv beside the images (file, t), or fps in the camera file");
    for (std::size_t i = 0; i < times.size(); ++i) times[i].t_s = camera && camera->rate_hz ? static_cast<double>(i) / *camera->rate_hz : 0;
  }
  if (times.size() < 2 || times.size() > kFramesMax)
    return out.fault("input.frames_missing", field, fmt::format("found {} images, allowed 2 to {}", times.size(), kFramesMax), static_cast<double>(times.size()), 2, "images");
  for (std::size_t i = 0; i < times.size(); ++i) {
    const auto file = item.sources.resolve(out, field, *folder / "frames.csv", times[i].file);
    if (!file) return;
    const auto bytes = item.sources.read(out, field, *file);
    if (!bytes) return;
    if (item.depth == Depth::bytes) continue;
    const std::string name = item.sources.name_of(*file);
    const auto header = read_depth_header(*bytes, name);
    if (!header) return take_faults(item, header.error());
    if (camera && camera->camera.width_px > 0 && (header->width_px != camera->camera.width_px || header->height_px != camera->camera.height_px))
      return out.fault("input.frames_size", field,
                       fmt::format("found an image of {} x {} pixels ({}), allowed {} x {} as the camera file says", header->width_px, header->height_px, name, camera->camera.width_px, camera->camera.height_px),
                       header->width_px, camera->camera.width_px, "px");
    if (i == 0) {
      c.stream->camera->width_px = header->width_px, c.stream->camera->height_px = header->height_px;
    } else if (header->width_px != c.stream->camera->width_px || header->height_px != c.stream->camera->height_px) {
      return out.fault("input.frames_size", field, "found images of different sizes (" + name + "), allowed one size");
    }
    if (i == times.size() / 2 && sensor && camera) {  // one image tells the unit
      const auto image = read_depth_image(*bytes, name);
      if (!image) return take_faults(item, image.error());
      std::vector<Eigen::Vector3f> points;
      for (std::size_t k = 0; k < image->depth_count.size(); k += 7)
        if (image->depth_count[k]) points.emplace_back(0.f, 0.f, static_cast<float>(image->depth_count[k] * camera->camera.depth_unit_mm));
      check_unit(item, points, *sensor, at + ".intrinsics");
    }
    c.stream->frames.push_back({.file = name, .sha256 = sha256_hex(*bytes), .t_s = times[i].t_s, .exposure_s = times[i].exposure_s > 0 || !camera ? times[i].exposure_s : camera->exposure_s,
                                .brightness_ratio = times[i].brightness_ratio});
  }
}

void read_lines(Item& item, const CaptureText& t, const std::string& at, const std::optional<CameraFile>& camera, const SensorSpec* sensor, Capture& c) {
  std::string name;
  const auto bytes = bytes_at(item, at + ".profiles", *t.profiles, name);
  if (!bytes || item.depth == Depth::bytes) return;
  const auto calibrated = item.calibration.value.sensors.find(t.sensor);
  const bool has_map = calibrated != item.calibration.value.sensors.end() && calibrated->second.profile_map && is_whole(*calibrated->second.profile_map);
  auto read = read_profiles(*bytes, name, camera, has_map && !calibrated->second.profile_map->is_metric);
  if (!read) return take_faults(item, read.error());
  if (has_map) {
    const ProfileMap map = profile_map_of(*calibrated->second.profile_map);
    if (!map.is_metric && !read->is_pixel)
      return item.scans.out.fault("input.profile_map", at + ".profiles", "found x, z in mm, allowed u, v in pixels: the calibration of sensor '" + t.sensor + "' maps pixels");
    for (Eigen::Vector3f& p : read->points) p = profile_point(map, Vec2(p.x(), p.z())).cast<float>();
    item.note("input.profile_map", "the profiles are mapped by the calibration of sensor " + t.sensor, name, Note::Level::note);
  }
  c.points_sensor = std::move(read->points), c.dropped_count = read->dropped_count;
  for (const ProfileFile::Line& l : read->lines)
    c.stream->frames.push_back({.t_s = l.t_s, .exposure_s = camera ? camera->exposure_s : 0, .begin = l.begin, .end = l.end});
  if (sensor) check_unit(item, c.points_sensor, *sensor, at + ".profiles");
}

}  // namespace

void read_stream(Item& item, const CaptureText& t, const std::string& at, const CellSpec& cell, const SensorSpec* sensor, Capture& c) {
  if (!t.robot_log) return;  // a fault already
  c.stream.emplace();
  ClockSpec& clock = c.stream->clock;
  const SyncText sync = t.sync.value_or(SyncText{});
  clock.uses_flash = sync.flash.has_value();
  clock.is_common = sync.clocks.value_or(sync.flash ? Clocks::separate : Clocks::common) == Clocks::common;
  clock.offset_s = sync.offset_s, clock.sigma_s = sync.offset_sd_s.value_or(kCommonClockSigma_s);
  if (const auto c0 = item.calibration.value.sensors.find(t.sensor); t.profiles && !t.sync && c0 != item.calibration.value.sensors.end() && c0->second.profile_map)
    clock.offset_s = c0->second.profile_map->latency_s, clock.sigma_s = std::max(1e-5, c0->second.profile_map->latency_sd_s);
  std::optional<CameraFile> camera;
  if (t.intrinsics) camera = read_camera(item, t, at);
  if (t.frames) {
    c.stream->camera = camera ? camera->camera : DepthCamera{};
    read_frames(item, t, at, camera, sensor, c);
  } else {
    read_lines(item, t, at, camera, sensor, c);
  }
  read_log(item, t, at, cell, c);
}

}  // namespace asbuilt::inputs
