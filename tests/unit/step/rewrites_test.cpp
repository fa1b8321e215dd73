// SPDX-License-Identifier: GPL-3.0-or-later
// A part stays what it is, whatever way its file is written: made parts and real files, each rewritten ten ways. All files: study_rewrites.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "rewrite_check.hpp"
#include "step_text.hpp"
#include "variants.hpp"

namespace asbuilt {
namespace {

void expect_same(const std::string& text, const std::string& name) {
  const test::PartSums before = test::part_sums(text, 1);
  int ways = 0;
  for (const test::Rewrite& r : test::rewrites()) {
    const std::string other = r.make(text);
    if (other.empty()) continue;
    EXPECT_NE(other, text);
    EXPECT_EQ(test::difference_of(before, test::part_sums(other, r.scale)), "") << name << ", " << r.name;
    ++ways;
  }
  EXPECT_GE(ways, 8) << name;
}

TEST(Rewrites, MadePartsStayThemselves) {
  for (const auto& [wall, has_seam] : {std::pair{test::Drum::Wall::cylinder, false},
                                       {test::Drum::Wall::rational, true},
                                       {test::Drum::Wall::revolution, false},
                                       {test::Drum::Wall::extrusion, true}}) {
    test::StepText s;
    test::Drum d;
    d.wall = wall, d.has_seam = has_seam, d.no_ref_direction = wall == test::Drum::Wall::cylinder;
    int solid = 0;
    test::add_drum(s, d, 8, 25, solid);
    s.part({solid, test::add_box(s, {50, 0, 0}, {80, 20, 10})});
    expect_same(s.text(), "drum");
  }
}

TEST(Rewrites, RealFilesStayThemselves) {
  const std::filesystem::path root = "../shared/data/step";
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "no ../shared/data/step here";
  for (const std::string name :
       {"zoo_spatula.step", "creo8_top_cover_logo.stp", "atf_motor_holder_so101_base_asm.step", "sw2007_foot_voids.step",
        "stdev18_cube_hole.step", "fc_hex_nut_m8_hyperbola.step", "onshape_wrist_interface.step"}) {
    std::ifstream in(root / name, std::ios::binary);
    expect_same({std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()}, name);
  }
}

// The rewriting itself has to be able to tell: a part that is another one is found out.
TEST(Rewrites, ADifferentPartIsFoundOut) {
  test::StepText a, b;
  a.part({test::add_box(a, {0, 0, 0}, {30, 20, 10})});
  b.part({test::add_box(b, {0, 0, 0}, {30, 20, 10.01})});
  EXPECT_NE(test::difference_of(test::part_sums(a.text(), 1), test::part_sums(b.text(), 1)), "");
}

}  // namespace
}  // namespace asbuilt
