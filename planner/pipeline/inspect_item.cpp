// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/pipeline/inspect_item.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "planner/base/hash.hpp"
#include "planner/pipeline/posted.hpp"
#include "planner/pipeline/store.hpp"
#include "planner/plan/inspect/inspect.hpp"
#include "planner/plan/inspect/program.hpp"
#include "planner/report/inspection_json.hpp"
#include "planner/verify/verify.hpp"

namespace asbuilt {

namespace fs = std::filesystem;

namespace {

/// The joints at which a program stands still: those of a joint move that a wait follows.
std::vector<JointVector> stops_of(const Program& program) {
  std::vector<JointVector> out;
  const JointVector* at = nullptr;
  for (const Instruction& i : program.instructions) {
    if (const auto* m = std::get_if<MoveJoint>(&i)) at = &m->q_rad;
    if (std::holds_alternative<Wait>(i) && at != nullptr) out.push_back(*at), at = nullptr;
  }
  return out;
}

bool refuse_record(InspectRecord& r, Refusals why, const std::string& stage) {
  for (Refusal& x : why) {
    if (x.stage.empty()) x.stage = stage;
    r.reasons.push_back(std::move(x));
  }
  r.status = ItemStatus::refused;
  return false;
}

bool locate_item(const Batch& batch, const std::string& item_id, const InspectOptions& options, const Watch& watch, InspectRecord& r) {
  if (options.is_from_fixture) {
    InputsRecipe inputs = options.item.inputs;
    inputs.without_scans = true;
    auto job = load_job(batch, item_id, inputs);
    if (!job) return refuse_record(r, job.error(), "input");
    r.job = std::move(job->artefact), r.notes = job->notes;
    auto location = location_of_fixture(*r.job);
    if (!location) return refuse_record(r, location.error(), "inspect");
    r.location = std::move(*location);
    return true;
  }
  ItemOptions item = options.item;
  item.last_stage = "locate";
  ItemRecord located = run_item(batch, item_id, item, watch);
  r.job = std::move(located.job), r.notes = std::move(located.notes), r.reasons = std::move(located.reasons), r.location = std::move(located.location);
  if (!r.reasons.empty() || !r.location) {
    r.status = located.status;
    return false;
  }
  return true;
}

bool plan_item(const InspectOptions& options, InspectRecord& r) {
  const Job& job = *r.job;
  auto plan = plan_inspection({}, job, *r.location);
  if (!plan) return refuse_record(r, plan.error(), "inspect");
  r.notes.insert(r.notes.end(), plan->notes.begin(), plan->notes.end());
  r.inspection = std::move(plan->artefact);
  auto program = plan_inspection_program({}, job, *r.location, *r.inspection);
  if (!program) return refuse_record(r, program.error(), "inspect");
  const Verdict planned = verify_inspection(job, *r.location, *r.inspection, program->artefact);
  if (!planned.is_ok()) return refuse_record(r, refusals_of(planned, "planned program"), "verify");

  const PostContext context{job.cell, job.taken.empty() ? options.item.inputs.today : job.taken};
  std::vector<Language> languages = options.item.languages;
  if (languages.empty()) languages = {job.cell.controller.language};
  std::vector<ReleasedProgram> programs;
  bool is_ok = true;
  for (const Language language : languages) {
    const std::string name(name_of(language));
    const Post* post = find_post(language);
    if (post == nullptr) {
      is_ok = refuse_record(r, {{.code = "post.unknown_language", .where = name, .message = "there is no post for " + name + "; nothing was emitted"}}, "post");
      continue;
    }
    auto posted = write_and_read_back(*post, program->artefact, context);
    if (!posted) {
      is_ok = refuse_record(r, posted.error(), "post");
      continue;
    }
    Verdict verdict = verify_inspection(job, *r.location, *r.inspection, posted->artefact.read_back);
    const bool was_checked = !verdict.checks.empty();
    verdict.checks.insert(verdict.checks.begin(), posted->artefact.checks.begin(), posted->artefact.checks.end());
    if (!was_checked || !verdict.is_ok()) {
      is_ok = refuse_record(r, was_checked ? refusals_of(verdict, name + " program") : refusals_of({}, name + " program"), "verify");
      continue;
    }
    r.stops.push_back(stops_of(posted->artefact.read_back));
    programs.push_back({std::move(posted->artefact.text), std::move(verdict)});
  }
  if (!is_ok) {
    r.stops.clear();
    return false;
  }
  r.programs = std::move(programs);
  r.status = ItemStatus::emitted;
  return true;
}

}  // namespace

InspectRecord inspect_item(const Batch& batch, const std::string& item_id, const InspectOptions& options, const Watch& watch) {
  InspectRecord r;
  r.batch_id = batch.id, r.item_id = item_id;
  try {
    if (locate_item(batch, item_id, options, watch, r)) plan_item(options, r);
  } catch (const std::exception& fault) {
    r.status = ItemStatus::failed;
    r.programs.clear();
    r.reasons.push_back({.code = "inspect.failed", .where = "item " + item_id, .message = std::string("a fault of the program itself: ") + fault.what(), .stage = "inspect"});
  }
  return r;
}

void write_inspection(const fs::path& out, const InspectRecord& r) {
  const fs::path folder = out / r.item_id;
  fs::create_directories(folder);
  for (const char* name : {"programs", ".programs", "inspection.json"}) fs::remove_all(folder / name);
  for (const auto& f : fs::directory_iterator(folder))
    if (f.path().filename().string().rfind("scans", 0) == 0) fs::remove(f.path());
  if (r.status == ItemStatus::emitted) {
    const fs::path aside = folder / ".programs";
    for (std::size_t k = 0; k < r.programs.size(); ++k) {
      const ReleasedProgram& program = r.programs[k];
      must(program.verdict.is_ok(), "a program with a failed check came to the release");
      for (const ProgramFile& file : program.text.files) {
        const fs::path path = aside / name_of(program.text.language) / file.name;
        write_file_whole(path, file.bytes);
        const auto again = read_file_whole(path);
        if (!again || sha256_hex(*again) != sha256_hex(file.bytes))
          throw std::runtime_error(fmt::format("{}: what was written is not what was checked; nothing was emitted", file.name));
      }
      const std::string name = k == 0 ? "scans.yaml" : "scans-" + std::string(name_of(program.text.language)) + ".yaml";
      write_file_whole(folder / name, scans_text(*r.job, *r.inspection, r.stops[k]));
    }
    fs::rename(aside, folder / "programs");
  }
  write_file_whole(folder / "inspection.json", inspection_json({r.batch_id, r.item_id, r.status, r.reasons, r.notes, r.job, r.location, r.inspection, r.programs}));
}

}  // namespace asbuilt
