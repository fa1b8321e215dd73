// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/ply.hpp"

#include <bit>
#include <cstring>
#include <optional>

#include "planner/io/text_scan.hpp"

namespace asbuilt {

namespace {

using namespace text_scan;

static_assert(std::endian::native == std::endian::little, "the readers assume a little-endian machine");

int size_of(PlyType t) {
  static constexpr int sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return sizes[int(t)];
}

std::optional<PlyType> type_of(std::string_view word) {
  static constexpr std::pair<std::string_view, PlyType> names[] = {
      {"char", PlyType::int8},     {"int8", PlyType::int8},       {"uchar", PlyType::uint8},    {"uint8", PlyType::uint8},
      {"short", PlyType::int16},   {"int16", PlyType::int16},     {"ushort", PlyType::uint16},  {"uint16", PlyType::uint16},
      {"int", PlyType::int32},     {"int32", PlyType::int32},     {"uint", PlyType::uint32},    {"uint32", PlyType::uint32},
      {"float", PlyType::float32}, {"float32", PlyType::float32}, {"double", PlyType::float64}, {"float64", PlyType::float64}};
  for (const auto& [name, type] : names)
    if (name == word) return type;
  return std::nullopt;
}

template <class T>
double value_as(const char* p, bool is_big) {
  char b[sizeof(T)];
  if (is_big)
    for (std::size_t i = 0; i < sizeof(T); ++i) b[i] = p[sizeof(T) - 1 - i];
  else std::memcpy(b, p, sizeof(T));
  T v;
  std::memcpy(&v, b, sizeof(T));
  return double(v);
}

double value_at(const char* p, PlyType t, bool is_big) {
  switch (t) {
    case PlyType::int8:
      return double(static_cast<signed char>(*p));
    case PlyType::uint8:
      return double(static_cast<unsigned char>(*p));
    case PlyType::int16:
      return value_as<std::int16_t>(p, is_big);
    case PlyType::uint16:
      return value_as<std::uint16_t>(p, is_big);
    case PlyType::int32:
      return value_as<std::int32_t>(p, is_big);
    case PlyType::uint32:
      return value_as<std::uint32_t>(p, is_big);
    case PlyType::float32:
      return value_as<float>(p, is_big);
    default:
      return value_as<double>(p, is_big);
  }
}

bool is_finite(float f) { return (std::bit_cast<std::uint32_t>(f) & 0x7f800000u) != 0x7f800000u; }

struct Coordinates {
  int property[3] = {-1, -1, -1};
  bool are_complete() const { return property[0] >= 0 && property[1] >= 0 && property[2] >= 0; }
};
Coordinates coordinates_of(const PlyElement& e) {
  Coordinates c;
  for (int k = 0; k < 3; ++k)
    for (std::size_t i = 0; i < e.properties.size(); ++i)
      if (!e.properties[i].is_list && e.properties[i].name == std::string(1, "xyz"[k])) c.property[k] = int(i);
  return c;
}

tl::unexpected<Refusals> ends_early(const std::string& where, const PlyElement& e, std::uint64_t done) {
  return refuse({.code = "input.cloud_truncated",
                 .where = where,
                 .message = "found the end of the file after " + std::to_string(done) + " of " + std::to_string(e.count) +
                            " entries of element '" + e.name.substr(0, 40) +
                            "', allowed as many as the header says; copy or export the file again",
                 .measured = double(done),
                 .limit = double(e.count),
                 .unit = "entries",
                 .stage = "input"});
}

void add_point(CloudFile& cloud, double x, double y, double z) {
  const Eigen::Vector3f p(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
  if (is_finite(p.x()) && is_finite(p.y()) && is_finite(p.z())) cloud.points.push_back(p);
  else ++cloud.dropped_count;
}

/// Where the values of a file go: points of a cloud, or vertices and faces of a mesh.
struct Sink {
  CloudFile cloud;
  PlyPolygons mesh;
  bool wants_mesh = false;

  void point(double x, double y, double z) {
    if (wants_mesh) mesh.vertices.emplace_back(x, y, z);
    else add_point(cloud, x, y, z);
  }
  /// The property of a face that names its corners; -1 where the element is no face.
  int corners_of(const PlyElement& e) const {
    if (wants_mesh && e.name == "face")
      for (std::size_t i = 0; i < e.properties.size(); ++i)
        if (e.properties[i].is_list && (e.properties[i].name == "vertex_indices" || e.properties[i].name == "vertex_index")) return int(i);
    return -1;
  }
  void corner(double v) { mesh.corners.push_back(v >= 0 && v < 4294967295.0 ? std::uint32_t(v) : 0xffffffffu); }
};

/// A table of fixed records: `stride` bytes each, checked to lie wholly inside the file.
void read_records(const char* data, const PlyElement& e, std::size_t stride, bool is_big, Sink& sink) {
  CloudFile& cloud = sink.cloud;
  const Coordinates c = coordinates_of(e);
  std::size_t offset[3];
  for (int k = 0; k < 3; ++k) {
    offset[k] = 0;
    for (int i = 0; i < c.property[k]; ++i) offset[k] += std::size_t(size_of(e.properties[std::size_t(i)].type));
  }
  const PlyType tx = e.properties[std::size_t(c.property[0])].type, ty = e.properties[std::size_t(c.property[1])].type,
                tz = e.properties[std::size_t(c.property[2])].type;
  const bool is_float_row = tx == PlyType::float32 && ty == tx && tz == tx && offset[1] == offset[0] + 4 && offset[2] == offset[0] + 8;
  if (is_float_row && !is_big && !sink.wants_mesh) {
    cloud.points.resize(e.count);
    Eigen::Vector3f* to = cloud.points.data();
    const char* from = data + offset[0];
    for (std::uint64_t i = 0; i < e.count; ++i, from += stride) {
      std::uint32_t bits[3];
      std::memcpy(bits, from, 12);
      std::memcpy(to->data(), bits, 12);
      constexpr std::uint32_t m = 0x7f800000u;
      to += ((bits[0] & m) != m) & ((bits[1] & m) != m) & ((bits[2] & m) != m);
    }
    const std::size_t kept = std::size_t(to - cloud.points.data());
    cloud.dropped_count += e.count - kept;
    cloud.points.resize(kept);
    return;
  }
  if (!sink.wants_mesh) cloud.points.reserve(e.count);
  for (std::uint64_t i = 0; i < e.count; ++i, data += stride)
    sink.point(value_at(data + offset[0], tx, is_big), value_at(data + offset[1], ty, is_big), value_at(data + offset[2], tz, is_big));
}

/// Fills the sink; a refusal, or nothing.
std::optional<Refusals> read_binary(std::string_view bytes, const PlyHeader& h, const std::string& name, Sink& sink) {
  const bool is_big = h.format == PlyFormat::big_endian;
  std::size_t at = h.data_begin;
  const auto here = [&] { return name + ": byte " + std::to_string(at); };
  for (const PlyElement& e : h.elements) {
    if (e.properties.empty()) continue;
    std::size_t least = 0;
    bool has_list = false;
    for (const PlyProperty& p : e.properties) least += std::size_t(size_of(p.is_list ? p.count_type : p.type)), has_list |= p.is_list;
    const std::uint64_t fit = (bytes.size() - at) / least;
    if (fit < e.count) {
      const std::uint64_t done = has_list ? 0 : fit;
      at = bytes.size();
      return ends_early(here(), e, done).value();
    }
    const bool is_vertex = e.name == "vertex";
    if (!has_list) {
      if (is_vertex) read_records(bytes.data() + at, e, least, is_big, sink);
      at += e.count * least;
      continue;
    }
    const Coordinates c = coordinates_of(e);
    const int corners = sink.corners_of(e);
    for (std::uint64_t i = 0; i < e.count; ++i) {
      double xyz[3] = {0, 0, 0};
      for (std::size_t k = 0; k < e.properties.size(); ++k) {
        const PlyProperty& p = e.properties[k];
        const std::size_t size = std::size_t(size_of(p.is_list ? p.count_type : p.type));
        if (bytes.size() - at < size) return ends_early(here(), e, i).value();
        const double value = value_at(bytes.data() + at, p.is_list ? p.count_type : p.type, is_big);
        if (p.is_list) {
          if (!(value >= 0) || value != std::floor(value))
            return refuse({.code = "input.cloud_value",
                           .where = here(),
                           .message = "found a list of negative or broken length, allowed a whole number from 0",
                           .stage = "input"})
                .value();
          at += size;
          if (value > double((bytes.size() - at) / std::size_t(size_of(p.type)))) return ends_early(here(), e, i).value();
          if (int(k) == corners) {
            sink.mesh.sizes.push_back(std::uint32_t(value));
            for (std::size_t n = 0; n < std::size_t(value); ++n)
              sink.corner(value_at(bytes.data() + at + n * std::size_t(size_of(p.type)), p.type, is_big));
          }
          at += std::size_t(value) * std::size_t(size_of(p.type));
          continue;
        }
        at += size;
        for (int d = 0; d < 3; ++d)
          if (c.property[d] == int(k)) xyz[d] = value;
      }
      if (is_vertex) sink.point(xyz[0], xyz[1], xyz[2]);
    }
  }
  return std::nullopt;
}

std::optional<Refusals> read_ascii(std::string_view bytes, const PlyHeader& h, const std::string& name, Sink& sink) {
  std::string_view rest = bytes.substr(h.data_begin), line;
  int number = h.data_line - 1;
  const auto here = [&] { return name + ":" + std::to_string(number); };
  for (const PlyElement& e : h.elements) {
    if (e.properties.empty()) continue;
    const bool is_vertex = e.name == "vertex";
    const Coordinates c = coordinates_of(e);
    const int corners = sink.corners_of(e);
    const std::uint64_t fit = rest.size() / (2 * e.properties.size()) + 1;  // a value and its blank take two bytes
    if (is_vertex && !sink.wants_mesh) sink.cloud.points.reserve(std::min(e.count, fit));
    for (std::uint64_t i = 0; i < e.count; ++i) {
      do {
        if (!take_line(rest, line)) return ends_early(here(), e, i).value();
        ++number;
      } while (line.find_first_not_of(" \t\r") == std::string_view::npos);
      double xyz[3] = {0, 0, 0};
      for (std::size_t k = 0; k < e.properties.size(); ++k) {
        const PlyProperty& p = e.properties[k];
        std::uint64_t values = 1;
        double value = 0;
        for (std::uint64_t n = 0; n < values + (p.is_list ? 1 : 0); ++n) {
          const std::string_view word = take_word(line);
          if (word.empty()) {
            if (rest.empty()) return ends_early(here(), e, i).value();
            return refuse({.code = "input.cloud_value",
                           .where = here(),
                           .message = "found a line of element '" + e.name.substr(0, 40) + "' with too few values for '" +
                                      p.name.substr(0, 40) + "', allowed all of them on one line",
                           .stage = "input"})
                .value();
          }
          if (!parse_number(word, value))
            return refuse({.code = "input.cloud_value",
                           .where = here() + ": " + p.name.substr(0, 40),
                           .message = "found " + shown_word(word) + ", allowed a number with a decimal point",
                           .stage = "input"})
                .value();
          if (p.is_list && n == 0) {
            if (!(value >= 0 && value <= double(line.size())) || value != std::floor(value)) {
              if (rest.empty()) return ends_early(here(), e, i).value();
              return refuse({.code = "input.cloud_value",
                             .where = here() + ": " + p.name.substr(0, 40),
                             .message = "found a list of length " + shown_word(word) + ", allowed as many values as follow on the line",
                             .stage = "input"})
                  .value();
            }
            values = std::uint64_t(value);
            if (int(k) == corners) sink.mesh.sizes.push_back(std::uint32_t(values));
          } else if (int(k) == corners) {
            sink.corner(value);
          }
        }
        if (!p.is_list)
          for (int d = 0; d < 3; ++d)
            if (c.property[d] == int(k)) xyz[d] = value;
      }
      if (const std::string_view extra = take_word(line); !extra.empty())
        return refuse({.code = "input.cloud_value",
                       .where = here(),
                       .message = "found " + shown_word(extra) + " after the last value of element '" + e.name.substr(0, 40) +
                                  "', allowed the end of the line",
                       .stage = "input"})
            .value();
      if (is_vertex) sink.point(xyz[0], xyz[1], xyz[2]);
    }
  }
  return std::nullopt;
}

}  // namespace

bool is_ply(std::string_view bytes) { return bytes.substr(0, 4) == "ply\n" || bytes.substr(0, 5) == "ply\r\n"; }

Result<PlyHeader> read_ply_header(std::string_view bytes, const std::string& name) {
  PlyHeader h;
  int number = 0;
  const auto refused = [&](const std::string& message) {
    return refuse({.code = "input.cloud_header", .where = name + ":" + std::to_string(number), .message = message, .stage = "input"});
  };
  std::string_view rest = bytes, line;
  bool has_format = false;
  while (true) {
    if (!take_line(rest, line))
      return refused("found the end of the file inside the header, allowed 'end_header'; copy or export the file again");
    ++number;
    if (number == 1) continue;  // "ply"
    if (number > 10000 || line.size() > 10000) return refused("found a header of more than 10000 lines or characters a line, allowed less");
    const std::string_view key = take_word(line);
    if (key == "comment" || key == "obj_info" || key.empty()) continue;
    if (key == "format") {
      const std::string_view form = take_word(line);
      if (form == "ascii") h.format = PlyFormat::ascii;
      else if (form == "binary_little_endian") h.format = PlyFormat::little_endian;
      else if (form == "binary_big_endian") h.format = PlyFormat::big_endian;
      else return refused("found format " + shown_word(form) + ", allowed ascii | binary_little_endian | binary_big_endian");
      has_format = true;
    } else if (key == "element") {
      PlyElement e;
      e.name = std::string(take_word(line));
      const std::string_view count = take_word(line);
      const auto r = std::from_chars(count.data(), count.data() + count.size(), e.count);
      if (e.name.empty() || count.empty() || r.ec != std::errc() || r.ptr != count.data() + count.size() || e.count > (1ull << 40))
        return refused("found an element with the count " + shown_word(count) + ", allowed a whole number below 2^40");
      h.elements.push_back(std::move(e));
    } else if (key == "property") {
      if (h.elements.empty()) return refused("found a property before any element, allowed after one");
      PlyProperty p;
      std::string_view word = take_word(line);
      if (word == "list") {
        p.is_list = true;
        word = take_word(line);
        const auto count_type = type_of(word);
        if (!count_type)
          return refused("found the type " + shown_word(word) + ", allowed char, uchar, short, ushort, int, uint, float, double");
        p.count_type = *count_type;
        word = take_word(line);
      }
      const auto type = type_of(word);
      if (!type) return refused("found the type " + shown_word(word) + ", allowed char, uchar, short, ushort, int, uint, float, double");
      p.type = *type;
      p.name = std::string(take_word(line));
      if (p.name.empty()) return refused("found a property without a name");
      h.elements.back().properties.push_back(std::move(p));
    } else if (key == "end_header") {
      break;
    } else {
      return refused("found " + shown_word(key) + ", allowed format, comment, obj_info, element, property, end_header");
    }
  }
  if (!has_format) return refused("found a header without a format line");
  h.data_begin = bytes.size() - rest.size();
  h.data_line = number + 1;
  return h;
}

namespace {

std::optional<Refusals> read_into(std::string_view bytes, const std::string& name, Sink& sink) {
  const Result<PlyHeader> header = read_ply_header(bytes, name);
  if (!header) return header.error();
  int vertices = 0;
  for (const PlyElement& e : header->elements) {
    if (e.name != "vertex") continue;
    if (!coordinates_of(e).are_complete())
      return refuse({.code = "input.cloud_no_xyz",
                     .where = name,
                     .message = "found an element 'vertex' without the properties x, y, z, allowed with them",
                     .stage = "input"})
          .value();
    ++vertices;
  }
  if (vertices != 1)
    return refuse({.code = "input.cloud_no_xyz",
                   .where = name,
                   .message = "found " + std::to_string(vertices) + " elements named 'vertex', allowed one",
                   .measured = double(vertices),
                   .limit = 1,
                   .stage = "input"})
        .value();
  sink.cloud.format = header->format == PlyFormat::ascii           ? "ply ascii"
                      : header->format == PlyFormat::little_endian ? "ply binary_little_endian"
                                                                   : "ply binary_big_endian";
  return header->format == PlyFormat::ascii ? read_ascii(bytes, *header, name, sink) : read_binary(bytes, *header, name, sink);
}

}  // namespace

Result<CloudFile> read_ply_points(std::string_view bytes, const std::string& name) {
  Sink sink;
  if (auto fault = read_into(bytes, name, sink)) return refuse_all(std::move(*fault));
  return std::move(sink.cloud);
}

Result<PlyPolygons> read_ply_polygons(std::string_view bytes, const std::string& name) {
  Sink sink;
  sink.wants_mesh = true;
  if (auto fault = read_into(bytes, name, sink)) return refuse_all(std::move(*fault));
  for (const std::uint32_t c : sink.mesh.corners)
    if (c >= sink.mesh.vertices.size())
      return refuse({.code = "input.cloud_value",
                     .where = name,
                     .message = "found a face with a corner that is not in the file; export the mesh again",
                     .stage = "input"});
  return std::move(sink.mesh);
}

}  // namespace asbuilt
