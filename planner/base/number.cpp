// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/base/number.hpp"

#include <charconv>
#include <cmath>

#include "planner/base/result.hpp"

namespace asbuilt {

std::string fixed_number(double value, int decimals) {
  must(std::isfinite(value), "a number to print is not finite");
  char buffer[400];
  const auto r = std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::fixed, decimals);
  must(r.ec == std::errc(), "a number to print is too long");
  std::string text(buffer, r.ptr);
  if (text.front() == '-' && text.find_first_not_of("-0.") == std::string::npos) text.erase(0, 1);
  return text;
}

std::string shortest_number(double value) {
  must(std::isfinite(value), "a number to print is not finite");
  if (value == 0) return "0";
  char buffer[64];
  const auto r = std::to_chars(buffer, buffer + sizeof buffer, value);
  return std::string(buffer, r.ptr);
}

double rounded(double value, int decimals) {
  const double scale = std::pow(10.0, decimals);
  const double r = std::round(value * scale) / scale;
  return r == 0 ? 0.0 : r;
}

}  // namespace asbuilt
