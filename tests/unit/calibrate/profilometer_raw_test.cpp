// SPDX-License-Identifier: GPL-3.0-or-later
// Holes in raw passes: found, numbered whichever way the plate lies, placed without the bias of oblique light; and what is refused.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/calibrate/profilometer_holes.hpp"
#include "planner/calibrate/profilometer_solve.hpp"
#include "tests/support/profilometer_files.hpp"

namespace asbuilt {
namespace {

using rig::pass_at;
using rig::small_cell;
using rig::small_sheet;
std::string first_code(const Refusals& r) { return r.front().code; }

TEST(ProfilometerHoles, are_numbered_whichever_way_the_plate_lies) {
  const auto c = small_cell(1);
  for (const auto& stand : {simulate::ProfilometerStand{0, 0.2, 0, 0, false}, {-40, 0, -0.3, kPi / 2, true}, {40, 0, 0.3, kPi, false}, {10, -0.3, 0.1, 0.5, false}}) {
    const auto pass = pass_at(c, stand);
    Random r(3), none(1);
    const ProfileScan scan = simulate::scanned(c, pass, 0, Vec6::Zero(), r);
    const auto blobs = find_holes(scan);
    ASSERT_TRUE(blobs) << first_code(blobs.error());
    const auto holes = number_holes(c.plate, *blobs, scan.name);
    ASSERT_TRUE(holes) << holes.error().front().message;
    auto quiet = c;
    quiet.hole_sd_mm = quiet.path_sd_mm = 0;
    const auto seen = simulate::seen_holes(quiet, pass, 0, Vec6::Zero(), none);
    EXPECT_GT(holes->size(), seen.size() * 8 / 10);
    // the sensor of the truth: what is left is the fit's own error
    auto truth = rig::truth_of(c);
    const ConeFits fits = fit_cones(scan, c.plate, *blobs, *holes, truth);
    Vec3 bias = Vec3::Zero(), square = Vec3::Zero();
    double n = 0;
    for (const HoleSighting& h : fits.view.holes)
      for (const auto& s : seen) {
        if (s.column != h.column || s.row != h.row) continue;
        const PassResiduals p = residuals_of(c.plate, HoleView{"", false, {h}}, truth, false, false);
        EXPECT_LT(p.r.norm(), 0.2);
        bias += p.r.head<3>(), square += p.r.head<3>().cwiseAbs2(), ++n;
      }
    ASSERT_GT(n, 60);
    bias /= n;
    EXPECT_LT(bias.head<2>().norm(), 0.01) << "tilt " << stand.tilt_x_rad << " " << stand.tilt_y_rad << ": " << bias.transpose();
    EXPECT_LT(std::abs(bias.z()), 0.01) << "tilt " << stand.tilt_x_rad << " " << stand.tilt_y_rad << ": " << bias.transpose();
    EXPECT_LT((square / n).cwiseSqrt().maxCoeff(), 0.05);
  }
}

struct Found {
  simulate::ProfilometerCell cell = small_cell(2);
  std::vector<HoleBlob> blobs;
  std::vector<NumberedHole> holes;
  Found() {
    Random r(5);
    blobs = *find_holes(simulate::scanned(cell, pass_at(cell, {0, 0.2, 0.1, 0.3, false}), 0, Vec6::Zero(), r));
    holes = *number_holes(cell.plate, blobs, "pass");
  }
  std::vector<HoleBlob> without(const std::vector<std::array<int, 2>>& cells) const {
    std::vector<HoleBlob> out;
    for (std::size_t b = 0; b < blobs.size(); ++b) {
      bool is_out = false;
      for (const auto& h : holes)
        if (h.blob == b)
          for (const auto& c : cells) is_out = is_out || (c[0] == h.column && c[1] == h.row);
      if (!is_out) out.push_back(blobs[b]);
    }
    return out;
  }
};

TEST(ProfilometerHoles, missing_and_false_holes_do_not_mislead) {
  const Found f;
  auto agrees = [&](const std::vector<HoleBlob>& blobs) {
    const auto again = number_holes(f.cell.plate, blobs, "pass");
    if (!again) return first_code(again.error());
    for (const auto& h : *again)
      for (const auto& g : f.holes)
        if (f.blobs[g.blob].u == blobs[h.blob].u && f.blobs[g.blob].profile == blobs[h.blob].profile && (g.column != h.column || g.row != h.row)) return std::string("misled");
    return std::string("same");
  };
  EXPECT_EQ(agrees(f.without({{3, 3}, {4, 3}, {7, 7}, {9, 2}, {6, 4}})), "same");
  for (const auto& one : f.cell.plate.large) EXPECT_EQ(agrees(f.without({one})), "same") << "without one large hole it is still unique";
  // two of three gone, and what could tell the rest: either the same or a refusal, never another numbering
  for (int keep = 0; keep < 3; ++keep) {
    std::vector<std::array<int, 2>> gone;
    for (int k = 0; k < 3; ++k)
      if (k != keep) gone.push_back(f.cell.plate.large[std::size_t(k)]);
    EXPECT_NE(agrees(f.without(gone)), "misled") << keep;
  }
  // a corner of the plate without any large hole
  std::vector<std::array<int, 2>> beyond;
  for (int column = 4; column < 12; ++column)
    for (int row = 0; row < 10; ++row) beyond.push_back({column, row});
  EXPECT_EQ(agrees(f.without(beyond)), "calibrate.plate_ambiguous");
  auto dirty = f.blobs;
  Random r(2);
  for (int k = 0; k < 4; ++k) dirty.push_back(dirty[r.below(f.blobs.size())]), dirty.back().u += 17 + k, dirty.back().profile += 3;
  EXPECT_EQ(agrees(dirty), "same");
  for (int k = 0; k < 12; ++k) dirty.push_back(dirty[r.below(f.blobs.size())]), dirty.back().u += 17 + k % 3, dirty.back().profile += 3;
  EXPECT_EQ(agrees(dirty), "calibrate.holes_off_raster");
}

TEST(ProfilometerHoles, another_plate_is_refused) {
  const Found f;
  auto code = [&](const HolePlate& p) {
    const auto r = number_holes(p, f.blobs, "pass");
    return r ? std::string("none") : first_code(r.error());
  };
  HolePlate p = f.cell.plate;
  p.columns_count = 8;
  EXPECT_EQ(code(p), "calibrate.plate_mismatch");
  p = f.cell.plate, p.large = {{{2, 2}, {3, 2}, {2, 7}}};
  EXPECT_EQ(code(p), "calibrate.plate_mismatch");
  p = f.cell.plate, p.diameter_mm = 1.5;
  EXPECT_EQ(code(p), "calibrate.plate_mismatch");
}

TEST(ProfilometerHoles, a_plain_plate_has_none) {
  auto c = small_cell(3);
  c.plate.diameter_mm = c.plate.large_diameter_mm = 0.01;
  Random r(1);
  const auto none = find_holes(simulate::scanned(c, pass_at(c, {}), 0, Vec6::Zero(), r));
  ASSERT_FALSE(none);
  EXPECT_EQ(first_code(none.error()), "calibrate.holes_not_found");
  EXPECT_FALSE(find_holes(ProfileScan{}));
}

std::vector<ProfileScan> raw_scans(const simulate::ProfilometerCell& c, std::uint64_t seed) { return rig::scans_of(c, rig::raw_passes(c), seed); }

TEST(Profilometer, raw_passes_to_a_calibration_without_any_guess) {
  const auto c = small_cell(4);
  const auto r = calibrate_profilometer(rig::recipe_of(c), c.plate, raw_scans(c, 4), small_sheet());
  ASSERT_TRUE(r) << r.error().front().code << " " << r.error().front().message;
  const auto truth = rig::truth_of(c);
  for (double u : {100.0, 320.0, 540.0})
    for (double v : {150.0, 256.0, 360.0}) {
      Eigen::Matrix<double, 3, Eigen::Dynamic> J;
      const Vec3 e = flange_point(r->artefact.state, {u, v}, &J) - flange_point(truth, {u, v});
      const Vec3 sd = (J * r->artefact.covariance * J.transpose()).diagonal().cwiseSqrt();
      EXPECT_LT(e.cwiseQuotient(sd).cwiseAbs().maxCoeff(), 4.5) << u << " " << v << ": " << e.transpose() << " sd " << sd.transpose();
    }
  EXPECT_NEAR(r->artefact.state.latency_s, c.latency_s, 5 * r->artefact.latency_sd_s + 1e-4);
}

TEST(Profilometer, a_device_that_delivers_mm_with_a_wrong_scale_is_corrected) {
  auto c = small_cell(5);
  c.device.is_metric = true, c.device.noise_px = 0.02, c.device.scale_z_ratio = 1 / 1.02, c.device.form_mm = 0.02;
  auto recipe = rig::recipe_of(c);
  recipe.is_metric = true, recipe.model = ProfilometerModel::plane_map;
  const auto r = calibrate_profilometer(recipe, c.plate, raw_scans(c, 5), {});
  ASSERT_TRUE(r) << r.error().front().code << " " << r.error().front().message;
  int said = 0;
  for (const Note& n : r->notes)
    if (n.code == "calibrate.sensor_scale") {
      ++said;
      EXPECT_NE(n.text.find("depth"), std::string::npos) << n.text;
      EXPECT_NE(n.text.find("1.02"), std::string::npos) << n.text;
    }
  EXPECT_EQ(said, 1);
}

}  // namespace
}  // namespace asbuilt
