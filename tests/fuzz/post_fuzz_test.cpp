// SPDX-License-Identifier: GPL-3.0-or-later
// No bytes break a reader or a lint rule, no list of moves breaks a writer: they answer or refuse. A few seconds by default;
// POST_FUZZ_ROUNDS sets the number of mutations a dialect for the long run.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <limits>

#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

int rounds(int otherwise) {
  const char* asked = std::getenv("POST_FUZZ_ROUNDS");
  return asked ? std::atoi(asked) : otherwise;
}

std::string mutated(std::string s, const std::string& other, Random& r) {
  static const char* pieces[] = {"1e308", "-0", "99999999999999999999", "{", "}", "[", "]", "(", ")", ";", "%", "#", "=", ",", "\r\n", "\n", "NaN", "C00000",
                                 "PTP ", "LIN ", "CIRC ", "END", "ENDDAT", "DEF A( )", "A( )", "MOVC C00001 V=1 PL=0", "CALL JOB:A", "///", "%L A", "LL A", "M17", "G02 ",
                                 "#CS ON", "X", "TOOL_DATA[", "WAIT FOR ABS(", "\xff", std::string_view("\0", 1).data(), "'", "\\"};
  const int n = 1 + static_cast<int>(r.below(6));
  for (int k = 0; k < n && !s.empty(); ++k) {
    const std::size_t at = r.below(s.size());
    switch (r.below(7)) {
      case 0: s[at] = static_cast<char>(r.below(256)); break;
      case 1: s.erase(at, r.below(20)); break;
      case 2: s.insert(at, pieces[r.below(std::size(pieces))]); break;
      case 3: s.insert(at, s.substr(r.below(s.size()), r.below(80))); break;
      case 4: s.resize(at); break;
      case 5: s.insert(at, other.substr(r.below(other.size()), r.below(200))); break;
      default: {  // a line elsewhere
        const std::size_t a = s.find('\n', at);
        if (a == std::string::npos) break;
        const std::size_t b = s.find('\n', a + 1);
        if (b == std::string::npos) break;
        const std::string line = s.substr(a + 1, b - a);
        s.erase(a + 1, b - a);
        s.insert(r.below(s.size() + 1), line);
      }
    }
  }
  return s;
}

/// POST_FUZZ_SECONDS: by the clock, for each reader; POST_FUZZ_ONLY names one dialect.
TEST(PostFuzz, readers_and_rules_take_any_bytes) {
  const PostContext context = post_context();
  const char* asked = std::getenv("POST_FUZZ_SECONDS");
  const char* only = std::getenv("POST_FUZZ_ONLY");
  const double seconds = asked ? std::atof(asked) : 0;
  for (const Post& post : posts()) {
    if (only && name_of(post.language) != only) continue;
    Random r = Random::stream(asked ? 20261124 : 20261122, name_of(post.language));
    int accepted = 0;
    const int count = asked ? 2000000000 : rounds(4000);
    const auto start = std::chrono::steady_clock::now();
    int n = 0;
    for (; n < count; ++n) {
      if (asked && n % 100 == 0 && std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() > seconds) break;
      PostContext small = context;
      if (n % 3 == 0) small.cell.controller.options["krl.max_lines"] = small.cell.controller.options["inform.max_lines"] = "50";
      PostContext given = context;
      if (n % 5 == 1)  // with what is checked on the machine
        for (PostContext* c : {&small, &given})
          for (const auto& [key, value] : {std::pair{"krl.serial_number", "860123"}, {"krl.kernel", "V8.3"}, {"beckhoff.tool_data", "0 1 2 5 4 3"}}) c->cell.controller.options[key] = value;
      Program p = random_program(1 + n % 40, mix_for(post, {.sections = 2, .points = 6, .has_triggers = true}));
      if (n % 2 == 0)  // and stated in the header
        p.header.insert(p.header.end(), {"tool 1 cone-90: 12.346 -7.654 350.111 mm, ZYX 17.1887 -11.4592 5.7296 deg", "frame part: 1000.000 200.000 500.500 mm, ZYX 40.0000 2.0000 0.0000 deg",
                                         "controller " + std::string(name_of(post.language)) + ": KRC4, V in mm/s, A B C by cba, kinematic 45", "not run on a controller"});
      const auto text = post.write(p, small);
      ASSERT_TRUE(text);
      ProgramText t = *text;
      if (post.language == Language::inform && n % 3 == 1)
        t.files.push_back({"TOOL.CND", "//TOOL 1\r\n///NAME CONE\r\n12.346,-7.654,350.111,5.7296,-11.4592,17.1887\r\n0.000,0.000,120.000\r\n12.500\r\n0.000,0.000,0.000\r\n"});
      ProgramFile& f = t.files[r.below(t.files.size())];
      f.bytes = mutated(f.bytes, t.files[0].bytes, r);
      if (r.below(50) == 0) f.name = "x";
      if (r.below(50) == 0) t.files.pop_back();
      const auto back = post.read(t, given);
      if (back) {
        ++accepted;
        const auto again = post.write(*back, given);  // what is read can be judged like any program: written or refused
        (void)again;
      } else {
        ASSERT_FALSE(back.error().empty());
        ASSERT_FALSE(back.error().front().code.empty());
      }
      if (n % 4 == 0) {
        ASSERT_FALSE(post.lint(t, given).empty());
      }
    }
    std::printf("%s: %d mutations, %d still read\n", std::string(name_of(post.language)).c_str(), n, accepted);
  }
}

