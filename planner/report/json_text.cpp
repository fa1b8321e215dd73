// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/report/json_text.hpp"

#include <cmath>

#include "planner/base/number.hpp"

namespace asbuilt {

namespace {

constexpr std::size_t kLine = 140;

void write_scalar(const Json& j, std::string& text) {
  if (j.is_number_float())
    text += std::isfinite(j.get<double>()) ? shortest_number(j.get<double>()) : "null";
  else
    text += j.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void write_compact(const Json& j, std::string& text, const char* comma, const char* colon) {
  if (j.is_object()) {
    text += '{';
    bool is_first = true;
    for (const auto& [key, value] : j.items()) {
      if (!is_first) text += comma;
      is_first = false;
      write_scalar(Json(key), text);
      text += colon;
      write_compact(value, text, comma, colon);
    }
    text += '}';
  } else if (j.is_array()) {
    text += '[';
    bool is_first = true;
    for (const Json& value : j) {
      if (!is_first) text += comma;
      is_first = false;
      write_compact(value, text, comma, colon);
    }
    text += ']';
  } else {
    write_scalar(j, text);
  }
}

bool is_row(const Json& j) {  // numbers, or points of numbers
  if (!j.is_array()) return false;
  for (const Json& e : j) {
    if (e.is_object()) return false;
    if (!e.is_array()) continue;
    if (e.size() > 4) return false;
    for (const Json& x : e)
      if (x.is_structured()) return false;
  }
  return true;
}

void write_readable(const Json& j, std::string& text, int level) {
  std::string line;
  if (is_row(j) || !j.is_structured()) {
    write_compact(j, text, ", ", ": ");
    return;
  }
  if (j.size() <= 12) {
    write_compact(j, line, ", ", ": ");
    if (line.size() + static_cast<std::size_t>(level) <= kLine) {
      text += line;
      return;
    }
  }
  const std::string indent(static_cast<std::size_t>(level + 1), ' ');
  text += j.is_object() ? "{\n" : "[\n";
  std::size_t left = j.size();
  for (const auto& [key, value] : j.items()) {
    text += indent;
    if (j.is_object()) write_scalar(Json(key), text), text += ": ";
    write_readable(value, text, level + 1);
    text += --left ? ",\n" : "\n";
  }
  text += std::string(static_cast<std::size_t>(level), ' ') + (j.is_object() ? "}" : "]");
}

}  // namespace

std::string readable_json(const Json& json) {
  std::string text;
  write_readable(json, text, 0);
  return text + "\n";
}

std::string compact_json(const Json& json) {
  std::string text;
  write_compact(json, text, ",", ":");
  return text;
}

Json number(double value, int decimals) { return std::isfinite(value) ? Json(rounded(value, decimals)) : Json(nullptr); }

Json significant(double value, int digits) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0) return 0.0;
  const int decimals = digits - 1 - static_cast<int>(std::floor(std::log10(std::abs(value))));
  if (decimals > 300) return 0.0;
  if (decimals >= 0 && decimals <= 15) return rounded(value, decimals);
  const double scale = std::pow(10.0, decimals);
  return std::isfinite(scale) && scale > 0 ? std::round(value * scale) / scale : value;
}

Json numbers(const std::vector<double>& values, int decimals) {
  Json a = Json::array();
  for (const double v : values) a.push_back(number(v, decimals));
  return a;
}

Json point(const Vec3& p, int decimals) { return Json::array({number(p.x(), decimals), number(p.y(), decimals), number(p.z(), decimals)}); }

Json points(const std::vector<Vec3>& p, int decimals) {
  Json a = Json::array();
  for (const Vec3& v : p) a.push_back(point(v, decimals));
  return a;
}

}  // namespace asbuilt
