// SPDX-License-Identifier: GPL-3.0-or-later
// Every lint rule has a text that breaks it: an emitted program with one edit.
#include <gtest/gtest.h>

#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

/// A short program with every kind of line: joint, straight, rounded, arc, spindle, output, wait, remark.
Program sample() {
  const PostContext c = post_context();
  Program p;
  p.name = "SAMPLE";
  p.header = {"item sample"};
  auto& out = p.instructions;
  const Pose<frame::Base, frame::Work> T_base_work(quat_from_zyx(0.5, 0, 0), Vec3(1000, 200, 500));
  const auto at = [&](double x, double y, double z) { return T_base_work * Pose<frame::Work, frame::Tool>(quat_from_zyx(0, 0, 3.0), Vec3(x, y, z)); };
  out.emplace_back(SetTool{1, c.cell.tools[0].T_flange_tool});
  out.emplace_back(SetFrame{T_base_work});
  out.emplace_back(MoveJoint{c.cell.robot.home_rad, 0.5});
  out.emplace_back(Comment{"edge one"});
  out.emplace_back(SpindleOn{12000});
  out.emplace_back(Wait{1.5});
  out.emplace_back(MoveLinear{at(0, 0, 50), 100, true, 0});
  out.emplace_back(MoveLinear{at(0, 0, 1.5), 20, true, 0});
  out.emplace_back(MoveLinear{at(10, 0, 0), 10, false, 0.5});
  out.emplace_back(SetOutput{7, true});
  out.emplace_back(MoveLinear{at(20, 0, 0), 10, false, 0.5});
  out.emplace_back(MoveLinear{at(30, 0, 0), 10, true, 0});
  out.emplace_back(MoveCircular{at(30 + 10 * std::sin(0.5), 10 - 10 * std::cos(0.5), 0), at(40, 10, 0), 10, true, 0});
  out.emplace_back(MoveLinear{at(40, 10, 50), 100, true, 0});
  out.emplace_back(SpindleOff{});
  out.emplace_back(MoveJoint{c.cell.robot.home_rad, 0.5});
  return p;
}

struct Edit {
  Language language;
  const char* rule;
  const char* from;
  const char* to;     // "" removes
  const char* file = "";  // extension; empty: the first file
  const char* option = "";
};

