// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/pcd.hpp"

#include <cstdint>
#include <cstring>
#include <optional>

#include "planner/io/text_scan.hpp"

namespace asbuilt {

namespace {

using namespace text_scan;

struct PcdField {
  std::string name;
  char type = 'F';
  int size = 4, count = 1;
  std::size_t offset = 0;  // in the record
};

std::optional<std::uint64_t> whole(std::string_view word, std::uint64_t limit) {
  std::uint64_t v = 0;
  const auto r = std::from_chars(word.data(), word.data() + word.size(), v);
  if (word.empty() || r.ec != std::errc() || r.ptr != word.data() + word.size() || v > limit) return std::nullopt;
  return v;
}

double value_at(const char* p, const PcdField& f) {
  const auto as = [&]<class T>(T v) {
    std::memcpy(&v, p, sizeof v);
    return double(v);
  };
  if (f.type == 'F') return f.size == 4 ? as(float{}) : as(double{});
  if (f.type == 'I')
    return f.size == 1 ? as(std::int8_t{}) : f.size == 2 ? as(std::int16_t{}) : f.size == 4 ? as(std::int32_t{}) : as(std::int64_t{});
  return f.size == 1 ? as(std::uint8_t{}) : f.size == 2 ? as(std::uint16_t{}) : f.size == 4 ? as(std::uint32_t{}) : as(std::uint64_t{});
}

/// LZF: a control byte below 32 opens a run of literals; else a copy of bytes already written. False on broken data.
bool lzf_expand(std::string_view from, std::string& to) {
  std::size_t i = 0, o = 0;
  while (i < from.size()) {
    const auto control = static_cast<unsigned char>(from[i++]);
    if (control < 32) {
      const std::size_t n = std::size_t(control) + 1;
      if (from.size() - i < n || to.size() - o < n) return false;
      std::memcpy(to.data() + o, from.data() + i, n);
      i += n, o += n;
      continue;
    }
    std::size_t n = control >> 5;
    if (n == 7) {
      if (i >= from.size()) return false;
      n += static_cast<unsigned char>(from[i++]);
    }
    n += 2;
    if (i >= from.size()) return false;
    const std::size_t back = (std::size_t(control & 31) << 8 | static_cast<unsigned char>(from[i++])) + 1;
    if (back > o || to.size() - o < n) return false;
    if (back >= n) {
      std::memcpy(to.data() + o, to.data() + o - back, n);
      o += n;
    } else {
      for (std::size_t k = 0; k < n; ++k, ++o) to[o] = to[o - back];
    }
  }
  return o == to.size();
}

void add_point(CloudFile& cloud, double x, double y, double z) {
  const Eigen::Vector3f p(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
  if (p.allFinite()) cloud.points.push_back(p);
  else ++cloud.dropped_count;
}

}  // namespace

bool is_pcd(std::string_view bytes) {
  const std::string_view head = bytes.substr(0, 200);
  return head.substr(0, 6) == "# .PCD" || head.substr(0, 7) == "VERSION" ||
         (head.substr(0, 1) == "#" && head.find("\nVERSION") != std::string_view::npos);
}

Result<CloudFile> read_pcd_points(std::string_view bytes, const std::string& name) {
  std::vector<PcdField> fields;
  std::optional<std::uint64_t> points, width, height;
  std::string_view rest = bytes, line, data;
  int number = 0;
  const auto refused = [&](const char* code, const std::string& message) {
    return refuse({.code = code, .where = name + ":" + std::to_string(number), .message = message, .stage = "input"});
  };
  while (data.empty()) {
    if (!take_line(rest, line))
      return refused("input.cloud_header",
                     "found the end of the file inside the header, allowed a DATA line; copy or export the file again");
    ++number;
    if (number > 1000) return refused("input.cloud_header", "found a header of more than 1000 lines, allowed less");
    const std::string_view key = take_word(line);
    if (key.empty() || key.front() == '#' || key == "VERSION" || key == "VIEWPOINT") continue;
    if (key == "FIELDS" || key == "COLUMNS") {
      fields.clear();
      for (std::string_view w = take_word(line); !w.empty() && fields.size() < 1000; w = take_word(line))
        fields.push_back({.name = std::string(w)});
    } else if (key == "SIZE" || key == "TYPE" || key == "COUNT") {
      for (PcdField& f : fields) {
        const std::string_view w = take_word(line);
        if (key == "TYPE") {
          if (w != "F" && w != "I" && w != "U")
            return refused("input.cloud_header",
                           "found the type " + shown_word(w) + " of field '" + f.name.substr(0, 40) + "', allowed F, I, U");
          f.type = w[0];
        } else {
          const auto v = whole(w, key == "SIZE" ? 8 : 1000000);
          if (!v)
            return refused("input.cloud_header",
                           "found " + shown_word(w) + " in the line " + std::string(key) + ", allowed a whole number for every field");
          (key == "SIZE" ? f.size : f.count) = int(*v);
        }
      }
    } else if (key == "WIDTH" || key == "HEIGHT" || key == "POINTS") {
      const std::string_view w = take_word(line);
      const auto v = whole(w, 1ull << 40);
      if (!v)
        return refused("input.cloud_header",
                       "found " + shown_word(w) + " in the line " + std::string(key) + ", allowed a whole number below 2^40");
      (key == "WIDTH" ? width : key == "HEIGHT" ? height : points) = v;
    } else if (key == "DATA") {
      data = take_word(line);
      if (data != "ascii" && data != "binary" && data != "binary_compressed")
        return refused("input.cloud_header", "found DATA " + shown_word(data) + ", allowed ascii, binary, binary_compressed");
    } else {
      return refused("input.cloud_header",
                     "found " + shown_word(key) + ", allowed VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA");
    }
  }
  if (!points && width && height && (*height == 0 || *width < (1ull << 40) / *height)) points = *width * *height;
  if (!points) return refused("input.cloud_header", "found neither POINTS nor WIDTH and HEIGHT");
  const PcdField* axis[3] = {nullptr, nullptr, nullptr};
  std::size_t stride = 0;
  for (PcdField& f : fields) {
    const bool is_good = f.type == 'F' ? f.size == 4 || f.size == 8 : f.size == 1 || f.size == 2 || f.size == 4 || f.size == 8;
    if (!is_good)
      return refused("input.cloud_header", "found the field '" + f.name.substr(0, 40) + "' of type " + f.type + std::to_string(f.size) +
                                               ", allowed F4, F8, I1 to I8, U1 to U8");
    f.offset = stride;
    stride += std::size_t(f.size) * std::size_t(f.count);
    for (int k = 0; k < 3; ++k)
      if (f.name == std::string(1, "xyz"[k]) && f.count == 1) axis[k] = &f;
  }
  if (!axis[0] || !axis[1] || !axis[2]) return refused("input.cloud_no_xyz", "found no fields x, y, z, allowed a cloud with them");
  CloudFile cloud;
  cloud.format = "pcd " + std::string(data);
  const auto ends_early = [&](const std::string& where, std::uint64_t done) {
    return refuse({.code = "input.cloud_truncated",
                   .where = where,
                   .message = "found the end of the file after " + std::to_string(done) + " of " + std::to_string(*points) +
                              " points, allowed as many as the header says; copy or export the file again",
                   .measured = double(done),
                   .limit = double(*points),
                   .unit = "points",
                   .stage = "input"});
  };
  if (data == "ascii") {
    cloud.points.reserve(std::min<std::uint64_t>(*points, rest.size() / (2 * fields.size()) + 1));
    for (std::uint64_t i = 0; i < *points; ++i) {
      do {
        if (!take_line(rest, line)) return ends_early(name + ":" + std::to_string(number), i);
        ++number;
      } while (line.find_first_not_of(" \t\r") == std::string_view::npos);
      double xyz[3] = {0, 0, 0};
      for (const PcdField& f : fields)
        for (int n = 0; n < f.count; ++n) {
          const std::string_view w = take_word(line);
          double v = 0;
          if (w.empty() && rest.empty()) return ends_early(name + ":" + std::to_string(number), i);
          if (!parse_number(w, v))
            return refused("input.cloud_value", "found " + (w.empty() ? std::string("no value") : shown_word(w)) + " for field '" +
                                                    f.name.substr(0, 40) + "', allowed a number with a decimal point");
          for (int k = 0; k < 3; ++k)
            if (axis[k] == &f) xyz[k] = v;
        }
      add_point(cloud, xyz[0], xyz[1], xyz[2]);
    }
    return cloud;
  }
  const std::size_t begin = bytes.size() - rest.size();
  std::string expanded;
  const char* base[3];
  std::size_t step[3];
  if (data == "binary") {
    if (rest.size() / stride < *points) return ends_early(name + ": byte " + std::to_string(bytes.size()), rest.size() / stride);
    for (int k = 0; k < 3; ++k) base[k] = rest.data() + axis[k]->offset, step[k] = stride;
  } else {
    if (rest.size() < 8) return ends_early(name + ": byte " + std::to_string(bytes.size()), 0);
    std::uint32_t packed = 0, plain = 0;
    std::memcpy(&packed, rest.data(), 4), std::memcpy(&plain, rest.data() + 4, 4);
    if (rest.size() - 8 < packed) return ends_early(name + ": byte " + std::to_string(bytes.size()), 0);
    const auto broken = [&](const std::string& message) {
      return refuse({.code = "input.cloud_value", .where = name + ": byte " + std::to_string(begin), .message = message, .stage = "input"});
    };
    if (plain != *points * stride || *points > (1ull << 32))
      return broken("found compressed data of " + std::to_string(plain) + " bytes, allowed " + std::to_string(*points) + " points of " +
                    std::to_string(stride) + " bytes");
    if (plain / 100 > packed) return broken("found data that grow more than 100 times, which this compression cannot");
    expanded.resize(plain);
    if (!lzf_expand(rest.substr(8, packed), expanded))
      return broken("found compressed data that do not expand to their length; copy or export the file again");
    for (int k = 0; k < 3; ++k) base[k] = expanded.data() + axis[k]->offset * *points, step[k] = std::size_t(axis[k]->size);
  }
  const bool are_floats = axis[0]->type == 'F' && axis[1]->type == 'F' && axis[2]->type == 'F' && axis[0]->size == 4 &&
                          axis[1]->size == 4 && axis[2]->size == 4;
  if (are_floats) {
    cloud.points.resize(*points);
    Eigen::Vector3f* to = cloud.points.data();
    for (std::uint64_t i = 0; i < *points; ++i) {
      std::uint32_t bits[3];
      for (int k = 0; k < 3; ++k) std::memcpy(&bits[k], base[k] + i * step[k], 4);
      std::memcpy(to->data(), bits, 12);
      constexpr std::uint32_t m = 0x7f800000u;  // all ones: NaN or infinite
      to += ((bits[0] & m) != m) & ((bits[1] & m) != m) & ((bits[2] & m) != m);
    }
    const std::size_t kept = std::size_t(to - cloud.points.data());
    cloud.dropped_count = *points - kept;
    cloud.points.resize(kept);
    return cloud;
  }
  cloud.points.reserve(*points);
  for (std::uint64_t i = 0; i < *points; ++i)
    add_point(cloud, value_at(base[0] + i * step[0], *axis[0]), value_at(base[1] + i * step[1], *axis[1]),
              value_at(base[2] + i * step[2], *axis[2]));
  return cloud;
}

}  // namespace asbuilt
