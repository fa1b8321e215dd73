// SPDX-License-Identifier: GPL-3.0-or-later
// JSON Schema (2020-12) and the tables of docs/formats.md, both from the lists of fields the loader reads by.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include <cmath>

#include "planner/inputs/files_batch.hpp"
#include "planner/inputs/files_captures.hpp"
#include "planner/inputs/files_cell.hpp"
#include "planner/inputs/files_part.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/inputs/yaml_reader.hpp"
#include "planner/io/file.hpp"

namespace asbuilt {

namespace inputs {
namespace {

using Json = nlohmann::ordered_json;

/// 3 rather than 3.0.
Json number(double v) {
  if (v == std::floor(v) && std::abs(v) < 1e15) return static_cast<long long>(v);
  return v;
}

Json list_of(const Json& item) { return {{"type", "array"}, {"items", item}}; }
Json list_of(const Json& item, std::size_t count) { return {{"type", "array"}, {"items", item}, {"minItems", count}, {"maxItems", count}}; }
Json map_of(const Json& item) { return {{"type", "object"}, {"additionalProperties", item}}; }

class SchemaWriter {
 public:
  Json properties = Json::object();
  Json required = Json::array(), conditions = Json::array();
  Json dependent = Json::object();
  std::optional<Json> choice;
  Json additional = false;

  template <class T>
  void operator()(const char* name, T& value, const Field& f) {
    Json j = type(value, f);
    describe(j, f);
    if constexpr (std::is_same_v<T, double> || std::is_same_v<T, int>) {
      if (f.is_optional) j["default"] = number(value);
    } else if constexpr (std::is_same_v<T, bool>) {
      if (f.is_optional) j["default"] = value;
    }
    add(name, std::move(j), f);
  }
  static void describe(Json& j, const Field& f) {
    if (!f.doc.empty()) j["description"] = f.doc;
    if (!f.unit.empty()) j["x-unit"] = f.unit;
    if (!f.when_key.empty()) j["x-required-when"] = std::string(f.when_key) + ": " + std::string(f.when_values);
  }
  void add(const char* name, Json j, const Field& f) {
    properties[name] = std::move(j);
    if (!f.when_key.empty()) {
      Json words = Json::array();
      std::string_view rest = f.when_values;
      while (true) {
        const std::size_t bar = rest.find('|');
        words.push_back(rest.substr(0, bar));
        if (bar == std::string_view::npos) break;
        rest.remove_prefix(bar + 1);
      }
      const std::string key(f.when_key);
      Json when;
      when["if"] = {{"properties", {{key, {{"enum", words}}}}}, {"required", {key}}};
      when["then"] = {{"required", {name}}};
      conditions.push_back(std::move(when));
    } else if (!f.is_optional) {
      required.push_back(name);
    }
  }
  void exactly_one(std::initializer_list<const char*> names) {
    Json one = Json::array();
    for (const char* n : names) one.push_back({{"required", {n}}});
    choice = std::move(one);
  }
  void together(const char* name, std::initializer_list<const char*> others) {
    for (const char* o : others) dependent[name].push_back(o);
  }
  void rest(std::map<std::string, std::string>&, const char* doc) {
    additional = {{"type", {"string", "number", "boolean"}}, {"description", doc}};
  }

  Json object() const {
    Json o;
    o["type"] = "object";
    o["properties"] = properties;
    if (!required.empty()) o["required"] = required;
    if (choice) o["oneOf"] = *choice;
    if (!dependent.empty()) o["dependentRequired"] = dependent;
    if (!conditions.empty()) o["allOf"] = conditions;
    o["additionalProperties"] = additional;
    return o;
  }

