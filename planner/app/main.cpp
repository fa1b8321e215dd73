// SPDX-License-Identifier: GPL-3.0-or-later
// The command line: which command, which options. What the commands do is in the other files of this room.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>

#include "planner/app/commands.hpp"

namespace {

using namespace asbuilt;

int run(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "worker") return run_order(argv[2]);

  CLI::App app{"asbuilt: from CAD, scans and calibration to checked robot programs"};
  app.require_subcommand(1);
  app.set_version_flag("--version", ASBUILT_VERSION);
  ConsoleOptions console_options;
  std::function<int(Console&)> command;
  const auto add = [&](const std::string& name, const std::string& about, std::function<int(Console&)> body) {
    CLI::App* sub = app.add_subcommand(name, about);
    sub->add_flag("--json", console_options.is_json, "one JSON document on standard output");
    sub->add_flag("--quiet", console_options.is_quiet, "no progress");
    sub->add_option("--log", console_options.log_file, "append every event to this file, one JSON object a line");
    sub->callback([&command, body] { command = body; });
    return sub;
  };

  BatchArguments batch;
  CLI::App* c = add("batch", "every item of a batch through all stages", [&](Console& console) { return batch_command(batch, console); });
  c->add_option("BATCH", batch.batch, "the batch file (YAML)")->required();
  c->add_option("--out", batch.out, "folder for results; what an earlier run left there is taken up")->required();
  c->add_option("-j", batch.jobs_count, "items at a time")->check(CLI::PositiveNumber);
  c->add_option("--only", batch.only, "only this item (may be repeated)")->delimiter(',');
  c->add_option("--post", batch.post, "languages: krl, inform, beckhoff; without it the cell's own")->delimiter(',');
  c->add_option("--executor", batch.executor, "local or slurm")->check(CLI::IsMember({"local", "slurm"}));
  c->add_option("--timeout", batch.timeout_s, "seconds one item may take; 0: no limit")->check(CLI::NonNegativeNumber);
  c->add_flag("--allow-outside", batch.allow_outside, "files may lie outside the batch's folder");

  DemoArguments demo;
  c = add("demo", "virtual parts with known truth through the whole chain, and how far the result is from the truth", [&](Console& console) { return demo_command(demo, console); });
  c->add_option("--out", demo.out, "folder for everything (default out/demo)");
  c->add_option("--seed", demo.seed, "another seed, other parts");
  c->add_option("-j", demo.jobs_count, "items at a time")->check(CLI::PositiveNumber);

  CalibrateArguments calibrate;
  c = add("calibrate", "from captures to a calibration with covariances", [&](Console& console) { return calibrate_command(calibrate, console); });
  c->add_option("CAPTURES", calibrate.captures, "the captures file (YAML)")->required();
  CLI::Option* calibrate_out = c->add_option("--out", calibrate.out, "the calibration to write (YAML)");
  c->add_option("--check", calibrate.check, "write nothing; say whether the sensor still sees the target where this calibration (YAML) says")->excludes(calibrate_out);
  c->add_flag("--allow-outside", calibrate.allow_outside, "files may lie outside the captures' folder");

  CadArguments cad;
  c = add("cad", "what the reader sees of a CAD file", [&](Console& console) { return cad_command(cad, console); });
  c->add_option("FILE", cad.file, "STEP, or a mesh: STL, PLY, OBJ, 3MF")->required();
  c->add_flag("--edges", cad.wants_edges, "every edge, with its faces, kind, length, angle and points");
  c->add_option("--mesh", cad.mesh_out, "write the triangles to this .ply or .stl");
  c->add_option("--chord", cad.chord_mm, "largest distance of the triangles from the surface, mm")->check(CLI::PositiveNumber);
  c->add_option("--angle", cad.angle_deg, "largest turn of the normal between neighbours, degree")->check(CLI::Range(0.1, 90.0));
  c->add_option("--units", cad.units, "of a mesh whose format carries none")->check(CLI::IsMember({"mm", "cm", "m", "inch"}));