TEST(PostFuzz, empty_and_odd_files) {
  const PostContext context = post_context();
  for (const Post& post : posts()) {
    EXPECT_FALSE(post.read({post.language, {}}, context));
    EXPECT_FALSE(post.lint({post.language, {}}, context).empty());
    for (const char* name : {"A.src", "A.dat", "A.JBI", "UFRAME.CND", "A.nc", "", "A"})
      for (const std::string& bytes : {std::string(), std::string("\n"), std::string("\r\n"), std::string(100000, '('), std::string(100000, '\n'), std::string(3, '\0'), std::string("%L A\nLL A\nM17\n%B\nLL A\nM30\n"),
                                       std::string("DEF A( )\nA( )\nEND\n"), std::string("DEF A( )\nB( )\nEND\nDEF B( )\nA( )\nEND\n")}) {
        EXPECT_FALSE(post.read({post.language, {{name, bytes}}}, context)) << name << " " << bytes.substr(0, 40);
        EXPECT_FALSE(post.lint({post.language, {{name, bytes}}}, context).empty());
      }
  }
}

TEST(PostFuzz, writers_take_any_list_of_moves) {
  const PostContext context = post_context();
  const double odd[] = {0, -0.0, 1e-300, 1e300, -1e9, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 3.999, 1e-7, 720};
  for (const Post& post : posts()) {
    Random r = Random::stream(7, name_of(post.language));
    int written = 0;
    const int count = rounds(2000);
    for (int n = 0; n < count; ++n) {
      Program p = random_program(1 + n % 50, mix_for(post, {.sections = 2, .points = 5, .has_triggers = true}));
      const int edits = 1 + static_cast<int>(r.below(3));
      for (int k = 0; k < edits && !p.instructions.empty(); ++k) {
        const std::size_t at = r.below(p.instructions.size());
        const double v = odd[r.below(std::size(odd))];
        switch (r.below(6)) {
          case 0: p.instructions.erase(p.instructions.begin() + static_cast<long>(at)); break;
          case 1: p.instructions.insert(p.instructions.begin() + static_cast<long>(at), p.instructions[r.below(p.instructions.size())]); break;
          case 2: std::swap(p.instructions[at], p.instructions[r.below(p.instructions.size())]); break;
          case 3:
            if (auto* m = std::get_if<MoveLinear>(&p.instructions[at])) m->speed_mm_s = v, m->blend_mm = v;
            if (auto* m = std::get_if<MoveJoint>(&p.instructions[at])) m->q_rad[r.below(6)] = v;
            break;
          case 4:
            if (auto* m = std::get_if<MoveLinear>(&p.instructions[at])) m->T_base_tool.p_mm[static_cast<int>(r.below(3))] = v;
            if (auto* m = std::get_if<SpindleOn>(&p.instructions[at])) m->rpm = v;
            if (auto* m = std::get_if<SetTool>(&p.instructions[at])) m->number = static_cast<int>(r.below(5));
            break;
          default:
            if (auto* m = std::get_if<MoveLinear>(&p.instructions[at])) m->T_base_tool.q.coeffs()[static_cast<int>(r.below(4))] = v;
            if (auto* m = std::get_if<Wait>(&p.instructions[at])) m->time_s = v;
        }
      }
      const auto text = post.write(p, context);
      if (!text) continue;
      ++written;
      const auto back = post.read(*text, context);  // what is written is never a lie
      ASSERT_TRUE(back) << text_of(back.error()) << text->files[0].bytes;
      ASSERT_EQ(difference(p, *back, tolerance_of(post, context), prints_in_base(post, context)), "") << n << "\n" << text->files[0].bytes;
    }
    std::printf("%s: %d lists, %d written\n", std::string(name_of(post.language)).c_str(), count, written);
  }
}

}  // namespace
}  // namespace asbuilt
