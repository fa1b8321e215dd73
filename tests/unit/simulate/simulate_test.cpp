// SPDX-License-Identifier: GPL-3.0-or-later
// The virtual cell has to be right before anything is judged by it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "planner/io/step/step_reader.hpp"
#include "planner/simulate/files.hpp"
#include "planner/geom/mesh_query.hpp"
#include "planner/robot/robot.hpp"
#include "planner/simulate/part_model.hpp"
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

/// Of every part that is not prismatic: the truth lies on what is scanned, and what is made is not what is drawn.
TEST(PartModel, made_edges_lie_on_the_made_mesh_and_follow_the_drawn_ones) {
  for (const char* kind : {"casting", "freeform"}) {
    const PartModel part = make_part(kind, 7);
    ASSERT_EQ(part.drawn_edges.size(), part.made_edges.size());
    ASSERT_GE(part.made_edges.size(), 4u);
    const MeshQuery made(part.made), drawn(part.drawn);
    double farthest = 0;
    for (std::size_t e = 0; e < part.made_edges.size(); ++e) {
      const TrueEdge &a = part.drawn_edges[e], &b = part.made_edges[e];
      for (std::size_t k = 0; k < b.p.size(); k += 5) {
        EXPECT_LT(made.closest(b.p[k]).distance_mm, 0.004) << kind << " " << b.id << " " << k;
        farthest = std::max(farthest, drawn.closest(b.p[k]).distance_mm);
        EXPECT_GT(b.n_1[k].cross(b.n_2[k]).dot(b.tangent[k]), 0.9);
        // a step into each face stays on it; a step out along the bisector leaves the material
        const Vec3 into_1 = b.n_1[k].cross(b.tangent[k]);
        EXPECT_LT(made.closest(b.p[k] + 0.5 * into_1).distance_mm, 0.02) << kind << " " << b.id << " " << k;
      }
      EXPECT_NEAR(a.s_mm.back(), b.s_mm.back(), 2.0);
    }
    EXPECT_GT(farthest, 0.02);
    EXPECT_LT(farthest, 2.5);
    const PartModel again = make_part(kind, 7), other = make_part(kind, 8);
    EXPECT_EQ(part.made_edges[0].p[3], again.made_edges[0].p[3]);
    EXPECT_NE(part.made_edges[0].p[3], other.made_edges[0].p[3]);
    EXPECT_EQ(part.step, other.step);  // the drawing does not depend on the seed
  }
}

TEST(PartModel, its_drawing_is_read_as_one_closed_solid_whose_worked_edges_are_sharp) {
  for (const char* kind : {"casting", "freeform"}) {
    const PartModel part = make_part(kind, 7);
    const auto read = read_step(part.step, kind, {});
    ASSERT_TRUE(read.has_value()) << kind;
    const Brep& brep = read->artefact;
    EXPECT_EQ(brep.solids_count, 1);
    EXPECT_EQ(brep.open_edges_count, 0);
    EXPECT_TRUE(brep.unread.empty());
    for (const TrueEdge& e : part.drawn_edges) {
      const Vec3 m = e.p[e.p.size() / 2];
      const BrepEdge* nearest = nullptr;
      double best = 1e300;
      for (const BrepEdge& b : brep.edges)
        for (const Vec3& p : b.p)
          if ((p - m).norm() < best) best = (p - m).norm(), nearest = &b;
      ASSERT_NE(nearest, nullptr);
      EXPECT_LT(best, 0.6);
      EXPECT_EQ(nearest->kind, EdgeKind::sharp_convex) << kind << " " << e.id;
      EXPECT_NEAR(nearest->length_mm, e.s_mm.back(), 0.02);
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
    const auto robot = Robot::from(cell.robot);
    ASSERT_TRUE(robot.has_value());
    Random r(seed);
    double mean = 0;
    int n = 0;
    for (int k = 0; k < 300; ++k) {  // tool down, leaning up to half a radian, over the space in front of the arm
      const Eigen::Quaterniond q = quat_exp(Vec3(r.uniform(-0.5, 0.5), r.uniform(-0.5, 0.5), 0)) * quat_exp(r.uniform(-3, 3) * Vec3::UnitZ()) * quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
      const Pose<frame::Base, frame::Tool> T(q, Vec3(r.uniform(850, 1500), r.uniform(-500, 500), r.uniform(350, 1000)));
      const auto joints = posture(*robot, T * cell.tools[0].T_flange_tool.inverse());
      if (!joints) continue;
      mean += ((arm.actual(*joints) * cell.tools[0].T_flange_tool).p_mm - T.p_mm).norm();
      ++n;
    }
    ASSERT_GT(n, 200);
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