const Edit kEdits[] = {
    {Language::krl, "G-00", "LIN {X 0.000", "LINN {X 0.000"},
    {Language::krl, "G-01", "edge one", "edge \xc3\xbc"},
    {Language::krl, "G-01", "END\r\n", "END"},
    {Language::krl, "G-01", "  $ADVANCE=3\r\n", "  $ADVANCE=3\n"},
    {Language::krl, "G-01", "  $ADVANCE=3\r\n", "  $ADVANCE=3 \r\n"},
    {Language::krl, "G-02", "X 0.000", "X -0.000"},
    {Language::krl, "G-02", "X 10.000", "X 1.0e1"},
    {Language::krl, "G-03", "A5 90.0000", "A5 130.0000"},
    {Language::krl, "G-05", "  $OUT[5]=FALSE\r\n", ""},
    {Language::krl, "G-02", "A6 0.0000", "A6 .00000"},
    {Language::krl, "G-02", "A6 0.0000", "A6 00.000"},
    {Language::krl, "G-05", "$ANOUT[1]=0.00000", "$ANOUT[1]=0.00001"},
    {Language::krl, "G-10", "  $OUT[5]=TRUE\r\n", ""},
    {Language::inform, "G-05", "AOUT AO#(1) 0.000", "AOUT AO#(1) 0.001"},
    {Language::inform, "G-10", "DOUT OT#(5) ON\r\n", ""},
    {Language::krl, "G-06", "$VEL.CP=0.100000", "$VEL.CP=5.000000"},
    {Language::krl, "G-09", "  ;ENDFOLD (PROGRAM)", "  MISSING( )\r\n  ;ENDFOLD (PROGRAM)"},
    {Language::krl, "K-01", "DEF SAMPLE( )", "DEF OTHER( )"},
    {Language::krl, "K-01", "DEFDAT SAMPLE", "DEFDAT OTHER", ".dat"},
    {Language::krl, "K-02", "&ACCESS RVP\r\n", ""},
    {Language::krl, "K-02", "  ;ENDFOLD (PROGRAM)\r\n", ""},
    {Language::krl, "K-02", "  ;FOLD PROGRAM\r\n", "  ;FOLD PROGRAM\r\n  IF $MOVE_BCO THEN\r\n"},
    {Language::krl, "K-02", "  ;FOLD PROGRAM\r\n", "  ;FOLD PROGRAM\r\n  ELSEIF\r\n"},
    {Language::krl, "K-03", "  ;FOLD PROGRAM\r\n", "  ;FOLD PROGRAM\r\n  DECL INT I\r\n"},
    {Language::krl, "K-04", "  BAS (#INITMOV,0)\r\n", ""},
    {Language::krl, "K-05", "  PTP {A1 0.0000", "  PTP $AXIS_ACT\r\n  PTP {A1 0.0000"},
    {Language::krl, "K-06", "  $IPO_MODE=#BASE\r\n", ""},
    {Language::krl, "K-06", "TOOL_DATA[1]\r\n", "TOOL_DATA[17]\r\n"},
    {Language::krl, "K-06", "-EXPECTED_TOOL_1.Y", "-EXPECTED_TOOL_1.Z"},
    {Language::krl, "K-06", ".Z)<0.010", ".Z)<0.011"},
    {Language::krl, "K-06", "  WAIT FOR ABS(TOOL_DATA[1].B-EXPECTED_TOOL_1.B)<0.0100\r\n", ""},
    {Language::krl, "K-06", "TOOL_1={X 12.346", "TOOL_1={X 12.349", ".dat"},
    {Language::krl, "K-02", "&REL 1\r\n", ""},
    {Language::krl, "K-07", "$VEL.CP=0.010000", "$VEL.CP=10.000000"},
    {Language::krl, "K-07", "$VEL.CP=0.010000", "$VEL.CP=0.000000"},
    {Language::krl, "K-07", "#VEL_PTP,50", "#VEL_PTP,101"},
    {Language::krl, "K-07", "$ADVANCE=3", "$ADVANCE=6"},
    {Language::krl, "K-07", "  $ADVANCE=3\r\n", "  $ADVANCE=3\r\n  $VEL_AXIS[7]=50\r\n"},
    {Language::krl, "K-08", "$APO.CDIS=0.500", "$APO.CDIS=-0.500"},
    {Language::krl, "K-08", " C_DIS", " C_PTP"},
    {Language::krl, "K-09", "LIN {X 0.000", "LIN {S 2,T 2,X 0.000"},
    {Language::krl, "K-09", "  PTP {A1 0.0000,A2 -100.0000,A3 100.0000,A4 0.0000,A5 90.0000,A6 0.0000}", "  PTP {X 1.0,Y 1.0,Z 1.0,A 1.0,B 1.0,C 1.0,S 6,T 2}"},
    {Language::krl, "K-10", "  TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[7]=TRUE", "  $OUT[7]=TRUE"},
    {Language::krl, "K-11", "DISTANCE=0", "DISTANCE=2"},
    {Language::krl, "K-11", "DO $OUT[7]=TRUE", "DO $OUT[7]=TRUE PRIO=3"},
    {Language::krl, "K-12", "CIRC {X 34.794,Y 1.224", "CIRC {X 30.000,Y 0.000"},
    {Language::krl, "K-13", "  ; edge one", "  ; edge one, and then a remark that goes on and on and on and on and on and on and on and on and on and on and on and on and "
                             "on and on and on and on and on and on and on and on and on and on and on and on and on and on and on and on and on and on"},
    {Language::krl, "K-14", "A6 0.0000}", "A6 0.0000,E1 0.0}"},
    {Language::krl, "K-15", "LIN {X 0.000", "SLIN {X 0.000", "", "krl.version=KRC2"},
    {Language::krl, "K-16", "  ;FOLD PROGRAM", "  ;FOLD PTP P1;%{PE}%R 5.6"},

    {Language::inform, "I-01", "/JOB\r\n", " /JOB\r\n"},
    {Language::inform, "I-01", "END\r\n", "END"},
    {Language::inform, "I-01", "NOP\r\n", "NOP\n"},
    {Language::inform, "I-02", "//NAME SAMPLE", "//NAME OTHER"},
    {Language::inform, "I-02", "//NAME SAMPLE", "//NAME sample"},
    {Language::inform, "I-02", "//POS\r\n", "//POS\r\n//POS\r\n"},
    {Language::inform, "I-03", "///NPOS 1", "///NPOS 2"},
    {Language::inform, "I-03", "C00003=", "C00004="},
    {Language::inform, "I-03", "MOVL C00003", "MOVL C00004"},
    {Language::inform, "I-04", "C00000=0", "C00000=0.5"},
    {Language::inform, "I-04", "C00000=0,", "C00000=0,0,0,"},
    {Language::inform, "I-05", "///RCONF 0,", "///RCONF -1,"},
    {Language::inform, "I-05", "///RCONF 0,", "///RCONF "},
    {Language::inform, "I-06", "///TOOL 1", "///TOOL 9"},
    {Language::inform, "I-06", "///POSTYPE BASE", "///POSTYPE USER"},
    {Language::inform, "I-07", "///ATTR SC,RW", "///ATTR SC,RW,RJ"},
    {Language::inform, "I-08", "V=100.0", "V=2000.0"},
    {Language::inform, "I-08", "VJ=50.00", "VJ=150.00"},
    {Language::inform, "I-08", " PL=0", " PL=9"},
    {Language::inform, "I-09", "MOVC C00006", "MOVL C00006"},
    {Language::inform, "I-10", "C00000=0,", "C00000=999999,"},
    {Language::inform, "I-11", "NOP\r\n", "NOP\r\nNOP\r\n"},
    {Language::inform, "I-11", "'edge one", "'edge one and a remark that is too long for the pendant"},
    {Language::inform, "I-12", "T=1.50", "T=700.00"},
    {Language::inform, "I-12", "T=1.50", "T=1.505"},
    {Language::inform, "I-13", "TIMER", "ARCON ASF#(1)\r\nTIMER"},
    {Language::inform, "I-14", "TIMER", "CALL JOB:MISSING\r\nTIMER"},
    {Language::inform, "I-16", "MOVJ C00000 VJ=50.00 PL=0", "MOVJ C00000 VJ=50.00 PL=1"},
    {Language::inform, "I-16", "DOUT OT#(7)", "DOUT OT#(9999)"},
    {Language::inform, "I-17", "///DATE 2026/11/22", "///DATE 2026/11/23"},

    {Language::beckhoff, "G-02", "Y0.000", "Y.000"},
    {Language::beckhoff, "G-02", "Y0.000", "Y00.000"},
    {Language::krl, "K-02", "&REL 1", "&REL 1.5"},
    {Language::beckhoff, "B-01", "G90 G71 G94 G17", "%SECOND\r\nG90 G71 G94 G17"},
    {Language::beckhoff, "B-04", "#TRAFO OFF", ";"},
    {Language::beckhoff, "B-04", "#CS OFF ALL", ";"},
    {Language::beckhoff, "B-04", "#KIN ID [45]", ";"},
    {Language::beckhoff, "B-14", " G53", ""},
    {Language::beckhoff, "B-14", " G40", ""},
    {Language::beckhoff, "B-14", " G162", ""},
    {Language::beckhoff, "B-01", "M05", "M05 &"},
    {Language::beckhoff, "B-02", "; edge one", "; edge {one}"},
    {Language::beckhoff, "B-02", "M05", "(M05"},
    {Language::beckhoff, "B-03", "#CS OFF\r\n", "#CS OFF M05\r\n"},
    {Language::beckhoff, "B-03", "#CS ON [1]", "#CS ON [1] F100"},
    {Language::beckhoff, "B-03", "#TRAFO ON\r\n", "#TRAFO OFF\r\n"},
    {Language::beckhoff, "B-04", "M30", "#TRAFO ON\r\nM30"},
    {Language::beckhoff, "B-05", " F6000.00", ""},
    {Language::beckhoff, "B-05", "G94", "G93"},
    {Language::beckhoff, "B-06", " A0.0000 B0.0000 C-8.1127 F6000.00", " A0.0000 B0.0000 F6000.00"},
    {Language::beckhoff, "B-06", "X0.000 Y0.000 Z-1.500 A0.0000 B0.0000 C-8.1127", "X0.000 Y0.000 Z-1.500 A0.0000 B0.0000 C-198.1127"},
    {Language::beckhoff, "B-06", "G01 X0.000 Y0.000 Z-50.000 A0.0000 B0.0000 C-8.1127", "G01 X0.000 Y0.000 Z-50.000 A0.0000 B0.0000 C-178.1127"},
    {Language::beckhoff, "B-07", " F6000.00", " IS2 F6000.00"},
    {Language::beckhoff, "B-08", "G17 G02 X40.000", "G17 G02 X40.100"},
    {Language::beckhoff, "B-09", "N30 ", "N15 "},
    {Language::beckhoff, "B-10", "M30\r\n", ""},
    {Language::beckhoff, "B-10", "M05", "LL MISSING"},
    {Language::beckhoff, "B-11", "M05", "P1=5"},
    {Language::beckhoff, "B-11", "M05", "$IF V.L.X > 1"},
    {Language::beckhoff, "B-12", "S12000 M03", "M03"},
    {Language::beckhoff, "B-12", "M05", "S0 M05"},
    {Language::beckhoff, "B-12", "T1 D1", "D1"},
    {Language::beckhoff, "B-09", "N10 G90", "G90"},
    {Language::beckhoff, "B-14", "G90 G71", "G71"},
    {Language::beckhoff, "B-14", "G90 G71", "G91 G71"},
};

