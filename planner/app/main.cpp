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
