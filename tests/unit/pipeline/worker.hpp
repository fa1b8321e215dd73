// SPDX-License-Identifier: GPL-3.0-or-later
// The worker of the executor's tests: what it does is told by the item's name.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace asbuilt::test {

/// Called by main for `test_pipeline worker ORDER`.
int work(const std::string& order);
/// The command that starts this program as a worker.
std::vector<std::string> worker_command();
/// A new empty folder under the system's temporary one; removed with the object.
struct TemporaryFolder {
  std::filesystem::path path;
  TemporaryFolder();
  ~TemporaryFolder();
};

}  // namespace asbuilt::test