const Edit kEditsOfNci[] = {
    {Language::nci, "G-00", "N20 M41", "N20 M77"},
    {Language::nci, "B-02", "M05", "(M05"},
    {Language::nci, "B-04", "S12000 M03", "M41"},
    {Language::nci, "B-04", "M30", "M40\r\nM30"},
    {Language::nci, "B-05", " F6000.00", ""},
    {Language::nci, "B-06", " Q3=171.8873 F6000.00", " F6000.00"},
    {Language::nci, "B-06", " Q3=171.8873 F6000.00", " Q3=-171.8873 F6000.00"},
    {Language::nci, "B-06", " Q3=171.8873 F6000.00", " Q3=188.8873 F6000.00"},
    {Language::nci, "B-08", "G17 G03 X", "G17 G03 X1"},
    {Language::nci, "B-09", "N30 ", "N15 "},
    {Language::nci, "B-09", "N10 G90", "G90"},
    {Language::nci, "B-10", "M30\r\n", ""},
    {Language::nci, "B-12", "S12000 M03", "M03"},
    {Language::nci, "B-12", "M05", "S0 M05"},
    {Language::nci, "B-12", "T1 D1", "D1"},
    {Language::nci, "B-13", "M05", "#TRAFO OFF"},
    {Language::nci, "B-13", "M05", "$IF R1"},
    {Language::nci, "B-13", "S12000 M03", "S12000  M03"},
    {Language::nci, "B-13", "(edge one)", "(edge (one))"},
    {Language::nci, "B-13", " Q3=171.8873 F6000.00", " Q3=171.8873 Q6=1 F6000.00"},
    {Language::nci, "B-14", "G90 G71", "G71"},
    {Language::nci, "B-14", "G90 G71", "G91 G71"},
};
const Edit kEditsOfUr[] = {
    {Language::ur, "U-01", "end\n", "end\n  sleep(1.000)\n"},
    {Language::ur, "U-02", "def SAMPLE", "def OTHER"},
    {Language::ur, "U-03", "  movej(", "  movel(p[0.1, 0.1, 0.1, 0, 0, 0], a=1, v=0.1, r=0)\n  movej("},
    {Language::ur, "U-04", "r=0.000500)\n  set", "r=0.000500)\n  sleep(1.000)\n  set"},
    {Language::ur, "U-05", "a=1.200", "a=100.000"},
    {Language::ur, "U-05", "v=0.100000", "v=9.100000"},
};
std::vector<Edit> all_edits() {
  std::vector<Edit> all(std::begin(kEdits), std::end(kEdits));
  all.insert(all.end(), std::begin(kEditsOfNci), std::end(kEditsOfNci));
  all.insert(all.end(), std::begin(kEditsOfUr), std::end(kEditsOfUr));
  return all;
}