  template <class T>
  static Json type(T& value, const Field& f) {
    using namespace detail;
    Json j;
    const auto limits = [&](Json& n) {
      if (std::isfinite(f.min)) n["minimum"] = number(f.min);
      if (std::isfinite(f.max)) n["maximum"] = number(f.max);
    };
    if constexpr (is_optional<T>::value) {
      typename T::value_type inner{};
      return type(inner, f);
    } else if constexpr (std::is_same_v<T, double> || std::is_same_v<T, int>) {
      j["type"] = std::is_same_v<T, double> ? "number" : "integer";
      limits(j);
    } else if constexpr (std::is_same_v<T, bool>) {
      j["type"] = "boolean";
    } else if constexpr (std::is_same_v<T, std::string>) {
      j["type"] = Json::array({"string", "number"});
      if (f.form == Form::date) j = {{"type", "string"}, {"format", "date"}};
      if (f.form == Form::id) j = {{"type", "string"}, {"pattern", "^[A-Za-z0-9_][A-Za-z0-9._-]{0,99}$"}};
      if (f.form == Form::file) j = {{"type", "string"}, {"x-form", "path"}};
      if (f.form == Form::edge) j = {{"type", "string"}, {"x-form", "CAD id"}};
    } else if constexpr (std::is_same_v<T, NumberOrWord>) {
      Json n = {{"type", "number"}};
      limits(n);
      j["anyOf"] = Json::array({n, Json{{"const", f.word}}});
    } else if constexpr (std::is_same_v<T, PoseText>) {
      j["$ref"] = f.allows_joints ? "#/$defs/robot_pose" : "#/$defs/pose";
    } else if constexpr (is_vec3<T>) {
      Json n = {{"type", "number"}};
      limits(n);
      j = {{"type", "array"}, {"items", n}, {"minItems", 3}, {"maxItems", 3}};
    } else if constexpr (is_mat6<T>) {
      j = {{"type", "array"},
           {"items", {{"type", "array"}, {"items", {{"type", "number"}}}, {"minItems", 6}, {"maxItems", 6}}},
           {"minItems", 6},
           {"maxItems", 6}};
    } else if constexpr (std::is_enum_v<T>) {
      j["enum"] = Json::array();
      for (const auto& [word, e] : Words<T>::list) j["enum"].push_back(word);
    } else if constexpr (is_array<T>::value) {
      j = list_of(type(value[0], f), value.size());
    } else if constexpr (is_vector<T>::value) {
      typename T::value_type inner{};
      j = list_of(type(inner, f));
      if (f.count_min) j["minItems"] = f.count_min;
    } else if constexpr (is_map<T>::value) {
      typename T::mapped_type inner{};
      j = map_of(type(inner, f));
    } else {
      SchemaWriter w;
      T::fields(value, w);
      j = w.object();
      if (f.empty_means_present) j["type"] = Json::array({"object", "null"});
    }
    return j;
  }
};

Json numbers_of(int count) { return {{"type", "array"}, {"items", {{"type", "number"}}}, {"minItems", count}, {"maxItems", count}}; }

Json pose_schema(bool allows_joints) {
  const auto form = [](std::initializer_list<std::pair<const char*, Json>> parts) {
    Json o = {{"type", "object"}, {"properties", Json::object()}, {"required", Json::array()}, {"additionalProperties", false}};
    for (const auto& [key, j] : parts) o["properties"][key] = j, o["required"].push_back(key);
    return o;
  };
  Json rows = {{"type", "array"}, {"items", numbers_of(4)}, {"minItems", 4}, {"maxItems", 4}};
  Json forms = Json::array({form({{"xyz", numbers_of(3)}, {"quat", numbers_of(4)}}), form({{"xyz", numbers_of(3)}, {"zyx", numbers_of(3)}}),
                            form({{"xyz", numbers_of(3)}, {"rpy", numbers_of(3)}}), form({{"matrix", rows}})});
  if (allows_joints) forms.push_back(form({{"joints", numbers_of(6)}}));
  return {{"oneOf", forms}};
}

template <class File>
Json file_schema() {
  File file;
  SchemaWriter w;
  w.properties["asbuilt"] = {{"const", std::string(File::kind) + "/1"}, {"description", "kind and version of the file"}};
  w.required.push_back("asbuilt");
  File::fields(file, w);
  Json o;
  o["$schema"] = "https://json-schema.org/draft/2020-12/schema";
  o["title"] = std::string("asbuilt: ") + std::string(File::kind) + "/1";
  o["description"] = File::title;
  const Json object = w.object();
  for (const auto& [key, value] : object.items()) o[key] = value;
  if (const std::string text = o.dump();
      text.find("#/$defs/pose") != std::string::npos || text.find("#/$defs/robot_pose") != std::string::npos)
    o["$defs"] = {{"pose", pose_schema(false)}, {"robot_pose", pose_schema(true)}};
  return o;
}

template <class F>
bool for_kind(const std::string& kind, F&& f) {
  if (kind == "part") f.template operator()<PartFile>();
  else if (kind == "recipe") f.template operator()<RecipeFile>();
  else if (kind == "cell") f.template operator()<CellFile>();
  else if (kind == "fixture") f.template operator()<FixtureFile>();
  else if (kind == "calibration") f.template operator()<CalibrationFile>();
  else if (kind == "scans") f.template operator()<ScansFile>();
  else if (kind == "batch") f.template operator()<BatchFile>();
  else if (kind == "captures") f.template operator()<CapturesFile>();
  else return false;
  return true;
}

std::string type_words(const Json& j) {
  if (j.contains("$ref")) return j["$ref"] == "#/$defs/pose" ? "pose" : "pose or joints";
  if (j.contains("const")) return "`" + j["const"].get<std::string>() + "`";
  if (j.contains("enum")) {
    std::string all;
    for (const Json& e : j["enum"]) all += (all.empty() ? "`" : "`, `") + e.get<std::string>();
    return all + "`";
  }
  if (j.contains("anyOf")) return "number or `" + j["anyOf"][1]["const"].get<std::string>() + "`";
  if (j.contains("pattern")) return "name";
  if (j.contains("x-form")) return j["x-form"].get<std::string>();
  if (j.contains("format")) return "day";
  const Json& t = j["type"];
  if (t == "array") {
    const bool is_fixed = j.contains("maxItems") && j["maxItems"] == j["minItems"];
    return std::string("list of ") +
           (is_fixed                 ? std::to_string(j["minItems"].get<int>()) + " x "
            : j.contains("minItems") ? "at least " + std::to_string(j["minItems"].get<int>()) + " x "
                                     : "") +
           type_words(j["items"]);
  }
  if (t == "object" || (t.is_array() && t[0] == "object")) return j.contains("properties") ? "mapping" : "mapping by name";
  if (t.is_array()) return "text";
  return t.get<std::string>();
}

const Json* innermost(const Json* j) {
  while (j->contains("items")) j = &(*j)["items"];
  return j;
}

std::string range_words(const Json& outer) {
  const Json* j = innermost(&outer);
  if (j->contains("anyOf")) j = &(*j)["anyOf"][0];
  const bool low = j->contains("minimum"), high = j->contains("maximum");
  const auto text = [](const Json& n) { return n.is_number_integer() ? n.dump() : fmt::format("{:g}", n.get<double>()); };
  if (low && high) return text((*j)["minimum"]) + " to " + text((*j)["maximum"]);
  if (low) return "from " + text((*j)["minimum"]);
  if (high) return "to " + text((*j)["maximum"]);
  return "";
}

void add_rows(const Json& object, const std::string& path, std::string& out) {
  for (const auto& [name, j] : object["properties"].items()) {
    const std::string field = path.empty() ? name : path + "." + name;
    bool is_required = false;
    if (object.contains("required"))
      for (const Json& r : object["required"]) is_required = is_required || r == name;
    std::string need = is_required ? "yes" : "";
    if (j.contains("x-required-when")) need = "with `" + j["x-required-when"].get<std::string>() + "`";
    if (object.contains("oneOf"))
      for (const Json& o : object["oneOf"])
        if (o["required"][0] == name) need = "one of these";
    if (object.contains("dependentRequired"))
      for (const auto& [key, list] : object["dependentRequired"].items())
        for (const Json& l : list)
          if (l == name) need += (need.empty() ? "with `" : ", with `") + key + "`";
    if (j.contains("default")) need = "default " + j["default"].dump();
    for (std::size_t bar = need.find('|'); bar != std::string::npos; bar = need.find('|', bar + 4)) need.replace(bar, 1, " / ");
    out += "| `" + field + "` | " + type_words(j) + " | " + (j.contains("x-unit") ? j["x-unit"].get<std::string>() : "") + " | " +
           range_words(j) + " | " + need + " | " + (j.contains("description") ? j["description"].get<std::string>() : "") + " |\n";
    const Json* inner = innermost(&j);
    std::string deeper = field;
    for (const Json* k = &j; k->contains("items"); k = &(*k)["items"]) deeper += "[]";
    if (inner->contains("properties")) {
      add_rows(*inner, deeper, out);
    } else if (inner->contains("additionalProperties") && (*inner)["additionalProperties"].contains("properties")) {
      add_rows((*inner)["additionalProperties"], deeper + ".NAME", out);
    }
    if (inner->contains("properties") && (*inner)["additionalProperties"].is_object())
      out += "| `" + deeper + ".*` | text |  |  |  | " + (*inner)["additionalProperties"]["description"].get<std::string>() + " |\n";
  }
}

}  // namespace
}  // namespace inputs

using namespace inputs;

std::vector<std::string> file_kinds() { return {"part", "recipe", "cell", "fixture", "calibration", "scans", "batch", "captures"}; }

std::string schema_json(const std::string& kind) {
  std::string text;
  for_kind(kind, [&]<class File>() { text = file_schema<File>().dump(2) + "\n"; });
  return text;
}

std::string schema_table(const std::string& kind) {
  std::string text;
  for_kind(kind, [&]<class File>() {
    text = "| field | type | unit | range | required | meaning |\n|---|---|---|---|---|---|\n";
    add_rows(file_schema<File>(), "", text);
  });
  return text;
}

Refusals check_file(const std::string& kind, const std::filesystem::path& file) {
  Readout out{.name = file.filename().string()};
  auto bytes = read_file(file, out.name);
  if (!bytes) return bytes.error();
  if (!for_kind(kind, [&]<class File>() { (void)read_yaml<File>(*bytes, out); }))
    out.fault("input.wrong_kind", "",
              "found the kind '" + shown(kind) + "', allowed part, recipe, cell, fixture, calibration, scans, batch, captures");
  return out.faults;
}

}  // namespace asbuilt
