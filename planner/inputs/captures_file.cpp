// SPDX-License-Identifier: GPL-3.0-or-later
// A captures file with all it names -> CalibrationRequest.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "planner/inputs/files_captures.hpp"
#include "planner/inputs/item.hpp"
#include "planner/inputs/passes.hpp"
#include "planner/inputs/table.hpp"
#include "planner/io/cloud_file.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {

namespace fs = std::filesystem;
using namespace inputs;

namespace {

/// Turns per mm of the stated place: what a typical arm of one metre shows (0.03 degree beside 0.25 mm).
constexpr double kTurnPerLength_rad_mm = 5.2e-4 / 0.25;

struct Loader {
  Sources sources;
  Readout out;
  CapturesFile text;
  fs::path file;
  CalibrationRequest job;
  std::vector<Note> notes;
  Refusals faults;

  void note(std::string code, std::string what, std::string where, Note::Level level = Note::Level::warning) {
    notes.push_back({.level = level, .code = std::move(code), .text = std::move(what), .where = std::move(where)});
  }
  std::optional<std::pair<std::string, std::string>> bytes(const std::string& field, const std::string& name) {
    const auto path = sources.resolve(out, field, file, name);
    if (!path) return std::nullopt;
    auto b = sources.read(out, field, *path);
    if (!b) return std::nullopt;
    return std::pair{std::move(*b), sources.name_of(*path)};
  }
  std::optional<Table> table(const std::string& field, const std::string& name) {
    const auto b = bytes(field, name);
    if (!b) return std::nullopt;
    Table t = parse_table(b->first, b->second);
    if (t.nul_count) note("input.nul_bytes", fmt::format("{} NUL bytes were left out", t.nul_count), b->second, Note::Level::note);
    if (t.has_decimal_comma) note("input.decimal_comma", "commas are read as decimal points", b->second, Note::Level::note);
    return t;
  }
};

void read_cloud_of(Loader& l, const std::string& field, const std::string& name, TargetCapture& c) {
  const auto b = l.bytes(field, name);
  if (!b) return;
  auto cloud = read_cloud(b->first, b->second);
  if (!cloud) {
    l.faults.insert(l.faults.end(), cloud.error().begin(), cloud.error().end());
    return;
  }
  for (const Eigen::Vector3f& p : cloud->points) c.points_mm.push_back(p.cast<double>());
  c.dropped_count = cloud->dropped_count;
}

void read_profile(Loader& l, const std::string& field, const std::string& name, TargetCapture& c) {
  const auto t = l.table(field, name);
  if (!t) return;
  if (t->rows.empty()) return l.out.fault("input.table_empty", field, "found no row in " + t->name + ", allowed x, z or x, y, z");
  const auto x = t->column("x"), y = t->column("y"), z = t->column("z");
  const bool is_named = x && z;
  const std::size_t columns = t->rows.front().size();
  if (!is_named && columns != 2 && columns != 3)
    return l.out.fault("input.table_columns", field, fmt::format("found {} columns in {}, allowed x, z or x, y, z", columns, t->name), double(columns), 3, "columns");
  for (std::size_t i = 0; i < t->rows.size(); ++i) {
    const auto a = t->number(i, is_named ? *x : 0), b = is_named ? (y ? t->number(i, *y) : 0.0) : columns == 3 ? t->number(i, 1) : 0.0, d = t->number(i, is_named ? *z : columns - 1);
    if (!a || !b || !d)
      return l.out.fault("input.table_value", field, fmt::format("found no number in {}:{}, allowed numbers, or nan where nothing was measured", t->name, t->lines[i]));
    if (std::isfinite(*a) && std::isfinite(*b) && std::isfinite(*d)) c.points_mm.emplace_back(*a, *b, *d);
    else ++c.dropped_count;
  }
}

void read_corners(Loader& l, const std::string& field, const Table& t, const std::string& name, TargetCapture& c) {
  const auto pick = [&](std::initializer_list<const char*> names) -> std::optional<std::size_t> {
    for (const char* n : names)
      if (const auto k = t.column(n); k && !t.header.empty()) return k;
    return std::nullopt;
  };
  const auto view = pick({"image", "view", "name"});
  auto u = pick({"u", "u_px", "x_px"}), v = pick({"v", "v_px", "y_px"}), id = pick({"id", "corner_id"});
  const auto col = pick({"col", "column"}), row = pick({"row"});
  if (t.header.empty() && !t.rows.empty() && t.rows.front().size() == 3) id = 0, u = 1, v = 2;
  if (!u || !v || (!id && !(col && row)))
    return l.out.fault("input.table_columns", field, "found no columns id, u, v (or col, row, u, v) in " + t.name + ", allowed these, and `image` where one file holds several");
  std::set<int> seen;
  for (std::size_t i = 0; i < t.rows.size(); ++i) {
    if (view && (*view >= t.rows[i].size() || t.rows[i][*view] != name)) continue;
    const auto a = t.number(i, *u), b = t.number(i, *v);
    const auto k = id ? t.number(i, *id) : std::optional<double>();
    const auto ci = col ? t.number(i, *col) : std::optional<double>(), ri = row ? t.number(i, *row) : std::optional<double>();
    if (!a || !b || !std::isfinite(*a) || !std::isfinite(*b) || !(id ? k.has_value() : ci && ri))
      return l.out.fault("input.table_value", field, fmt::format("found no number in {}:{}, allowed numbers", t.name, t.lines[i]));
    const int number = static_cast<int>(id ? *k : *ri * l.job.target.columns_count + *ci);
    if (number < 0 || number >= l.job.target.columns_count * l.job.target.rows_count || !seen.insert(number).second)
      return l.out.fault("input.table_value", field,
                         fmt::format("found the point {} in {}:{}, allowed each of 0 to {} once an image", number, t.name, t.lines[i], l.job.target.columns_count * l.job.target.rows_count - 1));
    c.corners.push_back({number, Vec2(*a, *b)});
  }
}

Eigen::Quaterniond turn_of(const std::string& kind, const std::array<double, 4>& v) {
  const auto r = [&](int i) { return rad_from_deg(v[static_cast<std::size_t>(i)]); };
  if (kind == "quat") return Eigen::Quaterniond(v[0], v[1], v[2], v[3]).normalized();
  if (kind == "zyx") return quat_from_zyx(r(0), r(1), r(2));
  if (kind == "rpy") return quat_from_zyx(r(2), r(1), r(0));
  return (quat_exp(Vec3(r(0), 0, 0)) * quat_exp(Vec3(0, r(1), 0)) * quat_exp(Vec3(0, 0, r(2)))).normalized();
}

std::string filled(const std::string& pattern, const std::string& name) {
  const std::size_t at = pattern.find("{}");
  return at == std::string::npos ? pattern : pattern.substr(0, at) + name + pattern.substr(at + 2);
}

void take_files(Loader& l, const std::string& at, const std::optional<std::string>& cloud, const std::optional<std::string>& image, const std::optional<std::string>& profiles,
                const std::optional<std::string>& points, TargetCapture& c, std::map<std::string, Table>& tables, const std::string& name) {
  if (cloud) read_cloud_of(l, at + ".cloud", *cloud, c);
  if (profiles) read_profile(l, at + ".profiles", *profiles, c);
  if (image)
    if (auto b = l.bytes(at + ".image", *image)) c.image = std::move(b->first);
  if (points) {
    if (!tables.count(*points)) {
      const auto t = l.table(at + ".points", *points);
      if (!t) return;
      tables[*points] = *t;
    }
    read_corners(l, at + ".points", tables[*points], name, c);
  }
}

void read_table_of_poses(Loader& l, std::map<std::string, Table>& tables, std::optional<Robot>& robot) {
  const PoseTableText& p = *l.text.poses;
  const auto t = l.table("poses.file", p.file);
  if (!t) return;
  const auto columns = [&](const char* field, const std::vector<std::string>& names, std::size_t count) -> std::optional<std::vector<std::size_t>> {
    if (names.empty()) return std::nullopt;
    std::vector<std::size_t> k;
    const std::string where = std::string("poses.") + field;
    if (names.size() != count) {
      l.out.fault("input.table_columns", where, fmt::format("found {} columns, allowed {}", names.size(), count), double(names.size()), double(count), "columns");
      return std::nullopt;
    }
    for (const std::string& n : names) {
      const auto c = t->column(n);
      if (!c) {
        l.out.fault("input.table_columns", where, "found no column '" + shown(n) + "' in " + t->name + ", allowed a word of its header or a number from 1");
        return std::nullopt;
      }
      k.push_back(*c);
    }
    return k;
  };
  const auto xyz = columns("xyz", p.xyz, 3), joints = columns("joints", p.joints, 6);
  struct Turn {
    std::string kind;
    std::optional<std::vector<std::size_t>> at;
  };
  const auto turn = [&](const std::string& prefix, const std::vector<std::string>& quat, const std::vector<std::string>& zyx, const std::vector<std::string>& rpy,
                        const std::vector<std::string>& turns) {
    if (!quat.empty()) return Turn{"quat", columns((prefix + "quat").c_str(), quat, 4)};
    if (!zyx.empty()) return Turn{"zyx", columns((prefix + "zyx").c_str(), zyx, 3)};
    if (!rpy.empty()) return Turn{"rpy", columns((prefix + "rpy").c_str(), rpy, 3)};
    return Turn{"turns", columns((prefix + "xyz_turns").c_str(), turns, 3)};
  };
  const Turn r = turn("", p.quat, p.zyx, p.rpy, {}), sensor_r = turn("sensor_", p.sensor_quat, p.sensor_zyx, p.sensor_rpy, p.sensor_xyz_turns);
  const auto sensor_xyz = columns("sensor_xyz", p.sensor_xyz, 3);
  if (!l.out.faults.empty()) return;
  if (!joints && !(xyz && r.at))
    return l.out.fault("input.table_columns", "poses", "found no joints and no xyz with quat, zyx or rpy, allowed one of them: a row has to say where the flange was");
  const auto name_column = p.name ? t->column(*p.name) : std::nullopt;
  if (p.name && !name_column) return l.out.fault("input.table_columns", "poses.name", "found no column '" + shown(*p.name) + "' in " + t->name);
  for (std::size_t i = 0; i < t->rows.size(); i += static_cast<std::size_t>(p.every)) {
    TargetCapture c;
    const std::string at = fmt::format("{}:{}", t->name, t->lines[i]);
    const auto numbers = [&](const std::vector<std::size_t>& k) -> std::optional<std::array<double, 6>> {
      std::array<double, 6> v{};
      for (std::size_t j = 0; j < k.size(); ++j) {
        const auto x = t->number(i, k[j]);
        if (!x || !std::isfinite(*x)) {
          l.out.fault("input.table_value", "poses.file", "found no number in " + at + ", allowed numbers");
          return std::nullopt;
        }
        v[j] = *x;
      }
      return v;
    };
    const auto pose = [&](const std::vector<std::size_t>& place, const Turn& turned, double mm, Eigen::Quaterniond& q, Vec3& v) {
      const auto a = numbers(place), b = numbers(*turned.at);
      if (!a || !b) return false;
      v = mm * Vec3((*a)[0], (*a)[1], (*a)[2]);
      if (turned.kind == "quat") {
        const double norm = std::sqrt((*b)[0] * (*b)[0] + (*b)[1] * (*b)[1] + (*b)[2] * (*b)[2] + (*b)[3] * (*b)[3]);
        if (std::abs(norm - 1) > 0.01) {
          l.out.fault("input.bad_rotation", "poses.file", fmt::format("found a quaternion of length {:.4g} in {}, allowed 1", norm, at), norm, 1, "");
          return false;
        }
      }
      q = turn_of(turned.kind, {(*b)[0], (*b)[1], (*b)[2], (*b)[3]});
      return true;
    };
    if (joints) {
      const auto v = numbers(*joints);
      if (!v) return;
      std::array<double, 6> q{};
      for (std::size_t j = 0; j < 6; ++j) q[j] = rad_from_deg((*v)[j]);
      c.q_rad = q;
      if (robot) c.T_base_flange = robot->forward(q);
    } else {
      if (!pose(*xyz, r, mm_of(p.units.value_or(LengthUnit::mm)), c.T_base_flange.q, c.T_base_flange.p_mm)) return;
    }
    if (sensor_xyz && sensor_r.at) {
      Pose<frame::Sensor, frame::Target> T;
      if (!pose(*sensor_xyz, sensor_r, mm_of(p.sensor_units.value_or(LengthUnit::mm)), T.q, T.p_mm)) return;
      c.T_sensor_target = T;
    }
    const std::string name = name_column ? t->rows[i][*name_column] : std::to_string(i + 1);
    c.name = name_column ? name : "row " + name;
    const auto named = [&](const std::optional<std::string>& pattern) { return pattern ? std::optional<std::string>(filled(*pattern, name)) : std::nullopt; };
    take_files(l, "poses", named(p.cloud), named(p.image), named(p.profiles), named(p.points), c, tables, name);
    l.job.captures.push_back(std::move(c));
  }
}

}  // namespace

