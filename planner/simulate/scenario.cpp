// SPDX-License-Identifier: GPL-3.0-or-later
// A scenario file: which virtual part, which seed, which fault.
#include <yaml-cpp/yaml.h>

#include <fstream>

#include "planner/simulate/simulate.hpp"

namespace asbuilt {

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
    fault(1, "", "found no mapping; allowed: asbuilt, part, seed, turn, tilt, trap, size, light, item");
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
      } else if (key == "item") {
        s.item_id = kv.second.as<std::string>();
      } else {
        fault(line, key, "unknown key; allowed: asbuilt, part, seed, turn, tilt, trap, size, light, item");
      }
    } catch (const YAML::Exception&) {
      fault(line, key, "found a value of another type");
    }
  }
  if (!faults.empty()) return refuse_all(faults);
  return Done<Scenario>{s, {}};
}

}  // namespace asbuilt
