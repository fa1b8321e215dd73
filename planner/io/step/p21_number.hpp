// SPDX-License-Identifier: GPL-3.0-or-later
// One number of a Part 21 text. In a header because every second parameter of a file is one.
#pragma once

#include <charconv>
#include <cstdint>

#include "planner/io/step/p21.hpp"

namespace asbuilt::p21 {

constexpr double kPow10[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                             1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

inline bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Reads an integer or a real at `p` and leaves `p` after it; what is wrong with it, or null. Correctly rounded: short ones by one exact
/// division or multiplication, the others by std::from_chars.
inline const char* read_number(const char*& p, const char* end, Value& v) {
  const char* b = p;
  bool negative = false;
  if (*p == '-' || *p == '+') negative = *p++ == '-';
  std::uint64_t m = 0;
  int digits_seen = 0, exponent = 0;
  bool exact = true, real = false;
  const auto digit = [&](bool fraction) {
    if (digits_seen < 18) {
      m = 10 * m + static_cast<std::uint64_t>(*p - '0');
      if (m) ++digits_seen;
      if (fraction) --exponent;
    } else {
      if (*p != '0') exact = false;
      if (!fraction) ++exponent;
    }
    ++p;
  };
  const char* first = p;
  while (p < end && is_digit(*p)) digit(false);
  if (p < end && *p == '.') {
    real = true;
    ++p;
    while (p < end && is_digit(*p)) digit(true);
  }
  if (p == first) return "a number without digits";
  if (p < end && (*p == 'E' || *p == 'e')) {
    real = true;
    ++p;
    bool minus = false;
    if (p < end && (*p == '-' || *p == '+')) minus = *p++ == '-';
    int e = 0;
    const char* eb = p;
    while (p < end && is_digit(*p)) {
      if (e < 100000) e = 10 * e + (*p - '0');
      ++p;
    }
    if (p == eb) return "an exponent without digits";
    exponent += minus ? -e : e;
  }
  if (!real) {
    v.kind = Kind::integer;
    if (!exact || digits_seen >= 18) return "an integer with more than 17 digits";
    v.integer = negative ? -static_cast<std::int64_t>(m) : static_cast<std::int64_t>(m);
    return nullptr;
  }
  v.kind = Kind::real;
  if (exact && m <= (std::uint64_t(1) << 53) && exponent >= -22 && exponent <= 22) {  // exact by one rounding
    const double d = static_cast<double>(m);
    v.real = exponent < 0 ? d / kPow10[-exponent] : d * kPow10[exponent];
    if (negative) v.real = -v.real;
    return nullptr;
  }
  if (*b == '+') ++b;
  double d = 0;
  const auto r = std::from_chars(b, p, d);
  if (r.ec == std::errc::result_out_of_range) {
    d = exponent < 0 ? 0.0 : 1e308 * (negative ? -1 : 1);
  } else if (r.ec != std::errc()) {
    return "a number that cannot be read";
  }
  v.real = d;
  return nullptr;
}

}  // namespace asbuilt::p21
