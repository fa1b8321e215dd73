// SPDX-License-Identifier: GPL-3.0-or-later
// Runs every folder of tests/refuse (see its README): a batch with one thing wrong must be refused with exactly the codes, files,
// lines and fields that the case names. And: every refusal code that inputs and io can give is provoked by some test.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "planner/base/hash.hpp"
#include "planner/inputs/inputs.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

const fs::path kCases = "tests/refuse";

std::string read(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}
void write(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

std::string unescaped(const std::string& text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '\\' || i + 1 == text.size()) {
      out += text[i];
      continue;
    }
    ++i;
    out += text[i] == 'n' ? '\n' : text[i];
  }
  return out;
}

std::vector<std::string> case_names() {
  std::vector<std::string> names;
  for (const auto& e : fs::directory_iterator(kCases))
    if (fs::exists(e.path() / "case.txt")) names.push_back(e.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

struct Outcome {
  std::vector<std::string> refusals, messages;
  std::set<std::string> notes;
};

Outcome run(const fs::path& folder, const std::string& item, const InputsRecipe& recipe) {
  Outcome o;
  const auto add = [&](const Refusals& all) {
    for (const Refusal& r : all) {
      o.refusals.push_back(r.code + " @ " + r.where);
      o.messages.push_back(r.message);
      EXPECT_EQ(r.stage, "input") << r.code;
      EXPECT_FALSE(r.message.empty()) << r.code;
    }
  };
  const auto batch = load_batch(folder / "batch.yaml", recipe);
  if (!batch) {
    add(batch.error());
    return o;
  }
  const std::string hash = job_inputs_hash(batch->artefact, item, recipe);
  EXPECT_EQ(hash.size(), 64u);
  const auto job = load_job(batch->artefact, item, recipe);
  if (!job) add(job.error());
  else
    for (const Note& n : job->notes) o.notes.insert(n.code);
  return o;
}

class Refuse : public testing::TestWithParam<std::string> {};

TEST_P(Refuse, with_the_stated_code) {
  const fs::path from = kCases / GetParam(),
                 folder = fs::path(testing::TempDir()) / ("asbuilt_refuse_" + std::to_string(getpid()) + "_" + GetParam());
  fs::remove_all(folder);
  fs::copy(kCases / "base", folder, fs::copy_options::recursive);
  for (const auto& e : fs::directory_iterator(from))
    if (e.path().filename() != "case.txt")
      fs::copy(e.path(), folder / e.path().filename(), fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  std::vector<std::string> expected;
  std::set<std::string> notes;
  InputsRecipe recipe;
  std::string item = "slot-1", line;
  std::istringstream in(read(from / "case.txt"));
  bool has_reason = false;
  while (std::getline(in, line)) {
    std::istringstream w(line);
    std::string word, a, b;
    w >> word >> a >> b;
    if (word == "#") has_reason = true;
    else if (!has_reason && word == "note") notes.insert(a);
    else if (!has_reason) expected.push_back(line);
    else if (word == "edit") {
      const std::size_t colon = line.find(": "), arrow = line.find(" => ");
      ASSERT_NE(arrow, std::string::npos) << line;
      const fs::path file = folder / line.substr(5, colon - 5);
      const std::string old = unescaped(line.substr(colon + 2, arrow - colon - 2)), text = read(file);
      const std::size_t at = text.find(old);
      ASSERT_NE(at, std::string::npos) << "not in " << file << ": " << old;
      write(file, text.substr(0, at) + unescaped(line.substr(arrow + 4)) + text.substr(at + old.size()));
    } else if (word == "write") {
      const std::size_t colon = line.find(": ");
      write(folder / line.substr(6, colon - 6), unescaped(line.substr(colon + 2)));
    } else if (word == "copy") fs::copy_file(folder / a, folder / b);
    else if (word == "cut") fs::resize_file(folder / a, std::stoul(b));
    else if (word == "remove") fs::remove(folder / a);
    else if (word == "item") item = a;
    else if (word == "today") recipe.today = a;
    else if (word == "scale") {
      std::istringstream stl(read(folder / a));
      std::string out;
      for (std::string l; std::getline(stl, l);) {
        double x, y, z;
        if (std::sscanf(l.c_str(), "vertex %lf %lf %lf", &x, &y, &z) == 3)
          l = "vertex " + std::to_string(x / 1000) + " " + std::to_string(y / 1000) + " " + std::to_string(z / 1000);
        out += l + "\n";
      }
      write(folder / a, out);
    } else FAIL() << "unknown line: " << line;
  }
  ASSERT_TRUE(has_reason) << "the case does not say what would go wrong";
  const Outcome o = run(folder, item, recipe);
  std::string found, wanted;
  for (std::size_t i = 0; i < o.refusals.size(); ++i) found += o.refusals[i] + "\n";
  for (const std::string& e : expected) wanted += e + "\n";
  EXPECT_EQ(found, wanted) << testing::PrintToString(o.messages);
  for (const std::string& n : notes) EXPECT_TRUE(o.notes.count(n)) << n;
  fs::remove_all(folder);
}

INSTANTIATE_TEST_SUITE_P(Inputs, Refuse, testing::ValuesIn(case_names()), [](const auto& info) { return info.param; });

TEST(Refuse, the_base_itself_loads) {
  const Outcome o = run(kCases / "base", "slot-1", {});
  EXPECT_TRUE(o.refusals.empty()) << testing::PrintToString(o.refusals) << testing::PrintToString(o.messages);
}

TEST(Refuse, every_code_is_provoked_by_a_test) {
  const std::regex code("\"(input\\.[a-z0-9_]+)\"");
  std::set<std::string> given;
  std::string tests;
  for (const char* room : {"planner/inputs", "planner/io"})
    for (const auto& e : fs::recursive_directory_iterator(room)) {
      const std::string text = e.is_regular_file() ? read(e.path()) : "";
      for (std::sregex_iterator it(text.begin(), text.end(), code), end; it != end; ++it) given.insert((*it)[1]);
    }
  for (const char* room : {"tests/refuse", "tests/unit/inputs", "tests/unit/io", "tests/unit/calibrate"})
    for (const auto& e : fs::recursive_directory_iterator(room))
      if (e.is_regular_file()) tests += read(e.path());
  EXPECT_GT(given.size(), 50u);
  for (const std::string& c : given) EXPECT_NE(tests.find(c), std::string::npos) << c << " is given by the code and provoked by no test";
}

}  // namespace
}  // namespace asbuilt
