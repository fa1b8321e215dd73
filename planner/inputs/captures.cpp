// SPDX-License-Identifier: GPL-3.0-or-later
// The captures of one item: clouds read, flange poses taken or computed from joints, sensors and features found by name.
#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "planner/inputs/item.hpp"
#include "planner/io/cloud_file.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt::inputs {

void check_unit(Item& item, const std::vector<Eigen::Vector3f>& points, const SensorSpec& sensor, const std::string& field) {
  if (!(sensor.range_mm[1] > 0) || points.empty()) return;
  std::vector<float> distance;
  for (std::size_t i = 0; i < points.size(); i += 1 + points.size() / 1000) distance.push_back(points[i].norm());
  std::nth_element(distance.begin(), distance.begin() + std::ptrdiff_t(distance.size() / 2), distance.end());
  const double median = distance[distance.size() / 2];
  if (median < sensor.range_mm[0] / 20 || median > sensor.range_mm[1] * 20)
    item.scans.out.fault(
        "input.cloud_unit", field,
        fmt::format("found points {:.4g} mm away from sensor {}, whose range is {:g} to {:g} mm: the cloud's unit is not mm", median,
                    sensor.id, sensor.range_mm[0], sensor.range_mm[1]),
        median, median < sensor.range_mm[0] ? sensor.range_mm[0] : sensor.range_mm[1], "mm");
}

namespace {

void read_points(Item& item, const CaptureText& t, const std::string& field, const SensorSpec* sensor, Capture& c) {
  YamlSource<ScansFile>& s = item.scans;
  const auto file = item.sources.resolve(s.out, field, s.file, *t.cloud);
  if (!file) return;
  const auto bytes = item.sources.read(s.out, field, *file);
  if (!bytes || item.depth == Depth::bytes) return;
  const std::string name = item.sources.name_of(*file);
  auto cloud = read_cloud(*bytes, name);
  if (!cloud) {
    item.faults.insert(item.faults.end(), cloud.error().begin(), cloud.error().end());
    return;
  }
  c.points_sensor = std::move(cloud->points);
  c.dropped_count = cloud->dropped_count;
  if (c.dropped_count)
    item.note("input.points_dropped",
              fmt::format("{} of {} points have a NaN or infinite coordinate and were dropped", c.dropped_count,
                          c.dropped_count + c.points_sensor.size()),
              name, Note::Level::note);
  if (c.points_sensor.empty())
    item.faults.push_back(
        {.code = "input.cloud_empty",
         .where = name,
         .message = fmt::format("found no valid point ({} with a NaN or infinite coordinate), allowed at least one; take the scan again",
                                c.dropped_count),
         .measured = 0,
         .limit = 1,
         .unit = "points",
         .stage = "input"});
  else if (sensor) check_unit(item, c.points_sensor, *sensor, field);
}

}  // namespace

std::vector<Capture> captures_of(Item& item, const CellSpec& cell) {
  YamlSource<ScansFile>& s = item.scans;
  std::vector<Capture> captures;
  if (!s.is_read) return captures;
  std::optional<Robot> robot;
  std::map<std::string, std::string> first;  // cloud -> the capture that names it
  for (std::size_t i = 0; i < s.value.captures.size(); ++i) {
    const CaptureText& t = s.value.captures[i];
    const std::string at = "captures[" + std::to_string(i) + "]";
    Capture c;
    const SensorSpec* sensor = nullptr;
    for (std::size_t k = 0; k < cell.sensors.size(); ++k)
      if (cell.sensors[k].id == t.sensor) c.sensor = int(k), sensor = &cell.sensors[k];
    if (!sensor && !t.sensor.empty() && item.cell.is_read)
      s.out.fault("input.unknown_sensor", at + ".sensor",
                  "found the sensor '" + t.sensor + "', allowed one that " + item.cell.out.name + " has");
    if (sensor && !sensor->is_calibrated && item.calibration.is_read && !item.calibration.value.sensors.count(sensor->id))
      s.out.fault("input.sensor_not_calibrated", at + ".sensor",
                  "found a capture of sensor '" + t.sensor + "', which " + item.calibration.out.name +
                      " does not name; calibrate it: without its covariance nothing can be said about the scan");
    if (t.feature) {
      c.feature = t.feature;
      const auto& features = item.part.value.features;
      if (item.part.is_read && std::none_of(features.begin(), features.end(), [&](const FeatureText& f) { return f.id == *t.feature; }))
        s.out.fault("input.unknown_feature", at + ".feature",
                    "found the feature '" + *t.feature + "', allowed one that " + item.part.out.name + " has");
    }
    if (t.base_flange && t.base_flange->joints_deg) {
      std::array<double, 6> q{};
      bool is_inside = true;
      for (std::size_t j = 0; j < 6; ++j) {
        q[j] = rad_from_deg((*t.base_flange->joints_deg)[j]);
        const JointSpec& l = cell.robot.joints[j];
        if (l.min_rad < l.max_rad && (q[j] < l.min_rad - 1e-9 || q[j] > l.max_rad + 1e-9)) {
          is_inside = false;
          s.out.fault("input.joints_outside_limits", at + ".base_flange.joints[" + std::to_string(j) + "]",
                      fmt::format("found {:g} degree, allowed {:g} to {:g}", (*t.base_flange->joints_deg)[j], deg_from_rad(l.min_rad),
                                  deg_from_rad(l.max_rad)),
                      (*t.base_flange->joints_deg)[j], deg_from_rad(q[j] < l.min_rad ? l.min_rad : l.max_rad), "degree");
        }
      }
      c.q_rad = q;
      if (is_inside && item.depth == Depth::all && item.has_kinematics && item.cell.out.faults.empty()) {
        if (!robot) {
          auto made = Robot::from(cell.robot);
          if (!made) {
            for (Refusal& r : made.error()) r.stage = "input", item.faults.push_back(r);
            return captures;
          }
          robot = std::move(*made);
        }
        c.T_base_flange = robot->forward(q);
      }
    } else if (t.base_flange) {
      c.T_base_flange = t.base_flange->pose<frame::Base, frame::Flange>();
      const double reach = t.base_flange->p_mm.norm();
      if (s.out.lines.count(at + ".base_flange") && reach < 30 && s.out.faults.empty())
        s.out.fault(
            "input.pose_unit", at + ".base_flange",
            fmt::format("found the flange {:.3g} mm from the origin of base, allowed outside the robot's own foot; lengths are mm", reach),
            reach, 30, "mm");
    }
    if (t.cloud || t.frames || t.profiles) {
      c.name = t.cloud ? *t.cloud : t.frames ? *t.frames : *t.profiles;
      const std::string field = at + (t.cloud ? ".cloud" : t.frames ? ".frames" : ".profiles");
      if (const auto [it, is_new] = first.try_emplace(c.name, at); !is_new)
        s.out.fault("input.cloud_twice", field,
                    "found '" + shown(c.name) + "', which " + it->second + " names already, allowed once: one scan was not taken from two places");
      if (t.cloud) read_points(item, t, field, sensor, c);
      else read_stream(item, t, at, cell, sensor, c);
    }
    captures.push_back(std::move(c));
  }
  return captures;
}

}  // namespace asbuilt::inputs