  StageArguments stage;
  const std::pair<const char*, const char*> stages[] = {{"fuse", "the captures of one item as one measured cloud"},
                                                        {"locate", "where the part of one item sits"},
                                                        {"fit", "the edges of one item as they are"},
                                                        {"burr", "the burrs on the edges of one item"},
                                                        {"path", "the path of the tool tip for one item"},
                                                        {"motion", "the joint motion for one item"}};
  for (const auto& [name, about] : stages) {
    c = add(name, about, [&stage, name = std::string(name)](Console& console) { return stage.stage = name, stage_command(stage, console); });
    c->add_option("BATCH", stage.batch, "the batch file (YAML)")->required();
    c->add_option("--item", stage.item, "which item")->required();
    c->add_option("--out", stage.out, "folder whose store is used (default out)");
    c->add_flag("--allow-outside", stage.allow_outside, "files may lie outside the batch's folder");
  }

  InspectArguments inspect;
  c = add("inspect", "from where to scan the edges of one item: poses, what they will see, the robot program", [&](Console& console) { return inspect_command(inspect, console); });
  c->add_option("BATCH", inspect.batch, "the batch file (YAML)")->required();
  c->add_option("--item", inspect.item, "which item")->required();
  c->add_option("--out", inspect.out, "folder for the plan and its program (default out)");
  c->add_option("--post", inspect.post, "languages: krl, inform, beckhoff; without it the cell's own")->delimiter(',');
  c->add_option("--at", inspect.at, "where the part is: as its scans find it, or as the fixture holds it (no scans needed)")->check(CLI::IsMember({"scans", "fixture"}));
  c->add_flag("--allow-outside", inspect.allow_outside, "files may lie outside the batch's folder");

  VerifyArguments verify;
  c = add("verify", "read emitted programs back, replay them, check them", [&](Console& console) { return verify_command(verify, console); });
  c->add_option("PROGRAM", verify.programs, "program files: .src .dat, .JBI .CND, .nc .cnc .mpf")->required();
  c->add_option("--cell", verify.cell, "the cell they run in (YAML)")->required();
  c->add_option("--calibration", verify.calibration, "the calibration they were made with (default: calibration.yaml beside the cell)");
  c->add_option("--result", verify.result, "the result.json they came with");

  CompareArguments compare;
  c = add("compare", "drawing against adapted edge (one result), two runs of one item, or two programs", [&](Console& console) { return compare_command(compare, console); });
  c->add_option("A", compare.a, "result.json, the folder of one, or a program")->required();
  c->add_option("B", compare.b, "the other; without it: drawing against adapted");
  c->add_option("--cell", compare.cell, "needed to compare programs (YAML)");
  c->add_option("--calibration", compare.calibration, "as for verify");

  std::string scenario, simulated;
  c = add("simulate", "the virtual cell: scans of an imperfect part, with the truth beside them", [&](Console& console) { return simulate_command(scenario, simulated, console); });
  c->add_option("SCENARIO", scenario, "the scenario file (YAML)")->required();
  c->add_option("--out", simulated, "folder for batch and truth")->required();

  std::string kind, shown, why_item_id, why_out = "out";
  c = add("schema", "JSON Schema of a kind of file", [&](Console& console) { return schema_command(kind, console); });
  c->add_option("KIND", kind, "part, recipe, cell, fixture, calibration, scans, batch or captures")->required();
  c = add("show", "a result.json or batch.json for reading", [&](Console& console) { return show_command(shown, console); });
  c->add_option("FILE", shown, "the file, or its folder")->required();
  c = add("why", "why each stage of an item's latest run ran again, or did not", [&](Console& console) { return why_command(why_item_id, why_out, console); });
  c->add_option("ITEM", why_item_id, "the item's id")->required();
  c->add_option("--out", why_out, "folder of the run (default out)");

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  Console console(console_options);
  return command(console);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& fault) {
    std::fprintf(stderr, "asbuilt: a fault of the program itself: %s\n", fault.what());
    return 1;
  }
}
