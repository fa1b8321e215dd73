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
