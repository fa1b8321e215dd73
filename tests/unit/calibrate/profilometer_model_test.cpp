// SPDX-License-Identifier: GPL-3.0-or-later
// The sensor models: the published rotation re-derived, the map against an independent projection, derivatives, the linear start.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/geom/profilometer_model.hpp"
#include "planner/calibrate/profilometer_solve.hpp"
#include "planner/calibrate/profilometer_start.hpp"
#include "tests/support/profilometer_rig.hpp"

namespace asbuilt {
namespace {

TEST(ProfilometerModel, rotation_is_a_rotation) {
  Random r(3);
  for (int i = 0; i < 200; ++i) {
    const Mat3 R = rotation_camera_sensor(r.uniform(-1.5, 1.5), r.uniform(-3, 3));
    EXPECT_LT((R * R.transpose() - Mat3::Identity()).norm(), 1e-12);
    EXPECT_NEAR(R.determinant(), 1, 1e-12);
  }
}

TEST(ProfilometerModel, the_light_starts_one_baseline_beside_the_camera) {
  const double alpha = 0.4, L = 70;
  const Mat3 R = rotation_camera_sensor(alpha, 0.1);
  const Vec3 meets(0, 0, L / std::tan(alpha));
  const Vec3 source = meets - R.col(2) * (meets.z() / R(2, 2));  // back along the light to the camera's own depth
  EXPECT_NEAR(source.norm(), L, 1e-9);
  EXPECT_NEAR(source.z(), 0, 1e-9);
}

TEST(ProfilometerModel, maps_pixels_back_to_where_an_independent_projection_took_them_from) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto cell = rig::profilometer_cell(seed);
    const auto state = rig::truth_of(cell);
    Random r(seed);
    for (int i = 0; i < 100; ++i) {
      const Vec2 xz(r.uniform(-45, 45), r.uniform(-60, 60));
      Vec2 uv;
      if (!simulate::project(cell.device, xz, uv)) continue;
      EXPECT_LT((plane_point(state.intrinsics, uv) - xz).norm(), 1e-8);
      Vec2 back;
      ASSERT_TRUE(pixel_of(state.intrinsics, xz, uv + Vec2(20, -10), back));
      EXPECT_LT((back - uv).norm(), 1e-5);
    }
  }
}

TEST(ProfilometerModel, derivatives_are_those_of_the_map) {
  Random r(5);
  ProfilometerIntrinsics camera = rig::truth_of(rig::profilometer_cell(2)).intrinsics, map;
  camera.values[11] = 0.2;
  map.model = ProfilometerModel::plane_map, map.degree_count = 5, map.uv_center = Vec2(600, 500), map.uv_half = 600;
  const auto sheet = plane_map_parameters(5, 0.05);
  EXPECT_EQ(plane_map_parameters(4, 0.05).size(), 27u);  // 5 and 22: with hand-eye, target and latency the 40 of the design
  map.values.resize(Eigen::Index(sheet.size()));
  for (Eigen::Index i = 0; i < map.values.size(); ++i) map.values[i] = (i < 3 ? 40 : 0.1) + 0.05 * r.normal();
  for (ProfilometerIntrinsics* m : {&camera, &map})
    for (int k = 0; k < 30; ++k) {
      const Vec2 uv(r.uniform(0, 1279), r.uniform(0, 1023));
      MapJacobian J;
      plane_point(*m, uv, &J);
      for (Eigen::Index i = 0; i < m->values.size(); ++i) {
        const double step = 1e-6 * std::max(1e-2, std::abs(m->values[i])), was = m->values[i];
        m->values[i] = was + step;
        const Vec2 up = plane_point(*m, uv);
        m->values[i] = was - step;
        const Vec2 down = plane_point(*m, uv);
        m->values[i] = was;
        EXPECT_LT(((up - down) / (2 * step) - J.col(i)).norm(), 2e-5 * (1 + J.col(i).norm())) << i;
      }
    }
}

TEST(ProfilometerSolve, derivatives_of_the_residuals_are_those_of_the_disturbed_state) {
  auto cell = rig::profilometer_cell(4);
  const auto state = rig::truth_of(cell);
  auto views = rig::views_of(cell, {rig::passes_of(cell, simulate::published_stands(0.3, true, false))[17]}, 1);
  views[0].holes.resize(40);
  const PassResiduals p = residuals_of(cell.plate, views[0], state, true, true);
  for (Eigen::Index i = 0; i < p.J.cols(); ++i) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(p.J.cols());
    const double step = i < 12 ? 1e-6 * std::max(1e-2, std::abs(state.intrinsics.values[i])) : 1e-5;
    d[i] = step;
    const Eigen::VectorXd up = residuals_of(cell.plate, views[0], moved(state, d), false, false).r;
    const Eigen::VectorXd down = residuals_of(cell.plate, views[0], moved(state, -d), false, false).r;
    EXPECT_LT(((up - down) / (2 * step) - p.J.col(i)).norm(), 1e-4 * (1 + p.J.col(i).norm())) << i;
  }
  for (int i = 0; i < 6; ++i) {
    Vec6 d = Vec6::Zero();
    d[i] = 1e-5;
    HoleView up = views[0], down = views[0];
    for (auto& h : up.holes) h.T_base_flange = h.T_base_flange.disturbed(d);
    for (auto& h : down.holes) h.T_base_flange = h.T_base_flange.disturbed(-d);
    const Eigen::VectorXd n = (residuals_of(cell.plate, up, state, false, false).r - residuals_of(cell.plate, down, state, false, false).r) / 2e-5;
    EXPECT_LT((n - p.robot.col(i)).norm(), 1e-4 * (1 + n.norm())) << i;
  }
}