Result<Done<CalibrationRequest>> load_captures(const fs::path& given, const InputsRecipe& recipe) {
  const fs::path full = fs::weakly_canonical(given);
  auto whole = read_file(full, given.string());
  if (!whole) return tl::unexpected(whole.error());
  Loader l{Sources(full.parent_path(), recipe.allow_outside), {}, {}, full, {}, {}, {}};
  l.out.name = l.sources.name_of(full);
  l.sources.read(l.out, "", full);
  l.text = read_yaml<CapturesFile>(*whole, l.out);
  if (!l.out.is_of_kind) return refuse_all(std::move(l.out.faults));
  const CapturesFile& t = l.text;
  CalibrationRequest& job = l.job;
  job.subject = t.robot ? CalibrationRequest::Subject::robot : t.tool ? CalibrationRequest::Subject::tool : CalibrationRequest::Subject::sensor;
  job.id = t.robot.value_or(t.tool.value_or(t.sensor.value_or("")));
  job.is_sensor_fixed = t.mount.value_or(Mount::flange) == Mount::base;
  job.cell_file = t.cell, job.taken = t.taken.value_or(recipe.today).substr(0, 10), job.valid_days = t.valid_days;
  const TargetText& g = t.target;
  job.target = {g.kind, g.diameter_mm, g.pitch_mm, g.marker_mm, g.columns_count, g.rows_count, g.dictionary, g.centers_mm};

  // the cell, without its meshes
  Item item{Sources(full.parent_path(), recipe.allow_outside)};
  item.depth = Depth::bytes;
  if (!t.cell.empty()) {
    if (const auto path = l.sources.resolve(l.out, "cell", full, t.cell)) {
      if (const auto b = l.sources.read(l.out, "cell", *path)) {
        item.cell.file = *path, item.cell.out.name = l.sources.name_of(*path);
        item.cell.value = read_yaml<CellFile>(*b, item.cell.out);
        item.cell.is_read = item.cell.out.is_of_kind;
        item.cell.value.robot.links.clear(), item.cell.value.obstacles.clear();  // no shapes are needed here
        for (ToolText& tool : item.cell.value.tools) tool.mesh.reset();
        for (SensorText& sensor : item.cell.value.sensors) sensor.mesh.reset();
        job.cell = cell_of(item, item.cell);
        std::move(item.cell.out.faults.begin(), item.cell.out.faults.end(), std::back_inserter(l.faults));
        std::move(item.faults.begin(), item.faults.end(), std::back_inserter(l.faults));
      }
    }
  }
  bool has_sensor = false;
  if (item.cell.is_read && !job.id.empty()) {
    if (job.subject == CalibrationRequest::Subject::sensor) {
      for (const SensorSpec& s : job.cell.sensors)
        if (s.id == job.id) has_sensor = true, job.sensor_sd = s.noise_mm, job.nominal = s.T_flange_sensor, job.is_profile_sensor = s.kind == SensorKind::profile;
      if (!has_sensor && !job.is_sensor_fixed)
        l.out.fault("input.unknown_sensor", "sensor", "found the sensor '" + shown(job.id) + "', allowed one that " + item.cell.out.name + " has (a fixed one needs mount: base)");
      if (job.is_sensor_fixed) job.nominal.reset();
    } else if (job.subject == CalibrationRequest::Subject::tool) {
      const auto it = std::find_if(job.cell.tools.begin(), job.cell.tools.end(), [&](const ToolSpec& s) { return s.id == job.id; });
      if (it == job.cell.tools.end()) l.out.fault("input.unknown_tool", "tool", "found the tool '" + shown(job.id) + "', allowed one that " + item.cell.out.name + " has");
      else job.nominal = Pose<frame::Flange, frame::Sensor>(it->T_flange_tool.q, it->T_flange_tool.p_mm);
      if (job.is_sensor_fixed) l.out.fault("input.mount_of_tool", "mount", "found a tool on base, allowed flange: a tool is on the flange");
    } else if (job.id != job.cell.robot.model) {
      l.out.fault("input.unknown_robot", "robot", "found the robot '" + shown(job.id) + "', allowed '" + job.cell.robot.model + "', the model of " + item.cell.out.name);
    }
  }
  const bool is_plate = g.kind == TargetKind::hole_plate;
  if (is_plate) {
    HolePlate plate{"target", g.columns_count, g.rows_count, g.pitch_mm, g.diameter_mm, g.large_diameter_mm, rad_from_deg(g.cone_deg), {g.origin, g.along_x, g.along_y}, g.hole_sd_mm};
    for (const auto& hole : plate.large)
      if (hole[0] >= plate.columns_count || hole[1] >= plate.rows_count)
        l.out.fault("input.out_of_range", "target", fmt::format("found a large hole in column {}, row {}, allowed columns 0 to {} and rows 0 to {}", hole[0], hole[1], plate.columns_count - 1, plate.rows_count - 1));
    const bool is_square = plate.large[0] != plate.large[1] && plate.large[0] != plate.large[2] && plate.large[1] != plate.large[2];
    if (!is_square) l.out.fault("input.out_of_range", "target", "found two large holes in one place, allowed three different ones");
    job.target.plate = plate;
    if (t.sheet)
      job.sheet = ProfilometerSheet{.focal_mm = t.sheet->focal_mm, .pixel_mm = t.sheet->pixel_mm, .width_px = t.sheet->width_px, .height_px = t.sheet->height_px, .baseline_mm = t.sheet->baseline_mm,
                                    .triangulation_rad = rad_from_deg(t.sheet->triangulation_deg)};
    if (t.latency) job.latency_s = t.latency->value_s, job.latency_sd_s = t.latency->sd_s;
    if (t.poses) l.out.fault("input.not_for_this_target", "poses", "found a table of poses, allowed a list of captures: each pass over the plate has its own log or velocity");
  }
  const bool is_image = g.kind == TargetKind::checkerboard || g.kind == TargetKind::charuco || g.kind == TargetKind::circle_grid;
  if (is_image || !(job.sensor_sd > 0)) job.sensor_sd = is_image ? 0.15 : g.kind == TargetKind::tip ? 0.05 : 0.05;
  if (t.noise_mm) job.sensor_sd = *t.noise_mm;
  job.sensor_sd_rad = t.noise_turn_deg ? rad_from_deg(*t.noise_turn_deg) : job.sensor_sd / 500;
  job.tool_turn_sd_rad = rad_from_deg(t.tool_turn_deg.value_or(0.3));
  const auto per_axis = [](const MeanSd& m) { return std::sqrt((m.mean_mm * m.mean_mm + m.sd_mm * m.sd_mm) / 3); };
  const RobotAccuracy& a = job.cell.robot.accuracy;
  job.robot_sd_mm = std::max(1e-3, per_axis(a.absolute)), job.robot_sd_rad = kTurnPerLength_rad_mm * job.robot_sd_mm;
  job.repeat_sd_mm = std::max(1e-3, per_axis(a.repeatability)), job.repeat_sd_rad = kTurnPerLength_rad_mm * job.repeat_sd_mm;
  if (t.robot_sd) job.robot_sd_mm = t.robot_sd->position_mm, job.robot_sd_rad = rad_from_deg(t.robot_sd->turn_deg);
  if (t.repeat_sd) job.repeat_sd_mm = t.repeat_sd->position_mm, job.repeat_sd_rad = rad_from_deg(t.repeat_sd->turn_deg);
  if (t.intrinsics) {
    const IntrinsicsText& i = *t.intrinsics;
    CameraConstants c{i.fx_px, i.fy_px, i.cx_px, i.cy_px, 0, 0, 0, 0, 0};
    for (std::size_t k = 0; k < 5 && k < i.distortion.size(); ++k) c[4 + k] = i.distortion[k];
    if (i.distortion.size() > 5)
      l.out.fault("input.wrong_type", "intrinsics.distortion", fmt::format("found {} numbers, allowed k1, k2, p1, p2, k3", i.distortion.size()), double(i.distortion.size()), 5, "");
    job.camera = c;
  }
  job.is_camera_free = is_image && (t.is_camera_free || !job.camera);

  // where the arm goes by joints
  std::optional<Robot> robot;
  const bool wants_robot = job.subject == CalibrationRequest::Subject::robot || (t.poses && !t.poses->joints.empty()) || is_plate ||
                           std::any_of(t.captures.begin(), t.captures.end(), [](const TargetCaptureText& c) { return c.base_flange && c.base_flange->joints_deg; });
  if (wants_robot && item.has_kinematics && l.faults.empty()) {
    auto made = Robot::from(job.cell.robot);
    if (made) robot = std::move(*made);
    else
      for (Refusal r : made.error()) r.stage = "input", l.faults.push_back(std::move(r));
  }
  std::map<std::string, Table> tables;
  if (t.poses && l.out.faults.empty()) read_table_of_poses(l, tables, robot);
  for (std::size_t i = 0; i < t.captures.size(); ++i) {
    const TargetCaptureText& c = t.captures[i];
    const std::string at = "captures[" + std::to_string(i) + "]";
    TargetCapture capture;
    for (const auto* n : {&c.name, &c.cloud, &c.image, &c.profiles})
      if (capture.name.empty() && *n) capture.name = **n;
    if (capture.name.empty()) capture.name = "capture " + std::to_string(i + 1);
    capture.is_held_out = c.is_held_out;
    if (!c.base_flange && !(is_plate && c.robot_log)) {
      if (l.out.faults.empty()) l.out.fault("input.missing_key", at + ".base_flange", "found no base_flange, which is required: where the flange was");
      continue;
    }
    if (c.base_flange && c.base_flange->joints_deg) {
      std::array<double, 6> q{};
      for (std::size_t j = 0; j < 6; ++j) q[j] = rad_from_deg((*c.base_flange->joints_deg)[j]);
      capture.q_rad = q;
      if (robot) capture.T_base_flange = robot->forward(q);
    } else if (c.base_flange) {
      capture.T_base_flange = c.base_flange->pose<frame::Base, frame::Flange>();
    }
    if (is_plate) {
      if (l.out.faults.empty() && l.faults.empty()) {
        bool is_metric = false;
        capture.scan = read_pass(l.sources, l.out, l.faults, full, at, c, capture, robot, is_metric);
        if (i > 0 && capture.scan && is_metric != job.is_profile_metric) l.out.fault("input.profile_columns", at, "found passes in pixels and passes in mm, allowed one kind");
        job.is_profile_metric = is_metric;
        if (capture.scan) job.captures.push_back(std::move(capture));
      }
      continue;
    }
    if (c.sensor_target) capture.T_sensor_target = c.sensor_target->pose<frame::Sensor, frame::Target>();
    take_files(l, at, c.cloud, c.image, c.profiles, c.points, capture, tables, c.name.value_or(capture.name));
    job.captures.push_back(std::move(capture));
  }
  if (job.captures.empty() && l.out.faults.empty()) l.out.fault("input.missing_key", "captures", "found no captures, allowed a list of captures, or a table of poses");
  for (std::size_t i = 0; i < job.captures.size() && l.out.faults.empty() && l.faults.empty(); ++i) {
    const TargetCapture& c = job.captures[i];
    const std::string field = i < t.captures.size() && !t.poses ? "captures[" + std::to_string(i) + "]" : "captures";
    const bool wants_points = g.kind == TargetKind::balls || g.kind == TargetKind::ball || g.kind == TargetKind::plane || g.kind == TargetKind::corner;
    if (wants_points && c.points_mm.empty()) l.out.fault("input.capture_empty", field, "found no valid point in " + c.name + ", allowed a cloud or a profile; take the capture again");
    if (is_image && c.image.empty() && c.corners.empty() && !(t.poses && t.poses->points))
      l.out.fault("input.capture_empty", field, "found neither image nor points in " + c.name + ", allowed one of them");
    if (g.kind == TargetKind::pose && !c.T_sensor_target) l.out.fault("input.capture_empty", field, "found no sensor_target in " + c.name + ", allowed the pose as measured");
    if (job.subject == CalibrationRequest::Subject::robot && !c.q_rad) l.out.fault("input.capture_empty", field, "found no joints in " + c.name + ", allowed the joints: an arm is calibrated by them");
  }
  if (t.previous && !job.id.empty()) {
    if (const auto path = l.sources.resolve(l.out, "previous", full, *t.previous)) {
      if (auto b = l.sources.read(l.out, "previous", *path)) {
        job.earlier_others = std::move(*b);
        Readout other{.name = l.sources.name_of(*path)};
        const CalibrationFile c = read_yaml<CalibrationFile>(job.earlier_others, other);
        std::move(other.faults.begin(), other.faults.end(), std::back_inserter(l.faults));
        job.earlier_created = c.created;
        if (auto e = load_earlier(*path, job.subject, job.is_sensor_fixed, job.id)) job.earlier = std::move(*e);
      }
    }
  }
  if (!l.out.faults.empty() || !l.faults.empty()) {
    l.faults.insert(l.faults.begin(), l.out.faults.begin(), l.out.faults.end());
    return refuse_all(std::move(l.faults));
  }
  job.inputs = l.sources.files();
  return Done<CalibrationRequest>{std::move(job), std::move(l.notes)};
}

}  // namespace asbuilt