TEST(PostLint, emitted_sample_breaks_no_rule) {
  for (const Post& post : posts()) {
    const auto text = post.write(sample(), post_context());
    ASSERT_TRUE(text) << text_of(text.error());
    for (const Check& c : post.lint(*text, post_context())) EXPECT_TRUE(c.is_passed && c.measured == 0) << c.name << " " << c.where;
  }
}

TEST(PostLint, every_edit_breaks_its_rule) {
  for (const Edit& e : all_edits()) {
    PostContext context = post_context();
    if (std::string_view o = e.option; !o.empty()) context.cell.controller.options[std::string(o.substr(0, o.find('=')))] = o.substr(o.find('=') + 1);
    const Post& post = *find_post(e.language);
    auto text = post.write(sample(), context);
    ASSERT_TRUE(text);
    ProgramFile* file = &text->files[0];
    for (ProgramFile& f : text->files)
      if (*e.file && f.name.ends_with(e.file)) file = &f;
    const std::size_t at = file->bytes.find(e.from);
    if (at == std::string::npos) {
      ADD_FAILURE() << e.rule << ": \"" << e.from << "\" is not in\n" << file->bytes;
      continue;
    }
    file->bytes.replace(at, std::string_view(e.from).size(), e.to);
    const Check* found = nullptr;
    const auto checks = post.lint(*text, context);
    for (const Check& c : checks)
      if (c.name == std::string("lint.") + e.rule) found = &c;
    ASSERT_NE(found, nullptr) << e.rule;
    EXPECT_GT(found->measured, 0) << name_of(e.language) << " " << e.rule << ": \"" << e.from << "\" -> \"" << e.to << "\" is not seen";
    const std::string_view rule = e.rule;
    const bool is_warning = rule == "K-13" || rule == "G-07" || rule == "I-15" || rule == "I-17" || rule == "G-08";
    EXPECT_EQ(found->is_passed, is_warning) << e.rule;
  }
}

