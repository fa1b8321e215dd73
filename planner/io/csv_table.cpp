// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/csv_table.hpp"

#include <algorithm>
#include <cctype>
#include <set>

#include "planner/io/text_scan.hpp"

namespace asbuilt {
namespace {

using text_scan::shown_word;

constexpr std::size_t kColumnsMax = 4096;

std::string_view trimmed(std::string_view s) {
  while (!s.empty() && (text_scan::is_blank(s.front()) || s.front() == '"')) s.remove_prefix(1);
  while (!s.empty() && (text_scan::is_blank(s.back()) || s.back() == '"')) s.remove_suffix(1);
  return s;
}

void split(std::string_view line, char separator, std::vector<std::string_view>& fields) {
  fields.clear();
  for (;;) {
    const std::size_t end = line.find(separator);
    fields.push_back(trimmed(line.substr(0, end)));
    if (end == std::string_view::npos || fields.size() > kColumnsMax) return;
    line.remove_prefix(end + 1);
  }
}

/// A number with a point or, where `comma` allows it, a comma.
bool number_of(std::string_view field, bool comma, double& value) {
  if (field.empty()) {
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  if (text_scan::parse_number(field, value)) return true;
  if (!comma) return false;
  std::string text(field.substr(0, 64));
  const std::size_t at = text.find(',');
  if (at == std::string::npos || field.size() > 64) return false;
  text[at] = '.';
  return text_scan::parse_number(text, value);
}

}  // namespace

int CsvTable::column(std::initializer_list<std::string_view> names) const {
  for (const std::string_view n : names)
    for (std::size_t i = 0; i < columns.size(); ++i)
      if (columns[i] == n) return static_cast<int>(i);
  return -1;
}

Result<CsvTable> read_csv_table(std::string_view bytes, const std::string& name, std::string_view text_column) {
  CsvTable t;
  std::string clean;
  if (bytes.find('\0') != std::string_view::npos) {
    clean.reserve(bytes.size());
    for (const char c : bytes)
      if (c) clean += c;
      else ++t.nul_count;
    bytes = clean;
  }
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  std::size_t line_number = 0;
  const auto refused = [&](const char* code, const std::string& message) {
    return refuse({.code = code, .where = name + ":" + std::to_string(line_number), .message = message, .stage = "input"});
  };
  std::string_view rest = bytes, line;
  std::vector<std::string_view> fields;
  char separator = ',';
  while (text_scan::take_line(rest, line)) {
    ++line_number;
    if (trimmed(line).empty() || line.front() == '#') continue;
    separator = line.find(';') != std::string_view::npos ? ';' : line.find('\t') != std::string_view::npos ? '\t' : ',';
    split(line, separator, fields);
    break;
  }
  if (fields.empty()) return refused("input.table_empty", "found no line of column names, allowed a header line and rows of numbers");
  if (fields.size() > kColumnsMax) return refused("input.table_header", "found more than 4096 columns, allowed fewer");
  std::set<std::string> seen;
  bool has_name = false;
  for (const std::string_view f : fields) {
    std::string column;
    for (const char c : f.substr(0, 100)) column += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    double value = 0;
    has_name = has_name || (!column.empty() && !number_of(column, true, value));
    if (!column.empty() && !seen.insert(column).second)
      return refused("input.table_header", "found the column " + shown_word(column) + " twice, allowed once");
    t.columns.push_back(std::move(column));
  }
  if (!has_name) return refused("input.table_header", "found numbers where the names of the columns should stand; add a header line that names them with their units");
  const int text_at = text_column.empty() ? -1 : t.column({text_column});
  const std::size_t count = t.columns.size();
  std::string problem;
  std::size_t problem_line = 0;
  while (text_scan::take_line(rest, line)) {
    ++line_number;
    if (trimmed(line).empty() || line.front() == '#') continue;
    if (!problem.empty()) {  // something follows the row that could not be read: it was not just cut off
      line_number = problem_line;
      return refused("input.table_value", problem);
    }
    split(line, separator, fields);
    const bool is_padded = fields.size() == count + 1 && fields.back().empty();
    if (fields.size() != count && !is_padded) {
      problem = "found " + std::to_string(fields.size()) + " fields, allowed " + std::to_string(count) + " as in the header", problem_line = line_number;
      continue;
    }
    const std::size_t begin = t.values.size();
    for (std::size_t i = 0; i < count && problem.empty(); ++i) {
      double value = std::numeric_limits<double>::quiet_NaN();
      if (static_cast<int>(i) == text_at) t.texts.emplace_back(fields[i].substr(0, 1000));
      else if (!number_of(fields[i], separator != ',', value))
        problem = "found " + shown_word(fields[i]) + " in column " + shown_word(t.columns[i]) + ", allowed a number", problem_line = line_number;
      t.values.push_back(value);
    }
    if (!problem.empty()) {
      t.values.resize(begin);
      t.texts.resize(std::min(t.texts.size(), t.rows_count));
      continue;
    }
    ++t.rows_count;
  }
  if (!problem.empty()) {
    const bool is_cut = !bytes.empty() && bytes.back() != '\n' && t.rows_count > 0;  // the writer was stopped in the middle of a row
    if (!is_cut) {
      line_number = problem_line;
      return refused("input.table_value", problem);
    }
    t.broken_count = 1;
  }
  if (t.rows_count == 0) return refused("input.table_empty", "found a header and no row of numbers");
  return t;
}

}  // namespace asbuilt
