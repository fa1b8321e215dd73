// SPDX-License-Identifier: GPL-3.0-or-later
// Runs the built program and keeps what it said.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "planner/base/archive.hpp"

namespace asbuilt::test {

struct Ran {
  int status = -1;
  std::string out, err;
};
/// The words are passed as they are, without a shell.
Ran run_program(const std::vector<std::string>& words);

/// A new empty folder; removed with the object unless KEEP_E2E is set.
struct Folder {
  std::filesystem::path path;
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
};

std::string read_text(const std::filesystem::path& file);
void write_text(const std::filesystem::path& file, const std::string& text);
Json result_of(const std::filesystem::path& out, const std::string& item);

/// Every program and every result.json under a run's folder, by path; results without timing_s.
std::map<std::string, std::string> what_came_out(const std::filesystem::path& out);

}  // namespace asbuilt::test
