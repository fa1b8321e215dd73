// SPDX-License-Identifier: GPL-3.0-or-later
// The readers of every kind of YAML file: what is written is read, in any order of keys; every form of a pose is the same pose; no
// bytes break them; the documentation says what the readers do.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "planner/inputs/dates.hpp"
#include "planner/inputs/files_batch.hpp"
#include "planner/inputs/files_captures.hpp"
#include "planner/inputs/files_part.hpp"
#include "planner/inputs/inputs.hpp"
#include "tests/unit/inputs/yaml_text.hpp"

namespace asbuilt {
namespace {

using namespace inputs;
namespace fs = std::filesystem;

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string faults_of(const Readout& out) {
  std::string text;
  for (const Refusal& r : out.faults) text += r.code + " | " + r.where + " | " + r.message + "\n";
  return text;
}

template <class F>
void for_each_kind(F&& f) {
  f.template operator()<PartFile>(), f.template operator()<RecipeFile>(), f.template operator()<CellFile>(),
      f.template operator()<FixtureFile>();
  f.template operator()<CalibrationFile>(), f.template operator()<ScansFile>(), f.template operator()<BatchFile>(),
      f.template operator()<CapturesFile>();
}

TEST(Yaml, what_is_written_is_read_in_any_order_of_keys) {
  std::mt19937_64 engine(11);
  for_each_kind([&]<class File>() {
    for (std::size_t round = 0; round < 40; ++round) {
      File file;
      test::Filler filler(engine);
      File::fields(file, filler);
      const std::string text = test::yaml_of(file, round);
      Readout out{.name = "f"};
      File again = read_yaml<File>(text, out);
      ASSERT_TRUE(out.faults.empty()) << File::kind << "\n" << faults_of(out) << text;
      EXPECT_EQ(test::yaml_of(again, round), text);
      // Another order of keys: the same values.
      Readout other{.name = "f"};
      File turned = read_yaml<File>(test::yaml_of(again, round + 3 * 5 * 7 * 8), other);
      EXPECT_EQ(test::yaml_of(turned, round), text);
    }
  });
}

constexpr const char* kPieces[] = {"{",   "}",       "[",     "]", ": ",           "- ",   "&a ",       "*a", "!!binary ", "|\n",
                                   ">\n", "\n---\n", "# ",    "'", "\"",           "? ",   "%YAML 9\n", "\t", "\n  ",      "null",
                                   "~",   ".nan",    "1e999", "-", "\xef\xbb\xbf", "\xff", "<<: *a",    "@",  "`"};

TEST(Yaml, no_bytes_break_the_readers) {
  std::mt19937_64 engine(20261122);
  const auto below = [&](std::size_t n) { return n ? std::size_t(engine() % n) : 0; };
  std::size_t read = 0, refused = 0;
  for_each_kind([&]<class File>() {
    File file;
    test::Filler filler(engine);
    File::fields(file, filler);
    const std::string good = test::yaml_of(file, 0);
    for (int round = 0; round < 400; ++round) {
      std::string text = good;
      for (std::size_t k = 1 + below(5); k-- > 0;) {
        const std::size_t at = below(text.size() + 1);
        switch (below(5)) {
          case 0:
            if (at < text.size()) text[at] = char(engine());
            break;
          case 1:
            text.insert(at, kPieces[below(std::size(kPieces))]);
            break;
          case 2:
            text.erase(at, below(10));
            break;
          case 3:
            text.insert(at, text.substr(below(text.size() + 1), below(80)));
            break;
          default:
            if (below(10) == 0) text.resize(at);
        }
      }
      Readout out{.name = "f"};
      (void)read_yaml<File>(text, out);
      ++(out.faults.empty() ? read : refused);
      for (const Refusal& r : out.faults) {
        EXPECT_FALSE(r.code.empty() || r.message.empty());
        EXPECT_EQ(r.where.substr(0, 1), "f");
        EXPECT_NO_THROW((void)nlohmann::json(r.message + r.where).dump());  // only text comes out
      }
    }
  });
  EXPECT_GT(refused, 1000u);
}

TEST(Yaml, text_that_nests_or_repeats_without_end_is_refused) {
  Readout deep{.name = "f"};
  (void)read_yaml<PartFile>("asbuilt: part/1\nid: " + std::string(200000, '['), deep);
  ASSERT_FALSE(deep.faults.empty());
  EXPECT_EQ(deep.faults[0].code, "input.yaml_syntax");
  std::string text =
      "asbuilt: part/1\nid: p\ncad: a.step\nfeatures:\n  - &f\n    id: a\n    recipe: r\n    edges:\n      near:\n        - &p [0, 0, 0]\n";
  for (int i = 0; i < 2000; ++i) text += "        - *p\n";
  for (int i = 0; i < 1000; ++i) text += "  - *f\n";
  Readout wide{.name = "f"};
  (void)read_yaml<PartFile>(text, wide);
  ASSERT_FALSE(wide.faults.empty());
  EXPECT_EQ(wide.faults[0].code, "input.too_large");
}

TEST(Yaml, every_form_of_a_pose_is_the_same_pose) {
  // 30 degrees about z, then 20 about y, then 10 about x.
  const Eigen::Quaterniond q = quat_from_zyx(rad_from_deg(30), rad_from_deg(20), rad_from_deg(10));
  const Mat3 r = q.toRotationMatrix();
  std::string rows;
  for (int i = 0; i < 3; ++i)
    rows += "[" + shortest_number(r(i, 0)) + ", " + shortest_number(r(i, 1)) + ", " + shortest_number(r(i, 2)) + ", " +
            std::to_string(i + 1) + "], ";
  const std::string quat =
      shortest_number(q.w()) + ", " + shortest_number(q.x()) + ", " + shortest_number(q.y()) + ", " + shortest_number(q.z());
  for (const std::string& form : {"{xyz: [1, 2, 3], quat: [" + quat + "]}", std::string("{xyz: [1, 2, 3], zyx: [30, 20, 10]}"),
                                  std::string("{rpy: [10, 20, 30], xyz: [1, 2, 3]}"), "{matrix: [" + rows + "[0, 0, 0, 1]]}"}) {
    Readout out{.name = "f"};
    const auto file =
        read_yaml<FixtureFile>("asbuilt: fixture/1\nbase_fixture: " + form +
                                   "\nfixture_part: {xyz: [0, 0, 0], quat: [1, 0, 0, 0]}\nplay: {xyz: [1, 1, 1], rpy: [1, free, 2]}\n",
                               out);
    ASSERT_TRUE(out.faults.empty()) << faults_of(out);
    EXPECT_LT((file.base_fixture.p_mm - Vec3(1, 2, 3)).norm(), 1e-12) << form;
    EXPECT_LT(file.base_fixture.q.angularDistance(q), 1e-12) << form;
    EXPECT_TRUE(file.play.rpy_deg[1].is_word);
  }
}

TEST(Yaml, days_are_days) {
  EXPECT_EQ(*day_number("1970-01-01"), 0);
  EXPECT_EQ(*day_number("2026-11-22") - *day_number("2026-10-22"), 31);
  EXPECT_EQ(*day_number("2028-03-01") - *day_number("2028-02-28"), 2);
  EXPECT_EQ(day_number("2026-11-22T08:00:00"), day_number("2026-11-22"));
  for (const char* wrong : {"", "2026", "2026-13-01", "2026-02-29", "22.11.2026", "2026-1-1", "2026-11-22x", "abcd-ef-gh"})
    EXPECT_FALSE(day_number(wrong)) << wrong;
}

TEST(Schema, says_what_the_reader_does) {
  for (const std::string& kind : file_kinds()) {
    const auto schema = nlohmann::json::parse(schema_json(kind));
    EXPECT_EQ(schema["properties"]["asbuilt"]["const"], kind + "/1");
    EXPECT_EQ(schema["additionalProperties"], false) << kind;
    EXPECT_EQ(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
  }
  EXPECT_EQ(schema_json("nothing"), "");
  EXPECT_EQ(schema_table("nothing"), "");
  const auto recipe = nlohmann::json::parse(schema_json("recipe"));
  EXPECT_EQ(recipe["properties"]["edge_break"]["properties"]["width"]["x-unit"], "mm");
  EXPECT_EQ(recipe["properties"]["process"]["enum"].size(), 3u);
  // Taking a required key out of a good file gives exactly that fault.
  std::mt19937_64 engine(3);
  RecipeFile file;
  test::Filler filler(engine);
  RecipeFile::fields(file, filler);
  const std::string good = test::yaml_of(file, 0);
  for (const auto& name : recipe["required"]) {
    std::string text;
    std::istringstream in(good);
    for (std::string line; std::getline(in, line);)
      if (line.compare(0, name.get<std::string>().size() + 1, name.get<std::string>() + ":") != 0) text += line + "\n";
    Readout out{.name = "f"};
    (void)read_yaml<RecipeFile>(text, out);
    ASSERT_EQ(out.faults.size(), 1u) << name << faults_of(out);
    EXPECT_EQ(out.faults[0].code, name == "asbuilt" ? "input.missing_header" : "input.missing_key") << name;
  }
}

/// docs/formats.md: between the marks stands the table of the schema; GOLDEN=write puts it there.
TEST(Docs, tables_and_examples_of_formats_are_true) {
  const fs::path file = "docs/formats.md";
  std::string text = read_text(file);
  ASSERT_FALSE(text.empty()) << file;
  const bool is_written = std::getenv("GOLDEN") && std::string(std::getenv("GOLDEN")) == "write";
  for (const std::string& kind : file_kinds()) {
    const std::string begin = "<!-- fields of " + kind + " -->\n", end = "<!-- end -->";
    const std::size_t at = text.find(begin), stop = text.find(end, at);
    ASSERT_NE(at, std::string::npos) << kind;
    const std::size_t from = at + begin.size();
    if (is_written) text = text.substr(0, from) + schema_table(kind) + text.substr(stop);
    else EXPECT_EQ(text.substr(from, stop - from), schema_table(kind)) << "GOLDEN=write build/dev/bin/test_inputs --gtest_filter=Docs.*";
  }
  if (is_written) std::ofstream(file, std::ios::binary) << text;
  int examples = 0;
  for (std::size_t at = text.find("```yaml\n"); at != std::string::npos; at = text.find("```yaml\n", at + 1)) {
    const std::string example = text.substr(at + 8, text.find("```", at + 8) - at - 8);
    const std::string kind = example.substr(9, example.find('/') - 9);
    Readout out{.name = "docs/formats.md"};
    bool is_known = false;
    for_each_kind([&]<class File>() {
      if (File::kind != kind) return;
      is_known = true;
      (void)read_yaml<File>(example, out);
    });
    EXPECT_TRUE(is_known) << example;
    EXPECT_TRUE(out.faults.empty()) << kind << "\n" << faults_of(out);
    ++examples;
  }
  EXPECT_GE(examples, 8);
  std::set<std::string> codes;
  const std::regex code("\"(input\\.[a-z0-9_]+)\"");
  for (const char* room : {"planner/inputs", "planner/io"})
    for (const auto& e : fs::recursive_directory_iterator(room)) {
      const std::string source = e.is_regular_file() ? read_text(e.path()) : "";
      for (std::sregex_iterator it(source.begin(), source.end(), code), last; it != last; ++it) codes.insert((*it)[1]);
    }
  for (const std::string& c : codes) EXPECT_NE(text.find("`" + c + "`"), std::string::npos) << c << " is not in " << file;
}

}  // namespace
}  // namespace asbuilt
