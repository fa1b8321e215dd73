// SPDX-License-Identifier: GPL-3.0-or-later
// What a program states of tool, frame, controller and runs, and what it checks on the machine: every difference from the cell is named.
#include <gtest/gtest.h>

#include <functional>

#include "planner/base/number.hpp"
#include "tests/support/post_programs.hpp"

namespace asbuilt {
namespace {

using namespace support;

template <class A, class B>
std::string pose_text(const Pose<A, B>& T, double z, double y, double x) {
  std::string s;
  for (int i = 0; i < 3; ++i) s += (i ? " " : "") + fixed_number(T.p_mm[i], 3);
  return s + " mm, ZYX " + fixed_number(z, 4) + " " + fixed_number(y, 4) + " " + fixed_number(x, 4) + " deg";
}

/// A program whose header states everything; the cell's tool 1 and a frame with whole digits.
Program stated(Language language, PostContext& context) {
  ToolSpec& tool = context.cell.tools[0];
  tool.T_flange_tool = {quat_from_zyx(rad_from_deg(10), rad_from_deg(-20), rad_from_deg(30)), Vec3(1.5, -2.25, 350.125)};
  Program p;
  p.name = "STATED";
  const Pose<frame::Base, frame::Work> T_base_work(quat_from_zyx(rad_from_deg(40), rad_from_deg(2), 0), Vec3(1000, 200, 500.5));
  const std::map<Language, std::string> controllers = {{Language::krl, "KRC4"},
                                                       {Language::inform, "V in mm/s, pulses per degree 1435.64000 1435.64000 1365.33000 1137.78000 1137.78000 910.22000"},
                                                       {Language::beckhoff, "A B C by cba, kinematic 45"},
                                                       {Language::nci, "Q1 Q2 Q3 by cba, kinematics by M 40 41"},
                                                       {Language::ur, "Polyscope"}};
  p.header = {"item stated", "tool 1 " + tool.id + ": " + pose_text(tool.T_flange_tool, 10, -20, 30), "frame part: " + pose_text(T_base_work, 40, 2, 0),
              "controller " + std::string(name_of(language)) + ": " + controllers.at(language), "not run on a controller"};
  const auto at = [&](double x) { return T_base_work * Pose<frame::Work, frame::Tool>(quat_from_zyx(0, 0, 2.5), Vec3(x, 0, 50)); };
  p.instructions = {SetTool{1, tool.T_flange_tool}, SetFrame{T_base_work}, MoveJoint{context.cell.robot.home_rad, 0.5}, MoveLinear{at(0), 100, true, 0},
                    MoveLinear{at(30), 100, true, 0}, MoveJoint{context.cell.robot.home_rad, 0.5}};
  return p;
}

const Check& check_of(const std::vector<Check>& checks, const std::string& name) {
  for (const Check& c : checks)
    if (c.name == name) return c;
  throw Bug("no such check");
}

const std::vector<Language> kByNumber = {Language::krl, Language::inform, Language::beckhoff, Language::nci};  // the others print the tool itself
const std::vector<Language> kAll = {Language::krl, Language::inform, Language::beckhoff, Language::nci, Language::ur};

struct Case {
  const char* name;
  const char* rule;
  std::vector<Language> languages;
  std::function<void(Program&, PostContext&)> at_writing;  // the program or the cell it is written for
  std::function<void(PostContext&)> at_checking;           // the cell it is checked in
};

const Case kCases[] = {
    {"another calibration", "G-14", kByNumber, {}, [](PostContext& c) { c.cell.tools[0].T_flange_tool.p_mm.z() += 0.002; }},
    {"a tool turned", "G-14", kByNumber, {}, [](PostContext& c) { c.cell.tools[0].T_flange_tool.q = c.cell.tools[0].T_flange_tool.q * quat_exp(Vec3(0, 0, 1e-5)); }},
    {"another tool under the number", "G-14", kAll, {}, [](PostContext& c) { c.cell.tools[0].id = "ball-6"; }},
    {"another number", "G-14", kAll, [](Program& p, PostContext&) { p.header[1].replace(5, 1, "3"); }, {}},
    {"a tool that is no pose", "G-14", kAll, [](Program& p, PostContext&) { p.header[1].resize(30); }, {}},
    {"no tool stated", "G-14", kAll, [](Program& p, PostContext&) { p.header.erase(p.header.begin() + 1); }, {}},
    {"another frame", "G-15", {Language::krl, Language::beckhoff}, [](Program& p, PostContext&) { p.header[2].replace(p.header[2].find("1000.000"), 8, "1000.002"); }, {}},
    {"a frame turned", "G-15", {Language::krl, Language::beckhoff}, [](Program& p, PostContext&) { p.header[2].replace(p.header[2].find("40.0000"), 7, "40.0005"); }, {}},
    {"another user frame", "G-15", {Language::inform},
     [](Program& p, PostContext& c) { c.cell.controller.options["inform.user_frame"] = "4", p.header[2].replace(p.header[2].find("1000.000"), 8, "1000.002"); }, {}},
    {"no frame stated", "G-15", kAll, [](Program& p, PostContext&) { p.header.erase(p.header.begin() + 2); }, {}},
    {"another language", "G-16", kByNumber, [](Program& p, PostContext&) { p.header[3].replace(0, p.header[3].find(':'), "controller ur"); }, {}},
    {"no language", "G-16", kAll, [](Program& p, PostContext&) { p.header[3].replace(0, p.header[3].find(':'), "controller plc"); }, {}},
    {"no controller stated", "G-16", kAll, [](Program& p, PostContext&) { p.header.erase(p.header.begin() + 3); }, {}},
    {"another version", "G-16", {Language::krl}, {}, [](PostContext& c) { c.cell.controller.options["krl.version"] = "KRC2"; }},
    {"units six times too fast", "G-16", {Language::inform}, {}, [](PostContext& c) { c.cell.controller.speed_unit = SpeedUnit::cm_min; }},
    {"another robot", "G-16", {Language::inform}, {}, [](PostContext& c) { (*c.cell.controller.pulses_per_degree)[4] += 0.01; }},
    {"another meaning of A B C", "G-16", {Language::beckhoff}, {}, [](PostContext& c) { c.cell.controller.orientation = BeckhoffOrientation::ypr; }},
    {"another kinematic", "G-16", {Language::beckhoff}, [](Program& p, PostContext&) { p.header[3].replace(p.header[3].find("45"), 2, "46"); }, {}},
    {"another meaning of Q", "G-16", {Language::nci}, {}, [](PostContext& c) { c.cell.controller.options["nci.orientation"] = "euler"; }},
    {"other M functions", "G-16", {Language::nci}, [](Program& p, PostContext&) { p.header[3].replace(p.header[3].find("40 41"), 5, "42 43"); }, {}},
    {"a run without a receipt", "G-17", kAll, [](Program& p, PostContext&) { p.header[4] = "run on a controller: 0123456789ab 2026-11-20 by nobody"; }, {}},
    {"run and not run", "G-17", kAll, [](Program& p, PostContext&) { p.header.push_back(p.header[4]); }, {}},
    {"neither run nor not run", "G-17", kAll, [](Program& p, PostContext&) { p.header.pop_back(); }, {}},
    {"another receipt", "G-17", {Language::krl, Language::inform, Language::beckhoff, Language::nci, Language::ur},
     [](Program& p, PostContext&) { p.header[4] = "run on a controller: 0123456789ab 2026-11-20 by A. Smith, cell 3"; },
     [](PostContext& c) {
       for (const Post& post : posts()) c.cell.controller.options[std::string(name_of(post.language)) + ".receipt"] = "0123456789ab 2026-11-21 by A. Smith, cell 3";
     }},
};

TEST(PostPreamble, what_the_header_states_is_held_against_the_cell) {
  for (const Case& k : kCases)
    for (const Language language : k.languages) {
      PostContext context = post_context();
      Program p = stated(language, context);
      const Post& post = *find_post(language);
      const auto good = post.write(p, context);
      ASSERT_TRUE(good) << text_of(good.error());
      for (const Check& c : post.lint(*good, context)) ASSERT_TRUE(c.is_passed) << name_of(language) << " " << c.name << " " << c.where;
      if (k.at_writing) k.at_writing(p, context);
      const auto text = post.write(p, context);
      ASSERT_TRUE(text) << text_of(text.error());
      if (k.at_checking) k.at_checking(context);
      const auto checks = post.lint(*text, context);
      const Check& c = check_of(checks, std::string("lint.") + k.rule);
      EXPECT_FALSE(c.is_passed) << k.name << " " << name_of(language);
    }
}

TEST(PostPreamble, a_header_that_states_nothing_breaks_no_rule) {
  for (const Language language : kAll) {
    PostContext context = post_context();
    Program p = stated(language, context);
    p.header = {"made by hand", "tool 7 is sharp", "frame of mind: good", "controller: new"};
    const auto text = find_post(language)->write(p, context);
    for (const Check& c : find_post(language)->lint(*text, context)) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
  }
}

TEST(PostPreamble, krl_waits_for_its_controller) {
  PostContext context = post_context();
  const Program p = stated(Language::krl, context);
  auto& options = context.cell.controller.options;
  options["krl.serial_number"] = "860123", options["krl.kernel"] = "V8.3";
  Program q = p;
  q.header[3] += ", serial_number 860123, kernel V8.3";
  const Post& post = *find_post(Language::krl);
  const auto text = post.write(q, context);
  ASSERT_TRUE(text) << text_of(text.error());
  EXPECT_NE(text->files[0].bytes.find("  WAIT FOR $KR_SERIALNO==860123\r\n  WAIT FOR StrFind(1,$RCV_INFO[],\"V8.3\",#NOT_CASE_SENS)\r\n"), std::string::npos) << text->files[0].bytes;
  for (const Check& c : post.lint(*text, context)) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
  const auto refused = [&](const std::string& from, const std::string& to) {
    ProgramText t = *text;
    const std::size_t at = t.files[0].bytes.find(from);
    ASSERT_NE(at, std::string::npos);
    t.files[0].bytes.replace(at, from.size(), to);
    const auto back = post.read(t, context);
    ASSERT_FALSE(back) << from << " -> " << to;
    EXPECT_EQ(back.error().front().code, "read.check");
  };
  refused("==860123", "==860124");
  refused("\"V8.3\"", "\"V8.6\"");
  refused("  WAIT FOR $KR_SERIALNO==860123\r\n", "");
  refused("  WAIT FOR StrFind(1,$RCV_INFO[],\"V8.3\",#NOT_CASE_SENS)\r\n", "");
  options.erase("krl.kernel");
  EXPECT_FALSE(post.read(*text, context));  // waits for something the cell does not know
  for (const auto& [key, value] : std::map<std::string, std::string>{{"krl.serial_number", "12a"}, {"krl.kernel", "V\"8"}}) {
    PostContext bad = post_context();
    bad.cell.controller.options[key] = value;
    const auto no = post.write(random_program(5, {.sections = 1}), bad);
    ASSERT_FALSE(no);
    EXPECT_EQ(no.error().front().code, "post.option");
  }
}

TEST(PostPreamble, beckhoff_waits_for_its_tool) {
  PostContext context = post_context();
  const Program p = stated(Language::beckhoff, context);
  context.cell.controller.options["beckhoff.tool_data"] = "0 1 2 5 4 3";
  const Post& post = *find_post(Language::beckhoff);
  const auto text = post.write(p, context);
  ASSERT_TRUE(text) << text_of(text.error());
  EXPECT_NE(text->files[0].bytes.find("#WAIT FOR ABS[V.G.WZ[1].KIN_PARAM[1]+22500] < 100\r\n"), std::string::npos) << text->files[0].bytes;
  EXPECT_NE(text->files[0].bytes.find("#WAIT FOR ABS[V.G.WZ[1].KIN_PARAM[5]-100000] < 100\r\n"), std::string::npos) << text->files[0].bytes;
  for (const Check& c : post.lint(*text, context)) EXPECT_TRUE(c.is_passed) << c.name << " " << c.where;
  ASSERT_TRUE(post.read(*text, context));
  const auto refused = [&](const std::string& from, const std::string& to, const char* code) {
    ProgramText t = *text;
    const std::size_t at = t.files[0].bytes.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    t.files[0].bytes.replace(at, from.size(), to);
    const auto back = post.read(t, context);
    ASSERT_FALSE(back) << from << " -> " << to;
    EXPECT_EQ(back.error().front().code, code) << from << " -> " << to;
  };
  refused("+22500", "+22600", "read.check");
  refused("+22500", "-22500", "read.check");
  refused("] < 100", "] < 101", "read.range");
  refused("KIN_PARAM[1]", "KIN_PARAM[7]", "read.check");
  refused("WZ[1]", "WZ[9]", "read.tool");
  const std::size_t first = text->files[0].bytes.find("#WAIT"), line = text->files[0].bytes.rfind('\n', first) + 1;
  refused(text->files[0].bytes.substr(line, text->files[0].bytes.find('\n', line) + 1 - line), "", "read.check");
  context.cell.controller.options.erase("beckhoff.tool_data");
  EXPECT_EQ(post.read(*text, context).error().front().code, "read.undefined");
  PostContext bad = post_context();
  bad.cell.controller.options["beckhoff.tool_data"] = "0 1";
  const auto no = post.write(random_program(5, {.sections = 1}), bad);
  ASSERT_FALSE(no);
  EXPECT_EQ(no.error().front().code, "post.option");
}

TEST(PostPreamble, inform_tool_data_of_the_controller_are_the_cells) {
  PostContext context = post_context();
  const Program p = stated(Language::inform, context);
  const Post& post = *find_post(Language::inform);
  const auto text = post.write(p, context);
  ASSERT_TRUE(text);
  const auto with = [&](const std::string& values) {
    ProgramText t = *text;
    t.files.push_back({"TOOL.CND", "//TOOL 0\r\n///NAME \r\n0.000,0.000,0.000,0.0000,0.0000,0.0000\r\n0.000,0.000,0.000\r\n0.000\r\n0.000,0.000,0.000\r\n//TOOL 1\r\n///NAME CONE\r\n" + values +
                                       "\r\n0.000,0.000,120.000\r\n12.500\r\n0.000,0.000,0.000\r\n"});
    return post.read(t, context);
  };
  const auto good = with("1.500,-2.250,350.125,30.0000,-20.0000,10.0000");
  EXPECT_TRUE(good) << text_of(good.error());
  for (const char* bad : {"1.500,-2.250,350.145,30.0000,-20.0000,10.0000", "1.500,-2.250,350.125,30.0000,-20.0000,10.0200"}) {
    const auto back = with(bad);
    ASSERT_FALSE(back);
    EXPECT_EQ(back.error().front().code, "read.tool_data");
    EXPECT_EQ(back.error().front().where, "TOOL.CND:9");
  }
}

}  // namespace
}  // namespace asbuilt
