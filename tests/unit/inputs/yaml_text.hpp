// SPDX-License-Identifier: GPL-3.0-or-later
// Two more visitors of the lists of fields, for tests: one fills a file with random allowed values, one writes it as YAML.
#pragma once

#include <random>
#include <string>
#include <type_traits>
#include <vector>

#include "planner/base/number.hpp"
#include "planner/inputs/yaml_reader.hpp"

namespace asbuilt::test {

using namespace inputs;

/// Random values inside every limit; every optional field is there.
class Filler {
 public:
  explicit Filler(std::mt19937_64& engine) : engine_(engine) {}
  template <class T>
  void operator()(const char*, T& value, const Field& f) {
    fill(value, f);
  }
  void exactly_one(std::initializer_list<const char*>) {}
  void together(const char*, std::initializer_list<const char*>) {}
  void rest(std::map<std::string, std::string>& values, const char*) { values["further_value"] = "text"; }

 private:
  std::mt19937_64& engine_;
  double uniform() { return double(engine_() >> 11) * 0x1.0p-53; }
  std::size_t below(std::size_t n) { return std::size_t(engine_() % n); }

  template <class T>
  void fill(T& v, const Field& f) {
    using namespace inputs::detail;
    const double low = std::max(f.min, -1000.0), high = std::max(low, std::min(f.max, std::max(1000.0, low)));
    if constexpr (is_optional<T>::value) {
      fill(v.emplace(), f);
    } else if constexpr (std::is_same_v<T, double>) {
      v = low + (high - low) * uniform();
    } else if constexpr (std::is_same_v<T, int>) {
      v = int(std::ceil(low)) + int(below(std::size_t(std::floor(high) - std::ceil(low)) + 1));
    } else if constexpr (std::is_same_v<T, bool>) {
      v = below(2) != 0;
    } else if constexpr (std::is_same_v<T, std::string>) {
      const std::string number = std::to_string(below(1000000));
      v = f.form == Form::date   ? "2026-0" + std::to_string(1 + below(9)) + "-1" + std::to_string(below(10))
          : f.form == Form::edge ? "#" + number
          : f.form == Form::file ? "a folder/file_" + number + ".ply"
          : f.form == Form::id   ? "id-" + number
                                 : "a text: with \"quotes\" and # " + number;
    } else if constexpr (std::is_same_v<T, NumberOrWord>) {
      v.is_word = !f.word.empty() && below(2) != 0;
      v.value = v.is_word ? 0 : low + (high - low) * uniform();
    } else if constexpr (std::is_same_v<T, PoseText>) {
      static const double quats[][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0.5, 0.5, 0.5, 0.5}, {0.5, -0.5, 0.5, -0.5}};
      const auto& q = quats[below(4)];
      v.q = Eigen::Quaterniond(q[0], q[1], q[2], q[3]);
      v.p_mm = Vec3(1000 * uniform(), -500 * uniform(), 20 * uniform());
      v.joints_deg.reset();
      if (f.allows_joints && below(2))
        for (double& j : v.joints_deg.emplace()) j = 360 * uniform() - 180;
    } else if constexpr (is_vec3<T>) {
      for (int k = 0; k < 3; ++k) v[k] = low + (high - low) * uniform();
    } else if constexpr (is_mat6<T>) {
      v.setZero();
      for (int k = 0; k < 6; ++k) v(k, k) = uniform();
      v(0, 4) = v(4, 0) = 0.9 * std::sqrt(v(0, 0) * v(4, 4));
    } else if constexpr (std::is_enum_v<T>) {
      v = Words<T>::list[below(Words<T>::list.size())].second;
    } else if constexpr (is_array<T>::value) {
      for (auto& e : v) fill(e, f);
    } else if constexpr (is_vector<T>::value) {
      v.clear();
      for (std::size_t i = std::max<std::size_t>(1, f.count_min) + below(3); i-- > 0;) fill(v.emplace_back(), f);
    } else if constexpr (is_map<T>::value) {
      v.clear();
      for (std::size_t i = 1 + below(3); i-- > 0;) fill(v["name-" + std::to_string(i)], f);
    } else {
      T::fields(v, *this);
    }
  }
};

/// YAML in flow style. Of keys that exclude each other the one at `choice` (modulo their number) is written.
class YamlText {
 public:
  std::vector<std::pair<std::string, std::string>> entries;
  explicit YamlText(std::size_t choice) : choice_(choice) {}

