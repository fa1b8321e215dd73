// SPDX-License-Identifier: GPL-3.0-or-later
// A table of numbers as measuring programs and spreadsheets write it: one header line, then rows. Comma, semicolon or tab between the
// columns, decimal point or (where the comma does not separate) decimal comma, NUL bytes and byte order marks skipped.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "planner/base/result.hpp"

namespace asbuilt {

struct CsvTable {
  std::vector<std::string> columns;  // lower case, without blanks and quotes
  std::vector<double> values;        // row by row; NaN where a field is empty or says so
  std::vector<std::string> texts;    // parallel to values where `text_column` was asked for: that column's text by row
  std::size_t rows_count = 0;
  std::size_t nul_count = 0;         // NUL bytes that were skipped
  std::size_t broken_count = 0;      // rows at the very end that were cut off in the middle

  /// Index of the first of these names that is a column; -1 where none is.
  int column(std::initializer_list<std::string_view> names) const;
  double at(std::size_t row, int column) const { return values[row * columns.size() + static_cast<std::size_t>(column)]; }
};

/// `text_column`: a column of words instead of numbers ("" for none). `name` is what a refusal calls the file.
/// Refuses input.table_header (no names of columns, names twice), input.table_value (a field that is no number, a row of another
/// length), input.table_empty.
Result<CsvTable> read_csv_table(std::string_view bytes, const std::string& name, std::string_view text_column = {});

}  // namespace asbuilt
