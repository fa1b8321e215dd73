// SPDX-License-Identifier: GPL-3.0-or-later
// Lines and numbers of text files, by position, without copies. Used by the cloud readers.
#pragma once

#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>

namespace asbuilt::text_scan {

inline bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r'; }

/// Takes the next line off `rest`, without its line end. False at the end of the text.
inline bool take_line(std::string_view& rest, std::string_view& line) {
  if (rest.empty()) return false;
  const std::size_t end = rest.find('\n');
  line = rest.substr(0, end);
  rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return true;
}

/// Takes the next word off `line`; empty at its end.
inline std::string_view take_word(std::string_view& line) {
  std::size_t i = 0;
  while (i < line.size() && is_blank(line[i])) ++i;
  std::size_t j = i;
  while (j < line.size() && !is_blank(line[j])) ++j;
  const std::string_view word = line.substr(i, j - i);
  line.remove_prefix(j);
  return word;
}

/// A number as programs write it, also nan, inf and the spellings of Windows ("1.#QNAN"). False for anything else.
inline bool parse_number(std::string_view word, double& value) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  if (word.empty()) return false;
  const auto r = std::from_chars(word.data(), word.data() + word.size(), value);
  if (r.ec == std::errc::result_out_of_range) {
    value = std::numeric_limits<double>::infinity();
    return r.ptr == word.data() + word.size();
  }
  if (r.ec != std::errc()) return false;
  if (r.ptr == word.data() + word.size()) return true;
  if (*r.ptr == '#') {
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  return false;
}

/// A word as it may stand in a message.
inline std::string shown_word(std::string_view word) {
  std::string text;
  for (const char c : word.substr(0, 40)) text += c >= 0x20 && c < 0x7f ? c : '?';
  return "'" + text + (word.size() > 40 ? "...'" : "'");
}

}  // namespace asbuilt::text_scan
