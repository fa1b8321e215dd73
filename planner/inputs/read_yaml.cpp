// SPDX-License-Identifier: GPL-3.0-or-later
// Reading by the list of fields, for every kind of file.
#include "planner/inputs/files_batch.hpp"
#include "planner/inputs/files_captures.hpp"
#include "planner/inputs/files_cell.hpp"
#include "planner/inputs/files_part.hpp"
#include "planner/inputs/yaml_reader.hpp"

namespace asbuilt::inputs {

template <class T>
void MapReader::operator()(const char* name, T& value, const Field& f) {
  const YAML::Node* node = take(name);
  if (node) out_.lines[child(name)] = key_line_[name];
  if (!node || (node->IsNull() && !f.empty_means_present)) {
    if (is_required(f)) missing(name, node != nullptr, f);
    return;
  }
  read(out_, *node, child(name), f, value);
}

template <class T>
void MapReader::read(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, T& value) {
  using namespace detail;
  mark(out, node, field);
  if constexpr (is_optional<T>::value) {
    read(out, node, field, f, value.emplace());
  } else if constexpr (std::is_same_v<T, double>) {
    read_number(out, node, field, f, value);
  } else if constexpr (std::is_same_v<T, int>) {
    read_integer(out, node, field, f, value);
  } else if constexpr (std::is_same_v<T, bool>) {
    read_bool(out, node, field, value);
  } else if constexpr (std::is_same_v<T, std::string>) {
    read_text(out, node, field, f, value);
  } else if constexpr (std::is_same_v<T, NumberOrWord>) {
    read_number_or_word(out, node, field, f, value);
  } else if constexpr (std::is_same_v<T, PoseText>) {
    read_pose(out, node, field, f, value);
  } else if constexpr (is_vec3<T>) {
    read_vec3(out, node, field, f, value);
  } else if constexpr (is_mat6<T>) {
    read_matrix6(out, node, field, f, value);
  } else if constexpr (std::is_enum_v<T>) {
    std::vector<std::string_view> words;
    for (const auto& [word, e] : Words<T>::list) words.push_back(word);
    if (const auto found = read_choice(out, node, field, words))
      for (const auto& [word, e] : Words<T>::list)
        if (word == *found) value = e;
  } else if constexpr (is_array<T>::value) {
    if (!expect_list(out, node, field, value.size(), false)) return;
    for (std::size_t i = 0; i < value.size(); ++i) read(out, node[i], field + "[" + std::to_string(i) + "]", f, value[i]);
  } else if constexpr (is_vector<T>::value) {
    if (!expect_list(out, node, field, f.count_min, true)) return;
    value.clear();
    std::size_t i = 0;
    for (const YAML::Node& entry : node) read(out, entry, field + "[" + std::to_string(i++) + "]", f, value.emplace_back());
  } else if constexpr (is_map<T>::value) {
    if (!expect_map(out, node, field)) return;
    for (const auto& entry : node) {
      const std::string key = entry.first.IsScalar() ? entry.first.Scalar() : std::string();
      if (key.empty() || value.count(key)) {
        out.fault(key.empty() ? "input.wrong_type" : "input.duplicate_key", field,
                  key.empty() ? "found a key that is no name, allowed names" : "found the key '" + key + "' twice, allowed once");
        continue;
      }
      out.lines[field + "." + key] = entry.first.Mark().line + 1;
      read(out, entry.second, field + "." + key, f, value[key]);
    }
  } else {
    if (node.IsNull() && f.empty_means_present) return;
    if (!expect_map(out, node, field)) return;
    MapReader reader(out, node, field);
    T::fields(value, reader);
    reader.finish();
  }
}

template <class T>
T read_yaml(std::string_view text, Readout& out) {
  T value;
  const std::optional<YAML::Node> node = parse_yaml(text, out);
  if (!node || !expect_map(out, *node, "")) return value;
  MapReader reader(out, *node, "");
  if (!reader.header(T::kind)) return value;
  T::fields(value, reader);
  reader.finish();
  return value;
}

template PartFile read_yaml(std::string_view, Readout&);
template RecipeFile read_yaml(std::string_view, Readout&);
template CellFile read_yaml(std::string_view, Readout&);
template FixtureFile read_yaml(std::string_view, Readout&);
template CalibrationFile read_yaml(std::string_view, Readout&);
template ScansFile read_yaml(std::string_view, Readout&);
template BatchFile read_yaml(std::string_view, Readout&);
template CapturesFile read_yaml(std::string_view, Readout&);

}  // namespace asbuilt::inputs
