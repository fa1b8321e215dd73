// SPDX-License-Identifier: GPL-3.0-or-later
// Every artefact lists its fields once, in a static `visit(self, archive)`. From that list come the bytes in the store,
// their content hash, and the JSON a person reads. Bytes are little-endian with every double in full; JSON is for people.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "planner/base/frames.hpp"
#include "planner/base/hash.hpp"
#include "planner/base/result.hpp"

namespace asbuilt {

using Json = nlohmann::ordered_json;

namespace archive_detail {

struct AnyArchive {
  template <class T>
  void operator()(const char*, T&) {}
};
template <class T>
concept Visitable = requires(T& t, AnyArchive a) { std::remove_const_t<T>::visit(t, a); };

template <class T>
struct is_vector : std::false_type {};
template <class T, class A>
struct is_vector<std::vector<T, A>> : std::true_type {};
template <class T>
struct is_array : std::false_type {};
template <class T, std::size_t N>
struct is_array<std::array<T, N>> : std::true_type {};
template <class T>
struct is_optional : std::false_type {};
template <class T>
struct is_optional<std::optional<T>> : std::true_type {};
template <class T>
struct is_shared : std::false_type {};
template <class T>
struct is_shared<std::shared_ptr<T>> : std::true_type {};
template <class T>
struct is_map : std::false_type {};
template <class K, class V>
struct is_map<std::map<K, V>> : std::true_type {};
template <class T>
struct is_pair : std::false_type {};
template <class K, class V>
struct is_pair<std::pair<K, V>> : std::true_type {};
template <class T>
struct is_variant : std::false_type {};
template <class... T>
struct is_variant<std::variant<T...>> : std::true_type {};
template <class T>
struct is_pose : std::false_type {};
template <class A, class B>
struct is_pose<Pose<A, B>> : std::true_type {};
template <class T>
concept EigenFixed = std::is_base_of_v<Eigen::MatrixBase<T>, T> && (T::SizeAtCompileTime != Eigen::Dynamic);
template <class T>
inline constexpr bool is_plain = std::is_arithmetic_v<T> || std::is_enum_v<T>;

}  // namespace archive_detail

/// Writes a value as canonical bytes.
class ByteWriter {
 public:
  std::string bytes;

  template <class T>
  void operator()(const char*, const T& v) {
    write(v);
  }
  template <class T>
  void write(const T& v) {
    using namespace archive_detail;
    if constexpr (std::is_same_v<T, std::string>) {
      write<std::uint64_t>(v.size());
      bytes += v;
    } else if constexpr (std::is_same_v<T, bool>) {
      bytes += v ? '\1' : '\0';
    } else if constexpr (is_plain<T>) {
      const char* p = reinterpret_cast<const char*>(&v);
      bytes.append(p, sizeof v);
    } else if constexpr (is_vector<T>::value) {
      write<std::uint64_t>(v.size());
      for (const auto& e : v) write<std::remove_cvref_t<typename T::value_type>>(e);
    } else if constexpr (is_array<T>::value) {
      for (const auto& e : v) write(e);
    } else if constexpr (is_optional<T>::value || is_shared<T>::value) {
      write<bool>(static_cast<bool>(v));
      if (v) write(*v);
    } else if constexpr (is_map<T>::value) {
      write<std::uint64_t>(v.size());
      for (const auto& [k, e] : v) write(k), write(e);
    } else if constexpr (is_pair<T>::value) {
      write(v.first), write(v.second);
    } else if constexpr (is_variant<T>::value) {
      write<std::uint32_t>(static_cast<std::uint32_t>(v.index()));
      std::visit([this](const auto& e) { write(e); }, v);
    } else if constexpr (is_pose<T>::value) {
      for (double d : {v.q.w(), v.q.x(), v.q.y(), v.q.z(), v.p_mm.x(), v.p_mm.y(), v.p_mm.z()}) write(d);
    } else if constexpr (EigenFixed<T>) {
      for (int i = 0; i < v.rows(); ++i)
        for (int j = 0; j < v.cols(); ++j) write(v(i, j));
    } else if constexpr (std::is_same_v<T, std::monostate>) {
    } else {
      T::visit(v, *this);
    }
  }
};

/// Reads what ByteWriter wrote; throws Bug on bytes that end too early.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : rest_(bytes) {}

