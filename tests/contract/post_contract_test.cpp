// SPDX-License-Identifier: GPL-3.0-or-later
// Every post of the registry obeys the same laws: what it writes it reads back, the same input gives the same bytes, its own
// lint rules hold, and the dialects of one program replay to one path.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <map>

#include "planner/base/archive.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

/// POST_PROGRAMS sets the number of programs a dialect for the long run.
int programs_count() {
  const char* asked = std::getenv("POST_PROGRAMS");
  return asked ? std::atoi(asked) : 2000;
}

class PostContract : public testing::TestWithParam<Language> {
 protected:
  const Post& post() const { return *find_post(GetParam()); }
  const PostContext context = post_context();
};

TEST_P(PostContract, reads_back_what_it_wrote) {
  const Tolerance tolerance = tolerance_of(post(), context);
  for (int seed = 1; seed <= programs_count(); ++seed) {
    const Program p = random_program(seed, mix_for(post(), {.has_triggers = true}));
    const auto text = post().write(p, context);
    ASSERT_TRUE(text) << "seed " << seed << "\n" << text_of(text.error());
    const auto back = post().read(*text, context);
    ASSERT_TRUE(back) << "seed " << seed << "\n" << text_of(back.error());
    ASSERT_EQ(difference(p, *back, tolerance, prints_in_base(post(), context)), "") << "seed " << seed << "\n" << text->files[0].bytes;
  }
}

TEST_P(PostContract, same_program_same_bytes) {
  for (int seed = 1; seed <= 20; ++seed) {
    const Program p = random_program(seed, mix_for(post()));
    const auto a = post().write(p, context), b = post().write(p, context);
    ASSERT_TRUE(a && b);
    ASSERT_EQ(to_bytes(*a), to_bytes(*b));
  }
}

/// Writing what was read changes nothing: every printed digit is kept.
TEST_P(PostContract, a_second_round_is_byte_equal) {
  for (int seed = 1; seed <= 200; ++seed) {
    Program p = random_program(seed, mix_for(post(), {.has_arcs = false}));
    const auto a = post().write(p, context);
    ASSERT_TRUE(a);
    const auto q = post().read(*a, context);
    ASSERT_TRUE(q);
    const auto b = post().write(*q, context);
    ASSERT_TRUE(b) << text_of(b.error());
    ASSERT_EQ(a->files[0].bytes, b->files[0].bytes) << "seed " << seed;
  }
}

TEST_P(PostContract, its_own_lint_rules_hold) {
  for (int seed = 1; seed <= 100; ++seed) {
    const auto text = post().write(random_program(seed, mix_for(post())), context);
    ASSERT_TRUE(text);
    for (const Check& c : post().lint(*text, context)) ASSERT_TRUE(c.is_passed) << "seed " << seed << " " << c.name << " " << c.where;
  }
}

TEST_P(PostContract, bytes_are_ascii_with_the_controllers_line_end) {
  const auto text = post().write(random_program(7, mix_for(post())), context);
  ASSERT_TRUE(text);
  for (const ProgramFile& f : text->files) {
    const bool is_crlf = GetParam() != Language::ur;
    ASSERT_TRUE(f.bytes.ends_with("\n"));
    for (std::size_t i = 1; i < f.bytes.size(); ++i) ASSERT_TRUE(f.bytes[i] != '\n' || (f.bytes[i - 1] == '\r') == is_crlf);
    for (char c : f.bytes) ASSERT_TRUE((c >= 0x20 && c <= 0x7e) || c == '\r' || c == '\n') << f.name;
    EXPECT_EQ(f.bytes.find("-0.000 "), std::string::npos);
  }
}

/// The machine's options change the text, not what it says.
TEST_P(PostContract, options_say_the_same) {
  const std::vector<std::map<std::string, std::string>> choices = {
      {{"krl.version", "KRC2"}, {"inform.flip", "b_axis"}, {"inform.user_frame", "3"}},
      {{"krl.delivery", "sub"}, {"inform.relative", "yes"}, {"inform.user_frame", "5"}},
      {{"krl.motion", "spline"}, {"krl.tool", "literal"}, {"inform.name_length", "8"}},
  };
  for (const auto& options : choices)
    for (int seed = 1; seed <= 100; ++seed) {
      PostContext other = context;
      for (const auto& [k, v] : options) other.cell.controller.options[k] = v;
      other.cell.controller.speed_unit = SpeedUnit::cm_min;
      other.cell.controller.options["nci.orientation"] = "ypr";
      other.cell.controller.orientation = seed % 2 ? BeckhoffOrientation::euler : BeckhoffOrientation::ypr;
      const Program p = random_program(seed, mix_for(post(), {.has_new_frames = false, .has_splines = false}));
      const auto text = post().write(p, other);
      ASSERT_TRUE(text) << text_of(text.error());
      const auto back = post().read(*text, other);
      ASSERT_TRUE(back) << text_of(back.error()) << text->files[0].bytes;
      ASSERT_EQ(difference(p, *back, tolerance_of(post(), other), prints_in_base(post(), other)), "") << text->files[0].bytes;
      for (const Check& c : post().lint(*text, other)) ASSERT_TRUE(c.is_passed) << c.name << " " << c.where;
    }
}

