// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/io/cloud_file.hpp"

#include "planner/io/file.hpp"
#include "planner/io/pcd.hpp"
#include "planner/io/ply.hpp"
#include "planner/io/text_scan.hpp"

namespace asbuilt {

namespace {

using namespace text_scan;

/// x y z on each line, divided by blanks, commas or semicolons; further columns are skipped; '#' and '//' open comments; one
/// line of words at the head names the columns.
Result<CloudFile> read_xyz_points(std::string_view bytes, const std::string& name) {
  if (const auto bad = first_not_utf8(bytes.substr(0, 4096)); bad && *bad + 4 < std::min<std::size_t>(bytes.size(), 4096))
    return refuse({.code = "input.cloud_format",
                   .where = name + ": byte " + std::to_string(*bad),
                   .message = "found bytes that are neither PLY nor PCD nor text, allowed PLY, PCD, XYZ text",
                   .stage = "input"});
  CloudFile cloud;
  cloud.format = "xyz";
  std::string_view rest = bytes, line;
  std::string copy;
  int number = 0;
  bool had_data = false, had_head = false;
  cloud.points.reserve(bytes.size() / 32);
  while (take_line(rest, line)) {
    ++number;
    for (const std::string_view mark : {"#", "//"})  // a comment opens a line or follows a blank ("1.#QNAN" is a number)
      for (std::size_t c = line.find(mark); c != std::string_view::npos; c = line.find(mark, c + 1))
        if (c == 0 || is_blank(line[c - 1])) {
          line = line.substr(0, c);
          break;
        }
    const char divider = line.find(';') != std::string_view::npos ? ';' : line.find(',') != std::string_view::npos ? ',' : ' ';
    if (divider != ' ') {
      copy.assign(line);
      for (char& ch : copy)
        if (ch == divider) ch = ' ';
      line = copy;
    }
    double xyz[3] = {0, 0, 0};
    int count = 0;
    std::string_view word, first;
    bool is_bad = false;
    for (; count < 3; ++count) {
      word = take_word(line);
      if (count == 0) first = word;
      if (word.empty()) break;
      if (!parse_number(word, xyz[count])) {
        is_bad = true;
        break;
      }
    }
    if (first.empty()) continue;
    if (is_bad && count == 0 && !had_data && !had_head) {
      had_head = true;
      continue;
    }
    if (count < 3) {
      if (rest.empty() && !is_bad && had_data)
        return refuse({.code = "input.cloud_truncated",
                       .where = name + ":" + std::to_string(number),
                       .message = "found a last line with " + std::to_string(count) +
                                  " of 3 coordinates, allowed whole lines; copy or export the file again",
                       .measured = double(count),
                       .limit = 3,
                       .stage = "input"});
      return refuse({.code = had_data ? "input.cloud_value" : "input.cloud_format",
                     .where = name + ":" + std::to_string(number),
                     .message = "found " + (is_bad ? shown_word(word) : "a line with " + std::to_string(count) + " values") +
                                ", allowed x y z with decimal points, divided by blanks, commas or semicolons",
                     .stage = "input"});
    }
    had_data = true;
    const Eigen::Vector3f p(static_cast<float>(xyz[0]), static_cast<float>(xyz[1]), static_cast<float>(xyz[2]));
    if (p.allFinite()) cloud.points.push_back(p);
    else ++cloud.dropped_count;
  }
  if (!had_data)
    return refuse({.code = "input.cloud_format",
                   .where = name,
                   .message = "found no line of coordinates, allowed PLY, PCD, XYZ text",
                   .stage = "input"});
  return cloud;
}

}  // namespace

Result<CloudFile> read_cloud(std::string_view bytes, const std::string& name) {
  if (is_ply(bytes)) return read_ply_points(bytes, name);
  if (is_pcd(bytes)) return read_pcd_points(bytes, name);
  return read_xyz_points(bytes, name);
}

}  // namespace asbuilt
