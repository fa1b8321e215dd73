// SPDX-License-Identifier: GPL-3.0-or-later
// Robots from URDF: real models against an independent table of poses; shapes placed in base; what is no arm is refused.
#include "planner/io/urdf.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "planner/io/file.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

const fs::path kRobots = "../shared/data/robots";

TEST(Urdf, real_robots_reach_the_known_poses) {
  if (!fs::exists(kRobots)) GTEST_SKIP() << "no " << kRobots;
  int arms = 0;
  for (const auto& entry : fs::directory_iterator(kRobots)) {
    const std::string name = entry.path().filename();
    std::ifstream table(entry.path() / "fk_cases.csv");
    std::string line, base, tip;
    if (!std::getline(table, line) || line.find("base=") == std::string::npos) continue;
    std::istringstream head(line.substr(line.find("base=") + 5));
    head >> base >> tip;
    tip = tip.substr(4);
    if (tip.back() == ';') tip.pop_back();
    const auto bytes = read_file(entry.path() / (name + ".urdf"), name);
    ASSERT_TRUE(bytes);
    const auto urdf = read_urdf(*bytes, name, base, tip);
    if (name == "motoman_motopos_d500") {
      ASSERT_FALSE(urdf);
      EXPECT_EQ(urdf.error()[0].code, "input.urdf_joints");
      continue;
    }
    ASSERT_TRUE(urdf) << name << ": " << urdf.error()[0].message;
    EXPECT_GE(urdf->artefact.shapes.size(), 7u) << name;
    const ChainKinematics& k = urdf->artefact.kinematics;
    int rows = 0;
    while (std::getline(table, line)) {
      std::vector<double> v;
      std::istringstream cells(line);
      for (std::string cell; std::getline(cells, cell, ',');) {
        char* end = nullptr;
        v.push_back(std::strtod(cell.c_str(), &end));
        if (end == cell.c_str()) v.clear();
      }
      if (v.size() != 18) continue;
      ++rows;
      Pose<frame::Base, frame::Base> T;
      for (std::size_t j = 0; j < 6; ++j)
        T = T * k.joints[j].T_parent_joint *
            Pose<frame::Base, frame::Base>(Eigen::Quaterniond(Eigen::AngleAxisd(v[j], k.joints[j].axis)), Vec3::Zero());
      T = T * k.T_last_tip;
      Mat3 R;
      Vec3 p_mm;
      for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) R(r, c) = v[std::size_t(6 + 4 * r + c)];
        p_mm[r] = 1000 * v[std::size_t(6 + 4 * r + 3)];
      }
      ASSERT_LT((T.p_mm - p_mm).norm(), 1e-6) << name;
      ASSERT_LT((T.rotation() - R).norm(), 1e-8) << name;
    }
    EXPECT_EQ(rows, 40) << name;
    ++arms;
  }
  EXPECT_GE(arms, 20);
}

std::string arm(const std::string& extra = "", const std::string& type = "revolute", int joints = 6) {
  std::string s =
      "<robot name=\"r\">\n<link name=\"world\"/>\n<link name=\"b\"><collision><geometry><box size=\"0.1 0.2 "
      "0.3\"/></geometry></collision></link>\n"
      "<joint name=\"stand\" type=\"fixed\"><parent link=\"world\"/><child link=\"b\"/><origin xyz=\"5 5 5\"/></joint>\n"
      "<link name=\"feet\"/><joint name=\"feet\" type=\"fixed\"><parent link=\"b\"/><child link=\"feet\"/><origin xyz=\"0 0 0.5\" rpy=\"0 "
      "0 1.5707963267948966\"/></joint>\n";
  for (int j = 1; j <= joints; ++j) {
    const std::string n = std::to_string(j), parent = j == 1 ? "b" : "l" + std::to_string(j - 1);
    s += "<link name=\"l" + n +
         "\"><visual><origin xyz=\"0 0 0.05\"/><geometry><cylinder radius=\"0.02\" length=\"0.1\"/></geometry></visual></link>\n<joint "
         "name=\"j" +
         n + "\" type=\"" + type + "\"><parent link=\"" + parent + "\"/><child link=\"l" + n +
         "\"/><origin xyz=\"0 0 0.1\"/><axis xyz=\"0 " + (j % 2 ? "0 1" : "2 0") +
         "\"/><limit lower=\"-1\" upper=\"1\" velocity=\"2\" effort=\"0\"/></joint>\n";
  }
  return s + extra + "</robot>\n";
}

