// SPDX-License-Identifier: GPL-3.0-or-later
// The cell: units turned to rad, meshes read, a URDF walked, the calibration put in place of the nominal poses.
#include <fmt/format.h>

#include <cmath>
#include <set>

#include "planner/base/number.hpp"
#include "planner/inputs/dates.hpp"
#include "planner/inputs/item.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/io/urdf.hpp"

namespace asbuilt::inputs {

namespace fs = std::filesystem;

namespace {

constexpr SizeGate kLinkGate{2, 2e4, "a robot's link"};
constexpr SizeGate kToolGate{1, 1e4, "a tool or sensor"};
constexpr SizeGate kObstacleGate{1, 2e5, "an obstacle"};

std::string index(const char* list, std::size_t i) { return std::string(list) + "[" + std::to_string(i) + "]"; }

/// "package://some_package/meshes/a.stl" is looked for beside the URDF and in the folders above it.
std::string mesh_path(const fs::path& urdf, const std::string& file) {
  constexpr std::string_view scheme = "package://";
  if (file.compare(0, scheme.size(), scheme) != 0) return file.compare(0, 7, "file://") == 0 ? file.substr(7) : file;
  const std::string rest = file.substr(scheme.size());
  const std::size_t slash = rest.find('/');
  const std::string inner = slash == std::string::npos ? rest : rest.substr(slash + 1);
  std::error_code error;
  for (const std::string& candidate : {inner, "../" + inner, "../../" + rest, "../" + rest, rest})
    if (fs::is_regular_file(urdf.parent_path() / candidate, error)) return candidate;
  return inner;
}

void add_urdf(Item& item, YamlSource<CellFile>& s, RobotSpec& robot) {
  const KinematicsText& k = s.value.robot.kinematics;
  if (!k.urdf || !k.base || !k.tip) return;
  const std::string field = "robot.kinematics.urdf";
  const auto file = item.sources.resolve(s.out, field, s.file, *k.urdf);
  if (!file) return;
  const auto bytes = item.sources.read(s.out, field, *file);
  if (!bytes) return;
  auto read = read_urdf(*bytes, item.sources.name_of(*file), *k.base, *k.tip);
  if (!read) {
    for (Refusal& r : read.error()) item.faults.push_back(std::move(r));
    return;
  }
  UrdfRobot& urdf = read->artefact;
  item.notes.insert(item.notes.end(), read->notes.begin(), read->notes.end());
  for (std::size_t j = 0; j < 6 && j < s.value.robot.joints.size(); ++j) {
    const auto [low, high] = std::pair{deg_from_rad(urdf.limits_rad[j][0]), deg_from_rad(urdf.limits_rad[j][1])};
    const JointText& t = s.value.robot.joints[j];
    if (low < high && (t.min_deg < low - 0.1 || t.max_deg > high + 0.1))
      item.note("input.joint_limits_wider",
                fmt::format("joint {} may move from {:g} to {:g} degree, in the URDF only from {:.1f} to {:.1f}", j + 1, t.min_deg,
                            t.max_deg, low, high),
                s.out.where(index("robot.joints", j)));
  }
  robot.kinematics = std::move(urdf.kinematics);
  item.has_kinematics = true;
  if (!s.value.robot.links.empty()) return;
  Readout naming{.name = item.sources.name_of(*file)};
  for (UrdfShape& shape : urdf.shapes) {
    Mesh mesh = std::move(shape.mesh_shape);
    if (!shape.file.empty()) {
      const std::string where = "link " + shape.link;
      naming.lines[where] = shape.line;
      mesh = mesh_at(item, naming, where, *file, mesh_path(*file, shape.file), std::nullopt, kLinkGate, shape.scale, 1000.0);
    }
    if (!mesh.triangles.empty()) robot.links.push_back({shape.joint, transformed(shape.T_base_shape, mesh)});
  }
  item.faults.insert(item.faults.end(), naming.faults.begin(), naming.faults.end());
}

RobotSpec robot_of(Item& item, YamlSource<CellFile>& s) {
  const RobotText& t = s.value.robot;
  RobotSpec robot;
  robot.model = t.model;
  if (t.kinematics.opw) {
    const OpwText& o = *t.kinematics.opw;
    OpwParameters p{o.a1_mm, o.a2_mm, o.b_mm, o.c1_mm, o.c2_mm, o.c3_mm, o.c4_mm, {}, o.signs};
    for (std::size_t j = 0; j < 6; ++j) {
      p.offsets_rad[j] = rad_from_deg(o.offsets_deg[j]);
      if (o.signs[j] == 0) s.out.fault("input.out_of_range", "robot.kinematics.opw." + index("signs", j), "found 0, allowed 1 or -1");
    }
    robot.kinematics = p;
    item.has_kinematics = s.out.faults.empty();
  }
  add_urdf(item, s, robot);
  if (!t.joints.empty() && t.joints.size() != 6)
    s.out.fault("input.wrong_type", "robot.joints", "found " + std::to_string(t.joints.size()) + " joints, allowed 6",
                double(t.joints.size()), 6, "joints");
  for (std::size_t j = 0; j < 6 && j < t.joints.size(); ++j) {
    const JointText& q = t.joints[j];
    robot.joints[j] = {rad_from_deg(q.min_deg), rad_from_deg(q.max_deg), rad_from_deg(q.speed_deg_s), rad_from_deg(q.acceleration_deg_s2),
                       rad_from_deg(q.jerk_deg_s3)};
    if (s.out.lines.count(index("robot.joints", j) + ".max") && !(q.min_deg < q.max_deg))
      s.out.fault("input.joint_limits", index("robot.joints", j),
                  fmt::format("found the limits {:g} to {:g} degree, allowed the lower one first", q.min_deg, q.max_deg), q.min_deg,
                  q.max_deg, "degree");
    robot.home_rad[j] = rad_from_deg(t.home.joints_deg[j]);
    if (s.out.lines.count("robot.home.joints") && q.min_deg < q.max_deg &&
        (t.home.joints_deg[j] < q.min_deg || t.home.joints_deg[j] > q.max_deg))
      s.out.fault("input.home_outside_limits", "robot.home." + index("joints", j),
                  fmt::format("found {:g} degree, allowed {:g} to {:g}", t.home.joints_deg[j], q.min_deg, q.max_deg), t.home.joints_deg[j],
                  t.home.joints_deg[j] < q.min_deg ? q.min_deg : q.max_deg, "degree");
  }
  for (std::size_t i = 0; i < t.links.size(); ++i) {
    const LinkText& l = t.links[i];
    Mesh mesh = mesh_at(item, s.out, "robot." + index("links", i) + ".mesh", s.file, l.mesh, l.units, kLinkGate);
    robot.links.push_back({l.joint, std::move(mesh)});
  }
  std::set<int> drawn;
  for (const LinkMesh& l : robot.links) drawn.insert(l.joint);
  std::string missing;
  for (int j = 0; j <= 6; ++j)
    if (!drawn.count(j)) missing += (missing.empty() ? "" : ", ") + std::to_string(j);
  if (drawn.empty() && item.depth == Depth::all && item.has_kinematics && item.faults.empty())
    s.out.fault("input.links_missing", "robot.links",
                "found no shape of the arm, allowed one for the base and one for each moving link: without them no collision can be seen");
  else if (!missing.empty() && item.depth == Depth::all)
    item.note("input.link_not_drawn", "no shape moves with joint " + missing + ": collisions of that part of the arm are not seen",
              s.out.where("robot.links"));
  const auto mean_sd = [](const MeanSdText& m) { return MeanSd{m.mean_mm, m.sd_mm}; };
  robot.accuracy = {mean_sd(t.accuracy.absolute), mean_sd(t.accuracy.repeatability),
                    mean_sd(t.accuracy.short_term.value_or(t.accuracy.repeatability))};
  return robot;
}

ControllerSpec controller_of(const ControllerText& t) {
  ControllerSpec c;
  c.language = t.language;
  const auto keep = [&](const char* block, const std::map<std::string, std::string>& rest) {
    for (const auto& [key, value] : rest) c.options[std::string(block) + "." + key] = value;
  };
  if (t.krl) keep("krl", t.krl->rest);
  if (t.inform) c.pulses_per_degree = t.inform->pulses_per_degree, c.speed_unit = t.inform->speed_unit, keep("inform", t.inform->rest);
  if (t.beckhoff) c.orientation = t.beckhoff->orientation, c.kinematic_id = t.beckhoff->kinematic_id, keep("beckhoff", t.beckhoff->rest);
  if (t.nci) keep("nci", t.nci->rest);
  if (t.ur) keep("ur", t.ur->rest);
  return c;
}

}  // namespace

Mesh mesh_at(Item& item, Readout& naming, const std::string& field, const fs::path& naming_file, const std::string& text,
             std::optional<LengthUnit> units, const SizeGate& gate, const Vec3& scale, double mm_per_unit) {
  if (text.empty()) return {};
  const auto file = item.sources.resolve(naming, field, naming_file, text);
  if (!file) return {};
  const auto bytes = item.sources.read(naming, field, *file);
  if (!bytes || item.depth == Depth::bytes) return {};
  const std::string name = item.sources.name_of(*file);
  if (const auto own = mesh_unit_mm(*bytes, name)) mm_per_unit = *own;
  else if (mm_per_unit <= 0) mm_per_unit = mm_of(units.value_or(LengthUnit::mm));
  auto mesh = read_mesh(*bytes, name, mm_per_unit);
  if (!mesh) {
    item.faults.insert(item.faults.end(), mesh.error().begin(), mesh.error().end());
    return {};
  }
  Mesh m = std::move(mesh->mesh);
  if (scale != Vec3::Ones()) {
    for (Vec3& v : m.vertices) v = v.cwiseProduct(scale);
    if (scale.prod() < 0)
      for (auto& t : m.triangles) std::swap(t[1], t[2]);
  }
  const double size = m.box().diagonal_mm();
  if (size < gate.min_mm || size > gate.max_mm) {
    naming.fault("input.size_implausible", field,
                 fmt::format("found {} with a diagonal of {:.4g} mm, allowed {:g} to {:g} mm: the unit of {} is wrong", gate.what, size,
                             gate.min_mm, gate.max_mm, name),
                 size, size < gate.min_mm ? gate.min_mm : gate.max_mm, "mm");
    return {};
  }
  if (mesh->dropped_count)
    item.note("input.mesh_dropped", std::to_string(mesh->dropped_count) + " triangles with a NaN or infinite corner were dropped", name);
  return m;
}

CellSpec cell_of(Item& item, YamlSource<CellFile>& s) {
  CellSpec cell;
  if (!s.is_read) return cell;
  cell.id = s.value.id;
  cell.robot = robot_of(item, s);
  cell.controller = controller_of(s.value.controller);
  std::set<std::string> ids;
  std::set<int> numbers;
  const auto unique = [&](const std::string& field, const std::string& id) {
    if (!id.empty() && !ids.insert(id).second) s.out.fault("input.duplicate_id", field, "found the id '" + id + "' twice, allowed once");
  };
  for (std::size_t i = 0; i < s.value.tools.size(); ++i) {
    const ToolText& t = s.value.tools[i];
    const std::string at = index("tools", i);
    unique(at + ".id", t.id);
    if (!t.id.empty() && !numbers.insert(t.number).second)
      s.out.fault("input.duplicate_id", at + ".number", "found the number " + std::to_string(t.number) + " twice, allowed once");
    ToolSpec tool;
    tool.id = t.id, tool.number = t.number, tool.T_flange_tool = t.flange_tool.pose<frame::Flange, frame::Tool>();
    const CutterText& c = t.cutter;
    tool.cutter = {c.shape,
                   rad_from_deg(c.included_angle_deg),
                   c.shape == CutterShape::cylinder && c.tip_diameter_mm == 0 ? c.diameter_mm : c.tip_diameter_mm,
                   c.diameter_mm,
                   c.length_mm,
                   c.shank_diameter_mm.value_or(c.diameter_mm),
                   c.teeth_count};
    if (c.shape == CutterShape::cone && c.diameter_mm > 0 && c.tip_diameter_mm >= c.diameter_mm)
      s.out.fault("input.out_of_range", at + ".cutter.tip_diameter",
                  fmt::format("found {:g} mm, allowed less than the diameter of {:g} mm", c.tip_diameter_mm, c.diameter_mm),
                  c.tip_diameter_mm, c.diameter_mm, "mm");
    tool.spindle = {t.spindle.max_rpm, t.spindle.output, t.spindle.analog};
    if (t.mesh) tool.mesh_flange = mesh_at(item, s.out, at + ".mesh", s.file, *t.mesh, t.units, kToolGate);
    cell.tools.push_back(std::move(tool));
  }
  ids.clear();
  for (std::size_t i = 0; i < s.value.sensors.size(); ++i) {
    const SensorText& t = s.value.sensors[i];
    const std::string at = index("sensors", i);
    unique(at + ".id", t.id);
    SensorSpec sensor;
    sensor.id = t.id, sensor.kind = t.kind, sensor.T_flange_sensor = t.flange_sensor.pose<frame::Flange, frame::Sensor>();
    sensor.range_mm = t.range_mm, sensor.field_of_view_mm = t.field_of_view_mm, sensor.noise_mm = t.noise_mm;
    sensor.working_distance_mm = t.working_distance_mm.value_or(0.5 * (t.range_mm[0] + t.range_mm[1]));
    sensor.pixels_count = t.pixels_count, sensor.second_ray_mm = t.second_ray_mm;
    if (t.incidence_deg) sensor.incidence_max_rad = rad_from_deg(*t.incidence_deg);
    if (s.out.lines.count(at + ".range") && !(t.range_mm[0] < t.range_mm[1]))
      s.out.fault("input.out_of_range", at + ".range",
                  fmt::format("found {:g} to {:g} mm, allowed the nearer distance first", t.range_mm[0], t.range_mm[1]), t.range_mm[0],
                  t.range_mm[1], "mm");
    if (t.mesh) sensor.mesh_flange = mesh_at(item, s.out, at + ".mesh", s.file, *t.mesh, t.units, kToolGate);
    cell.sensors.push_back(std::move(sensor));
  }
  for (std::size_t i = 0; i < s.value.obstacles.size(); ++i) {
    const ObstacleText& t = s.value.obstacles[i];
    Mesh mesh = mesh_at(item, s.out, index("obstacles", i) + ".mesh", s.file, t.mesh, t.units, kObstacleGate);
    cell.obstacles.push_back(
        {t.name.value_or(fs::path(t.mesh).stem().string()), transformed(t.base_obstacle.pose<frame::Base, frame::Obstacle>(), mesh)});
  }
  return cell;
}

void apply_calibration(Item& item, CellSpec& cell, const std::string& taken) {
  YamlSource<CalibrationFile>& s = item.calibration;
  if (!s.is_read || !item.cell.is_read) return;
  const CalibrationFile& c = s.value;
  if (!c.cell.empty()) {
    if (const auto named = item.sources.resolve(s.out, "cell", s.file, c.cell); named && *named != item.cell.file)
      s.out.fault("input.calibration_of_other_cell", "cell",
                  "found the calibration of '" + shown(c.cell) + "', allowed that of " + item.sources.name_of(item.cell.file));
  }
  const auto made = day_number(c.created), day = day_number(taken);
  if (made && day && c.valid_days > 0) {
    const long age = *day - *made;
    if (age > c.valid_days)
      s.out.fault("input.calibration_expired", "valid_days",
                  fmt::format("found a calibration of {} that is {} days old on {}, allowed {} days; calibrate again",
                              c.created.substr(0, 10), age, taken, c.valid_days),
                  double(age), double(c.valid_days), "days");
    if (age < 0)
      item.note("input.calibration_after_scans", fmt::format("the calibration was made {} days after the scans", -age),
                s.out.where("created"));
  } else if (made && !day && !item.scans.out.lines.count("taken")) {
    s.out.fault("input.date_missing", "valid_days",
                "found no day of the scans to measure the calibration's age at; write `taken` into the scans file");
  }
  for (const auto& [id, t] : c.sensors) {
    const auto it = std::find_if(cell.sensors.begin(), cell.sensors.end(), [&](const SensorSpec& x) { return x.id == id; });
    if (it == cell.sensors.end()) {
      s.out.fault("input.unknown_sensor", "sensors." + shown(id), "found the sensor '" + shown(id) + "', allowed one that the cell has");
      continue;
    }
    const double moved = (t.flange_sensor.p_mm - it->T_flange_sensor.p_mm).norm();
    if (moved > 100)
      item.note("input.calibration_far_from_nominal", fmt::format("sensor {} lies {:.1f} mm from its nominal place", id, moved),
                s.out.where("sensors." + id + ".flange_sensor"));
    it->T_flange_sensor = t.flange_sensor.pose<frame::Flange, frame::Sensor>();
    it->covariance = t.covariance;
    it->is_calibrated = true;
    if (t.profile_map && !is_whole(*t.profile_map))
      s.out.fault("input.profile_map", "sensors." + id + ".profile_map.values", fmt::format("found {} numbers, allowed as many as a map of that degree has", t.profile_map->values.size()));
  }
  for (const auto& [id, t] : c.tools) {
    const auto it = std::find_if(cell.tools.begin(), cell.tools.end(), [&](const ToolSpec& x) { return x.id == id; });
    if (it == cell.tools.end()) {
      s.out.fault("input.unknown_tool", "tools." + shown(id), "found the tool '" + shown(id) + "', allowed one that the cell has");
      continue;
    }
    it->T_flange_tool = t.flange_tool.pose<frame::Flange, frame::Tool>();
    it->covariance = t.covariance;
  }
  if (c.robot && c.robot->opw) {
    const OpwCorrectionText& o = *c.robot->opw;
    bool is_zero = true;
    for (const double v : {o.a1_mm, o.a2_mm, o.b_mm, o.c1_mm, o.c2_mm, o.c3_mm, o.c4_mm}) is_zero = is_zero && v == 0;
    for (const double v : o.offsets_deg) is_zero = is_zero && v == 0;
    if (!is_zero)
      s.out.fault("input.robot_corrections_not_supported", "robot.opw",
                  "found corrections of the arm, which this version does not apply; remove them, the controller keeps its own model");
  }
}

}  // namespace asbuilt::inputs
