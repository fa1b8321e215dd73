// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/simulate/simulate.hpp"

namespace asbuilt {
Result<Done<std::filesystem::path>> simulate(const Scenario&, const std::filesystem::path&) { return refuse({.code = "input.not_built"}); }
Result<Done<Scenario>> load_scenario(const std::filesystem::path&) { return refuse({.code = "input.not_built"}); }
Result<Done<std::map<std::string, double>>> compare_with_truth(const std::filesystem::path&, const std::filesystem::path&) {
  return refuse({.code = "input.not_built"});
}
}  // namespace asbuilt
