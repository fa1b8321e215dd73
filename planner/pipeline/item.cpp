// SPDX-License-Identifier: GPL-3.0-or-later
// One item, all stages, one straight line. Each stage is handed the artefacts before it and nothing else.
#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "planner/burr/burr.hpp"
#include "planner/fit/fit.hpp"
#include "planner/fuse/fuse.hpp"
#include "planner/locate/locate.hpp"
#include "planner/pipeline/frames.hpp"
#include "planner/pipeline/posted.hpp"
#include "planner/pipeline/stage_run.hpp"
#include "planner/plan/motion/motion.hpp"
#include "planner/plan/path/path.hpp"
#include "planner/plan/program/program.hpp"
#include "planner/verify/verify.hpp"
#include "postprocessors/post.hpp"

namespace asbuilt {

namespace {

/// The job as the measuring and planning stages see it: without what must not make them run again.
/// The file hashes change with a comment in a file; the controller concerns the posts alone.
Job job_to_plan(const Job& job) {
  Job j = job;
  j.inputs.clear();
  j.cell.controller = {};
  return j;
}

/// The planned job as the measuring stages (fuse to burr) see it: the numbers that only decide how an edge is cut are not there
/// (NaN: a stage that came to use one would show at once), so that changing one measures nothing again.
Job job_to_measure(const Job& planned) {
  Job j = planned;
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  for (Recipe& r : j.recipes) {
    r.spindle_rpm = r.width_mm = r.tolerance_mm = r.feed_min_mm_s = r.feed_max_mm_s = r.removal_max_mm3_s = kUnknown;
    r.approach_mm = r.lead_mm = r.path_tolerance_mm = r.gate_probability_ratio = kUnknown;
    r.chip_load_mm.reset();
    r.weld.clear();
  }
  j.overrides.clear();
  return j;
}

}  // namespace

ItemRecord run_item(const Batch& batch, const std::string& item_id, const ItemOptions& options, const Watch& watch) {
  ItemRun run(batch.id, item_id, options, watch);
  ItemRecord& r = run.record;
  const auto is_last = [&](const char* name) { return options.last_stage == name; };
  std::string job, measured_job, cloud, location, features, burrs, path, motion, program;  // content hashes

  std::string files;
  if (!run.step("input", "input", [&] { files = job_inputs_hash(batch, item_id, options.inputs); })) return std::move(r);
  const std::string inputs_recipe = fmt::format("{} {} {}", options.inputs.allow_outside, options.inputs.today, batch.id);
  if (!run.stage<Job>("input", "input", r.job, {inputs_recipe, {{"files", files}}}, [&] { return load_job(batch, item_id, options.inputs); }))
    return std::move(r);
  const Job planned = job_to_plan(*r.job);
  const Job measured = job_to_measure(planned);
  if (!run.step("input", "input", [&] { job = content_hash(planned), measured_job = content_hash(measured); })) return std::move(r);

  const FuseRecipe fuse_recipe;
  if (!run.stage<MeasuredCloud>("fuse", "fuse", r.cloud, {to_bytes(fuse_recipe), {{"job", measured_job}}},
                                [&] { return fuse(fuse_recipe, measured, frames_under(batch.file.parent_path())); }, &cloud) || is_last("fuse"))
    return std::move(r);

  const LocateRecipe locate_recipe;
  if (!run.stage<Location>("locate", "locate", r.location, {to_bytes(locate_recipe), {{"job", measured_job}, {"cloud", cloud}}},
                           [&] { return locate(locate_recipe, measured, *r.cloud); }, &location) || is_last("locate"))
    return std::move(r);

  const FitRecipe fit_recipe;
  if (!run.stage<Features>("fit", "fit", r.features, {to_bytes(fit_recipe), {{"job", measured_job}, {"cloud", cloud}, {"location", location}}},
                           [&] { return fit(fit_recipe, measured, *r.cloud, *r.location); }, &features) || is_last("fit"))
    return std::move(r);

  const BurrRecipe burr_recipe;
  if (!run.stage<Burrs>("burr", "burr", r.burrs,
                        {to_bytes(burr_recipe), {{"job", measured_job}, {"cloud", cloud}, {"location", location}, {"features", features}}},
                        [&] { return measure_burrs(burr_recipe, measured, *r.cloud, *r.location, *r.features); }, &burrs) || is_last("burr"))
    return std::move(r);

  const PathRecipe path_recipe;
  if (!run.stage<ToolPath>("path", "path", r.tool_path,
                           {to_bytes(path_recipe), {{"job", job}, {"location", location}, {"features", features}, {"burrs", burrs}}},
                           [&] { return plan_path(path_recipe, planned, *r.location, *r.features, *r.burrs); }, &path) || is_last("path"))
    return std::move(r);

  const MotionRecipe motion_recipe;
  if (!run.stage<Motion>("motion", "motion", r.motion,
                         {to_bytes(motion_recipe), {{"job", job}, {"location", location}, {"features", features}, {"burrs", burrs}, {"path", path}}},
                         [&] { return plan_motion(motion_recipe, planned, *r.location, *r.features, *r.burrs, *r.tool_path); }, &motion) ||
      is_last("motion"))
    return std::move(r);

  const ProgramRecipe program_recipe;
  Job stamped = planned;  // the header names the inputs' hashes
  stamped.inputs = r.job->inputs;
  const std::string stamps = content_hash(stamped.inputs);
  if (!run.stage<Program>("program", "motion", r.program,
                          {to_bytes(program_recipe), {{"job", job}, {"inputs", stamps}, {"location", location}, {"path", path}, {"motion", motion}}},
                          [&] { return plan_program(program_recipe, stamped, *r.location, *r.tool_path, *r.motion); }, &program))
    return std::move(r);

  const auto verified = [&](const Program& p, const std::string& hash, std::optional<Verdict>& verdict) {
    return run.stage<Verdict>(
        "verify", "verify", verdict,
        {"", {{"job", job}, {"location", location}, {"features", features}, {"burrs", burrs}, {"path", path}, {"program", hash}}},
        [&] { return Done<Verdict>{verify_item(planned, *r.location, *r.features, *r.burrs, *r.tool_path, p), {}}; });
  };
  if (!verified(*r.program, program, r.motion_verdict)) return std::move(r);
  if (!r.motion_verdict->is_ok()) {
    run.refuse_item("verify", refusals_of(*r.motion_verdict, "planned program"));
    return std::move(r);
  }

  PostContext context{r.job->cell, r.job->taken.empty() ? options.inputs.today : r.job->taken};
  const std::string cell = content_hash(context.cell);
  std::vector<Language> languages = options.languages;
  if (languages.empty()) languages = {r.job->cell.controller.language};
  std::vector<ReleasedProgram> programs;
  for (const Language language : languages) {
    const std::string name(name_of(language));
    const Post* post = find_post(language);
    if (!post) {
      run.refuse_item("post", {{.code = "post.unknown_language", .where = name, .message = "there is no post for " + name + "; nothing was emitted"}});
      continue;
    }
    std::optional<Posted> posted;
    if (!run.stage<Posted>("post", "post", posted, {name + ' ' + context.date, {{"program", program}, {"cell", cell}}},
                           [&] { return write_and_read_back(*post, *r.program, context); }))
      continue;
    std::optional<Verdict> verdict;
    if (!verified(posted->read_back, content_hash(posted->read_back), verdict)) continue;
    const bool was_checked = !verdict->checks.empty();
    verdict->checks.insert(verdict->checks.begin(), posted->checks.begin(), posted->checks.end());
    if (!was_checked || !verdict->is_ok())
      run.refuse_item("verify", was_checked ? refusals_of(*verdict, name + " program") : refusals_of({}, name + " program"));
    programs.push_back({std::move(posted->text), std::move(*verdict)});
  }
  r.programs = std::move(programs);
  if (!r.reasons.empty()) return std::move(r);  // all languages asked for, or none

  r.status = ItemStatus::emitted;
  return std::move(r);
}

}  // namespace asbuilt
