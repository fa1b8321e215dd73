// SPDX-License-Identifier: GPL-3.0-or-later
// Clouds as bytes in every layout the readers know, from the same points.
#pragma once

#include <cstdint>
#include <cstring>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace asbuilt::test {

template <class T>
void put(std::string& bytes, T v, bool is_big = false) {
  char b[sizeof(T)];
  std::memcpy(b, &v, sizeof v);
  for (std::size_t i = 0; i < sizeof v; ++i) bytes += b[is_big ? sizeof v - 1 - i : i];
}

inline std::vector<Eigen::Vector3f> some_points(int count) {
  std::vector<Eigen::Vector3f> p;
  for (int i = 0; i < count; ++i) p.emplace_back(0.25f * float(i), -3.5f + 0.125f * float(i % 7), 400.0f + float(i % 11));
  return p;
}

struct PlyLayout {
  std::string format = "binary_little_endian";  // or binary_big_endian, ascii
  bool is_double = false;
  bool has_extra = false;       // a colour before x, a normal between y and z
  bool has_list = false;        // a list property in the vertex
  bool has_range_grid = false;  // a list element before the vertices, faces after them
};

inline std::string ply(const std::vector<Eigen::Vector3f>& points, const PlyLayout& l) {
  const std::string real = l.is_double ? "double" : "float";
  const bool is_ascii = l.format == "ascii", is_big = l.format == "binary_big_endian";
  std::string b = "ply\nformat " + l.format + " 1.0\ncomment made for a test\nobj_info num_cols 3\n";
  if (l.has_range_grid) b += "element range_grid 4\nproperty list uchar int vertex_indices\n";
  b += "element vertex " + std::to_string(points.size()) + "\n";
  if (l.has_extra) b += "property uchar red\n";
  if (l.has_list) b += "property list uchar short links\n";
  b += "property " + real + " x\nproperty " + real + " y\n";
  if (l.has_extra) b += "property float nx\n";
  b += "property " + real + " z\n";
  if (l.has_range_grid) b += "element face 1\nproperty list uchar int vertex_indices\nelement nothing 1000000000\n";
  b += "end_header\n";
  const auto number = [&](auto v) {
    if (is_ascii) b += std::to_string(v) + " ";
    else put(b, v, is_big);
  };
  const auto line = [&] {
    if (is_ascii) b += "\n";
  };
  if (l.has_range_grid)
    for (int i = 0; i < 4; ++i) {
      number(std::uint8_t(i % 2));
      if (i % 2) number(std::int32_t(i));
      line();
    }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (l.has_extra) number(std::uint8_t(200));
    if (l.has_list) {
      number(std::uint8_t(i % 3));
      for (std::size_t k = 0; k < i % 3; ++k) number(std::int16_t(k));
    }
    for (int k = 0; k < 3; ++k) {
      if (k == 2 && l.has_extra) number(0.5f);
      if (l.is_double) number(double(points[i][k]));
      else number(points[i][k]);
    }
    line();
  }
  if (l.has_range_grid) {
    number(std::uint8_t(3));
    for (int i = 0; i < 3; ++i) number(std::int32_t(i));
    line();
  }
  return b;
}

/// LZF with literals only: what any packer may write.
inline std::string lzf_literals(const std::string& plain) {
  std::string out;
  for (std::size_t i = 0; i < plain.size(); i += 32) {
    const std::size_t n = std::min<std::size_t>(32, plain.size() - i);
    out += char(n - 1);
    out += plain.substr(i, n);
  }
  return out;
}

