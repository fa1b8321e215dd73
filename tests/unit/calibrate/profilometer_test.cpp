// SPDX-License-Identifier: GPL-3.0-or-later
// The calibration of a profilometer from holes: truth within its own covariance, what is not observable named, faults named, refusals.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/calibrate/profilometer_observe.hpp"
#include "tests/support/profilometer_rig.hpp"

namespace asbuilt {
namespace {

struct Job {
  simulate::ProfilometerCell cell;
  std::vector<HoleView> views;
  ProfilometerRecipe recipe;
};


/// Published distances, tilts of 20 degrees, turned by 0, 90, 180 degrees, both ways.
Job good_job(std::uint64_t seed, const std::function<void(simulate::ProfilometerCell&)>& change = {}, double tilt_deg = 20, bool roll = true, bool both = true) {
  Job j{rig::profilometer_cell(seed), {}, {}};
  j.cell.plate.columns_count = 12, j.cell.plate.rows_count = 10, j.cell.plate.pitch_mm = 8;  // as large as the published one, fewer holes: quick
  j.cell.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
  j.recipe = rig::recipe_of(j.cell);
  if (change) change(j.cell);
  auto passes = rig::passes_of(j.cell, simulate::published_stands(rad_from_deg(tilt_deg), roll, both));
  const int poses = passes.back().pose + 1;
  for (const auto& p : rig::held_out_passes(j.cell, rad_from_deg(tilt_deg), both, poses)) passes.push_back(p);
  j.views = rig::views_of(j.cell, passes, seed);
  return j;
}

std::string code_of(const Result<Done<ProfilometerCalibration>>& r) { return r ? "none" : r.error().front().code; }
std::string message_of(const Result<Done<ProfilometerCalibration>>& r) { return r ? "none" : r.error().front().where + ": " + r.error().front().message; }

TEST(Profilometer, points_of_the_field_are_true_within_their_sd) {
  double sum = 0, n = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const Job j = good_job(seed);
    const auto r = calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet());
    ASSERT_TRUE(r) << message_of(r);
    const ProfilometerCalibration& c = r->artefact;
    EXPECT_LT(c.field.median_sd_mm.maxCoeff(), 0.04);
    EXPECT_LT(c.held_out_chi2_ratio, 3);
    EXPECT_EQ(c.restart_count, 0);
    EXPECT_NEAR(c.state.latency_s, j.cell.latency_s, 5 * c.latency_sd_s);
    const auto truth = rig::truth_of(j.cell);
    for (double u : {200.0, 640.0, 1100.0})
      for (double v : {200.0, 500.0, 800.0}) {
        Eigen::Matrix<double, 3, Eigen::Dynamic> J;
        const Vec3 e = flange_point(c.state, {u, v}, &J) - flange_point(truth, {u, v});
        const Mat3 S = J * c.covariance * J.transpose();
        EXPECT_LT(e.norm(), 0.12) << seed;
        sum += e.dot(S.ldlt().solve(e)) / 3, ++n;
      }
  }
  EXPECT_LT(sum / n, 2.2);  // 1 expected; points of one calibration hang together
  EXPECT_GT(sum / n, 0.3);
}

TEST(Profilometer, faults_are_named) {
  {
    const Job j = good_job(3, [](auto& c) { c.moved_from = 40, c.moved_by << 0.2, 0, 0, 0, 0, 0; });
    const auto r = calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet());
    EXPECT_EQ(code_of(r), "calibrate.sensor_moved") << message_of(r);
    if (!r) {
      EXPECT_EQ(r.error().front().where, "between pose 20 and pose 21");
      EXPECT_NEAR(r.error().front().measured, 0.2, 0.06);
    }
  }
  {
    const Job j = good_job(4, [](auto& c) { c.moved_from = 60, c.moved_by << 0, 0, 0, 0, rad_from_deg(0.1), 0; });
    EXPECT_EQ(code_of(calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet())), "calibrate.sensor_moved");
  }
  {
    const Job j = good_job(5, [](auto& c) { c.wrong_pose = 7, c.wrong_by << 1, 0, 0, 0, 0, 0; });
    const auto r = calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet());
    ASSERT_TRUE(r) << message_of(r);
    int named = 0;
    for (const Note& n : r->notes)
      if (n.code == "calibrate.pose_left_out") {
        ++named;
        EXPECT_EQ(n.where, "pose 8");
      }
    EXPECT_EQ(named, 1);
  }
  {
    const Job j = good_job(6, [](auto& c) { c.plate_scale_ratio = 1.003; });
    EXPECT_EQ(code_of(calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet())), "calibrate.plate_scale");
  }
  {
    const Job j = good_job(7, [](auto& c) { c.plate_scale_ratio = 15.0 / 8; });
    EXPECT_EQ(code_of(calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet())), "calibrate.plate_scale");
  }
}

