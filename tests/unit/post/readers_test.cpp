// SPDX-License-Identifier: GPL-3.0-or-later
// The readers on programs that the writers never write: hand-written in the manner of the pendant or of other systems, and
// programs that must be refused, each with its code and line.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "planner/base/number.hpp"
#include "planner/verify/arm.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

std::string crlf(std::string_view text) {
  std::string out;
  for (char c : text) out += c == '\n' ? "\r\n" : std::string(1, c);
  return out;
}
std::vector<Instruction> motions(const Program& p) {
  std::vector<Instruction> out;
  for (const Instruction& i : p.instructions)
    if (std::holds_alternative<MoveJoint>(i) || std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveCircular>(i)) out.push_back(i);
  return out;
}

TEST(PostReaders, krl_as_the_pendant_writes_it) {
  const char* src = R"(&ACCESS RVP
&REL 12
&COMMENT taught
&PARAM TEMPLATE = C:\KRC\Roboter\Template\vorgabe
DEF taught( )
;FOLD INI;%{PE}
  ;FOLD BASISTECH INI
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
    INTERRUPT ON 3
    BAS (#INITMOV,0 )
  ;ENDFOLD (BASISTECH INI)
;ENDFOLD (INI)
$H_DUMMY_IS_NOT_HERE
END
)";
  std::string s = src;
  s.replace(s.find("$H_DUMMY_IS_NOT_HERE\n"), 21, R"(;FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}
$BWDSTART=FALSE
PDAT_ACT=PDEFAULT
BAS(#PTP_DAT )
FDAT_ACT=FHOME
BAS(#FRAMES )
BAS (#VEL_PTP,100 )
PTP  XHOME
;ENDFOLD
BASE_DATA[2]={X 100.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}
FDAT_ACT=FP1
BAS(#FRAMES)
BAS(#CP_PARAMS,0.25)
$APO.CDIS=2.5
LIN XP1 C_DIS
TRIGGER WHEN DISTANCE=1 DELAY=0 DO $OUT[7]=TRUE PRIO=-1
lin {x 20, y -1}
SLIN XP2 WITH $VEL.CP=0.01
CIRC XA1,XP1
WORK ( )
SPTP {A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0,E1 0.0}
)");
  const char* dat = R"(&ACCESS RVP
DEFDAT taught PUBLIC
EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )
DECL INT SUCCESS
DECL FDAT FHOME={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}
DECL FDAT FP1={TOOL_NO 3,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}
DECL PDAT PDEFAULT={VEL 100.000,ACC 100.000,APO_DIST 100.000}
DECL GLOBAL E6POS XP1={X 10.0,Y 0.0,Z 5.0,A 0.0,B 90.0,C 0.0,S 2,T 35,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
E6POS XP2={X 0.0,Y 5.0,Z 5.0,A 0.0,B 90.0,C 0.0,S 2,T 35}
DECL E6POS XA1={X 6.0,Y 5.0,Z 5.0,A 0.0,B 90.0,C 0.0}
ENDDAT
)";
  const char* work = "&ACCESS RVP\nDEF WORK( )\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n";
  const PostContext context = post_context();
  const auto p = find_post(Language::krl)->read({Language::krl, {{"taught.src", s}, {"taught.dat", dat}, {"work.src", work}}}, context);
  ASSERT_TRUE(p) << text_of(p.error());
  EXPECT_EQ(p->name, "taught");
  const auto m = motions(*p);
  ASSERT_EQ(m.size(), 7u);
  EXPECT_EQ(std::get<MoveJoint>(m[0]).q_rad, context.cell.robot.home_rad);
  const auto& a = std::get<MoveLinear>(m[1]);
  EXPECT_LT((a.T_base_tool.p_mm - Vec3(110, 0, 5)).norm(), 1e-12);
  EXPECT_FALSE(a.is_exact);
  EXPECT_EQ(a.blend_mm, 2.5);
  EXPECT_EQ(a.speed_mm_s, 250);
  EXPECT_LT((std::get<MoveLinear>(m[2]).T_base_tool.p_mm - Vec3(120, -1, 5)).norm(), 1e-12);  // Z and the angles keep their value
  EXPECT_EQ(std::get<MoveLinear>(m[3]).speed_mm_s, 10);
  EXPECT_EQ(std::get<MoveCircular>(m[4]).speed_mm_s, 250);
  EXPECT_LT((std::get<MoveLinear>(m[5]).T_base_tool.p_mm - Vec3(101, 2, 3)).norm(), 1e-12);
  int tools = 0, at = 0, output_at = -1;
  for (const Instruction& i : p->instructions) {
    if (const auto* t = std::get_if<SetTool>(&i)) tools = tools * 10 + t->number;
    if (std::holds_alternative<SetOutput>(i)) output_at = at;
    at += std::holds_alternative<MoveLinear>(i) || std::holds_alternative<MoveJoint>(i);
  }
  EXPECT_EQ(tools, 13);
  EXPECT_EQ(output_at, 3);  // after the motion that follows the trigger
}

TEST(PostReaders, inform_with_pages_and_a_user_frame) {
  const std::string main = crlf("/JOB\n//NAME MAIN\n//POS\n///NPOS 1,0,0,0,0,0\n///TOOL 1\n///POSTYPE PULSE\n///PULSE\nC00000=0,-143564,136533,0,102400,0\n"
                                "//INST\n///DATE 2026/05/04 15:49\n///COMM made by hand\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\nMOVJ C00000 VJ=12.50 PL=0\n"
                                "CALL JOB:PAGE-1\nEND\n");
  const std::string page = crlf("/JOB\n//NAME PAGE-1\n//POS\n///NPOS 3,0,0,0,0,0\n///USER 4\n///TOOL 1\n///POSTYPE USER\n///RECTAN\n"
                                "///RCONF 1,0,0,0,0,0,0,0\nC00000=10.000,0.000,0.000,0.00,0.00,0.00\nC00001=20.000,10.000,0.000,0.00,0.00,0.00\n"
                                "C00002=30.000,0.000,0.000,0.00,0.00,90.00\n//INST\n///DATE 2026/05/04 15:49\n///ATTR SC,RW\n///GROUP1 RB1\nNOP\n"
                                "MOVC C00000 V=60.0 PL=0\nMOVC C00001 V=60.0 PL=0\nMOVC C00002 V=60.0 PL=0\nEND\n");
  const std::string frames = crlf("//UFRAME 4\n///NAME TABLE\n///TOOL 0\n///GROUP 1,0,0\n///BUSER 1000.000,0.000,0.000,0.0000,0.0000,90.0000\n");
  PostContext context = post_context();
  context.cell.controller.speed_unit = SpeedUnit::cm_min;
  const auto p = find_post(Language::inform)->read({Language::inform, {{"MAIN.JBI", main}, {"PAGE-1.JBI", page}, {"UFRAME.CND", frames}}}, context);
  ASSERT_TRUE(p) << text_of(p.error());
  const auto m = motions(*p);
  ASSERT_EQ(m.size(), 3u);
  EXPECT_NEAR(std::get<MoveJoint>(m[0]).q_rad[1], rad_from_deg(-100), 1e-9);
  EXPECT_EQ(std::get<MoveJoint>(m[0]).speed_ratio, 0.125);
  EXPECT_LT((std::get<MoveLinear>(m[1]).T_base_tool.p_mm - Vec3(1000, 10, 0)).norm(), 1e-9);
  EXPECT_NEAR(std::get<MoveLinear>(m[1]).speed_mm_s, 10, 1e-12);  // 60 cm/min
  EXPECT_LT((std::get<MoveCircular>(m[2]).T_base_via.p_mm - Vec3(990, 20, 0)).norm(), 1e-9);
}

TEST(PostReaders, beckhoff_with_sub_programs_and_both_kinds_of_joint_motion) {
  const char* nc = "%L WORK\n(start) G01 X10 Y0 Z0 A0 B0 C0 F600 (slow)\nG162 G02 X20 Y-10 I0 J-10\nG01 X20 Y-20 Z=5\nM17\n"
                   "%HAND_MADE\n( made (by) hand )\nN1 G90 G71 G94 G17\nN2 T1 D1\nN3 #MCS ON\nN4 G00 X0 Y-90 Z90 A0 B10 C0\nN5 #MCS OFF\n"
                   "N6 #TRAFO ON\nN7 #CS ON [100,0,0,0,0,90]\nN8 S[REV 1000 M03]\nN9 LL WORK\nN10 G60 G01 Z50 M5\nN11 #CS OFF ALL\nN12 #TRAFO OFF\n"
                   "N13 G01 X0 Y-90 Z90 A0 B0 C0 F3450\nN14 M30\n";
  const auto p = find_post(Language::beckhoff)->read({Language::beckhoff, {{"hand.nc", nc}}}, post_context());
  ASSERT_TRUE(p) << text_of(p.error());
  EXPECT_EQ(p->name, "HAND_MADE");
  const auto m = motions(*p);
  ASSERT_EQ(m.size(), 6u);
  EXPECT_EQ(std::get<MoveJoint>(m[0]).speed_ratio, 1);
  EXPECT_NEAR(std::get<MoveJoint>(m[0]).q_rad[4], rad_from_deg(10), 1e-12);
  const auto& a = std::get<MoveLinear>(m[1]);
  EXPECT_LT((a.T_base_tool.p_mm - Vec3(100, 10, 0)).norm(), 1e-9);
  EXPECT_EQ(a.speed_mm_s, 10);
  const auto& arc = std::get<MoveCircular>(m[2]);  // clockwise about (10, -10), from the top to the right
  const double h = 10 * std::sqrt(0.5);
  EXPECT_LT((arc.T_base_via.p_mm - Vec3(100 + 10 - h, 10 + h, 0)).norm(), 1e-9);
  EXPECT_LT((std::get<MoveLinear>(m[4]).T_base_tool.p_mm - Vec3(120, 20, 50)).norm(), 1e-9);
  EXPECT_NEAR(std::get<MoveJoint>(m[5]).speed_ratio, 0.5, 1e-12);  // 57.5 of the slowest joint's 115 degrees a second
}

TEST(PostReaders, beckhoff_arcs_beyond_half_a_turn_become_several) {
  const char* nc = "G90 G71 G94 G17\nT1\nG00 X0 Y-90 Z90 A0 B10 C0\n#TRAFO ON\nG01 X10 Y0 Z0 A0 B0 C0 F600\nG03 X10 Y0 I-10 J0\n#TRAFO OFF\nM30\n";
  const auto p = find_post(Language::beckhoff)->read({Language::beckhoff, {{"round.nc", nc}}}, post_context());
  ASSERT_TRUE(p) << text_of(p.error());
  const auto m = motions(*p);
  ASSERT_EQ(m.size(), 5u);
  for (int i = 2; i < 5; ++i) {
    EXPECT_NEAR(std::get<MoveCircular>(m[i]).T_base_via.p_mm.norm(), 10, 1e-9);
    EXPECT_NEAR(std::get<MoveCircular>(m[i]).T_base_tool.p_mm.norm(), 10, 1e-9);
  }
}

TEST(PostReaders, tools_written_out_are_found_in_the_cell) {
  const PostContext context = post_context();
  auto text = find_post(Language::krl)->write(random_program(2, {.has_two_tools = false, .has_equipment = false}), context);
  ASSERT_TRUE(text);
  std::string& s = text->files[0].bytes;
  const std::string line = "$TOOL=TOOL_DATA[1]";
  const std::string literal = text->files[1].bytes.substr(text->files[1].bytes.find('{'), text->files[1].bytes.find('}') - text->files[1].bytes.find('{') + 1);
  s.replace(s.find(line), line.size(), "$TOOL=" + literal);
  const auto p = find_post(Language::krl)->read(*text, context);
  ASSERT_TRUE(p) << text_of(p.error());
  EXPECT_EQ(std::get<SetTool>(p->instructions[0]).number, 1);
}

/// Every posture of the arm, said by S and T, comes back; without them, or with signs that no posture has, the target is refused.
TEST(PostReaders, ptp_to_a_frame_takes_the_posture_of_status_and_turn) {
  const PostContext context = post_context();
  Random r(5);
  int read = 0, ambiguous = 0;
  for (int n = 0; n < 30; ++n) {
    JointVector q{};
    for (std::size_t i = 0; i < 6; ++i) {
      const JointSpec& j = context.cell.robot.joints[i];
      q[i] = r.uniform(0.9 * j.min_rad, 0.9 * j.max_rad);
    }
    if (std::abs(q[4]) < 0.1) q[4] = 0.5;
    const Eigen::Isometry3d T = verifying::Arm(context.cell.robot).flange(q) * context.cell.tools[0].T_flange_tool.matrix();
    const Mat3 R = T.linear();
    const double cos_b = std::hypot(R(0, 0), R(1, 0));
    int turn = 0;
    for (std::size_t i = 0; i < 6; ++i) turn |= q[i] < 0 ? 1 << i : 0;
    const auto text = [](double v) { return fixed_number(v, 6); };
    const std::string target = "{X " + text(T.translation().x()) + ",Y " + text(T.translation().y()) + ",Z " + text(T.translation().z()) + ",A " + text(deg_from_rad(std::atan2(R(1, 0), R(0, 0)))) + ",B " +
                               text(deg_from_rad(std::atan2(-R(2, 0), cos_b))) + ",C " + text(deg_from_rad(std::atan2(R(2, 1), R(2, 2)))) + ",S " + std::to_string(2 + (q[4] < 0 ? 4 : 0)) + ",T " +
                               std::to_string(turn) + "}";
    const std::string src = "&ACCESS RVP\r\nDEF A( )\r\n$TOOL=TOOL_DATA[1]\r\n$BASE=$NULLFRAME\r\nBAS(#VEL_PTP,50)\r\nPTP " + target + "\r\nEND\r\n";
    const auto p = find_post(Language::krl)->read({Language::krl, {{"A.src", src}}}, context);
    if (!p) {
      const std::string code = p.error().front().code;  // never another posture: refused where it is not the only one, or was not found
      EXPECT_TRUE(code == "read.ambiguous" || code == "read.posture") << text_of(p.error());
      ++ambiguous;
      continue;
    }
    ++read;
    const MoveJoint m = std::get<MoveJoint>(motions(*p).front());
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(m.q_rad[i], q[i], 1e-4) << n << " joint " << i + 1 << " " << target;
  }
  EXPECT_GE(read, 20) << ambiguous;
}

struct Bad {
  Language language;
  const char* code;
  const char* from;
  const char* to;
  const char* file = "";  // "+": a second file; otherwise an ending that the last file gets
};
const Bad kBad[] = {
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  FOR I=1 TO 3"},
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  IF $IN[1] THEN"},
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  PTP_REL {A1 5}"},
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  GOTO X"},
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  HALT"},
    {Language::krl, "read.unknown", "  ;FOLD PROGRAM", "  WAIT FOR $IN[1]==TRUE"},
    {Language::krl, "read.unknown", "$IPO_MODE=#BASE", "$IPO_MODE=#TCP"},
    {Language::krl, "read.call", "  ;FOLD PROGRAM", "  ELSEWHERE( )"},
    {Language::krl, "read.tool", "$TOOL=TOOL_DATA[1]", "$TOOL=TOOL_DATA[2]"},
    {Language::krl, "read.tool", "$TOOL=TOOL_DATA[1]", "$TOOL={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}"},
    {Language::krl, "read.undefined", "  ;FOLD PROGRAM", "  $BASE=BASE_DATA[3]"},
    {Language::krl, "read.undefined", "  ;FOLD PROGRAM", "  LIN XP9"},
    {Language::krl, "read.load", "$TOOL=TOOL_DATA[1]", "$TOOL=TOOL_DATA[1]\r\n  $LOAD=LOAD_DATA[2]"},
    {Language::krl, "read.load", "  ;FOLD PROGRAM", "  $LOAD=LOAD_DATA[1]"},
    {Language::krl, "read.undefined", "  BAS (#VEL_PTP,30)\r\n", ""},
    {Language::krl, "read.order", "  ;FOLD PROGRAM", "  $VEL.CP=0.1\r\n  LIN {X 1,Y 1,Z 1,A 1,B 1,C 1}"},
    {Language::krl, "read.ptp_cartesian", "  PTP {A1", "  PTP {X 1,Y 1,Z 1,A 1,B 1,C 1}\r\n  PTP {A1"},
    {Language::krl, "read.posture", "  PTP {A1", "  PTP {X 9000,Y 1,Z 1,A 1,B 1,C 1,S 2,T 2}\r\n  PTP {A1"},
    {Language::krl, "read.spline", "  ;FOLD PROGRAM", "  SPLINE\r\n  ENDSPLINE"},
    {Language::krl, "read.spline", "  ;FOLD PROGRAM", "  SPL {X 1,Y 1,Z 1,A 1,B 1,C 1}"},
    {Language::krl, "read.spline", "  ;FOLD PROGRAM", "  SPLINE\r\n  WAIT SEC 1"},
    {Language::krl, "read.trigger", "  LIN {", "  TRIGGER WHEN PATH=5 DELAY=0 DO $OUT[7]=TRUE\r\n  LIN {"},
    {Language::krl, "read.trigger", "  LIN {", "  TRIGGER WHEN PATH=-5 DELAY=0 DO $OUT[5]=TRUE\r\n  LIN {"},
    {Language::krl, "read.file", "&ACCESS RVP\r\n&REL 1\r\nDEFDAT", "", ".odd"},
    {Language::krl, "read.number", "$ADVANCE=3", "$ADVANCE=1e999"},
    {Language::krl, "read.range", "$ADVANCE=3", "$ADVANCE=3.5"},
    {Language::krl, "read.missing", "\r\nEND\r\n", "\r\n"},
    {Language::krl, "read.name", "DECL FRAME", "DECL FRAME EXPECTED_TOOL_1={X 0,Y 0,Z 0,A 0,B 0,C 0}\r\n  DECL FRAME"},
    {Language::krl, "read.check", "TOOL_1={X 1", "TOOL_1={X 2"},
    {Language::krl, "read.trigger", "  ;ENDFOLD (PROGRAM)", "  TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[7]=TRUE"},
    {Language::krl, "read.not_ascii", "$ADVANCE=3", "$ADVANCE=3\xff"},
    {Language::inform, "read.line_end", "NOP\r\n", "NOP\n"},
    {Language::inform, "read.name", "//NAME PART_2", "//NAME PART_3"},
    {Language::inform, "read.count", "///NPOS 5", "///NPOS 6"},
    {Language::inform, "read.unknown", "NOP\r\n", "NOP\r\nJUMP *A IF IN#(1)=ON\r\n"},
    {Language::inform, "read.missing", "///ATTR SC,RW", "///ATTR SC,RW,RJ"},
    {Language::inform, "read.unknown", "///ATTR SC,RW", "///ATTR SC,RW,RJ\r\n///FRAME BASE"},
    {Language::inform, "read.unknown", "///ATTR SC,RW", "///ATTR SC,RW\r\n///FRAME BASE"},
    {Language::inform, "read.undefined", "///POSTYPE BASE", "///USER 7\r\n///POSTYPE USER"},
    {Language::inform, "read.order", "C00002=", "///POSTYPE BASE\r\nC00002="},
    {Language::inform, "read.missing", "END\r\n", ""},
    {Language::inform, "read.order", "MOVJ C00000 VJ", "MOVL C00000 V"},
    {Language::inform, "read.posture", "MOVL C00002 V", "MOVJ C00002 VJ"},
    {Language::inform, "read.spline", "MOVL C00002 V", "MOVS C00002 V"},
    {Language::inform, "read.arc", "MOVL C00003 V", "MOVC C00003 V"},
    {Language::inform, "read.file", "", "", ".odd"},
    {Language::inform, "read.range", "PL=0", "PL=1"},
    {Language::inform, "read.call", "NOP\r\n", "NOP\r\nCALL JOB:ELSEWHERE\r\n"},
    {Language::beckhoff, "read.unknown", "G90 G71", "G91 G71"},
    {Language::beckhoff, "read.unknown", "G90 G71 G94 G17", "G90 G70 G94 G17"},
    {Language::beckhoff, "read.unknown", "M05", "$IF P1 > 2"},
    {Language::beckhoff, "read.unknown", "M05", "M77"},
    {Language::beckhoff, "read.unknown", "M05", "#HSC ON"},
    {Language::beckhoff, "read.order", "#KIN ID [45]", "#KIN ID [45]\r\n#HSC ON [BSPLINE PATH_DEV=0.010]"},
    {Language::beckhoff, "read.hsc", "#CS ON [1]", "#CS ON [1]\r\n#HSC ON [BSPLINE PATH_DEV=0.5]"},
    {Language::beckhoff, "read.hsc", "#CS ON [1]", "#CS ON [1]\r\n#HSC ON [BSPLINE PATH_DEV=0.010]\r\n#CS OFF"},
    {Language::beckhoff, "read.spline", "#CS ON [1]", "#CS ON [1]\r\n#HSC ON [BSPLINE PATH_DEV=0.010]\r\n#HSC OFF"},
    {Language::beckhoff, "read.arc", "#CS ON [1]", "#CS ON [1]\r\nG17 G02 X0 Y0 Z0 A0 B0 C0 I1 J1 F100"},
    {Language::beckhoff, "read.rapid", "#CS ON [1]", "#CS ON [1]\r\nG00 X0 Y0 Z0 A0 B0 C0"},
    {Language::inform, "read.tool", "///TOOL 1", "///TOOL 2"},
    {Language::beckhoff, "read.name", "%PART_2", "%L A\r\nM17\r\n%L A\r\nM17\r\n%PART_2"},
    {Language::nci, "read.arc", "N90 G01", "N90 G17 G02"},
    {Language::ur, "read.file", "", "", "+"},
    {Language::ur, "read.missing", "end\n", ""},
    {Language::ur, "read.range", "v=", "v=-"},
    {Language::ur, "read.unknown", "sleep(", "sleeep("},
    {Language::nci, "read.unknown", "G90 G71", "G91 G71"},
    {Language::nci, "read.unknown", "M05", "#TRAFO ON"},
    {Language::nci, "read.unknown", "M05", "M77"},
    {Language::nci, "read.unknown", "M05", "((M05))"},
    {Language::nci, "read.unknown", "M05", "R1=5"},
    {Language::nci, "read.undefined", "G90 G71 G17", "G90 G17"},
    {Language::nci, "read.tool", "T1 D1", "T1 D3"},
    {Language::nci, "read.range", "N20 ", "N5 "},
    {Language::nci, "read.missing", "M30", "M05"},
    {Language::nci, "read.rapid", "N90 G01", "N90 G00"},
    {Language::nci, "read.file", "", "", "+"},
    {Language::nci, "read.missing", " Q3=0.0000", ""},
    {Language::beckhoff, "read.undefined", "G94 ", ""},
    {Language::beckhoff, "read.kinematic", "#KIN ID [45]", "#KIN ID [44]"},
    {Language::beckhoff, "read.tool", "T1 D1", "T1 D3"},
    {Language::beckhoff, "read.tool", "T1 D1", "T7 D7"},
    {Language::beckhoff, "read.range", "N20 ", "N5 "},
    {Language::beckhoff, "read.missing", "M30", "M05"},
    {Language::beckhoff, "read.missing", "#TRAFO ON\r\n", "#TRAFO ON\r\nG01 X5 F600\r\n"},
    {Language::beckhoff, "read.call", "M05", "LL ELSEWHERE"},
};

TEST(PostReaders, inform_frames_and_starts_of_splines_say_what_they_are) {
  PostContext context = post_context();
  context.cell.controller.options["inform.user_frame"] = "5";
  const Post& post = *find_post(Language::inform);
  int edits = 0;
  for (int seed = 1; seed <= 20; ++seed) {
    const auto text = post.write(random_program(seed, {.has_arcs = false, .has_new_frames = false}), context);
    ASSERT_TRUE(text);
    const auto refused = [&](std::size_t file, const std::string& from, const std::string& to, const char* code) {
      ProgramText t = *text;
      const std::size_t at = t.files[file].bytes.find(from);
      if (at == std::string::npos) return;
      ++edits;
      t.files[file].bytes.replace(at, from.size(), to);
      const auto back = post.read(t, context);
      ASSERT_FALSE(back) << from << " -> " << to;
      EXPECT_EQ(back.error().front().code, code);
    };
    refused(text->files.size() - 1, "///GROUP 1,0,0", "///GROUP 2,0,0", "read.unknown");
    // a spline behind a spline starts where the tool stands: its first line moves nothing, and its speed must be the next one's
    const std::string& s = text->files[0].bytes;
    for (std::size_t at = s.find("MOVS "); at != std::string::npos; at = s.find("MOVS ", at + 5)) {
      const std::size_t before = s.rfind("MOV", at - 1), v = s.find("V=", at) + 2, end = s.find(' ', v);
      const std::string c = s.substr(at + 5, 6), b = s.substr(before + 5, 6);
      if (s[before + 3] == 'S' || s.substr(s.find(c + "="), 60).substr(7, 30) != s.substr(s.find(b + "="), 60).substr(7, 30)) continue;
      ProgramText t = *text;
      t.files[0].bytes.replace(v, end - v, "1.7");
      ++edits;
      const auto back = post.read(t, context);
      ASSERT_FALSE(back) << s.substr(before, 120);
      EXPECT_EQ(back.error().front().code, "read.spline");
    }
  }
  EXPECT_GT(edits, 20);
}

/// Near the stretched arm both elbows have the same signs: which one is meant is not said, and nothing is guessed.
TEST(PostReaders, two_postures_of_one_status_and_turn_are_refused) {
  const PostContext context = post_context();
  int ambiguous = 0;
  for (double a3 = -20; a3 < 20; a3 += 0.5) {
    const JointVector q{0, rad_from_deg(-60), rad_from_deg(a3), 0, rad_from_deg(30), 0};
    const Eigen::Isometry3d T = verifying::Arm(context.cell.robot).flange(q) * context.cell.tools[0].T_flange_tool.matrix();
    const Mat3 R = T.linear();
    const auto text = [](double v) { return fixed_number(v, 6); };
    const std::string target = "{X " + text(T.translation().x()) + ",Y " + text(T.translation().y()) + ",Z " + text(T.translation().z()) + ",A " + text(deg_from_rad(std::atan2(R(1, 0), R(0, 0)))) + ",B " +
                               text(deg_from_rad(std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0))))) + ",C " + text(deg_from_rad(std::atan2(R(2, 1), R(2, 2)))) + ",S 2,T " + (a3 < 0 ? "6}" : "2}");
    const std::string src = "&ACCESS RVP\r\nDEF A( )\r\n$TOOL=TOOL_DATA[1]\r\n$BASE=$NULLFRAME\r\nBAS(#VEL_PTP,50)\r\nPTP " + target + "\r\nEND\r\n";
    const auto p = find_post(Language::krl)->read({Language::krl, {{"A.src", src}}}, context);
    ambiguous += !p && p.error().front().code == "read.ambiguous";
  }
  EXPECT_GT(ambiguous, 5);
}

/// The codes in the source of each reader, and the cases here; those with machine values of their own are in preamble_test.cpp.
TEST(PostReaders, every_code_has_a_case) {
  namespace fs = std::filesystem;
  std::set<std::pair<std::string, std::string>> cases = {{"inform", "read.tool_data"}, {"beckhoff", "read.check"}};
  std::set<std::string> any = {"read.ambiguous"};  // above
  for (const Bad& b : kBad) cases.insert({std::string(name_of(b.language)), b.code}), any.insert(b.code);
  const std::regex code("\"(read\\.[a-z_]+)\"");
  int found = 0;
  for (const auto& e : fs::recursive_directory_iterator("postprocessors")) {
    if (e.path().extension() != ".cpp" && e.path().extension() != ".hpp") continue;
    std::ostringstream s;
    s << std::ifstream(e.path()).rdbuf();
    const std::string text = s.str(), dialect = e.path().parent_path().filename().string();
    for (std::sregex_iterator i(text.begin(), text.end(), code), end; i != end; ++i, ++found) {
      const std::string name = (*i)[1];
      if (dialect == "postprocessors") EXPECT_TRUE(any.count(name)) << e.path() << ": " << name << " has no case";
      else EXPECT_TRUE(cases.count({dialect, name})) << e.path() << ": " << name << " has no case in " << dialect;
    }
  }
  EXPECT_GT(found, 200);
}

TEST(PostReaders, what_they_cannot_read_is_named_with_its_line) {
  for (const Bad& b : kBad) {
    const PostContext context = post_context();
    const Program p = random_program(2, mix_for(*find_post(b.language), {.sections = 1, .points = 1, .has_arcs = false, .has_events = false, .has_equipment = false, .has_splines = false}));
    auto text = find_post(b.language)->write(p, context);
    ASSERT_TRUE(text);
    bool has_edit = *b.file != 0;
    if (*b.file == '+') text->files.push_back({"more.nc", "N10 M30\r\n"});
    else if (*b.file) text->files.back().name += b.file;
    for (ProgramFile& f : text->files)
      if (const std::size_t at = f.bytes.find(b.from); at != std::string::npos && !has_edit) {
        f.bytes.replace(at, std::string_view(b.from).size(), b.to);
        has_edit = true;
      }
    if (!has_edit) {
      ADD_FAILURE() << b.from << " is not in\n" << text->files[0].bytes;
      continue;
    }
    const auto back = find_post(b.language)->read(*text, context);
    if (back) {
      ADD_FAILURE() << name_of(b.language) << " \"" << b.from << "\" -> \"" << b.to << "\" is read\n" << text->files[0].bytes;
      continue;
    }
    const Refusal& r = back.error().front();
    EXPECT_EQ(r.stage, "verify");
    EXPECT_NE(r.where.find(':'), std::string::npos) << r.where;
    EXPECT_EQ(r.code, b.code) << name_of(b.language) << " \"" << b.from << "\" -> \"" << b.to << "\": " << text_of(back.error());
  }
}

}  // namespace
}  // namespace asbuilt
