// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/app/console.hpp"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "planner/base/number.hpp"
#include "planner/report/json_text.hpp"

namespace asbuilt {

namespace {

void put(std::FILE* to, const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), to);
  std::fflush(to);
}

std::size_t letters(const std::string& text) {  // code points of UTF-8
  return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::size_t terminal_width() {
  winsize size{};
  return ::ioctl(2, TIOCGWINSZ, &size) == 0 && size.ws_col > 20 ? size.ws_col : 80;
}

}  // namespace

std::string refusal_text(const Refusal& r) {
  std::string text = r.where.empty() || r.message.find(r.where) != std::string::npos ? "" : r.where + ": ";
  text += r.message.empty() ? r.code : r.message;
  return text + (r.message.empty() ? "" : " [" + r.code + "]");
}

std::string text_table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows)
    for (std::size_t k = 0; k < row.size(); ++k) {
      if (k >= widths.size()) widths.push_back(0);
      widths[k] = std::max(widths[k], letters(row[k]));
    }
  std::string text;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t k = 0; k < row.size(); ++k) {
      line += row[k];
      if (k + 1 < row.size()) line += std::string(widths[k] - letters(row[k]) + 2, ' ');
    }
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
  }
  return text;
}

Console::Console(const ConsoleOptions& options) : options_(options), is_terminal_(::isatty(2) == 1) {
  if (options_.log_file.empty()) return;
  log_.open(options_.log_file, std::ios::app);
  if (!log_) throw std::runtime_error("--log " + options_.log_file + ": the file cannot be written");
}

Console::~Console() { clear_bar(); }

void Console::answer(const Json& json, const std::string& text) { answer_text(readable_json(json), text); }
void Console::answer_text(const std::string& json_text, const std::string& text) { put(stdout, options_.is_json ? json_text : text); }

void Console::say(const std::string& text) {
  if (options_.is_quiet) return;
  clear_bar();
  put(stderr, text + "\n");
}

void Console::complain(const std::string& text) {
  clear_bar();
  put(stderr, "asbuilt: " + text + "\n");
  log({{"event", "fault"}, {"message", text}});
}

void Console::complain(const Refusals& refusals) {
  for (const Refusal& r : refusals) complain(refusal_text(r));
}

void Console::log(const Json& event) {
  if (!log_.is_open()) return;
  Json line;
  line["time_s"] = rounded(std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count(), 3);
  for (const auto& [key, value] : event.items()) line[key] = value;
  log_ << line.dump(-1, ' ', false, Json::error_handler_t::replace) << "\n" << std::flush;
}

void Console::begin_items(std::size_t count) {
  items_count_ = count;
  finished_count_ = 0;
}

void Console::stage(const StageEvent& event) {
  running_[event.item] = event.stage;
  Json line{{"event", "stage"}, {"item", event.item}, {"stage", event.stage}, {"what", std::string(name_of(event.what))}};
  if (event.what != StageEvent::What::begun) {
    line["took_s"] = rounded(event.time_s, 3);
    line["peak_memory_mib"] = rounded(event.peak_memory_mib, 1);
    line["key"] = event.key;
  }
  log(line);
  draw_bar();
}

void Console::item(const BatchLine& line) {
  running_.erase(line.item_id);
  ++finished_count_;
  double time_s = 0;
  for (const auto& [stage, t] : line.timing_s) time_s += t;
  Json event{{"event", "item"}, {"item", line.item_id}, {"status", std::string(name_of(line.status))}, {"took_s", rounded(time_s, 3)}};
  if (!line.reasons.empty()) event["code"] = line.reasons.front().code, event["message"] = line.reasons.front().message;
  log(event);
  std::string text = fmt::format("{}/{} {}: {} in {:.1f} s", finished_count_, items_count_, line.item_id, name_of(line.status), time_s);
  if (!line.reasons.empty()) text += " - " + line.reasons.front().stage + ": " + refusal_text(line.reasons.front());
  say(text);
  draw_bar();
}

void Console::end_items() {
  clear_bar();
  items_count_ = 0;
}

void Console::draw_bar() {
  if (!is_terminal_ || options_.is_quiet || items_count_ == 0) return;
  constexpr std::size_t kCells = 24;
  const std::size_t full = kCells * finished_count_ / items_count_;
  std::string line = "[" + std::string(full, '#') + std::string(kCells - full, '.') + fmt::format("] {}/{}", finished_count_, items_count_);
  for (const auto& [item, stage] : running_) line += "  " + item + ": " + stage;
  const std::size_t width = terminal_width() - 1;
  if (line.size() > width) line.resize(width);
  put(stderr, "\r\x1b[K" + line);
  has_bar_ = true;
}

void Console::clear_bar() {
  if (has_bar_) put(stderr, "\r\x1b[K");
  has_bar_ = false;
}

}  // namespace asbuilt
