// SPDX-License-Identifier: GPL-3.0-or-later
// Every check of the verifier has a program, a plan or a cell that it fails on; a check in the source without a case fails the last test.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "planner/verify/arm.hpp"
#include "planner/verify/verify.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt {
namespace {

using testing::box_item;
using testing::box_mesh;
using testing::Item;
using testing::six_axis_arm;

Verdict verify(const Item& i) { return verify_item(i.world.job, i.world.location, i.world.features, i.world.burrs, i.path, i.program); }
bool fails(const Verdict& v, const std::string& name) {
  for (const Check& c : v.checks)
    if (c.name == name) return !c.is_passed;
  return false;
}
std::string failed(const Verdict& v) {
  std::string s;
  for (const Check& c : v.checks)
    if (!c.is_passed) s += c.name + " ";
  return s;
}
template <class T>
T& nth(Program& p, int n) {
  for (Instruction& i : p.instructions)
    if (auto* x = std::get_if<T>(&i))
      if (n-- == 0) return *x;
  throw std::runtime_error("no such instruction");
}

TEST(Checks, of_an_item_each_fail_on_their_own_fault) {
  const Item good = box_item();
  const auto check = [&](const std::string& name, auto&& change) {
    Item item = good;
    change(item);
    const Verdict v = verify(item);
    EXPECT_TRUE(fails(v, name)) << name << ": " << failed(v);
  };
  check("chip_load", [](Item& i) { i.world.job.recipes[0].chip_load_mm = 1e-4; });
  check("clearance.burr", [](Item& i) {
    for (EdgeBurr& b : i.world.burrs.edges)
      for (double& h : b.height_upper_mm) h = 30;
  });
  check("clearance.links", [](Item& i) {
    i.world.job.cell.robot.links.push_back({1, box_mesh({-60, -60, 500}, {60, 60, 700})});
    i.world.job.cell.obstacles.push_back({"pillar", box_mesh({-50, -50, 550}, {50, 50, 650})});
  });
  check("clearance.self", [](Item& i) { i.world.job.cell.robot.links.push_back({0, box_mesh({1100, -100, 720}, {1300, 100, 900})}); });
  check("feed.max", [](Item& i) {
    for (Instruction& x : i.program.instructions)
      if (auto* m = std::get_if<MoveLinear>(&x); m && m->speed_mm_s < 49) m->speed_mm_s = 1.05 * i.world.job.recipes[0].feed_max_mm_s;
  });
  check("frame.orientation", [](Item& i) {
    auto& T = nth<SetFrame>(i.program, 0).T_base_work;
    T.q = T.q * quat_exp(Vec3(0, 0, 1e-5));
  });
  check("order.moves", [](Item& i) { i.program.instructions.resize(2); });
  check("path.points", [](Item& i) {
    int n = 12;
    std::erase_if(i.program.instructions, [&](const Instruction& x) { return std::holds_alternative<MoveLinear>(x) && n-- == 0; });
  });
  check("path.recipe", [](Item& i) {
    for (CutPass& p : i.path.passes) p.recipe = "none";
  });
  check("speed.limit", [](Item& i) { nth<MoveLinear>(i.program, 0).speed_mm_s = 2500; });
  check("spindle.off_in_transfers", [](Item& i) { std::erase_if(i.program.instructions, [](const Instruction& x) { return std::holds_alternative<SpindleOff>(x); }); });
  check("tool.orientation", [](Item& i) {
    auto& T = nth<SetTool>(i.program, 0).T_flange_tool;
    T.q = T.q * quat_exp(Vec3(1e-5, 0, 0));
  });
}

CellSpec cell() {
  CellSpec c;
  c.robot = six_axis_arm();
  ToolSpec t;
  t.number = 1, t.id = "t", t.spindle.max_rpm = 10000;
  c.tools = {t};
  return c;
}

TEST(Checks, of_the_arm_alone_near_a_singular_posture) {
  const verifying::Arm arm(cell().robot);
  const auto at = [&](double a4, double a5) {
    return Pose<frame::Base, frame::Tool>(Pose<frame::Base, frame::Flange>(arm.flange({0, rad_from_deg(-70), rad_from_deg(90), rad_from_deg(a4), rad_from_deg(a5), 0})) * Pose<frame::Flange, frame::Tool>());
  };
  Program p;
  p.name = "SINGULAR";
  p.instructions = {SetTool{1, {}}, SetFrame{}, MoveJoint{six_axis_arm().home_rad, 0.3}, MoveJoint{{0, rad_from_deg(-70), rad_from_deg(90), rad_from_deg(1), rad_from_deg(4), 0}, 0.3},
                    MoveLinear{at(1, 4), 20, true, 0}, MoveLinear{at(-1, -4), 20, true, 0}, MoveJoint{six_axis_arm().home_rad, 0.3}};
  const Verdict v = verify_program(cell(), p);
  EXPECT_TRUE(fails(v, "joints.jump")) << failed(v);
  EXPECT_TRUE(fails(v, "singularity")) << failed(v);
}

TEST(Checks, of_the_rules_of_orientation) {
  Program p;
  p.name = "RULES";
  const auto at = [](double turn_deg) {
    return Pose<frame::Base, frame::Tool>(Eigen::Quaterniond(Eigen::AngleAxisd(rad_from_deg(turn_deg), Vec3::UnitX())) * quat_from_zyx(0, rad_from_deg(88), 0), Vec3(1300, 0, 900 + turn_deg));
  };
  p.instructions = {SetTool{1, {}}, SetFrame{}, MoveJoint{six_axis_arm().home_rad, 0.3}, MoveLinear{at(0), 20, true, 0}, MoveLinear{at(4.9), 20, true, 0}, MoveJoint{six_axis_arm().home_rad, 0.3}};
  EXPECT_TRUE(fails(verify_program(cell(), p), "orientation.rules")) << failed(verify_program(cell(), p));
}

TEST(Checks, of_a_comparison_each_fail_on_their_own_difference) {
  const auto T = [](double x, double y) { return Pose<frame::Base, frame::Tool>(quat_from_zyx(0.3, 0.2, 3), Vec3(x, y, 700)); };
  Program p;
  p.name = "COMPARE", p.header = {"item"};
  p.instructions = {SetTool{1, {}}, SetFrame{}, MoveJoint{six_axis_arm().home_rad, 0.3}, MoveLinear{T(1000, 0), 20, true, 0}, OutputOnPath{7, true, 3}, MoveLinear{T(1020, 0), 20, false, 0.5},
                    MoveCircular{T(1030, 5), T(1033, 15), 20, true, 0}, Comment{"a remark"}, MoveJoint{six_axis_arm().home_rad, 0.3}};
  const auto check = [&](const std::string& name, const PrintedSteps& steps, auto&& change) {
    Program q = p;
    change(q);
    EXPECT_TRUE(compare_programs(p, p, steps).is_ok());
    EXPECT_TRUE(fails(compare_programs(p, q, steps), name)) << name;
  };
  check("compare.angle", {}, [](Program& q) {
    auto& t = nth<MoveLinear>(q, 0).T_base_tool;
    t.q = quat_exp(Vec3(0, 0, 1.2e-6)) * t.q;
  });
  check("compare.arc", {.is_via_printed = false}, [](Program& q) { nth<MoveCircular>(q, 0).T_base_via.p_mm.x() += 0.02; });
  check("compare.coordinate", {}, [](Program& q) { nth<MoveCircular>(q, 0).T_base_via.p_mm.x() += 0.001; });
  check("compare.blend_kept", {.blend_mm = 0.001}, [](Program& q) { nth<MoveLinear>(q, 1).blend_mm -= 0.01; });
  check("compare.name", {}, [](Program& q) { q.name = "OTHER"; });
  check("compare.remarks", {}, [](Program& q) { nth<Comment>(q, 0).text = "another remark"; });
  check("compare.trigger", {}, [](Program& q) { nth<OutputOnPath>(q, 0).path_mm += 0.01; });
}

/// The names of the checks in the source, and those that a test names.
TEST(Checks, every_check_has_a_case) {
  namespace fs = std::filesystem;
  const auto slurp = [](const fs::path& p) {
    std::ostringstream s;
    s << std::ifstream(p).rdbuf();
    return s.str();
  };
  std::set<std::string> names;
  const std::regex made("(?:add_check\\(v, |run\\()\"([a-z_.]+)\"");
  for (const auto& e : fs::directory_iterator("planner/verify")) {
    const std::string text = slurp(e.path());
    for (std::sregex_iterator i(text.begin(), text.end(), made), end; i != end; ++i) names.insert((*i)[1]);
  }
  EXPECT_GT(names.size(), 60u);
  std::string cases;
  for (const char* file : {"tests/unit/verify/checks_test.cpp", "tests/unit/verify/verify_test.cpp", "tests/unit/verify/shape_test.cpp", "tests/unit/inspect/plan_test.cpp"}) cases += slurp(file);
  for (const std::string& name : names) EXPECT_NE(cases.find("\"" + name + "\""), std::string::npos) << name << " has no case";
}

}  // namespace
}  // namespace asbuilt
