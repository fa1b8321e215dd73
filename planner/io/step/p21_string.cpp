// SPDX-License-Identifier: GPL-3.0-or-later
// Strings of ISO 10303-21 (clause 6.4.3 and its control directives) to UTF-8.
#include <charconv>

#include "planner/io/step/p21.hpp"

namespace asbuilt::p21 {

std::string decoded(std::string_view raw) {
  std::string out;
  out.reserve(raw.size());
  const auto utf8 = [&](std::uint32_t c) {
    if (c < 0x80) {
      out += static_cast<char>(c);
    } else if (c < 0x800) {
      out += static_cast<char>(0xC0 | (c >> 6)), out += static_cast<char>(0x80 | (c & 63));
    } else if (c < 0x10000) {
      out += static_cast<char>(0xE0 | (c >> 12)), out += static_cast<char>(0x80 | ((c >> 6) & 63)),
          out += static_cast<char>(0x80 | (c & 63));
    } else {
      out += static_cast<char>(0xF0 | (c >> 18)), out += static_cast<char>(0x80 | ((c >> 12) & 63));
      out += static_cast<char>(0x80 | ((c >> 6) & 63)), out += static_cast<char>(0x80 | (c & 63));
    }
  };
  const auto hex = [&](std::size_t at, int n, std::uint32_t& v) {
    if (at + static_cast<std::size_t>(n) > raw.size()) return false;
    const auto r = std::from_chars(raw.data() + at, raw.data() + at + n, v, 16);
    return r.ec == std::errc() && r.ptr == raw.data() + at + n;
  };
  const auto starts = [&](std::size_t at, std::string_view w) { return raw.substr(at, w.size()) == w; };
  for (std::size_t i = 0; i < raw.size();) {
    const auto c = static_cast<std::uint8_t>(raw[i]);
    if (c == '\'' && i + 1 < raw.size() && raw[i + 1] == '\'') {
      out += '\'', i += 2;
    } else if (c == '\n' || c == '\r') {
      ++i;
    } else if (c == '\\') {
      std::uint32_t v = 0;
      if (starts(i, "\\\\")) {
        out += '\\', i += 2;
      } else if (starts(i, "\\X\\") && hex(i + 3, 2, v)) {
        utf8(v), i += 5;
      } else if (starts(i, "\\S\\") && i + 3 < raw.size()) {
        utf8(static_cast<std::uint8_t>(raw[i + 3]) + 128u), i += 4;
      } else if ((starts(i, "\\X2\\") || starts(i, "\\X4\\"))) {
        const int n = raw[i + 2] == '2' ? 4 : 8;
        std::size_t at = i + 4;
        std::uint32_t high = 0;
        while (hex(at, n, v)) {
          at += static_cast<std::size_t>(n);
          if (v >= 0xD800 && v < 0xDC00) {
            high = v;
          } else {
            if (v >= 0xDC00 && v < 0xE000 && high) v = 0x10000 + ((high - 0xD800) << 10) + (v - 0xDC00);
            high = 0;
            if (v < 0x110000) utf8(v);
          }
        }
        i = starts(at, "\\X0\\") ? at + 4 : at;
      } else if (starts(i, "\\P") && i + 3 < raw.size() && raw[i + 3] == '\\') {
        i += 4;
      } else {
        out += '\\', ++i;
      }
    } else if (c >= 0x80) {
      // UTF-8 as it stands if it is well formed, else Latin-1.
      const int more = c >= 0xF0 ? 3 : c >= 0xE0 ? 2 : c >= 0xC0 ? 1 : 0;
      bool ok = more > 0 && i + static_cast<std::size_t>(more) < raw.size();
      for (int k = 1; ok && k <= more; ++k) ok = (static_cast<std::uint8_t>(raw[i + static_cast<std::size_t>(k)]) & 0xC0) == 0x80;
      if (ok) {
        out += raw.substr(i, static_cast<std::size_t>(more) + 1), i += static_cast<std::size_t>(more) + 1;
      } else {
        utf8(c), ++i;
      }
    } else {
      out += raw[i++];
    }
  }
  return out;
}

}  // namespace asbuilt::p21
