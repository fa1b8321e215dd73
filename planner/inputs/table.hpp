// SPDX-License-Identifier: GPL-3.0-or-later
// Tables of numbers as other programs export them: comma, semicolon, tab or blanks between columns, decimal point or comma,
// a header line or none, '#' comments, stray NUL bytes. Columns are asked for by their header, or by their number from 1.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/inputs/yaml_reader.hpp"

namespace asbuilt::inputs {

struct Table {
  std::string name;
  std::vector<std::string> header;             // empty: none
  std::vector<std::vector<std::string>> rows;  // cells trimmed
  std::vector<int> lines;                      // of each row, from 1
  bool has_decimal_comma = false;
  std::size_t nul_count = 0;                   // NUL bytes left out

  /// The column of this header (or number), or none.
  std::optional<std::size_t> column(std::string_view name) const;
  /// A cell as a number: NaN where it is "nan" or empty; none where it is no number.
  std::optional<double> number(std::size_t row, std::size_t column) const;
};

Table parse_table(std::string_view bytes, const std::string& name);

}  // namespace asbuilt::inputs
