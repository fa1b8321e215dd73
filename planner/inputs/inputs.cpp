// SPDX-License-Identifier: GPL-3.0-or-later
// The stage's functions: batch, job, hash.
#include "planner/inputs/inputs.hpp"

#include <algorithm>
#include <set>

#include "planner/base/hash.hpp"
#include "planner/inputs/dates.hpp"
#include "planner/inputs/item.hpp"

namespace asbuilt {

namespace fs = std::filesystem;
using namespace inputs;

namespace {

void take(Refusals& all, Refusals& from) {
  all.insert(all.end(), std::make_move_iterator(from.begin()), std::make_move_iterator(from.end()));
  from.clear();
}

Refusals all_faults(Item& item) {
  Refusals all;
  take(all, item.batch.faults), take(all, item.cell.out.faults), take(all, item.calibration.out.faults);
  for (auto& r : item.recipes) take(all, r.out.faults);
  take(all, item.part.out.faults), take(all, item.fixture.out.faults), take(all, item.scans.out.faults), take(all, item.faults);
  return all;
}

struct Loaded {
  Job job;
  Item item;
};

/// Reads as far as depth says. Faults stay in the item.
std::optional<Loaded> load(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe, Depth depth) {
  const auto entry = std::find_if(batch.items.begin(), batch.items.end(), [&](const BatchItem& i) { return i.id == item_id; });
  if (entry == batch.items.end()) return std::nullopt;
  Loaded l{{}, Item(Sources(batch.file.parent_path(), recipe.allow_outside))};
  Job& job = l.job;
  Item& item = l.item;
  item.depth = depth;
  item.batch_file = fs::weakly_canonical(batch.file);
  item.batch.name = item.sources.name_of(item.batch_file);
  item.batch.lines = batch.lines;
  const std::string at = "items[" + std::to_string(entry - batch.items.begin()) + "]";
  item.cell = read_source<CellFile>(item.sources, item.batch, "cell", item.batch_file, batch.cell);
  item.calibration = read_source<CalibrationFile>(item.sources, item.batch, "calibration", item.batch_file, batch.calibration);
  for (std::size_t i = 0; i < batch.recipes.size(); ++i)
    item.recipes.push_back(
        read_source<RecipeFile>(item.sources, item.batch, "recipes[" + std::to_string(i) + "]", item.batch_file, batch.recipes[i]));
  item.part = read_source<PartFile>(item.sources, item.batch, at + ".part", item.batch_file, entry->part);
  item.fixture = read_source<FixtureFile>(item.sources, item.batch, at + ".fixture", item.batch_file, entry->fixture);
  if (!recipe.without_scans)
    item.scans = read_source<ScansFile>(item.sources, item.batch, at + ".scans", item.batch_file, entry->scans);

  job.batch_id = batch.id, job.item_id = item_id;
  job.taken = item.scans.value.taken.value_or(recipe.today).substr(0, 10);
  if (item.scans.is_read && !item.scans.value.item.empty() && item.scans.value.item != item_id)
    item.scans.out.fault("input.item_mismatch", "item",
                         "found the scans of '" + item.scans.value.item + "', allowed those of '" + item_id + "'");
  job.cell = cell_of(item, item.cell);
  job.calibration_created = item.calibration.value.created, job.calibration_valid_days = item.calibration.value.valid_days;
  apply_calibration(item, job.cell, job.taken);
  job.recipes = recipes_of(item);
  job.fixture = fixture_of(item);
  job.part = part_of(item, job.recipes);
  job.captures = captures_of(item, job.cell);
  for (std::size_t i = 0; i < entry->overrides.size(); ++i) {
    const Override& o = entry->overrides[i];
    const std::string field = at + ".overrides[" + std::to_string(i) + "]";
    const auto last = day_number(o.expires), day = day_number(job.taken);
    if (last && day && *day > *last) {
      item.note("input.override_expired",
                "the override of edge " + o.edge + " by " + o.name + " held until " + o.expires + " and is not used",
                item.batch.where(field));
      continue;
    }
    const auto& edges = job.part.brep.edges;
    if (depth == Depth::all && !edges.empty() &&
        std::none_of(edges.begin(), edges.end(), [&](const BrepEdge& e) { return e.id == o.edge; }))
      item.batch.fault(
          "input.unknown_edge", field + ".edge",
          "found the edge '" + shown(o.edge) + "', allowed an id that `asbuilt cad --edges` prints for " + item.part.value.cad);
    job.overrides.push_back(o);
  }
  job.inputs = item.sources.files();
  return l;
}

}  // namespace

Result<Done<Batch>> load_batch(const fs::path& file, const InputsRecipe& recipe) {
  const fs::path full = fs::weakly_canonical(file);
  Sources sources(full.parent_path(), recipe.allow_outside);
  Readout out{.name = sources.name_of(full)};
  auto bytes = read_file(full, file.string());
  if (!bytes) return tl::unexpected(bytes.error());
  const BatchFile read = read_yaml<BatchFile>(*bytes, out);
  Done<Batch> done;
  Batch& b = done.artefact;
  b.id = read.id, b.file = full, b.cell = read.cell, b.calibration = read.calibration, b.recipes = read.recipes;
  std::set<std::string> ids;
  for (std::size_t i = 0; i < read.items.size(); ++i) {
    const ItemText& t = read.items[i];
    if (!t.id.empty() && !ids.insert(t.id).second)
      out.fault("input.duplicate_id", "items[" + std::to_string(i) + "].id", "found the id '" + t.id + "' twice, allowed once");
    BatchItem& item = b.items.emplace_back(BatchItem{.id = t.id, .part = t.part, .fixture = t.fixture, .scans = t.scans});
    for (const OverrideText& o : t.overrides) item.overrides.push_back({o.edge, o.name, o.reason, o.expires});
  }
  const auto shared = [&](const std::string& field, const std::string& text) {
    if (text.empty()) return;
    if (const auto path = sources.resolve(out, field, full, text); path && !fs::is_regular_file(*path))
      out.fault("input.file_missing", field, "found no file '" + shown(text) + "', allowed an existing file, relative to this one");
  };
  shared("cell", b.cell), shared("calibration", b.calibration);
  for (std::size_t i = 0; i < b.recipes.size(); ++i) shared("recipes[" + std::to_string(i) + "]", b.recipes[i]);
  if (!out.faults.empty()) return refuse_all(std::move(out.faults));
  b.lines = std::move(out.lines);
  return done;
}

Result<Done<Job>> load_job(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe) {
  std::optional<Loaded> l = load(batch, item_id, recipe, Depth::all);
  if (!l)
    return refuse({.code = "input.unknown_item",
                   .where = batch.file.filename().string(),
                   .message = "found no item '" + shown(item_id) + "' in the batch",
                   .stage = "input"});
  if (Refusals faults = all_faults(l->item); !faults.empty()) return refuse_all(std::move(faults));
  return Done<Job>{std::move(l->job), std::move(l->item.notes)};
}

std::string job_inputs_hash(const Batch& batch, const std::string& item_id, const InputsRecipe& recipe) {
  std::optional<Loaded> l = load(batch, item_id, recipe, Depth::bytes);
  std::string text = batch.id + '\n' + item_id + '\n' + (recipe.allow_outside ? "outside\n" : "inside\n");
  if (!l) return sha256_hex(text);
  text += l->job.taken + '\n';
  for (const Override& o : l->job.overrides) text += o.edge + '\t' + o.name + '\t' + o.reason + '\t' + o.expires + '\n';
  for (const InputFile& f : l->job.inputs) text += f.path + '\t' + f.sha256 + '\n';
  for (const Refusal& r : all_faults(l->item)) text += r.code + '\t' + r.where + '\t' + r.message + '\n';
  return sha256_hex(text);
}

Result<Done<CellSpec>> load_cell(const fs::path& file, const InputsRecipe& recipe, const fs::path& calibration) {
  const fs::path full = fs::weakly_canonical(file);
  Item item{Sources(full.parent_path(), recipe.allow_outside)};
  auto bytes = read_file(full, file.string());
  if (!bytes) return tl::unexpected(bytes.error());
  item.cell.file = full;
  item.cell.out.name = item.sources.name_of(full);
  item.cell.value = read_yaml<CellFile>(*bytes, item.cell.out);
  item.cell.is_read = item.cell.out.is_of_kind;
  CellSpec cell = cell_of(item, item.cell);
  if (!calibration.empty()) {
    bytes = read_file(calibration, calibration.string());
    if (!bytes) return tl::unexpected(bytes.error());
    item.calibration.file = fs::weakly_canonical(calibration);
    item.calibration.out.name = calibration.filename().string();
    item.calibration.value = read_yaml<CalibrationFile>(*bytes, item.calibration.out);
    item.calibration.is_read = item.calibration.out.is_of_kind;
    if (item.calibration.is_read) apply_calibration(item, cell, item.calibration.value.created);
  }
  if (Refusals faults = all_faults(item); !faults.empty()) return refuse_all(std::move(faults));
  return Done<CellSpec>{std::move(cell), std::move(item.notes)};
}

}  // namespace asbuilt
