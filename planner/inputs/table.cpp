// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/inputs/table.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace asbuilt::inputs {

namespace {

std::string trimmed(std::string_view s) {
  while (!s.empty() && (s.front() == ' ' || s.front() == '\t' || s.front() == '"')) s.remove_prefix(1);
  while (!s.empty() && (s.back() == ' ' || s.back() == '\t' || s.back() == '"' || s.back() == '\r')) s.remove_suffix(1);
  return std::string(s);
}

std::vector<std::string> split(std::string_view line, char separator) {
  std::vector<std::string> out;
  if (separator == ' ') {
    std::size_t i = 0;
    while (i < line.size()) {
      while (i < line.size() && (line[i] == ' ' || line[i] == '\t')) ++i;
      std::size_t j = i;
      while (j < line.size() && line[j] != ' ' && line[j] != '\t') ++j;
      if (j > i) out.push_back(trimmed(line.substr(i, j - i)));
      i = j;
    }
    return out;
  }
  for (std::size_t i = 0;;) {
    const std::size_t j = std::min(line.find(separator, i), line.size());
    out.push_back(trimmed(line.substr(i, j - i)));
    if (j >= line.size()) return out;
    i = j + 1;
  }
}

std::optional<double> number_of(std::string text) {
  if (text.empty() || text == "nan" || text == "NaN" || text == ".Nan" || text == "-nan" || text == "NAN") return std::numeric_limits<double>::quiet_NaN();
  const char* begin = text.data();
  if (*begin == '+') ++begin;
  double v = 0;
  const auto r = std::from_chars(begin, text.data() + text.size(), v);
  if (r.ec != std::errc() || r.ptr != text.data() + text.size()) return std::nullopt;
  return v;
}

}  // namespace

std::optional<std::size_t> Table::column(std::string_view wanted) const {
  for (std::size_t i = 0; i < header.size(); ++i)
    if (header[i] == wanted) return i;
  std::size_t n = 0;
  const auto r = std::from_chars(wanted.data(), wanted.data() + wanted.size(), n);
  if (r.ec == std::errc() && r.ptr == wanted.data() + wanted.size() && n >= 1 && !rows.empty() && n <= rows.front().size()) return n - 1;
  return std::nullopt;
}

std::optional<double> Table::number(std::size_t row, std::size_t column) const {
  if (row >= rows.size() || column >= rows[row].size()) return std::nullopt;
  std::string text = rows[row][column];
  if (has_decimal_comma) std::replace(text.begin(), text.end(), ',', '.');
  return number_of(std::move(text));
}

Table parse_table(std::string_view bytes, const std::string& name) {
  Table t;
  t.name = name;
  std::string text;
  text.reserve(bytes.size());
  for (const char c : bytes) {
    if (c == '\0') ++t.nul_count;
    else text += c;
  }
  if (text.rfind("\xEF\xBB\xBF", 0) == 0) text.erase(0, 3);
  // the separator: of the first line that is no comment
  char separator = ' ';
  bool is_first = true;
  int number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string_view line = std::string_view(text).substr(at, end - at);
    at = end + 1, ++number;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    if (line.find_first_not_of(" \t") == std::string_view::npos || line[line.find_first_not_of(" \t")] == '#') continue;
    if (is_first) separator = line.find(';') != std::string_view::npos ? ';' : line.find('\t') != std::string_view::npos ? '\t' : line.find(',') != std::string_view::npos ? ',' : ' ';
    std::vector<std::string> cells = split(line, separator);
    if (is_first) {
      is_first = false;
      const bool is_header = std::any_of(cells.begin(), cells.end(), [](std::string c) {
        std::replace(c.begin(), c.end(), ',', '.');
        return !c.empty() && !number_of(c);
      });
      if (is_header) {
        t.header = std::move(cells);
        continue;
      }
    }
    if (separator != ',' && !t.has_decimal_comma)
      for (const std::string& c : cells) t.has_decimal_comma = t.has_decimal_comma || (c.find(',') != std::string::npos && number_of(c) == std::nullopt);
    t.rows.push_back(std::move(cells));
    t.lines.push_back(number);
  }
  return t;
}

}  // namespace asbuilt::inputs
