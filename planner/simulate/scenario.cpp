// SPDX-License-Identifier: GPL-3.0-or-later
// A scenario file: which virtual part, which seed, which fault.
#include <yaml-cpp/yaml.h>

#include <fstream>

#include "planner/simulate/simulate.hpp"

namespace asbuilt {

namespace {

/// The captures of a scans file whose poses are joints.
std::vector<PlannedCapture> planned_captures(const std::filesystem::path& file) {
  std::vector<PlannedCapture> out;
  for (const auto& c : YAML::LoadFile(file.string())["captures"]) {
    PlannedCapture p;
    p.sensor = c["sensor"].as<std::string>(), p.cloud = c["cloud"].as<std::string>();
    if (c["feature"]) p.feature = c["feature"].as<std::string>();
    const auto q = c["base_flange"]["joints"].as<std::vector<double>>();
    if (q.size() != 6) throw YAML::Exception(c.Mark(), "base_flange: six joints are wanted");
    for (std::size_t i = 0; i < 6; ++i) p.q_rad[i] = q[i] * 0.017453292519943295;
    out.push_back(p);
  }
  return out;
}

}  // namespace

Result<Done<Scenario>> load_scenario(const std::filesystem::path& file) {
  Scenario s;
  Refusals faults;
  const auto fault = [&](int line, const std::string& field, const std::string& message) {
    faults.push_back({.code = "input.bad_scenario", .where = file.string() + ":" + std::to_string(line) + ": " + field, .message = message, .stage = "input"});
  };
  YAML::Node root;
  try {
    root = YAML::LoadFile(file.string());
  } catch (const YAML::Exception& e) {
    fault(e.mark.line + 1, "", std::string("found no readable YAML: ") + e.what());
    return refuse_all(faults);
  }
  if (!root.IsMap()) {
    fault(1, "", "found no mapping; allowed: asbuilt, part, seed, turn, tilt, trap, size, light, width, tolerance, item, captures");
    return refuse_all(faults);
  }
  if (!root["asbuilt"] || root["asbuilt"].as<std::string>("") != "scenario/1") fault(1, "asbuilt", "found something else; allowed: scenario/1");
  for (const auto& kv : root) {
    const std::string key = kv.first.as<std::string>("");
    const int line = kv.first.Mark().line + 1;
    try {
      if (key == "asbuilt") {
      } else if (key == "part") {
        s.part = kv.second.as<std::string>();
      } else if (key == "seed") {
        s.seed = kv.second.as<std::uint64_t>();
      } else if (key == "turn") {
        s.turn_rad = kv.second.as<double>() * 0.017453292519943295;
      } else if (key == "tilt") {
        s.tilt_rad = kv.second.as<double>() * 0.017453292519943295;
      } else if (key == "trap") {
        s.trap = kv.second.as<std::string>();
      } else if (key == "size") {
        s.trap_size = kv.second.as<double>();
      } else if (key == "light") {
        s.is_light = kv.second.as<bool>();
      } else if (key == "width") {
        s.width_mm = kv.second.as<double>();
      } else if (key == "tolerance") {
        s.tolerance_mm = kv.second.as<double>();
      } else if (key == "captures") {
        const std::string name = kv.second.as<std::string>();
        try {
          s.captures = planned_captures(file.parent_path() / name);
        } catch (const YAML::Exception& e) {
          fault(line, key, "found no scans file whose captures give joints in '" + name + "': " + e.what());
        }
        if (s.captures.empty()) fault(line, key, "found no capture in '" + name + "'");
      } else if (key == "item") {
        s.item_id = kv.second.as<std::string>();
      } else {
        fault(line, key, "unknown key; allowed: asbuilt, part, seed, turn, tilt, trap, size, light, width, tolerance, item, captures");
      }
    } catch (const YAML::Exception&) {
      fault(line, key, "found a value of another type");
    }
  }
  if (!faults.empty()) return refuse_all(faults);
  return Done<Scenario>{s, {}};
}

}  // namespace asbuilt
