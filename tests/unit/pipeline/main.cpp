// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <thread>

#include "planner/base/archive.hpp"
#include "planner/pipeline/pipeline.hpp"
#include "tests/unit/pipeline/worker.hpp"

namespace asbuilt::test {

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "asbuilt-test-XXXXXX").string();
  path = ::mkdtemp(name.data());
}
TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path, ignored);
}

std::vector<std::string> worker_command() { return {std::filesystem::read_symlink("/proc/self/exe").string(), "worker"}; }

int work(const std::string& text) {
  const Json order = Json::parse(text);
  const std::string item = order.at("item");
  const auto tell = [&](const char* stage, int what) {
    const std::string line = Json{{"stage", stage}, {"what", what}, {"time_s", 0.25}, {"memory", 12.0}, {"key", ""}, {"parts", Json::object()}}.dump() + "\n";
    return ::write(order.at("events").get<int>(), line.data(), line.size());
  };
  tell("input", 0), tell("input", 1), tell("fit", 0);
  if (item.starts_with("crash")) ::raise(SIGSEGV);
  if (item.starts_with("abort")) std::abort();
  if (item.starts_with("slow")) std::this_thread::sleep_for(std::chrono::seconds(30));
  if (item.starts_with("silent")) return 0;  // says all is well and leaves nothing
  if (item.starts_with("broken")) return 77;
  ItemRecord record;
  record.item_id = item;
  record.status = ItemStatus::refused;
  record.reasons = {{.code = "fit.edge_not_seen", .message = "the edge was not seen", .stage = "fit"}};
  write_item(order.at("out").get<std::string>(), record);
  return 3;
}

}  // namespace asbuilt::test

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "worker") return asbuilt::test::work(argv[2]);
  ::testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
