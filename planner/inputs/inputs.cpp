// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/inputs/inputs.hpp"

namespace asbuilt {

Result<Done<Batch>> load_batch(const std::filesystem::path& file, const InputsRecipe&) {
  return refuse({.code = "input.not_built", .where = file.string(), .message = "", .stage = "input"});
}
Result<Done<Job>> load_job(const Batch&, const std::string& item_id, const InputsRecipe&) {
  return refuse({.code = "input.not_built", .where = item_id, .message = "", .stage = "input"});
}
std::string job_inputs_hash(const Batch&, const std::string&, const InputsRecipe&) { return {}; }
std::string schema_json(const std::string&) { return {}; }

}  // namespace asbuilt
