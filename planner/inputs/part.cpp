// SPDX-License-Identifier: GPL-3.0-or-later
// Recipes, fixture and part: units turned to rad, CAD read, features bound to its edges.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "planner/geom/mesh_brep.hpp"
#include "planner/inputs/item.hpp"
#include "planner/io/mesh_file.hpp"
#include "planner/io/step/step_reader.hpp"

namespace asbuilt::inputs {

namespace {

constexpr SizeGate kPartGate{1, 1e4, "a part"};
constexpr SizeGate kFixtureGate{1, 1e5, "a fixture"};

std::string index(const char* list, std::size_t i) { return std::string(list) + "[" + std::to_string(i) + "]"; }

std::string_view word_of(LengthUnit u) {
  for (const auto& [word, unit] : Words<LengthUnit>::list)
    if (unit == u) return word;
  return "";
}

bool is_step(std::string_view bytes, const std::filesystem::path& file) {
  std::string e = file.extension().string();
  for (char& c : e) c = c >= 'A' && c <= 'Z' ? char(c + 32) : c;
  return e == ".step" || e == ".stp" || e == ".p21" || bytes.substr(0, 13) == "ISO-10303-21;";
}

Brep cad_of(Item& item) {
  YamlSource<PartFile>& s = item.part;
  const PartFile& t = s.value;
  if (t.cad.empty()) return {};
  const auto file = item.sources.resolve(s.out, "cad", s.file, t.cad);
  if (!file) return {};
  const auto bytes = item.sources.read(s.out, "cad", *file);
  if (!bytes) return {};
  const std::string name = item.sources.name_of(*file);
  Brep brep;
  if (is_step(*bytes, *file)) {
    if (item.depth == Depth::bytes) return {};
    auto read = read_step(*bytes, name);
    if (!read) {
      for (Refusal& r : read.error()) {
        if (r.stage.empty()) r.stage = "input";
        item.faults.push_back(std::move(r));
      }
      return {};
    }
    brep = std::move(read->artefact);
    item.notes.insert(item.notes.end(), read->notes.begin(), read->notes.end());
    for (std::size_t i = 0; i < brep.unread.size() && i < 20; ++i)
      item.note("input.cad_unread", brep.unread[i].entity + ": " + brep.unread[i].why, name + ":" + std::to_string(brep.unread[i].line));
    static const std::map<std::string, double> known{{"mm", 1}, {"cm", 10}, {"m", 1000}, {"inch", 25.4}, {"in", 25.4}};
    if (const auto of_file = known.find(brep.units); t.units && of_file != known.end() && of_file->second != mm_of(*t.units))
      s.out.fault("input.units_contradict", "units",
                  "found a unit that is not the one in " + name + " (" + brep.units + "); remove it, STEP carries its own");
  } else {
    const std::optional<double> own = mesh_unit_mm(*bytes, name);
    if (!own && !t.units) {
      s.out.lines.try_emplace("units", s.out.lines["cad"]);
      s.out.fault("input.units_missing", "units", "found no unit for " + name + ", whose format carries none; allowed mm | cm | m | inch");
      return {};
    }
    if (own && t.units && std::abs(*own - mm_of(*t.units)) > 1e-9 * *own) {
      s.out.fault("input.units_contradict", "units",
                  fmt::format("found a unit that is not the one in {} ({:g} mm); remove it", name, *own));
      return {};
    }
    if (item.depth == Depth::bytes) return {};
    auto mesh = read_mesh(*bytes, name, own ? *own : mm_of(*t.units));
    if (!mesh) {
      item.faults.insert(item.faults.end(), mesh.error().begin(), mesh.error().end());
      return {};
    }
    brep = brep_from_mesh(mesh->mesh);
    brep.schema = file->extension().string();
    brep.units = own ? fmt::format("{:g} mm", *own) : std::string(word_of(*t.units));
    if (mesh->dropped_count)
      item.note("input.mesh_dropped", std::to_string(mesh->dropped_count) + " triangles with a NaN or infinite corner were dropped", name);
    if (brep.open_edges_count)
      item.note("input.cad_open",
                std::to_string(brep.open_edges_count) + " edges of the mesh have one triangle only: the shape is not closed", name);
  }
  const double size = brep.box.is_empty() ? brep.mesh.box().diagonal_mm() : brep.box.diagonal_mm();
  if (size < kPartGate.min_mm || size > kPartGate.max_mm)
    s.out.fault("input.size_implausible", "cad",
                fmt::format("found a part with a diagonal of {:.4g} mm, allowed {:g} to {:g} mm: the unit of {} is wrong", size,
                            kPartGate.min_mm, kPartGate.max_mm, name),
                size, size < kPartGate.min_mm ? kPartGate.min_mm : kPartGate.max_mm, "mm");
  return brep;
}

}  // namespace

std::vector<Recipe> recipes_of(Item& item) {
  std::vector<Recipe> all;
  std::set<std::string> ids;
  for (YamlSource<RecipeFile>& s : item.recipes) {
    if (!s.is_read) continue;
    const RecipeFile& t = s.value;
    Recipe r;
    r.id = t.id, r.process = t.process, r.tool = t.tool, r.spindle_rpm = t.spindle_rpm;
    r.width_mm = t.edge_break.width_mm, r.tolerance_mm = t.edge_break.tolerance_mm;
    r.feed_min_mm_s = t.feed.min_mm_s, r.feed_max_mm_s = t.feed.max_mm_s;
    r.removal_max_mm3_s = t.removal.max_mm3_s, r.chip_load_mm = t.removal.chip_load_mm;
    r.burr_max_height_mm = t.burr.max_height_mm, r.burr_max_passes_count = t.burr.max_passes_count;
    r.orientation = t.orientation.mode, r.axis_base = t.orientation.axis_base.normalized(),
    r.cone_rad = rad_from_deg(t.orientation.cone_deg);
    r.approach_mm = t.approach_mm, r.lead_mm = t.lead_mm, r.path_tolerance_mm = t.path_tolerance_mm,
    r.gate_probability_ratio = t.gate_probability_ratio;
    if (t.weld) {
      const auto keep = [&](const char* key, const std::optional<double>& v) {
        if (v) r.weld[key] = *v;
      };
      keep("speed", t.weld->speed_mm_s), keep("current", t.weld->current_A), keep("voltage", t.weld->voltage_V),
          keep("wire_feed", t.weld->wire_mm_s);
      keep("weave_width", t.weld->weave_width_mm), keep("weave_frequency", t.weld->weave_frequency_Hz),
          keep("work_angle", t.weld->work_angle_deg);
      keep("travel_angle", t.weld->travel_angle_deg), keep("stickout", t.weld->stickout_mm);
    }
    if (!t.id.empty() && !ids.insert(t.id).second)
      s.out.fault("input.duplicate_id", "id", "found the recipe id '" + t.id + "' twice in the batch, allowed once");
    if (item.cell.is_read && !t.tool.empty()) {
      const ToolText* tool = nullptr;
      for (const ToolText& x : item.cell.value.tools)
        if (x.id == t.tool) tool = &x;
      if (tool && item.calibration.is_read && !item.calibration.value.tools.count(t.tool))
        s.out.fault("input.tool_not_calibrated", "tool",
                    "found the tool '" + t.tool + "', which " + item.calibration.out.name +
                        " does not name; calibrate it: the program's tool number means the calibrated pose");
      if (!tool)
        s.out.fault("input.unknown_tool", "tool", "found the tool '" + t.tool + "', allowed one that " + item.cell.out.name + " has");
      else if (t.spindle_rpm > tool->spindle.max_rpm && tool->spindle.max_rpm > 0)
        s.out.fault("input.out_of_range", "spindle_rpm",
                    fmt::format("found {:g} rpm, allowed at most the {:g} rpm of tool {}", t.spindle_rpm, tool->spindle.max_rpm, t.tool),
                    t.spindle_rpm, tool->spindle.max_rpm, "rpm");
    }
    if (t.feed.min_mm_s > t.feed.max_mm_s && t.feed.max_mm_s > 0)
      s.out.fault("input.out_of_range", "feed.min",
                  fmt::format("found {:g} mm/s, allowed at most feed.max, {:g} mm/s", t.feed.min_mm_s, t.feed.max_mm_s), t.feed.min_mm_s,
                  t.feed.max_mm_s, "mm/s");
    if (t.edge_break.width_mm > 0 && t.edge_break.tolerance_mm >= t.edge_break.width_mm)
      s.out.fault("input.out_of_range", "edge_break.tolerance",
                  fmt::format("found {:g} mm, allowed less than the width of {:g} mm", t.edge_break.tolerance_mm, t.edge_break.width_mm),
                  t.edge_break.tolerance_mm, t.edge_break.width_mm, "mm");
    all.push_back(std::move(r));
  }
  return all;
}

FixtureSpec fixture_of(Item& item) {
  YamlSource<FixtureFile>& s = item.fixture;
  FixtureSpec f;
  if (!s.is_read) return f;
  const FixtureFile& t = s.value;
  f.T_base_fixture = t.base_fixture.pose<frame::Base, frame::Fixture>();
  f.T_fixture_part = t.fixture_part.pose<frame::Fixture, frame::Part>();
  f.play_mm = t.play.xyz_mm;
  for (std::size_t k = 0; k < 3; ++k)
    if (!t.play.rpy_deg[k].is_word) f.play_rad[k] = rad_from_deg(t.play.rpy_deg[k].value);
  if (t.mesh) f.mesh_fixture = mesh_at(item, s.out, "mesh", s.file, *t.mesh, t.units, kFixtureGate);
  return f;
}

PartSpec part_of(Item& item, const std::vector<Recipe>& recipes) {
  YamlSource<PartFile>& s = item.part;
  PartSpec part;
  if (!s.is_read) return part;
  const PartFile& t = s.value;
  part.id = t.id, part.material = t.material, part.cad_file = t.cad;
  part.brep = cad_of(item);
  if (t.symmetry) {
    const NumberOrWord& order = t.symmetry->order;
    if (!order.is_word && order.value != std::floor(order.value))
      s.out.fault("input.wrong_type", "symmetry.order", fmt::format("found {:g}, allowed a whole number or 'continuous'", order.value));
    part.symmetry = Symmetry{t.symmetry->axis.point_mm, t.symmetry->axis.direction.normalized(), order.is_word ? 0 : int(order.value)};
  }
  if (t.burr_zone)
    part.burr_zone = BurrZone{t.burr_zone->parting_plane.point_mm, t.burr_zone->parting_plane.normal.normalized(), t.burr_zone->width_mm};
  std::set<std::string> ids;
  std::map<int, std::pair<std::string, Process>> owner;
  for (std::size_t i = 0; i < t.features.size(); ++i) {
    const FeatureText& f = t.features[i];
    const std::string at = index("features", i);
    if (!f.id.empty() && !ids.insert(f.id).second)
      s.out.fault("input.duplicate_id", at + ".id", "found the id '" + f.id + "' twice, allowed once");
    const Recipe* recipe = nullptr;
    for (const Recipe& r : recipes)
      if (r.id == f.recipe) recipe = &r;
    bool all_recipes_read = true;
    for (const auto& r : item.recipes) all_recipes_read = all_recipes_read && r.is_read && !r.value.id.empty();
    if (!recipe && !f.recipe.empty() && all_recipes_read) {
      std::string known;
      for (const Recipe& r : recipes) known += (known.empty() ? "" : ", ") + r.id;
      s.out.fault("input.unknown_recipe", at + ".recipe", "found the recipe '" + f.recipe + "', allowed one of the batch: " + known);
    }
    FeatureSpec feature{f.id, f.recipe, {}};
    const bool are_edges_read = std::none_of(s.out.faults.begin(), s.out.faults.end(),
                                             [&](const Refusal& r) { return r.where.find(": " + at + ".edges") != std::string::npos; });
    if (item.depth == Depth::all && !part.brep.edges.empty() && are_edges_read)
      feature.edges = choose_edges(item, part.brep, f, at + ".edges", recipe && recipe->process == Process::deburr);
    for (const int e : feature.edges) {
      const Process process = recipe ? recipe->process : Process::scan;
      const auto [it, is_new] = owner.try_emplace(e, f.id, process);
      if (!is_new && it->second.second == process)
        s.out.fault("input.edge_twice", at + ".edges",
                    "found edge " + part.brep.edges[std::size_t(e)].id + " also in feature '" + it->second.first +
                        "', allowed in one feature of a process");
    }
    part.features.push_back(std::move(feature));
  }
  return part;
}

}  // namespace asbuilt::inputs