TEST(Urdf, base_may_hang_beside_the_chain) {
  const auto straight = read_urdf(arm(), "r", "b", "l6"), beside = read_urdf(arm(), "r", "feet", "l6");
  ASSERT_TRUE(straight && beside);
  const auto tip = [](const ChainKinematics& k) {
    Pose<frame::Base, frame::Base> T;
    for (const ChainJoint& j : k.joints) T = T * j.T_parent_joint;
    return T * k.T_last_tip;
  };
  EXPECT_LT((tip(straight->artefact.kinematics).p_mm - Vec3(0, 0, 600)).norm(), 1e-9);
  EXPECT_LT((tip(beside->artefact.kinematics).p_mm - Vec3(0, 0, 100)).norm(), 1e-9);
  EXPECT_LT((beside->artefact.shapes[0].T_base_shape.p_mm - Vec3(0, 0, -500)).norm(), 1e-9);
}

TEST(Urdf, shapes_are_placed_and_closed) {
  const auto r = read_urdf(arm(), "r", "b", "l6");
  ASSERT_TRUE(r);
  ASSERT_EQ(r->artefact.shapes.size(), 7u);
  EXPECT_EQ(r->artefact.shapes[0].joint, 0);
  EXPECT_EQ(r->artefact.shapes[6].joint, 6);
  EXPECT_LT((r->artefact.shapes[6].T_base_shape.p_mm - Vec3(0, 0, 650)).norm(), 1e-9);
  for (const UrdfShape& s : r->artefact.shapes) {
    double volume = 0;
    std::map<std::pair<int, int>, int> sides;
    for (const auto& t : s.mesh_shape.triangles) {
      volume += s.mesh_shape.vertices[std::size_t(t[0])].dot(
                    s.mesh_shape.vertices[std::size_t(t[1])].cross(s.mesh_shape.vertices[std::size_t(t[2])])) /
                6;
      for (std::size_t k = 0; k < 3; ++k) sides[{t[k], t[(k + 1) % 3]}] += 1;
    }
    for (const auto& [side, count] : sides) EXPECT_TRUE(count == 1 && sides.count({side.second, side.first})) << s.link;
    const double exact = s.joint == 0 ? 100.0 * 200 * 300 : kPi * 400 * 100;
    EXPECT_GE(volume, exact * 0.999999) << s.link;
    EXPECT_LE(volume, exact * 1.01) << s.link;
  }
}

TEST(Urdf, what_is_no_arm_is_refused) {
  const auto code = [](const std::string& text, const std::string& base, const std::string& tip) {
    const auto r = read_urdf(text, "r", base, tip);
    return r ? std::string() : r.error()[0].code;
  };
  EXPECT_EQ(code("<robot", "b", "l6"), "input.urdf_syntax");
  EXPECT_EQ(code("<machine/>", "b", "l6"), "input.urdf_syntax");
  EXPECT_EQ(code(arm(), "b", "nothing"), "input.urdf_link");
  EXPECT_EQ(code(arm(), "b", "l5"), "input.urdf_joints");
  EXPECT_EQ(code(arm(), "l1", "b"), "input.urdf_joints");
  EXPECT_EQ(code(arm("", "prismatic"), "b", "l6"), "input.urdf_joints");
  EXPECT_EQ(code(arm("<link name=\"island\"/>"), "island", "l6"), "input.urdf_link");
  EXPECT_EQ(code(arm("<joint name=\"loop\" type=\"fixed\"><parent link=\"l6\"/><child link=\"world\"/></joint>"), "b", "l6"),
            "input.urdf_link");
  EXPECT_EQ(code(arm("<link name=\"x\"><visual><geometry><box size=\"1 a 1\"/></geometry></visual></link><joint name=\"x\" "
                     "type=\"fixed\"><parent link=\"l6\"/><child link=\"x\"/></joint>"),
                 "b", "l6"),
            "input.urdf_value");
}

TEST(Urdf, a_joint_beside_the_chain_is_said) {
  const auto r = read_urdf(arm("<link name=\"rod\"><visual><geometry><sphere radius=\"0.1\"/></geometry></visual></link><joint "
                               "name=\"rod\" type=\"revolute\"><parent link=\"l1\"/><child link=\"rod\"/></joint>"),
                           "r", "b", "l6");
  ASSERT_TRUE(r);
  ASSERT_EQ(r->notes.size(), 1u);
  EXPECT_EQ(r->notes[0].code, "input.urdf_side_joint");
}

}  // namespace
}  // namespace asbuilt