  template <class T>
  void operator()(const char*, T& v) {
    read(v);
  }
  template <class T>
  void read(T& v) {
    using namespace archive_detail;
    if constexpr (std::is_same_v<T, std::string>) {
      v = std::string(take(count(1)));
    } else if constexpr (std::is_same_v<T, bool>) {
      v = take(1)[0] != '\0';
    } else if constexpr (is_plain<T>) {
      std::memcpy(&v, take(sizeof v).data(), sizeof v);
    } else if constexpr (is_vector<T>::value) {
      v.clear();
      const std::uint64_t n = count(1);
      if constexpr (std::is_same_v<typename T::value_type, bool>) {
        for (std::uint64_t i = 0; i < n; ++i) {
          bool b;
          read(b);
          v.push_back(b);
        }
      } else {
        v.resize(n);
        for (auto& e : v) read(e);
      }
    } else if constexpr (is_array<T>::value) {
      for (auto& e : v) read(e);
    } else if constexpr (is_optional<T>::value) {
      bool has;
      read(has);
      v.reset();
      if (has) read(v.emplace());
    } else if constexpr (is_shared<T>::value) {
      bool has;
      read(has);
      v.reset();
      if (has) {
        auto p = std::make_shared<std::remove_const_t<typename T::element_type>>();
        read(*p);
        v = p;
      }
    } else if constexpr (is_map<T>::value) {
      v.clear();
      for (std::uint64_t i = 0, n = count(1); i < n; ++i) {
        typename T::key_type k;
        read(k);
        read(v[k]);
      }
    } else if constexpr (is_pair<T>::value) {
      read(v.first), read(v.second);
    } else if constexpr (is_variant<T>::value) {
      std::uint32_t i;
      read(i);
      read_variant(v, i, std::make_index_sequence<std::variant_size_v<T>>{});
    } else if constexpr (is_pose<T>::value) {
      double d[7];
      for (double& x : d) read(x);
      v.q = Eigen::Quaterniond(d[0], d[1], d[2], d[3]);
      v.p_mm = Vec3(d[4], d[5], d[6]);
    } else if constexpr (EigenFixed<T>) {
      for (int i = 0; i < v.rows(); ++i)
        for (int j = 0; j < v.cols(); ++j) read(v(i, j));
    } else if constexpr (std::is_same_v<T, std::monostate>) {
    } else {
      T::visit(v, *this);
    }
  }
  bool at_end() const { return rest_.empty(); }

 private:
  std::string_view rest_;
  std::string_view take(std::uint64_t n) {
    must(n <= rest_.size(), "stored bytes end too early");
    std::string_view s = rest_.substr(0, n);
    rest_.remove_prefix(n);
    return s;
  }
  std::uint64_t count(std::uint64_t least) {
    std::uint64_t n;
    read(n);
    must(n <= rest_.size() / least, "stored bytes name more elements than there are");
    return n;
  }
  template <class V, std::size_t... I>
  void read_variant(V& v, std::uint32_t index, std::index_sequence<I...>) {
    must(index < sizeof...(I), "stored variant index out of range");
    ((I == index ? (read(v.template emplace<I>()), true) : false) || ...);
  }
};

template <class T>
std::string to_bytes(const T& v) {
  ByteWriter w;
  w.write(v);
  return std::move(w.bytes);
}
template <class T>
T from_bytes(std::string_view bytes) {
  ByteReader r(bytes);
  T v;
  r.read(v);
  must(r.at_end(), "stored bytes are longer than their type");
  return v;
}
template <class T>
std::string content_hash(const T& v) {
  return sha256_hex(to_bytes(v));
}

/// The JSON a person reads: field names as listed; NaN and infinity become null; enums become numbers unless they have a
/// free function `std::string_view name_of(E)` found by argument-dependent look-up; a pose becomes {xyz, quat}.
class JsonWriter {
 public:
  Json json = Json::object();

  template <class T>
  void operator()(const char* name, const T& v) {
    json[name] = value(v);
  }
  template <class T>
  static Json value(const T& v) {
    using namespace archive_detail;
    if constexpr (std::is_same_v<T, std::string> || std::is_same_v<T, bool>) {
      return v;
    } else if constexpr (std::is_floating_point_v<T>) {
      return std::isfinite(v) ? Json(v == 0 ? T(0) : v) : Json(nullptr);
    } else if constexpr (std::is_enum_v<T>) {
      if constexpr (requires { name_of(v); })
        return std::string(name_of(v));
      else
        return static_cast<long long>(v);
    } else if constexpr (std::is_integral_v<T>) {
      return v;
    } else if constexpr (is_vector<T>::value || is_array<T>::value) {
      Json a = Json::array();
      for (const auto& e : v) a.push_back(value<std::remove_cvref_t<typename T::value_type>>(e));
      return a;
    } else if constexpr (is_optional<T>::value || is_shared<T>::value) {
      return v ? value(*v) : Json(nullptr);
    } else if constexpr (is_map<T>::value) {
      Json o = Json::object();
      for (const auto& [k, e] : v) {
        if constexpr (std::is_same_v<typename T::key_type, std::string>)
          o[k] = value(e);
        else
          o[std::to_string(k)] = value(e);
      }
      return o;
    } else if constexpr (is_pair<T>::value) {
      return Json::array({value(v.first), value(v.second)});
    } else if constexpr (is_variant<T>::value) {
      return std::visit([](const auto& e) { return value(e); }, v);
    } else if constexpr (is_pose<T>::value) {
      Json o = Json::object();
      o["xyz"] = {v.p_mm.x(), v.p_mm.y(), v.p_mm.z()};
      o["quat"] = {v.q.w(), v.q.x(), v.q.y(), v.q.z()};
      return o;
    } else if constexpr (EigenFixed<T>) {
      Json a = Json::array();
      if constexpr (T::ColsAtCompileTime == 1 || T::RowsAtCompileTime == 1) {
        for (int i = 0; i < v.size(); ++i) a.push_back(value(v(i)));
      } else {
        for (int i = 0; i < v.rows(); ++i) {
          Json row = Json::array();
          for (int j = 0; j < v.cols(); ++j) row.push_back(value(v(i, j)));
          a.push_back(std::move(row));
        }
      }
      return a;
    } else if constexpr (std::is_same_v<T, std::monostate>) {
      return nullptr;
    } else {
      JsonWriter w;
      T::visit(v, w);
      return std::move(w.json);
    }
  }
};

template <class T>
Json to_json(const T& v) {
  return JsonWriter::value(v);
}

}  // namespace asbuilt
