// SPDX-License-Identifier: GPL-3.0-or-later
// The command line: exit statuses, messages, one JSON document on standard output.
#include <gtest/gtest.h>

#include "tests/e2e/run_program.hpp"

namespace asbuilt {
namespace {

using test::run_program;

TEST(CommandLine, exit_statuses) {
  const test::Folder folder;
  const std::string out = folder.path / "out";
  const std::vector<std::pair<std::vector<std::string>, int>> table{
      {{"--help"}, 0},
      {{"--version"}, 0},
      {{"batch", "--help"}, 0},
      {{}, 2},
      {{"bacth"}, 2},
      {{"batch"}, 2},
      {{"batch", "none.yaml"}, 2},
      {{"batch", "none.yaml", "--out", out}, 2},
      {{"batch", "none.yaml", "--out", out, "--colour", "blue"}, 2},
      {{"batch", "none.yaml", "--out", out, "-j", "0"}, 2},
      {{"batch", "none.yaml", "--out", out, "-j", "two"}, 2},
      {{"batch", "none.yaml", "--out", out, "--executor", "cloud"}, 2},
      {{"batch", "none.yaml", "--out", out, "--post", "fanuc"}, 2},
      {{"locate", "none.yaml", "--item", "x"}, 2},
      {{"cad", "none.step"}, 2},
      {{"calibrate", "none.yaml", "--out", out}, 2},
      {{"simulate", "none.yaml", "--out", out}, 2},
      {{"verify", "none.src", "--cell", "none.yaml"}, 2},
      {{"compare", "none.json", "none.json"}, 2},
      {{"show", "none.json"}, 2},
      {{"why", "x", "--out", out}, 2},
      {{"schema", "recipe"}, 0},
      {{"schema", "poem"}, 2},
  };
  for (const auto& [words, status] : table) {
    std::string line;
    for (const std::string& w : words) line += w + " ";
    const test::Ran ran = run_program(words);
    EXPECT_EQ(ran.status, status) << line << "\n" << ran.err;
    if (status != 0) EXPECT_FALSE(ran.err.empty()) << line;
    if (status != 0) EXPECT_TRUE(ran.out.empty()) << line << ran.out;
  }
}

TEST(CommandLine, an_unknown_language_names_those_that_are_known) {
  const test::Ran ran = run_program({"batch", "none.yaml", "--out", "x", "--post", "krl,fanuc"});
  EXPECT_NE(ran.err.find("fanuc"), std::string::npos);
  EXPECT_NE(ran.err.find("inform"), std::string::npos);
}

TEST(CommandLine, schemas_are_json) {
  for (const char* kind : {"part", "recipe", "cell", "fixture", "calibration", "scans", "batch"}) {
    const test::Ran ran = run_program({"schema", kind});
    EXPECT_EQ(ran.status, 0) << kind;
    EXPECT_TRUE(Json::parse(ran.out, nullptr, false).is_object()) << kind;
  }
}

}  // namespace
}  // namespace asbuilt
