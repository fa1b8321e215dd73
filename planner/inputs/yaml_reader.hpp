// SPDX-License-Identifier: GPL-3.0-or-later
// Fills a struct from YAML by its list of fields. Collects every fault instead of stopping at the first; each names file,
// line, field, what was found and what is allowed. Numbers and words are read by the declared type, never by guess.
#pragma once

#include <yaml-cpp/yaml.h>

#include <initializer_list>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "planner/base/result.hpp"
#include "planner/inputs/fields.hpp"

namespace asbuilt::inputs {

/// What reading one file gave besides its values.
struct Readout {
  std::string name;                  // as shown to people: relative to the batch's folder
  std::map<std::string, int> lines;  // field -> line, from 1
  Refusals faults;
  std::size_t nodes_count = 0;
  bool is_of_kind = false;  // the file is there and its first line is right; single fields may be faulty

  /// "part.yaml:12: features[0].recipe"; the line of the nearest parent where the field itself is not in the file.
  std::string where(const std::string& field) const;
  void fault(std::string code, const std::string& field, std::string message);
  void fault(std::string code, const std::string& field, std::string message, double measured, double limit, std::string unit);
};

namespace detail {
template <class T>
struct is_vector : std::false_type {};
template <class T>
struct is_vector<std::vector<T>> : std::true_type {};
template <class T>
struct is_array : std::false_type {};
template <class T, std::size_t N>
struct is_array<std::array<T, N>> : std::true_type {};
template <class T>
struct is_optional : std::false_type {};
template <class T>
struct is_optional<std::optional<T>> : std::true_type {};
template <class T>
struct is_map : std::false_type {};
template <class T>
struct is_map<std::map<std::string, T>> : std::true_type {};
template <class T>
inline constexpr bool is_vec3 = std::is_same_v<T, Vec3>;
template <class T>
inline constexpr bool is_mat6 = std::is_same_v<T, Mat6>;
}  // namespace detail

/// One mapping of the file and which of its keys have been asked for.
class MapReader {
 public:
  MapReader(Readout& out, const YAML::Node& node, std::string field);

  template <class T>
  void operator()(const char* name, T& value, const Field& f);
  void exactly_one(std::initializer_list<const char*> names);
  void together(const char* name, std::initializer_list<const char*> others);
  void rest(std::map<std::string, std::string>& values, const char* doc);
  /// Call once after all fields: faults the keys nobody asked for.
  void finish();
  /// The words of the header; empty where there is none.
  bool header(std::string_view kind);

  template <class T>
  static void read(Readout& out, const YAML::Node& node, const std::string& field, const Field& f, T& value);

 private:
  Readout& out_;
  const YAML::Node& node_;
  std::string field_;
  bool is_map_ = true;
  std::map<std::string, YAML::Node> values_;
  std::map<std::string, int> key_line_;
  std::vector<std::string> order_, asked_;
  std::set<std::string> taken_;

  std::string child(const std::string& name) const { return field_.empty() ? name : field_ + "." + name; }
  const YAML::Node* take(const std::string& name);
  bool is_required(const Field& f) const;
  void missing(const char* name, bool has_key, const Field& f);
  bool has(const char* name) const;
};

// The leaves. Each says itself what is wrong.
/// Notes the line of a value; the line of its key, where it has one, is noted already and stays.
void mark(Readout& out, const YAML::Node& node, const std::string& field);
void read_number(Readout&, const YAML::Node&, const std::string& field, const Field&, double& value);
void read_integer(Readout&, const YAML::Node&, const std::string& field, const Field&, int& value);
void read_bool(Readout&, const YAML::Node&, const std::string& field, bool& value);
void read_text(Readout&, const YAML::Node&, const std::string& field, const Field&, std::string& value);
void read_number_or_word(Readout&, const YAML::Node&, const std::string& field, const Field&, NumberOrWord& value);
void read_pose(Readout&, const YAML::Node&, const std::string& field, const Field&, PoseText& value);
void read_matrix6(Readout&, const YAML::Node&, const std::string& field, const Field&, Mat6& value);
void read_vec3(Readout&, const YAML::Node&, const std::string& field, const Field&, Vec3& value);
/// The word of a choice, or nothing after a fault.
std::optional<std::string> read_choice(Readout&, const YAML::Node&, const std::string& field, const std::vector<std::string_view>& words);
/// True when the node is a list whose length fits (exactly `count`, or at least `count` when `or_more`).
bool expect_list(Readout&, const YAML::Node&, const std::string& field, std::size_t count, bool or_more);
bool expect_map(Readout&, const YAML::Node&, const std::string& field);

/// The one document of a YAML text, or nothing after a fault.
std::optional<YAML::Node> parse_yaml(std::string_view text, Readout& out);

/// Reads one file of a kind. Whatever could be read is in the result; `out.faults` says whether it may be used.
/// Compiled once for each kind, in read_yaml.cpp.
template <class T>
T read_yaml(std::string_view text, Readout& out);

/// Text as it may stand in a message: printable, no longer than 60 characters.
std::string shown(std::string_view text);

}  // namespace asbuilt::inputs