/// No rule without a case that breaks it.
TEST(PostLint, every_rule_has_its_edit) {
  for (const Post& post : posts()) {
    const auto text = post.write(sample(), post_context());
    for (const Check& c : post.lint(*text, post_context())) {
      const std::string rule = c.name.substr(5);
      bool has_edit = rule == "G-04" || (rule >= "G-14" && rule <= "G-17") || rule == "G-07" || rule == "G-08" || rule == "G-10" || rule == "I-15";  // below, and in preamble_test.cpp
      for (const Edit& e : all_edits()) has_edit |= rule == e.rule;
      EXPECT_TRUE(has_edit) << rule;
    }
  }
}

const Check& check_of(const std::vector<Check>& checks, std::string_view name) {
  for (const Check& c : checks)
    if (c.name == name) return c;
  throw Bug("no such check");
}

TEST(PostLint, warns_of_points_too_close) {
  Program p = sample();
  p.instructions.insert(p.instructions.begin() + 8, p.instructions[7]);
  for (const Post& post : posts()) {
    const auto text = post.write(p, post_context());
    ASSERT_TRUE(text);
    const auto checks = post.lint(*text, post_context());
    EXPECT_EQ(check_of(checks, "lint.G-07").measured, 1);
    EXPECT_TRUE(check_of(checks, "lint.G-07").is_passed);
  }
}

TEST(PostLint, spindle_before_the_first_motion_is_an_error) {
  Program p = sample();
  p.instructions.insert(p.instructions.begin() + 2, SpindleOn{5000});
  for (const Post& post : posts()) {
    const auto text = post.write(p, post_context());
    ASSERT_TRUE(text) << text_of(text.error());
    EXPECT_FALSE(check_of(post.lint(*text, post_context()), "lint.G-10").is_passed) << name_of(post.language);
  }
}

TEST(PostLint, modules_that_nobody_calls_are_named) {
  const Post& post = *find_post(Language::krl);
  auto text = post.write(sample(), post_context());
  text->files.push_back({"LOOSE.src", "&ACCESS RVP\r\n&REL 1\r\nDEF LOOSE( )\r\nEND\r\n"});
  EXPECT_EQ(check_of(post.lint(*text, post_context()), "lint.G-08").measured, 1);
}

TEST(PostLint, a_long_job_is_named) {
  const Post& post = *find_post(Language::inform);
  Program p = sample();
  p.instructions.insert(p.instructions.begin() + 4, 10000, Comment{"again"});
  const auto text = post.write(p, post_context());
  ASSERT_TRUE(text);
  EXPECT_EQ(check_of(post.lint(*text, post_context()), "lint.I-15").measured, 1);
}

}  // namespace
}  // namespace asbuilt
