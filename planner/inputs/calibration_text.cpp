// SPDX-License-Identifier: GPL-3.0-or-later
// A calibration file as text, and one entry of it read back.
#include <fmt/format.h>

#include <algorithm>

#include "planner/base/number.hpp"
#include "planner/inputs/files_batch.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/inputs/item.hpp"
#include "planner/inputs/yaml_reader.hpp"
#include "planner/io/file.hpp"

namespace asbuilt {

using namespace inputs;

namespace {

template <class A, class B>
std::string pose_text(const Pose<A, B>& T) {
  Eigen::Quaterniond q = T.q.normalized();
  if (q.w() < 0) q.coeffs() *= -1;
  return fmt::format("{{xyz: [{}, {}, {}], quat: [{}, {}, {}, {}]}}", fixed_number(T.p_mm.x(), 6), fixed_number(T.p_mm.y(), 6), fixed_number(T.p_mm.z(), 6),
                     fixed_number(q.w(), 10), fixed_number(q.x(), 10), fixed_number(q.y(), 10), fixed_number(q.z(), 10));
}

std::string matrix_text(const Mat6& C) {
  std::string text = "[";
  for (int i = 0; i < 6; ++i) {
    text += i ? ", [" : "[";
    // six digits are plenty; both halves alike
    for (int k = 0; k < 6; ++k) text += (k ? ", " : "") + fmt::format("{:.6e}", C(std::min(i, k), std::max(i, k)) == 0 ? 0.0 : C(std::min(i, k), std::max(i, k)));
    text += "]";
  }
  return text + "]";
}

std::string yaml_quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("''") : std::string(1, c);
  return out + "'";
}

std::string origin_text(const CalibrationEntry& e, const std::string& indent) {
  std::string t = indent + "origin:\n";
  const std::string in = indent + "  ";
  t += in + "created: " + yaml_quoted(e.created) + "\n";
  t += in + "held_out: " + fixed_number(e.held_out_mm, 5) + "\n" + in + "fit_rms: " + fixed_number(e.fit_rms, 5) + "\n" + in + "noise: " + fixed_number(e.noise, 6) + "\n";
  t += in + "robot_sd: " + fixed_number(e.robot_sd_mm, 5) + "\n" + in + "robot_turn_sd: " + fixed_number(deg_from_rad(e.robot_sd_rad), 6) + "\n" + in + "dof: " + std::to_string(std::max(0, e.dof)) + "\n";
  if (!e.files.empty()) {
    t += in + "files:\n";
    for (const InputFile& f : e.files) t += in + "  - {path: " + yaml_quoted(f.path) + ", sha256: " + f.sha256 + "}\n";
  }
  if (!e.references.empty()) {
    t += in + "references:\n";
    for (const ReferenceView& r : e.references)
      t += in + "  - name: " + yaml_quoted(r.name) + "\n" + in + "    base_flange: " + pose_text(r.T_base_flange) + "\n" + in + "    sensor_target: " + pose_text(r.T_sensor_target) + "\n" + in +
           "    covariance: " + matrix_text(r.covariance) + "\n";
  }
  return t;
}

std::string camera_text(const CameraConstants& c) {
  return fmt::format("{{fx: {}, fy: {}, cx: {}, cy: {}, distortion: [{}, {}, {}, {}, {}]}}", fixed_number(c[0], 4), fixed_number(c[1], 4), fixed_number(c[2], 4), fixed_number(c[3], 4),
                     fixed_number(c[4], 8), fixed_number(c[5], 8), fixed_number(c[6], 8), fixed_number(c[7], 8), fixed_number(c[8], 8));
}

std::string profile_map_text(const ProfileMap& m) {
  std::string values;
  for (const double v : m.map.values) values += (values.empty() ? "" : ", ") + shortest_number(v);
  return fmt::format("{{metric: {}, camera: {}, values: [{}], center: [{}, {}], half: {}, degree: {}, sensor_map: {}, form_sd: {}, latency: {}, latency_sd: {}}}", m.is_metric,
                     m.map.model == ProfilometerModel::camera, values, shortest_number(m.map.uv_center.x()), shortest_number(m.map.uv_center.y()), shortest_number(m.map.uv_half), m.map.degree_count,
                     pose_text(m.T_sensor_map), fixed_number(m.form_sd_mm, 5), fixed_number(m.latency_s, 7), fixed_number(m.latency_sd_s, 7));
}

/// The lines under `key:` of a mapping at the left margin, split by entry, as they stand.
std::map<std::string, std::string> entries_of(const YAML::Node& section) {
  std::map<std::string, std::string> out;
  if (!section || !section.IsMap()) return out;
  for (const auto& entry : section) {
    YAML::Emitter emitter;
    emitter.SetIndent(2);
    emitter << entry.second;
    std::string text = emitter.c_str(), lines;
    for (std::size_t at = 0; at <= text.size();) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      lines += "    " + text.substr(at, end - at) + "\n";
      at = end + 1;
    }
    out[entry.first.Scalar()] = lines;
  }
  return out;
}

}  // namespace