/// The commanded place of a pose is wrong by a millimetre along x of the flange.
void put_off(std::vector<HoleView>& views, const std::string& name) {
  for (HoleView& v : views)
    if (v.name == name || v.name == name + " back")
      for (HoleSighting& h : v.holes) h.T_base_flange.p_mm += h.T_base_flange.q * Vec3(0.4, 0.9, 0);
}

TEST(Profilometer, refuses_by_name) {
  const Job good = good_job(9);
  auto code = [&](const std::vector<HoleView>& views, ProfilometerRecipe recipe) { return code_of(calibrate_profilometer(recipe, good.cell.plate, views, rig::sheet())); };
  {
    std::vector<HoleView> few(good.views.begin(), good.views.begin() + 6);
    few.push_back(good.views.back());
    EXPECT_EQ(code(few, good.recipe), "calibrate.too_few_poses");
  }
  {
    auto all = good.views;
    std::erase_if(all, [](const HoleView& v) { return v.is_held_out; });
    auto recipe = good.recipe;
    recipe.held_out_every_count = 0;
    EXPECT_EQ(code(all, recipe), "calibrate.no_held_out");
  }
  {
    auto recipe = good.recipe;
    recipe.field_sd_max_mm = 0.001;
    const auto r = calibrate_profilometer(recipe, good.cell.plate, good.views, rig::sheet());
    EXPECT_EQ(code_of(r), "calibrate.field_uncertain");
    EXPECT_NE(message_of(r).find("tilt"), std::string::npos) << "poses to add are named";
  }
  {
    auto off = good.views;
    for (const char* name : {"pose 4", "pose 15", "pose 26"}) put_off(off, name);
    EXPECT_EQ(code(off, good.recipe), "calibrate.poses_wrong");
  }
  {
    auto off = good.views;
    for (const char* name : {"check pose 46", "check pose 47", "check pose 48", "check pose 49", "check pose 50"}) put_off(off, name);
    EXPECT_EQ(code(off, good.recipe), "calibrate.held_out_off");
  }
  {
    auto broken = good.views;
    for (HoleView& v : broken) v.holes[3].uv.x() = std::nan("");
    EXPECT_EQ(code(broken, good.recipe), "calibrate.not_converged");
  }
  {
    // level at one distance, never tilted or turned: the light's plane may lean and the plate with it
    auto cell = good.cell;
    std::vector<simulate::ProfilometerStand> stands;
    for (int k = 0; k < 6; ++k) stands.push_back({0, 0, 0, 0, false}), stands.push_back({0, 0, 0, 0, true});
    auto passes = rig::passes_of(cell, stands);
    for (std::size_t i = 0; i < passes.size(); ++i) passes[i].T_base_flange.p_mm += cell.T_base_target.direction(Vec3(0, 3.0 * double(i / 2), 0)), passes[i].is_held_out = i >= 10, passes[i].name += std::to_string(i);
    const auto r = calibrate_profilometer(good.recipe, cell.plate, rig::views_of(cell, passes, 3), rig::sheet());
    EXPECT_EQ(code_of(r), "calibrate.unobservable") << message_of(r);
  }
}

