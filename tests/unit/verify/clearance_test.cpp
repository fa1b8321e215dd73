// SPDX-License-Identifier: GPL-3.0-or-later
#include "planner/verify/clearance.hpp"

#include <gtest/gtest.h>

#include "planner/base/random.hpp"
#include "tests/unit/verify/item.hpp"

namespace asbuilt::verifying {
namespace {

using testing::box_mesh;

TEST(Clearance, distance_of_two_boxes_is_that_of_their_faces_and_negative_inside) {
  const Body body("box", 7, box_mesh({-1, -1, -1}, {1, 1, 1}));
  const Standing standing("box", box_mesh({-10, -10, -10}, {10, 10, 10}));
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Vec3(15, 3, 2);
  EXPECT_NEAR(body.distance(T, standing), 4, 0.06);
  T.translation() = Vec3(11.5, 0, 0);
  EXPECT_NEAR(body.distance(T, standing), 0.5, 0.06);
  T.translation() = Vec3(10.5, 0, 0);
  EXPECT_LE(body.distance(T, standing), 0.0);
  T.translation() = Vec3(0, 0, 0);
  EXPECT_NEAR(body.distance(T, standing), -9, 0.1);  // inside: apart as surfaces, not free
  // and the other way round
  const Body big("big", 7, box_mesh({-10, -10, -10}, {10, 10, 10}));
  EXPECT_NEAR(big.distance(T, Standing("small", box_mesh({-1, -1, -1}, {1, 1, 1}))), -9, 0.1);
}

TEST(Clearance, distance_agrees_with_dense_sampling) {
  Random random(2);
  const Mesh mesh = box_mesh({-30, -5, -60}, {30, 5, 60});
  const Body body("plate", 7, mesh);
  const Standing standing("box", box_mesh({-20, -20, -20}, {20, 20, 20}));
  for (int k = 0; k < 20; ++k) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = quat_exp(Vec3(random.normal(), random.normal(), random.normal())).toRotationMatrix();
    T.translation() = Vec3(random.uniform(80, 120), random.uniform(-60, 60), random.uniform(-60, 60));
    double dense = 1e9;
    for (int t = 0; t < 12; ++t)
      for (int i = 0; i <= 40; ++i)
        for (int j = 0; i + j <= 40; ++j) {
          const auto& f = mesh.triangles[static_cast<std::size_t>(t)];
          const Vec3 p = mesh.vertices[static_cast<std::size_t>(f[0])] + (mesh.vertices[static_cast<std::size_t>(f[1])] - mesh.vertices[static_cast<std::size_t>(f[0])]) * (i / 40.0) +
                         (mesh.vertices[static_cast<std::size_t>(f[2])] - mesh.vertices[static_cast<std::size_t>(f[0])]) * (j / 40.0);
          dense = std::min(dense, standing.query.closest(T * p).distance_mm);
        }
    EXPECT_NEAR(body.distance(T, standing), dense, 0.1);
  }
}

TEST(Clearance, a_thin_wall_between_two_samples_is_not_missed) {
  const Arm arm(testing::six_axis_arm());
  const JointVector a{0.0, -1.6, 1.5, 0.0, 1.2, 0}, b{0.06, -1.6, 1.5, 0.0, 1.2, 0};
  const Body body("stick", 7, box_mesh({-2, -2, 0}, {2, 2, 300}));
  const Vec3 tip = arm.state({0.03, -1.6, 1.5, 0.0, 1.2, 0}).flange * Vec3(0, 0, 200);
  // a sheet of 0.4 mm across the way
  const Standing sheet("sheet", box_mesh(tip + Vec3(-80, -0.2, -80), tip + Vec3(80, 0.2, 80)));
  std::vector<Sample> samples(2);
  samples[0].q_rad = a, samples[1].q_rad = b;
  const std::vector<char> none(2, 0);
  const ClearanceResult r = follow_clearance(arm, samples, states_of(arm, samples), none, {&body, &sheet, 1.0, false});
  EXPECT_TRUE(!r.is_certain || r.least_mm < 1.0);
  const Standing away("away", box_mesh(tip + Vec3(-80, 299.8, -80), tip + Vec3(80, 300.2, 80)));
  const ClearanceResult free = follow_clearance(arm, samples, states_of(arm, samples), none, {&body, &away, 1.0, false});
  EXPECT_TRUE(free.is_certain);
  EXPECT_GT(free.least_mm, 100);
}

TEST(Clearance, certified_means_free_at_every_posture_in_between) {
  const Arm arm(testing::six_axis_arm());
  Random random(9);
  const Body body("tool", 7, testing::tool_body());
  int certified = 0;
  for (int k = 0; k < 40; ++k) {
    std::vector<Sample> samples(2);
    for (std::size_t i = 0; i < 6; ++i) {
      samples[0].q_rad[i] = std::array<double, 6>{0, -1.6, 1.5, 0, 1.2, 0}[i] + random.uniform(-0.1, 0.1);
      samples[1].q_rad[i] = samples[0].q_rad[i] + random.uniform(-0.1, 0.1);
    }
    const Vec3 near = arm.flange(samples[0].q_rad) * Vec3(random.uniform(-120, 120), random.uniform(-120, 120), random.uniform(150, 350));
    const Standing post("post", box_mesh(near - Vec3(5, 5, 40), near + Vec3(5, 5, 40)));
    const ClearanceResult r = follow_clearance(arm, samples, states_of(arm, samples), {0, 0}, {&body, &post, 2.0, false});
    if (!r.is_certain || r.least_mm < 2.0) continue;
    ++certified;
    for (int i = 0; i <= 100; ++i) {
      JointVector q;
      for (std::size_t j = 0; j < 6; ++j) q[j] = samples[0].q_rad[j] + i / 100.0 * (samples[1].q_rad[j] - samples[0].q_rad[j]);
      ASSERT_GE(body.distance(arm.flange(q), post), 2.0 - 0.06);
    }
  }
  EXPECT_GT(certified, 5);
}

TEST(Clearance, the_cutters_mesh_is_closed_and_faces_outward) {
  for (CutterShape shape : {CutterShape::cone, CutterShape::ball, CutterShape::cylinder}) {
    Cutter c = testing::cone_cutter();
    c.shape = shape;
    const MeshQuery q(cutter_mesh(c));
    EXPECT_LT(q.signed_distance(Vec3(0, 0, -10)), 0);
    EXPECT_GT(q.signed_distance(Vec3(0, 0, 1)), 0);
    double volume = 0;
    for (const auto& t : q.mesh().triangles)
      volume += q.mesh().vertices[static_cast<std::size_t>(t[0])].dot(q.mesh().vertices[static_cast<std::size_t>(t[1])].cross(q.mesh().vertices[static_cast<std::size_t>(t[2])])) / 6;
    EXPECT_GT(volume, 100);
  }
}

}  // namespace
}  // namespace asbuilt::verifying