std::string calibration_yaml(const std::string& cell_file, int valid_days, const CalibrationEntry& e, const std::string& earlier_yaml) {
  YAML::Node earlier;
  std::string created = e.created;
  if (!earlier_yaml.empty()) earlier = YAML::Load(earlier_yaml);
  std::map<std::string, std::string> sections[3];
  const char* names[] = {"sensors", "fixed_sensors", "tools"};
  for (int i = 0; i < 3; ++i)
    if (earlier && earlier[names[i]]) sections[i] = entries_of(earlier[names[i]]);
  std::string own;
  const int mine = e.subject == CalibrationRequest::Subject::tool ? 2 : e.is_sensor_fixed ? 1 : 0;
  std::string robot = "robot: {}\n";
  if (earlier && earlier["robot"] && earlier["robot"].IsMap() && earlier["robot"].size()) {
    const auto r = entries_of(earlier);
    if (r.count("robot")) {
      robot = "robot:\n";
      const std::string& lines = r.at("robot");
      for (std::size_t at = 0; at < lines.size();) {
        const std::size_t end = lines.find('\n', at);
        robot += lines.substr(at + 2, end - at - 2) + "\n";
        at = end + 1;
      }
    }
  }
  if (e.subject == CalibrationRequest::Subject::robot) {
    robot = "robot:\n";
    if (e.arm) {
      const OpwParameters& o = *e.arm;
      robot += fmt::format("  opw: {{a1: {}, a2: {}, b: {}, c1: {}, c2: {}, c3: {}, c4: {}, offsets: [{}, {}, {}, {}, {}, {}]}}\n", fixed_number(o.a1_mm, 5), fixed_number(o.a2_mm, 5),
                           fixed_number(o.b_mm, 5), fixed_number(o.c1_mm, 5), fixed_number(o.c2_mm, 5), fixed_number(o.c3_mm, 5), fixed_number(o.c4_mm, 5),
                           fixed_number(deg_from_rad(o.offsets_rad[0]), 7), fixed_number(deg_from_rad(o.offsets_rad[1]), 7), fixed_number(deg_from_rad(o.offsets_rad[2]), 7),
                           fixed_number(deg_from_rad(o.offsets_rad[3]), 7), fixed_number(deg_from_rad(o.offsets_rad[4]), 7), fixed_number(deg_from_rad(o.offsets_rad[5]), 7));
    }
    robot += origin_text(e, "  ");
  } else {
    own = std::string("    ") + (mine == 2 ? "flange_tool" : mine == 1 ? "base_sensor" : "flange_sensor") + ": " + pose_text(e.T_flange_sensor) + "\n";
    own += "    covariance: " + matrix_text(e.covariance) + "\n";
    if (mine != 2) own += "    rms: " + fixed_number(e.rms_mm, 5) + "\n    captures: " + std::to_string(e.captures_count) + "\n";
    if (mine != 2 && e.camera) own += "    intrinsics: " + camera_text(*e.camera) + "\n";
    if (mine == 0 && e.profile_map) own += "    profile_map: " + profile_map_text(*e.profile_map) + "\n";
    own += origin_text(e, "    ");
    sections[mine][e.id] = own;
  }
  // the file is as old as its oldest entry
  bool has_others = false;
  for (int i = 0; i < 3; ++i)
    for (const auto& [id, text] : sections[i]) has_others = has_others || i != mine || id != e.id || e.subject == CalibrationRequest::Subject::robot;
  if (has_others && earlier && earlier["created"]) created = std::min(created, earlier["created"].Scalar().substr(0, 10));
  if (has_others && earlier && earlier["valid_days"]) valid_days = std::min(valid_days, earlier["valid_days"].as<int>(valid_days));
  std::string text = "asbuilt: calibration/1\ncell: " + yaml_quoted(cell_file) + "\ncreated: " + yaml_quoted(created) + "\nvalid_days: " + std::to_string(valid_days) + "\n";
  for (int i = 0; i < 3; ++i) {
    if (sections[i].empty()) {
      text += i == 1 ? "" : std::string(names[i]) + ": {}\n";
      continue;
    }
    text += std::string(names[i]) + ":\n";
    for (const auto& [id, lines] : sections[i]) text += "  " + id + ":\n" + lines;
  }
  return text + robot;
}