TEST(Profilometer, moves_with_base_and_does_not_ask_in_which_order) {
  const Job j = good_job(10, {}, 20, false, true);
  const auto a = calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet());
  ASSERT_TRUE(a) << message_of(a);
  auto far = [&](const Result<Done<ProfilometerCalibration>>& b) {
    double worst = 0;
    for (double u : {200.0, 640.0, 1100.0})
      for (double v : {200.0, 500.0, 800.0}) worst = std::max(worst, (flange_point(a->artefact.state, {u, v}) - flange_point(b->artefact.state, {u, v})).norm());
    return worst;
  };
  auto moved_views = j.views;
  const Pose<frame::Base, frame::Base> by(quat_exp(Vec3(0.3, -0.8, 1.1)), Vec3(-400, 250, 90));
  for (HoleView& v : moved_views)
    for (HoleSighting& h : v.holes) h.T_base_flange = by * h.T_base_flange, h.velocity_base_mm_s = by.direction(h.velocity_base_mm_s);
  const auto b = calibrate_profilometer(j.recipe, j.cell.plate, moved_views, rig::sheet());
  ASSERT_TRUE(b) << message_of(b);
  EXPECT_LT(far(b), 2e-4);
  std::vector<HoleView> turned(j.views.rbegin(), j.views.rend());
  const auto c = calibrate_profilometer(j.recipe, j.cell.plate, turned, rig::sheet());
  ASSERT_TRUE(c) << message_of(c);
  EXPECT_LT(far(c), 2e-4);
  // the plate's frame by another large hole as the origin: the same holes under other names
  HolePlate plate = j.cell.plate;
  for (auto& l : plate.large) l[0] = plate.columns_count - 1 - l[0], l[1] = plate.rows_count - 1 - l[1];
  auto renamed = j.views;
  for (HoleView& v : renamed)
    for (HoleSighting& h : v.holes) h.column = plate.columns_count - 1 - h.column, h.row = plate.rows_count - 1 - h.row;
  const auto d = calibrate_profilometer(j.recipe, plate, renamed, rig::sheet());
  ASSERT_TRUE(d) << message_of(d);
  EXPECT_LT(far(d), 2e-4);
}

TEST(Profilometer, published_parameters_are_not_degrees_of_freedom) {
  // without noise, lens known: 20 numbers have 3 null directions (f, dU, dV have one scale; two more between camera, plane and hand-eye)
  auto cell = rig::profilometer_cell(11);
  cell.plate.columns_count = 12, cell.plate.rows_count = 10, cell.plate.pitch_mm = 8, cell.plate.large = {{{5, 4}, {8, 4}, {5, 6}}};
  cell.robot_sd_mm = cell.robot_sd_rad = cell.repeat_sd_mm = cell.repeat_sd_rad = cell.hole_sd_mm = 0;
  cell.device.k1 = cell.device.k2 = cell.device.p1 = cell.device.p2 = 0;
  const auto views = rig::views_of(cell, rig::passes_of(cell, simulate::published_stands(rad_from_deg(20), true, true)), 1);
  const auto truth = rig::truth_of(cell);
  Eigen::MatrixXd J;
  for (const HoleView& v : views) {
    const Eigen::MatrixXd one = residuals_of(cell.plate, v, truth, true, false).J;
    Eigen::MatrixXd all(J.rows() + one.rows(), one.cols());
    if (J.rows() > 0) all.topRows(J.rows()) = J;
    all.bottomRows(one.rows()) = one;
    J = all;
  }
  auto nulls = [&](const std::vector<int>& columns) {
    Eigen::MatrixXd A(J.rows(), Eigen::Index(columns.size()));
    for (std::size_t i = 0; i < columns.size(); ++i) A.col(Eigen::Index(i)) = J.col(columns[i]);
    for (Eigen::Index i = 0; i < A.cols(); ++i) A.col(i) /= A.col(i).norm();
    const Eigen::VectorXd s = Eigen::JacobiSVD<Eigen::MatrixXd>(A.transpose() * A).singularValues();
    int count = 0;
    for (const double x : s) count += x < 1e-12 * s[0];
    return count;
  };
  std::vector<int> poses;
  for (int i = 12; i < 24; ++i) poses.push_back(i);
  auto with = [&](std::vector<int> c) {
    c.insert(c.end(), poses.begin(), poses.end());
    return c;
  };
  EXPECT_EQ(nulls(with({0, 1, 2, 3, 4, 9, 10, 11})), 3);
  EXPECT_EQ(nulls(with({0, 3, 4, 9, 10, 11})), 1);
  EXPECT_EQ(nulls(with({0, 9, 10, 11})), 0);
}

TEST(Profilometer, latency_needs_both_directions) {
  Job j = good_job(8, {}, 20, false, false);
  EXPECT_EQ(code_of(calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet())), "calibrate.latency_unobservable");
  j.recipe.latency = LatencyChoice::known, j.recipe.latency_s = j.cell.latency_s, j.recipe.latency_sd_s = 1e-4;
  const auto r = calibrate_profilometer(j.recipe, j.cell.plate, j.views, rig::sheet());
  ASSERT_TRUE(r) << message_of(r);
  bool is_named = false;
  for (const OpenDirection& d : r->artefact.open) is_named = is_named || d.name.find("latency") != std::string::npos;
  EXPECT_TRUE(is_named);
}

}  // namespace
}  // namespace asbuilt