TEST(ProfilometerSolve, whitening_is_the_square_root_of_the_inverse_covariance) {
  auto cell = rig::profilometer_cell(4);
  const auto state = rig::truth_of(cell);
  auto views = rig::views_of(cell, rig::passes_of(cell, {{0, 0.1, 0, 0, false}, {0, 0.1, 0, 0, true}}), 1);
  for (auto& v : views) v.holes.resize(15);
  const auto recipe = rig::recipe_of(cell);
  ProfilometerProblem problem{&recipe, &cell.plate, grouped(views), camera_parameters(rig::sheet())};
  ASSERT_EQ(problem.groups.size(), 1u);
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(90, 90), A(90, 6);
  for (int k = 0; k < 2; ++k) A.middleRows(45 * k, 45) = residuals_of(cell.plate, views[std::size_t(k)], state, false, true).robot;
  Vec6 common, each;
  common << Vec3::Constant(recipe.robot_sd_mm), Vec3::Constant(recipe.robot_sd_rad);
  each << Vec3::Constant(recipe.repeat_sd_mm), Vec3::Constant(recipe.repeat_sd_rad);
  S = A * common.cwiseAbs2().asDiagonal() * A.transpose();
  for (int k = 0; k < 2; ++k) {
    const Eigen::MatrixXd B = A.middleRows(45 * k, 45);
    S.block(45 * k, 45 * k, 45, 45) += B * each.cwiseAbs2().asDiagonal() * B.transpose();
  }
  const double lateral = cell.hole_sd_mm * cell.hole_sd_mm + cell.plate.sd_mm * cell.plate.sd_mm, across = 0.25 * cell.hole_sd_mm * cell.hole_sd_mm;
  for (int j = 0; j < 30; ++j) S.diagonal().segment<3>(3 * j) += Vec3(lateral, lateral, across);
  Eigen::MatrixXd W = Eigen::MatrixXd::Identity(90, 90);
  whitener_of(problem, 0, state).apply(W);
  EXPECT_LT((W * S * W.transpose() - Eigen::MatrixXd::Identity(90, 90)).norm(), 1e-6);
}

TEST(ProfilometerStart, linear_start_needs_no_guess) {
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    auto cell = rig::profilometer_cell(seed);
    cell.plate.columns_count = 12, cell.plate.rows_count = 10, cell.plate.pitch_mm = 8, cell.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
    const auto views = rig::views_of(cell, rig::passes_of(cell, simulate::published_stands(rad_from_deg(10), false, false)), seed);
    const auto map = linear_start(cell.plate, grouped(views), 4);
    ASSERT_TRUE(map);
    const auto camera = camera_from_plane_map(*map, rig::sheet());
    // in the middle of the field it is where the sensor really sees: millimetres, before any lens is known
    const auto truth = rig::truth_of(cell);
    for (const auto& s : {*map, camera}) {
      const Vec3 d = flange_point(s, Vec2(640, 512)) - flange_point(truth, Vec2(640, 512));
      EXPECT_LT(d.norm(), 12) << seed << " " << d.transpose();
    }
    EXPECT_NEAR(camera.intrinsics.values[10], truth.intrinsics.values[10], 0.15);
  }
}

TEST(ProfilometerSolve, recovers_the_truth_exactly_without_noise) {
  auto cell = rig::profilometer_cell(7);
  cell.plate.columns_count = 12, cell.plate.rows_count = 10, cell.plate.pitch_mm = 8, cell.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
  cell.robot_sd_mm = cell.robot_sd_rad = cell.repeat_sd_mm = cell.repeat_sd_rad = 0;
  cell.hole_sd_mm = 1e-9;
  const auto views = rig::views_of(cell, rig::passes_of(cell, simulate::published_stands(rad_from_deg(20), true, true)), 1);
  ProfilometerRecipe recipe;
  ProfilometerProblem problem{&recipe, &cell.plate, grouped(views), camera_parameters(rig::sheet())};
  auto clean = views;
  for (auto& v : clean)
    for (auto& h : v.holes) h.sd_target_mm.setConstant(0.001);
  problem.groups = grouped(clean);
  const auto map = linear_start(cell.plate, problem.groups, 4);
  const SolveReport s = solve_joint(problem, camera_from_plane_map(*map, rig::sheet()));
  EXPECT_TRUE(s.is_converged);
  const auto truth = rig::truth_of(cell);
  for (double u : {50.0, 640.0, 1200.0})
    for (double v : {100.0, 500.0, 900.0}) EXPECT_LT((flange_point(s.state, {u, v}) - flange_point(truth, {u, v})).norm(), 2e-3) << u << " " << v;
  EXPECT_NEAR(s.state.latency_s, cell.latency_s, 1e-6);
}

}  // namespace
}  // namespace asbuilt