  template <class T>
  void operator()(const char* name, T& value, const Field& f) {
    if constexpr (inputs::detail::is_optional<T>::value) {
      if (value) entries.emplace_back(name, text(*value, f));
    } else {
      entries.emplace_back(name, text(value, f));
    }
  }
  void exactly_one(std::initializer_list<const char*> names) {
    std::vector<std::string> there;
    for (const char* n : names)
      for (const auto& [key, t] : entries)
        if (key == n) there.push_back(key);
    if (there.empty()) return;
    const std::string kept = there[choice_ % there.size()];
    std::erase_if(entries, [&](const auto& e) { return e.first != kept && std::find(there.begin(), there.end(), e.first) != there.end(); });
  }
  void together(const char*, std::initializer_list<const char*>) {}
  void rest(std::map<std::string, std::string>& values, const char*) {
    for (const auto& [key, value] : values) entries.emplace_back(key, quoted(value));
  }
  /// All entries, the order turned by `turn`.
  std::string map_text(std::size_t turn = 0) const {
    std::string out;
    for (std::size_t i = 0; i < entries.size(); ++i) {
      const auto& [key, t] = entries[(i + turn) % entries.size()];
      out += (out.empty() ? "{" : ", ") + key + ": " + t;
    }
    return (out.empty() ? "{" : out) + "}";
  }

  template <class T>
  std::string text(T& v, const Field& f) const {
    using namespace inputs::detail;
    const auto list = [&](auto&& each, std::size_t count) {
      std::string out = "[";
      for (std::size_t i = 0; i < count; ++i) out += (i ? ", " : "") + each(i);
      return out + "]";
    };
    if constexpr (std::is_same_v<T, double>) return shortest_number(v);
    else if constexpr (std::is_same_v<T, int>) return std::to_string(v);
    else if constexpr (std::is_same_v<T, bool>) return v ? "true" : "false";
    else if constexpr (std::is_same_v<T, std::string>) return quoted(v);
    else if constexpr (std::is_same_v<T, NumberOrWord>) return v.is_word ? std::string(f.word) : shortest_number(v.value);
    else if constexpr (std::is_same_v<T, PoseText>) {
      if (v.joints_deg) return "{joints: " + list([&](std::size_t i) { return shortest_number((*v.joints_deg)[i]); }, 6) + "}";
      const double q[] = {v.q.w(), v.q.x(), v.q.y(), v.q.z()};
      return "{xyz: " + list([&](std::size_t i) { return shortest_number(v.p_mm[Eigen::Index(i)]); }, 3) +
             ", quat: " + list([&](std::size_t i) { return shortest_number(q[i]); }, 4) + "}";
    } else if constexpr (is_vec3<T>) return list([&](std::size_t i) { return shortest_number(v[Eigen::Index(i)]); }, 3);
    else if constexpr (is_mat6<T>)
      return list(
          [&](std::size_t r) { return list([&](std::size_t c) { return shortest_number(v(Eigen::Index(r), Eigen::Index(c))); }, 6); }, 6);
    else if constexpr (std::is_enum_v<T>) {
      for (const auto& [word, e] : Words<T>::list)
        if (e == v) return std::string(word);
      return "?";
    } else if constexpr (is_array<T>::value || is_vector<T>::value) return list([&](std::size_t i) { return text(v[i], f); }, v.size());
    else if constexpr (is_map<T>::value) {
      std::string out;
      for (auto& [key, e] : v) out += (out.empty() ? "{" : ", ") + key + ": " + text(e, f);
      return out + "}";
    } else {
      YamlText inner(choice_);
      T::fields(v, inner);
      return inner.map_text(choice_);
    }
  }

 private:
  std::size_t choice_;
  static std::string quoted(const std::string& text) {
    std::string out = "\"";
    for (const char c : text) out += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return out + "\"";
  }
};

template <class File>
std::string yaml_of(File& file, std::size_t choice) {
  YamlText t(choice);
  t.entries.emplace_back("asbuilt", std::string(File::kind) + "/1");
  File::fields(file, t);
  std::string out;
  for (std::size_t i = 0; i < t.entries.size(); ++i) {
    const auto& [key, text] = t.entries[(i + choice) % t.entries.size()];
    out += key + ": " + text + "\n";
  }
  return out;
}

}  // namespace asbuilt::test
