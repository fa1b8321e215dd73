// SPDX-License-Identifier: GPL-3.0-or-later
// Real robots from their URDF with their collision meshes as the cell's robot: a block deburred on all four top edges.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>

#include "planner/io/mesh_file.hpp"
#include "planner/io/urdf.hpp"
#include "planner/plan/motion/motion.hpp"
#include "planner/robot/collision.hpp"
#include "tests/unit/motion/small_cell.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

std::string bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::optional<RobotSpec> robot_spec(const fs::path& folder) {
  const std::string name = folder.filename(), table = bytes_of(folder / "fk_cases.csv");
  std::smatch m;
  if (!std::regex_search(table, m, std::regex("base=(\\S+) tip=(\\S+);"))) return std::nullopt;
  auto read = read_urdf(bytes_of(folder / (name + ".urdf")), name, m[1], m[2]);
  if (!read) return std::nullopt;
  RobotSpec spec;
  spec.model = name;
  spec.kinematics = read->artefact.kinematics;
  for (int i = 0; i < 6; ++i)
    spec.joints[i] = {read->artefact.limits_rad[i][0], read->artefact.limits_rad[i][1], read->artefact.speed_rad_s[i], 10, 100};
  for (const UrdfShape& s : read->artefact.shapes) {
    Mesh mesh = s.mesh_shape;
    if (!s.file.empty()) {
      auto loaded = read_mesh(bytes_of(folder / s.file), s.file, 1000.0);
      if (!loaded) return std::nullopt;
      mesh = loaded->mesh;
      for (Vec3& v : mesh.vertices) v = v.cwiseProduct(s.scale);
    }
    spec.links.push_back({s.joint, transformed(s.T_base_shape, mesh)});
  }
  spec.accuracy.absolute = {0.5, 0.2}, spec.accuracy.repeatability = {0.05, 0.02}, spec.accuracy.short_term = {0.02, 0.01};
  return spec;
}

/// The block in front of the arm, the tool as large as the arm carries, home above the block in the roomiest posture.
std::optional<test::SmallCell> cell_of(const RobotSpec& spec) {
  const auto robot = Robot::from(spec);
  if (!robot) return std::nullopt;
  const double f = std::clamp(robot->reach_mm() / 2600, 0.4, 1.0);
  const Vec3 shoulder = robot->axes(JointVector{})[1].second;
  test::SmallCell c = test::small_cell(Vec3(0.47 * robot->reach_mm(), -30, shoulder.z() - 0.25 * robot->reach_mm()));
  ToolSpec& tool = c.job.cell.tools[0];
  tool.T_flange_tool.p_mm = {0, 0, 295 * f + 55};
  tool.mesh_flange = test::box_mesh(Vec3(-60, -60, 1 / f) * f, Vec3(60, 60, 294) * f);
  c.job.cell.sensors[0].mesh_flange = test::box_mesh(Vec3(62, -60, 60) * f, Vec3(195, 60, 180) * f);
  c.job.cell.robot = spec;
  double best = -1;
  for (int k = 0; k < 12; ++k) {
    const Pose<frame::Base, frame::Tool> T(quat_from_z(-Vec3::UnitZ(), Vec3(std::cos(k * kPi / 6), std::sin(k * kPi / 6), 0)),
                                           c.location.T_base_part.point({50, 30, 40 + 200 * f}));
    for (const JointVector& q : robot->inverse(T * tool.T_flange_tool.inverse())) {
      const double room = std::min({robot->joint_margin_rad(q), 4 * robot->singularity_ratio(q), 0.5}) - 0.01 * std::abs(q[5]) - 0.02 * std::abs(q[3]);
      if (room > best) best = room, c.job.cell.robot.home_rad = q;
    }
  }
  if (best < 0) return std::nullopt;
  c.path.passes.clear();
  const Vec3 p[4] = {{0, 0, 40}, {100, 0, 40}, {100, 60, 40}, {0, 60, 40}};
  const Vec3 inward[4] = {Vec3::UnitY(), -Vec3::UnitX(), -Vec3::UnitY(), Vec3::UnitX()};
  for (int k = 0; k < 4; ++k) c.path.passes.push_back(test::edge_pass(p[k], p[(k + 1) % 4], inward[k]));
  return c;
}

TEST(RealRobotMotion, EveryArmDeburrsABlock) {
  const fs::path root = "../shared/data/robots";
  if (!fs::is_directory(root)) GTEST_SKIP() << "../shared/data/robots is not here";
  std::vector<fs::path> folders;
  for (const auto& e : fs::directory_iterator(root)) folders.push_back(e.path());
  std::sort(folders.begin(), folders.end());
  const char* only = std::getenv("ASBUILT_TEST_ROBOT");
  int planned = 0;
  for (const auto& folder : folders) {
    const std::string name = folder.filename();
    if (!fs::exists(folder / "fk_cases.csv") || name == "motoman_motopos_d500") continue;
    if (only ? name != only : std::string("kuka_kr16_2 kuka_kr120_r2700_2 motoman_gp12 motoman_ar2010 motoman_hc10").find(name) == std::string::npos) continue;
    const auto spec = robot_spec(folder);
    ASSERT_TRUE(spec.has_value()) << name;
    const auto c = cell_of(*spec);
    ASSERT_TRUE(c.has_value()) << name;
    const auto m = plan_motion({}, c->job, c->location, c->features, c->burrs, c->path);
    ASSERT_TRUE(m.has_value()) << name << " " << m.error()[0].code << ": " << m.error()[0].message << " at " << m.error()[0].where;
    ++planned;
    const Robot robot = *Robot::from(*spec);
    std::size_t cuts = 0;
    for (const MotionSegment& s : m->artefact.segments) {
      cuts += s.kind == SegmentKind::cut;
      for (std::size_t i = 0; i < s.q_rad.size(); ++i) {
        EXPECT_GE(robot.joint_margin_rad(s.q_rad[i]), 0) << name;
        EXPECT_LT(((robot.forward(s.q_rad[i]) * c->job.cell.tools[0].T_flange_tool).p_mm - s.T_base_tool[i].p_mm).norm(), 1e-9);
      }
    }
    EXPECT_EQ(cuts, 4u) << name;
  }
  EXPECT_GT(planned, 0);
}

}  // namespace
}  // namespace asbuilt
