// SPDX-License-Identifier: GPL-3.0-or-later
// One function a command: takes what the command line said, says its answer, returns the exit status.
#pragma once

#include <string>
#include <vector>

#include "planner/app/console.hpp"

namespace asbuilt {

struct BatchArguments {
  std::string batch, out;
  int jobs_count = 1;
  std::vector<std::string> only, post;
  std::string executor = "local";
  bool allow_outside = false;
  double timeout_s = 0;
};
int batch_command(const BatchArguments& arguments, Console& console);

/// The languages of "krl,inform"; empty with a message in `fault` for one that is unknown.
std::vector<Language> languages_of(const std::vector<std::string>& words, std::string& fault);
/// The command that answers an order of run_batch: this program.
std::vector<std::string> own_worker_command();

}  // namespace asbuilt