inline std::string pcd(const std::vector<Eigen::Vector3f>& points, const std::string& data, bool is_double = false) {
  const std::string size = is_double ? "8" : "4";
  std::string b = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb x y normal z\nSIZE 4 " + size + " " + size + " 4 " +
                  size + "\nTYPE U F F F F\nCOUNT 1 1 1 3 1\nWIDTH " + std::to_string(points.size()) +
                  "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + std::to_string(points.size()) + "\nDATA " + data + "\n";
  const auto real = [&](std::string& to, float v) {
    if (is_double) put(to, double(v));
    else put(to, v);
  };
  if (data == "ascii") {
    for (const auto& p : points)
      b += "255 " + std::to_string(p.x()) + " " + std::to_string(p.y()) + " 0 0 1 " + std::to_string(p.z()) + "\n";
  } else if (data == "binary") {
    for (const auto& p : points) {
      put(b, std::uint32_t(255));
      real(b, p.x()), real(b, p.y());
      for (const float f : {0.f, 0.f, 1.f}) put(b, f);
      real(b, p.z());
    }
  } else {
    std::string plain;
    for (std::size_t i = 0; i < points.size(); ++i) put(plain, std::uint32_t(255));
    for (int k = 0; k < 2; ++k)
      for (const auto& p : points) real(plain, p[k]);
    for (std::size_t i = 0; i < points.size(); ++i)
      for (const float f : {0.f, 0.f, 1.f}) put(plain, f);
    for (const auto& p : points) real(plain, p.z());
    const std::string packed = lzf_literals(plain);
    put(b, std::uint32_t(packed.size())), put(b, std::uint32_t(plain.size()));
    b += packed;
  }
  return b;
}

inline std::string xyz(const std::vector<Eigen::Vector3f>& points, const std::string& divider) {
  std::string b = "# a comment\nX" + divider + "Y" + divider + "Z\n";
  for (const auto& p : points)
    b += std::to_string(p.x()) + divider + std::to_string(p.y()) + divider + std::to_string(p.z()) + divider + "17\n";
  return b;
}

/// Every layout with its name.
inline std::vector<std::pair<std::string, std::string>> all_layouts(const std::vector<Eigen::Vector3f>& points) {
  std::vector<std::pair<std::string, std::string>> all;
  for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"})
    for (int bits = 0; bits < 16; ++bits) {
      const PlyLayout l{format, (bits & 1) != 0, (bits & 2) != 0, (bits & 4) != 0, (bits & 8) != 0};
      all.emplace_back(std::string("ply ") + format + " " + std::to_string(bits), ply(points, l));
    }
  for (const char* data : {"ascii", "binary", "binary_compressed"})
    for (const bool is_double : {false, true})
      all.emplace_back(std::string("pcd ") + data + (is_double ? " double" : ""), pcd(points, data, is_double));
  for (const char* divider : {" ", "\t", ", ", ";"}) all.emplace_back(std::string("xyz '") + divider + "'", xyz(points, divider));
  return all;
}

/// The bytes with a few of them changed, cut out, doubled or put in.
inline std::string mutated(std::string bytes, std::mt19937_64& engine) {
  const auto below = [&](std::size_t n) { return n ? std::size_t(engine() % n) : 0; };
  static const char* const words[] = {"-1",
                                      "0",
                                      "99999999999",
                                      "4294967295",
                                      "18446744073709551615",
                                      "nan",
                                      "1e308",
                                      "list",
                                      "\n",
                                      "end_header\n",
                                      "element vertex 7\n",
                                      "property double x\n",
                                      " ",
                                      "\xff\xff\xff\xff",
                                      "DATA binary\n",
                                      "{",
                                      "]",
                                      ": "};
  for (std::size_t k = 1 + below(6); k-- > 0;) {
    const std::size_t at = below(bytes.size() + 1);
    switch (below(6)) {
      case 0:
      case 1:
        if (at < bytes.size()) bytes[at] = char(engine());
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3:
        bytes.insert(at, words[below(std::size(words))]);
        break;
      case 4:
        bytes.erase(at, below(20));
        break;
      default:
        bytes.insert(at, bytes.substr(below(bytes.size() + 1), below(64)));
    }
  }
  return bytes;
}

}  // namespace asbuilt::test
