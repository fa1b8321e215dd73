// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/inputs/dates.hpp"

#include <chrono>

namespace asbuilt::inputs {

std::optional<long> day_number(std::string_view text) {
  if (text.size() > 10 && text[10] != 'T' && text[10] != ' ') return std::nullopt;
  if (text.size() < 10 || text.size() > 40) return std::nullopt;
  int part[3] = {0, 0, 0};
  for (int i = 0, k = 0; i < 10; ++i) {
    if (i == 4 || i == 7) {
      if (text[i] != '-') return std::nullopt;
      ++k;
    } else {
      if (text[i] < '0' || text[i] > '9') return std::nullopt;
      part[k] = 10 * part[k] + (text[i] - '0');
    }
  }
  const std::chrono::year_month_day day{std::chrono::year(part[0]), std::chrono::month(unsigned(part[1])),
                                        std::chrono::day(unsigned(part[2]))};
  if (!day.ok()) return std::nullopt;
  return long(std::chrono::sys_days(day).time_since_epoch().count());
}

}  // namespace asbuilt::inputs