TEST(PostInform, position_levels_round_no_more_than_planned) {
  PostContext context = post_context();
  context.cell.controller.options["inform.position_levels"] = "0.5 2 5";
  const Post& post = *find_post(Language::inform);
  int rounded = 0;
  for (int seed = 1; seed <= 50; ++seed) {
    const Program p = random_program(seed, {.has_arcs = false});
    const auto text = post.write(p, context);
    ASSERT_TRUE(text);
    EXPECT_EQ(text->files[0].bytes.find("CR="), std::string::npos);
    const auto back = post.read(*text, context);
    ASSERT_TRUE(back) << text_of(back.error());
    std::vector<const MoveLinear*> a, b;
    for (const Instruction& i : p.instructions)
      if (const auto* m = std::get_if<MoveLinear>(&i)) a.push_back(m);
    for (const Instruction& i : back->instructions)
      if (const auto* m = std::get_if<MoveLinear>(&i)) b.push_back(m);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_LE(b[i]->is_exact ? 0 : b[i]->blend_mm, a[i]->is_exact ? 0 : a[i]->blend_mm);
      rounded += !b[i]->is_exact;
    }
  }
  EXPECT_GT(rounded, 50);
}

/// A program of 5000 points in 200-line modules says the same as the unsplit one.
TEST_P(PostContract, split_programs_join_to_the_same_motions) {
  PostContext small = context;
  small.cell.controller.options["krl.max_lines"] = small.cell.controller.options["inform.max_lines"] = "200";
  const Program p = random_program(11, mix_for(post(), {.sections = 40, .points = 60}));
  const auto text = post().write(p, small);
  ASSERT_TRUE(text) << text_of(text.error());
  EXPECT_GT(text->files.size(), GetParam() == Language::krl || GetParam() == Language::inform ? 10u : 0u);
  const auto back = post().read(*text, small);
  ASSERT_TRUE(back) << text_of(back.error());
  EXPECT_EQ(difference(p, *back, tolerance_of(post(), small), prints_in_base(post(), small)), "");
}

/// 100000 points: written, read, linted; the time is printed, the content compared.
TEST_P(PostContract, a_hundred_thousand_points) {
  PostContext big = context;
  const Program p = random_program(17, mix_for(post(), {.sections = 200, .points = 500, .has_events = false, .has_two_tools = false}));
  const auto now = [] { return std::chrono::steady_clock::now(); };
  const auto ms = [](auto d) { return std::chrono::duration<double, std::milli>(d).count(); };
  const auto t0 = now();
  const auto text = post().write(p, big);
  const auto t1 = now();
  ASSERT_TRUE(text) << text_of(text.error());
  const auto back = post().read(*text, big);
  const auto t2 = now();
  ASSERT_TRUE(back) << text_of(back.error());
  EXPECT_EQ(difference(p, *back, tolerance_of(post(), big), prints_in_base(post(), big)), "");
  const auto t3 = now();
  for (const Check& c : post().lint(*text, big)) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
  std::size_t bytes = 0;
  for (const ProgramFile& f : text->files) bytes += f.bytes.size();
  std::printf("%s: %.1f MB, write %.0f ms, read %.0f ms, lint %.0f ms\n", std::string(name_of(GetParam())).c_str(), static_cast<double>(bytes) / 1e6, ms(t1 - t0),
              ms(t2 - t1), ms(now() - t3));
}

INSTANTIATE_TEST_SUITE_P(Registry, PostContract, testing::ValuesIn([] {
                           std::vector<Language> all;
                           for (const Post& p : posts()) all.push_back(p.language);
                           return all;
                         }()),
                         [](const auto& info) { return std::string(name_of(info.param)); });

/// One program in all dialects: the same points in base (each within its own half digit), the same feed and events.
TEST(PostAgreement, dialects_replay_to_one_path) {
  const PostContext context = post_context();
  Tolerance t;
  t.position_mm = 0.001 * std::sqrt(3.0) + 1e-9;  // each of the two is within half a digit on every axis of its own frame
  t.angle_rad = 6e-6, t.speed_mm_s = 0.0501 + 0.0006, t.speed_ratio = 0.0051, t.blend_mm = 0.0506;
  t.joint_rad.fill(rad_from_deg(0.0007));
  t.is_via_printed = false;
  t.rpm = 4;
  for (int seed = 1; seed <= 100; ++seed) {
    const bool is_upright = seed % 2 == 0;  // what every dialect can say; the others say any turn
    const Program p = random_program(seed, {.has_equipment = !is_upright, .has_splines = false, .is_upright = is_upright});
    std::vector<Program> read;
    t.is_rounding_kept = !is_upright;
    for (const Post& post : posts()) {
      if (!is_upright && (post.arcs == Post::Arcs::in_planes_of_base || !post.has_equipment)) continue;
      const auto text = post.write(p, context);
      ASSERT_TRUE(text);
      const auto back = post.read(*text, context);
      ASSERT_TRUE(back);
      read.push_back(*back);
    }
    for (std::size_t i = 1; i < read.size(); ++i) ASSERT_EQ(difference(read[0], read[i], t, true), "") << "seed " << seed;
  }
}

}  // namespace
}  // namespace asbuilt