namespace inputs {
ProfileMap profile_map_of(const ProfileMapText& t) {
  ProfileMap m;
  m.is_metric = t.is_metric;
  m.map.model = t.is_camera ? ProfilometerModel::camera : ProfilometerModel::plane_map;
  m.map.values = Eigen::Map<const Eigen::VectorXd>(t.values.data(), Eigen::Index(t.values.size()));
  m.map.uv_center = {t.center[0], t.center[1]}, m.map.uv_half = t.half, m.map.degree_count = t.degree_count;
  m.T_sensor_map = t.sensor_map.pose<frame::Sensor, frame::Sensor>();
  m.form_sd_mm = t.form_sd_mm, m.latency_s = t.latency_s, m.latency_sd_s = t.latency_sd_s;
  return m;
}
bool is_whole(const ProfileMapText& t) {
  const std::size_t wanted = t.is_camera ? 12 : plane_map_parameters(t.degree_count, 1).size();
  return t.values.size() == wanted;
}
}  // namespace inputs

Result<EarlierCalibration> load_earlier(const std::filesystem::path& file, CalibrationRequest::Subject subject, bool is_sensor_fixed, const std::string& id) {
  auto bytes = read_file(file, file.filename().string());
  if (!bytes) return tl::unexpected(bytes.error());
  Readout out{.name = file.filename().string()};
  const CalibrationFile c = read_yaml<CalibrationFile>(*bytes, out);
  for (const auto& [name, sensor] : c.sensors)
    if (sensor.profile_map && !is_whole(*sensor.profile_map))
      out.fault("input.profile_map", "sensors." + name + ".profile_map.values", fmt::format("found {} numbers, allowed as many as the map of that degree has", sensor.profile_map->values.size()));
  if (!out.faults.empty()) return refuse_all(std::move(out.faults));
  EarlierCalibration e;
  e.file = out.name, e.created = c.created, e.valid_days = c.valid_days;
  std::optional<OriginText> origin;
  const auto camera = [&](const std::optional<IntrinsicsText>& i) {
    if (!i) return;
    CameraConstants k{i->fx_px, i->fy_px, i->cx_px, i->cy_px, 0, 0, 0, 0, 0};
    for (std::size_t j = 0; j < 5 && j < i->distortion.size(); ++j) k[4 + j] = i->distortion[j];
    e.camera = k;
  };
  bool is_there = false;
  if (subject == CalibrationRequest::Subject::tool) {
    if (const auto it = c.tools.find(id); it != c.tools.end())
      is_there = true, e.T_flange_sensor = it->second.flange_tool.pose<frame::Flange, frame::Sensor>(), e.covariance = it->second.covariance, origin = it->second.origin;
  } else if (subject == CalibrationRequest::Subject::sensor && is_sensor_fixed) {
    if (const auto it = c.fixed_sensors.find(id); it != c.fixed_sensors.end())
      is_there = true, e.T_flange_sensor = it->second.base_sensor.pose<frame::Flange, frame::Sensor>(), e.covariance = it->second.covariance, origin = it->second.origin, camera(it->second.intrinsics);
  } else if (subject == CalibrationRequest::Subject::sensor) {
    if (const auto it = c.sensors.find(id); it != c.sensors.end())
      is_there = true, e.T_flange_sensor = it->second.flange_sensor.pose<frame::Flange, frame::Sensor>(), e.covariance = it->second.covariance, origin = it->second.origin, camera(it->second.intrinsics);
    if (is_there && c.sensors.at(id).profile_map) e.profile_map = profile_map_of(*c.sensors.at(id).profile_map);
  }
  if (!is_there)
    return refuse({.code = "input.not_in_calibration",
                   .where = out.name,
                   .message = "found nothing about '" + shown(id) + "' in the calibration; name the calibration that it was made into, or calibrate it",
                   .stage = "input"});
  if (origin) {
    e.created = origin->created, e.sensor_sd = origin->noise.value_or(0);
    for (const ReferenceViewText& r : origin->references)
      e.references.push_back({r.name, r.base_flange.pose<frame::Base, frame::Flange>(), r.sensor_target.pose<frame::Sensor, frame::Target>(), r.covariance});
  }
  return e;
}

}  // namespace asbuilt
