// SPDX-License-Identifier: GPL-3.0-or-later
// A line scanner and a plate with holes by files: captures -> calibration file -> read back, checked, and applied; every refusal.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "planner/calibrate/profilometer_job.hpp"
#include "planner/inputs/inputs.hpp"
#include "tests/support/profilometer_files.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

class PlateFiles : public ::testing::Test {
 protected:
  fs::path folder;
  void SetUp() override {
    folder = fs::temp_directory_path() / ("asbuilt-plate-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder);
  }
  void TearDown() override { fs::remove_all(folder); }
  Result<Done<CalibrationRequest>> load(const std::string& name = "captures.yaml") const { return load_captures(folder / name, {false, "2026-11-20"}); }
  std::string text() const { return *read_file(folder / "captures.yaml", "captures"); }
  std::string code_of(std::string yaml) const {
    std::ofstream(folder / "other.yaml", std::ios::binary) << yaml;
    const auto r = load("other.yaml");
    return r ? "" : r.error().front().code;
  }
  static std::string with(std::string text, const std::string& a, const std::string& b) {
    const auto at = text.find(a);
    EXPECT_NE(at, std::string::npos) << a;
    return text.replace(at, a.size(), b);
  }
  /// Errors of the calibration at points of the plate, in base, in sd of the covariance as written.
  static double worst_z(const simulate::ProfilometerCell& c, const ProfilometerResult& r) {
    double worst = 0;
    for (double u : {0.2, 0.5, 0.8})
      for (double v : {0.35, 0.5, 0.65}) {
        Vec2 pair(u * c.device.width_px, v * c.device.height_px);
        Vec3 truth;
        if (c.device.is_metric) {
          const Vec3 at((u - 0.5) * 60, 0, (v - 0.5) * 60);
          EXPECT_TRUE(simulate::project(c.device, {at.x(), at.z()}, pair));
          truth = c.T_flange_sensor.point(at);
        } else {
          truth = flange_point(rig::truth_of(c), pair);
        }
        const Vec3 p = profile_point(r.map, pair);
        Eigen::Matrix<double, 3, 6> J;
        J << r.T_flange_sensor.rotation(), -r.T_flange_sensor.rotation() * skew(p);
        const Vec3 sd = ((J * r.covariance * J.transpose()).diagonal().array() + r.map.form_sd_mm * r.map.form_sd_mm).sqrt();
        worst = std::max(worst, (r.T_flange_sensor.point(p) - truth).cwiseQuotient(sd).cwiseAbs().maxCoeff());
      }
    return worst;
  }
};

TEST_F(PlateFiles, a_log_beside_the_profiles_gives_a_calibration_that_is_read_back_and_checked) {
  const auto c = rig::small_cell(11);
  const auto passes = rig::raw_passes(c);
  rig::write_captures(folder, c, passes, rig::scans_of(c, passes, 11), rig::PassFiles::csv_with_log);
  const auto job = load();
  ASSERT_TRUE(job) << job.error().front().where << ": " << job.error().front().message;
  EXPECT_EQ(job->artefact.captures.size(), passes.size());
  EXPECT_FALSE(job->artefact.is_profile_metric);
  const auto made = calibrate_hole_plate(job->artefact);
  ASSERT_TRUE(made) << made.error().front().code << " " << made.error().front().message;
  const ProfilometerResult& r = made->artefact;
  EXPECT_LT(worst_z(c, r), 4.5);
  EXPECT_NEAR(r.map.latency_s, c.latency_s, 5 * r.map.latency_sd_s + 1e-4);
  EXPECT_EQ(r.references.size(), passes.size());
  EXPECT_NE(hole_plate_report(job->artefact, r).find("accuracy"), std::string::npos);
  // the file
  CalibrationEntry e;
  e.id = "line", e.T_flange_sensor = r.T_flange_sensor, e.covariance = r.covariance, e.profile_map = r.map, e.created = job->artefact.taken, e.noise = r.noise_mm, e.references = r.references;
  std::ofstream(folder / "calibration.yaml", std::ios::binary) << calibration_yaml("cell.yaml", 30, e, "");
  const Refusals faults = check_file("calibration", folder / "calibration.yaml");
  ASSERT_TRUE(faults.empty()) << faults.front().where << " " << faults.front().message;
  const auto back = load_earlier(folder / "calibration.yaml", CalibrationRequest::Subject::sensor, false, "line");
  ASSERT_TRUE(back);
  ASSERT_TRUE(back->profile_map);
  for (const Vec2& uv : {Vec2(100, 200), Vec2(500, 300)}) EXPECT_LT((profile_point(*back->profile_map, uv) - profile_point(r.map, uv)).norm(), 1e-5);

  // the next day: one pass each way at a pose of the calibration, nothing moved; then the mount has slipped
  const std::vector<simulate::ProfilometerPass> monday(passes.begin(), passes.begin() + 2);
  for (const double moved_mm : {0.0, 0.2}) {
    auto now = c;
    now.moved_from = 0, now.moved_by << moved_mm * 0.6, moved_mm * 0.8, 0, 0, 0, 0;
    // the robot is off at these poses as it was when the references were taken
    Random robot = Random::stream(11, "robot"), noise = Random::stream(12, "noise");
    auto errors = simulate::robot_errors(c, passes, robot);
    std::vector<ProfileScan> scans;
    for (std::size_t i = 0; i < monday.size(); ++i) scans.push_back(simulate::scanned(now, monday[i], int(i), errors[i], noise));
    rig::write_captures(folder, now, monday, scans, rig::PassFiles::csv_with_log, "monday.yaml");
    auto check = load("monday.yaml");
    ASSERT_TRUE(check) << check.error().front().message;
    auto poses = plate_poses(check->artefact, *back);
    ASSERT_TRUE(poses) << poses.error().front().message;
    poses->artefact.repeat_sd_mm = 0.01, poses->artefact.repeat_sd_rad = 2e-5;
    const auto said = check_calibration(poses->artefact, *back);
    if (moved_mm == 0) {
      ASSERT_TRUE(said) << said.error().front().message;
      EXPECT_TRUE(said->artefact.lines.front().is_same_pose);
      EXPECT_GT(said->artefact.probability_ratio, 1e-3);
    } else {
      ASSERT_FALSE(said);
      EXPECT_EQ(said.error().front().code, "calibrate.sensor_moved");
      EXPECT_NEAR(said.error().front().measured, 0.2, 0.08);
    }
  }
  auto no_map = *back;
  no_map.profile_map.reset();
  EXPECT_EQ(plate_poses(job->artefact, no_map).error().front().code, "calibrate.no_reference");
}

TEST_F(PlateFiles, clouds_of_a_device_that_delivers_mm_keep_its_own_frame) {
  auto c = rig::small_cell(12);
  c.device.is_metric = true, c.device.noise_px = 0.02, c.device.scale_z_ratio = 1 / 1.02, c.device.form_mm = 0.02;
  const auto passes = rig::raw_passes(c);
  rig::write_captures(folder, c, passes, rig::scans_of(c, passes, 12), rig::PassFiles::ply_with_velocity);
  const auto job = load();
  ASSERT_TRUE(job) << job.error().front().where << ": " << job.error().front().message;
  EXPECT_TRUE(job->artefact.is_profile_metric);
  const auto made = calibrate_hole_plate(job->artefact);
  ASSERT_TRUE(made) << made.error().front().code << " " << made.error().front().message;
  EXPECT_LT(worst_z(c, made->artefact), 4.5);
  // the frame is the device's: what it calls x, z is nearly what the map says, up to the scale that was wrong
  for (const Vec2& xz : {Vec2(-20, -15), Vec2(25, 20)}) EXPECT_LT((profile_point(made->artefact.map, xz) - Vec3(xz.x(), 0, xz.y())).norm(), 0.02 * 40 + 0.2);
  EXPECT_LT((made->artefact.T_flange_sensor.p_mm - c.T_flange_sensor.p_mm).norm(), 1.5);
}

TEST_F(PlateFiles, faults_of_the_files_are_named) {
  const auto c = rig::small_cell(13);
  auto passes = rig::raw_passes(c, false);
  passes.resize(1);
  rig::write_captures(folder, c, passes, rig::scans_of(c, passes, 13), rig::PassFiles::csv_with_log);
  const std::string good = text();
  EXPECT_EQ(code_of(good), "");
  EXPECT_EQ(code_of(with(good, ", robot_log: captures_0_log.csv", "")), "input.missing_key");
  EXPECT_EQ(code_of(with(good, ", robot_log: captures_0_log.csv", ", base_flange: {xyz: [500, 0, 500], zyx: [0, 0, 0]}")), "input.pass_without_way");
  EXPECT_EQ(code_of(with(good, "profiles: captures_0.csv, ", "")), "input.capture_empty");
  EXPECT_EQ(code_of(with(good, "along_x: [8, 4]", "along_x: [12, 4]")), "input.out_of_range");
  EXPECT_EQ(code_of(with(good, "along_x: [8, 4]", "along_x: [5, 4]")), "input.out_of_range");
  EXPECT_EQ(code_of(with(good, ", cone: 120.0000", "")), "input.missing_key");
  std::ofstream(folder / "short.csv") << "t,x,y,z,qw,qx,qy,qz\n0,900,0,700,1,0,0,0\n0.5,900,10,700,1,0,0,0\n";
  EXPECT_EQ(code_of(with(good, "captures_0_log.csv", "short.csv")), "input.log_does_not_cover");
  EXPECT_EQ(code_of(good + "poses: {file: short.csv, xyz: [x, y, z], quat: [qw, qx, qy, qz]}\n"), "input.not_for_this_target");
  std::ofstream(folder / "back.xyz") << "0 0 100\n1 0 100\n0 5 100\n0 2 100\n";
  EXPECT_EQ(code_of(with(good, "profiles: captures_0.csv, robot_log: captures_0_log.csv", "cloud: back.xyz, base_flange: {xyz: [500, 0, 500], zyx: [0, 0, 0]}, velocity: [0, 40, 0]")), "input.profile_clock");
  // a plate before something that is no line scanner
  const auto job = load();
  ASSERT_TRUE(job);
  auto camera = job->artefact;
  camera.is_profile_sensor = false;
  EXPECT_EQ(calibrate_hole_plate(camera).error().front().code, "calibrate.target_not_supported");
  EXPECT_EQ(plate_poses(camera, {}).error().front().code, "calibrate.target_not_supported");
  EXPECT_EQ(calibrate_hole_plate(job->artefact).error().front().code, "calibrate.too_few_poses");
}

}  // namespace
}  // namespace asbuilt
