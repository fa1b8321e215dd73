// SPDX-License-Identifier: GPL-3.0-or-later
// What a command says and where: the answer on standard output, progress and messages on standard error, every event as a
// line of JSON in --log FILE.
#pragma once

#include <fstream>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "planner/base/archive.hpp"
#include "planner/pipeline/pipeline.hpp"

namespace asbuilt {

struct ConsoleOptions {
  bool is_json = false, is_quiet = false;
  std::string log_file;
};

class Console {
 public:
  explicit Console(const ConsoleOptions& options);
  ~Console();
  bool is_json() const { return options_.is_json; }

  /// The command's answer: a JSON document under --json, else the text.
  void answer(const Json& json, const std::string& text);
  void answer_text(const std::string& json_text, const std::string& text);
  /// One line on standard error, unless --quiet.
  void say(const std::string& text);
  /// A fault the user has to read, also under --quiet.
  void complain(const std::string& text);
  void complain(const Refusals& refusals);
  void log(const Json& event);

  // progress of a batch
  void begin_items(std::size_t count);
  void stage(const StageEvent& event);
  void item(const BatchLine& line);
  void end_items();

 private:
  ConsoleOptions options_;
  std::ofstream log_;
  bool is_terminal_ = false, has_bar_ = false;
  std::size_t items_count_ = 0, finished_count_ = 0;
  std::map<std::string, std::string> running_;  // item -> stage
  void draw_bar();
  void clear_bar();
};

/// Lines of a table with aligned columns.
std::string text_table(const std::vector<std::vector<std::string>>& rows);
std::string refusal_text(const Refusal& refusal);

}  // namespace asbuilt
