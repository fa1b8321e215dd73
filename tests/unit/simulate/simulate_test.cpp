// SPDX-License-Identifier: GPL-3.0-or-later
// The virtual cell has to be right before anything is judged by it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "planner/simulate/files.hpp"
#include "planner/simulate/simulate.hpp"
#include "planner/simulate/solid.hpp"
#include "planner/simulate/true_robot.hpp"

namespace asbuilt {
namespace {

using namespace simulate_detail;
namespace fs = std::filesystem;

std::string bytes_of(const fs::path& p) {
  std::ifstream f(p, std::ios::binary);
  std::stringstream s;
  s << f.rdbuf();
  return s.str();
}

TEST(Solid, worked_edges_lie_on_both_faces_and_drawn_and_made_match) {
  for (const Solid& nominal : {make_ring(true), make_bracket()}) {
    Random r(5);
    const Solid made = as_made(nominal, r, 1.0);
    const auto a = worked_edges(nominal, 0.5), b = worked_edges(made, 0.5);
    ASSERT_EQ(a.size(), b.size());
    ASSERT_GE(a.size(), 8u);
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].id, b[i].id);
      EXPECT_NEAR(a[i].s_mm.back(), b[i].s_mm.back(), 1.5);
      const Vec3 middle = b[i].p[b[i].p.size() / 2];
      double nearest = 1e9;
      for (const Vec3& p : a[i].p) nearest = std::min(nearest, (p - middle).norm());
      EXPECT_LT(nearest, 1.0);
      EXPECT_GT(nearest, 1e-4);  // as made is not as drawn
      for (std::size_t k = 0; k < b[i].p.size(); ++k) EXPECT_NEAR(b[i].n_1[k].dot(b[i].n_2[k]), 0, 0.02);
    }
  }
}

TEST(Parts, the_files_that_come_with_the_project_are_the_virtual_parts) {
  EXPECT_EQ(bytes_of("parts/bearing_ring/ring.step"), step_text(make_ring(true), "ring"));
  EXPECT_EQ(bytes_of("parts/bracket/bracket.step"), step_text(make_bracket(), "bracket"));
  EXPECT_EQ(bytes_of("fixtures/cells/virtual/cell.yaml"), cell_text(virtual_cell()));
}

TEST(TrueRobot, is_as_far_from_its_model_as_ordered) {
  const CellSpec cell = virtual_cell();
  for (std::uint64_t seed : {1, 2, 3}) {
    const TrueRobot arm(cell.robot, cell.tools[0].T_flange_tool, seed, 0.42, 0.07, 0.02);
    Random r(seed);
    double mean = 0;
    int n = 0;
    for (int k = 0; k < 300; ++k) {
      Joints q{};
      const double theta[6] = {r.uniform(-0.6, 0.6), 0.3 + r.uniform(-0.5, 0.5), 1.5 + r.uniform(-0.4, 0.5), r.uniform(-0.7, 0.7), r.uniform(-1.8, -0.8), r.uniform(-2, 2)};
      const auto& k_opw = std::get<OpwParameters>(cell.robot.kinematics);
      for (int i = 0; i < 6; ++i) q[i] = (theta[i] + k_opw.offsets_rad[i]) * k_opw.signs[i];
      mean += ((arm.actual(q) * cell.tools[0].T_flange_tool).p_mm - (arm.nominal(q) * cell.tools[0].T_flange_tool).p_mm).norm();
      ++n;
    }
    EXPECT_NEAR(mean / n, 0.42, 0.15);
  }
}

TEST(Simulate, writes_the_same_bytes_twice_and_names_a_bad_scenario) {
  const fs::path root = fs::temp_directory_path() / "asbuilt_simulate_test";
  fs::remove_all(root);
  Scenario s;
  s.seed = 3;
  for (const char* d : {"a", "b"}) {
    const auto r = simulate(s, root / d);
    ASSERT_TRUE(r.has_value());
  }
  int files = 0;
  for (const auto& f : fs::recursive_directory_iterator(root / "a"))
    if (f.is_regular_file()) {
      ++files;
      EXPECT_EQ(bytes_of(f.path()), bytes_of(root / "b" / fs::relative(f.path(), root / "a"))) << f.path();
    }
  EXPECT_GE(files, 25);
  s.trap = "no such trap";
  const auto bad = simulate(s, root / "c");
  ASSERT_FALSE(bad.has_value());
  EXPECT_EQ(bad.error().front().code, "input.bad_scenario");
  fs::remove_all(root);
}

}  // namespace
}  // namespace asbuilt
