// SPDX-License-Identifier: GPL-3.0-or-later
// From a captures file to a calibration file that the planner reads; tables as other programs write them; every fault of both.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "planner/base/number.hpp"
#include "planner/base/random.hpp"
#include "planner/calibrate/calibrate.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/inputs/table.hpp"
#include "planner/io/file.hpp"
#include "tests/support/calibrate_jobs.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;
using testing_calibrate::make_job;
using testing_calibrate::TrueJob;

class CalibrateFiles : public ::testing::Test {
 protected:
  fs::path folder;
  void SetUp() override {
    folder = fs::temp_directory_path() / ("asbuilt-files-" + std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder);
    fs::create_directories(folder);
    put("cell.yaml", *read_file("tests/refuse/base/cell.yaml", "cell"));
  }
  void TearDown() override { fs::remove_all(folder); }
  void put(const std::string& name, const std::string& text) const { std::ofstream(folder / name, std::ios::binary) << text; }
  Result<Done<CalibrationRequest>> read(const std::string& yaml) const {
    put("captures.yaml", yaml);
    return load_captures(folder / "captures.yaml", {false, "2026-11-20"});
  }
  std::string first_code(const std::string& yaml) const {
    const auto r = read(yaml);
    return r ? "" : r.error().front().code;
  }
};

std::string pose_text(const Pose<frame::Base, frame::Flange>& T) {
  return "{xyz: [" + shortest_number(T.p_mm.x()) + ", " + shortest_number(T.p_mm.y()) + ", " + shortest_number(T.p_mm.z()) + "], quat: [" + shortest_number(T.q.w()) + ", " + shortest_number(T.q.x()) + ", " +
         shortest_number(T.q.y()) + ", " + shortest_number(T.q.z()) + "]}";
}

TEST_F(CalibrateFiles, captures_to_a_calibration_that_the_planner_reads) {
  const TrueJob j = make_job({.seed = 2, .captures_count = 14});
  std::string yaml = "asbuilt: captures/1\ncell: cell.yaml\nsensor: wide\ntaken: 2026-11-18\nvalid_days: 20\nnoise: 0.01\nrobot_sd: {position: 0.05, turn: 0.006}\n"
                     "target: {kind: balls, diameter: 8.731, centers: [[0, 0, 0], [31, 4, 1], [8, 27, -2], [24, 20, 13]]}\ncaptures:\n";
  for (std::size_t k = 0; k < j.request.captures.size(); ++k) {
    std::string cloud;
    for (const Vec3& p : j.request.captures[k].points_mm) cloud += fixed_number(p.x(), 5) + " " + fixed_number(p.y(), 5) + " " + fixed_number(p.z(), 5) + "\n";
    const std::string name = "c" + std::to_string(k) + ".xyz";
    put(name, cloud);
    yaml += "  - {cloud: " + name + ", base_flange: " + pose_text(j.request.captures[k].T_base_flange) + "}\n";
  }
  const auto job = read(yaml);
  ASSERT_TRUE(job.has_value()) << job.error().front().where << ": " << job.error().front().message;
  EXPECT_EQ(job->artefact.captures.size(), 14u);
  EXPECT_EQ(job->artefact.inputs.size(), 16u);  // captures, cell, clouds
  const auto made = calibrate(job->artefact);
  ASSERT_TRUE(made.has_value()) << made.error().front().message;
  const CalibrationResult& r = made->artefact;
  CalibrationEntry e;
  e.id = "wide", e.T_flange_sensor = r.T_flange_sensor, e.covariance = r.covariance, e.rms_mm = r.accuracy_mm, e.captures_count = 14, e.created = job->artefact.taken;
  e.held_out_mm = r.accuracy_mm, e.fit_rms = r.solved.fit_rms, e.noise = r.solved.solution.sensor_sd, e.files = job->artefact.inputs, e.references = r.references, e.dof = r.solved.solution.dof;
  const std::string text = calibration_yaml("cell.yaml", 20, e, "");
  EXPECT_EQ(text, calibration_yaml("cell.yaml", 20, e, ""));
  put("calibration.yaml", text);
  const Refusals faults = check_file("calibration", folder / "calibration.yaml");
  EXPECT_TRUE(faults.empty()) << faults.front().where << " " << faults.front().message;
  // the entry read back is the entry written
  const auto back = load_earlier(folder / "calibration.yaml", CalibrationRequest::Subject::sensor, false, "wide");
  ASSERT_TRUE(back.has_value()) << back.error().front().message;
  EXPECT_LT((back->T_flange_sensor.p_mm - r.T_flange_sensor.p_mm).norm(), 1e-5);
  EXPECT_LT((back->covariance - r.covariance).norm(), 1e-5 * r.covariance.norm());
  EXPECT_EQ(back->references.size(), r.references.size());
  EXPECT_EQ(back->created, "2026-11-18");
  // a second sensor is added, the first carried on; the file is as old as its oldest entry
  CalibrationEntry other = e;
  other.id = "detail", other.created = "2026-12-01";
  const std::string both = calibration_yaml("cell.yaml", 20, other, text);
  put("both.yaml", both);
  EXPECT_TRUE(check_file("calibration", folder / "both.yaml").empty());
  const auto first = load_earlier(folder / "both.yaml", CalibrationRequest::Subject::sensor, false, "wide");
  ASSERT_TRUE(first.has_value());
  EXPECT_EQ(first->T_flange_sensor.p_mm, back->T_flange_sensor.p_mm);
  EXPECT_NE(both.find("created: '2026-11-18'"), std::string::npos);
  CalibrationEntry tool = e;
  tool.subject = CalibrationRequest::Subject::tool, tool.id = "cone-90";
  put("three.yaml", calibration_yaml("cell.yaml", 20, tool, both));
  EXPECT_TRUE(check_file("calibration", folder / "three.yaml").empty());
  CalibrationEntry fixed = e;
  fixed.is_sensor_fixed = true, fixed.id = "ceiling";
  put("four.yaml", calibration_yaml("cell.yaml", 20, fixed, both));
  EXPECT_TRUE(check_file("calibration", folder / "four.yaml").empty());
  EXPECT_TRUE(load_earlier(folder / "four.yaml", CalibrationRequest::Subject::sensor, true, "ceiling").has_value());
  const auto none = load_earlier(folder / "both.yaml", CalibrationRequest::Subject::tool, false, "cone-90");
  ASSERT_FALSE(none.has_value());
  EXPECT_EQ(none.error().front().code, "input.not_in_calibration");
}

/// Any bytes in a table of poses or points: an answer or a refusal that names the file, never anything else.
TEST_F(CalibrateFiles, any_bytes_in_the_tables) {
  const std::string poses = "name;x;y;z;qw;qx;qy;qz\na;1000,5;2;900;1;0;0;0\nb;1010;4,25E1;905;0,7071;0,7071;0;0\nc;990;-3;910;0.7071;0;0.7071;0\n";
  const std::string profile = "x,z\n1.5,200\n2.5,nan\n3.5,201\n4.5,202.25\n";
  const std::string yaml = "asbuilt: captures/1\ncell: cell.yaml\nsensor: wide\ntarget: {kind: ball, diameter: 30}\nposes: {file: poses.csv, name: name, xyz: [x, y, z], quat: [qw, qx, qy, qz], profiles: p.csv}\n";
  Random random(17);
  int good = 0, refused = 0;
  for (int round = 0; round < 400; ++round) {
    std::string a = poses, b = profile;
    std::string& hit = round % 2 ? a : b;
    const int cuts = 1 + int(random.below(4));
    for (int k = 0; k < cuts; ++k) {
      const std::size_t at = random.below(hit.size());
      switch (random.below(5)) {
        case 0: hit[at] = char(random.below(256)); break;
        case 1: hit.erase(at, 1 + random.below(5)); break;
        case 2: hit.insert(at, std::string(1 + random.below(3), char(random.below(256)))); break;
        case 3: hit.insert(at, "1e999"); break;
        default: hit = hit.substr(0, at) + hit.substr(at / 2);
      }
      if (hit.empty()) hit = ",";
    }
    put("poses.csv", a), put("p.csv", b);
    const auto r = read(yaml);
    if (r) {
      ++good;
      for (const TargetCapture& c : r->artefact.captures) {
        EXPECT_TRUE(c.T_base_flange.p_mm.allFinite());
        for (const Vec3& p : c.points_mm) EXPECT_TRUE(p.allFinite());
      }
    } else {
      ++refused;
      EXPECT_FALSE(r.error().front().where.empty());
      EXPECT_FALSE(r.error().front().message.empty());
    }
  }
  EXPECT_GT(good, 20);
  EXPECT_GT(refused, 100);
}

TEST_F(CalibrateFiles, tables_as_other_programs_write_them) {
  const inputs::Table german = inputs::parse_table(std::string("x;y;z\n1,5;-2,25E-01;\n") + std::string(2, '\0') + "3;4;nan\r\n", "t");
  EXPECT_TRUE(german.has_decimal_comma);
  EXPECT_EQ(german.nul_count, 2u);
  ASSERT_EQ(german.rows.size(), 2u);
  EXPECT_EQ(*german.number(0, 0), 1.5);
  EXPECT_EQ(*german.number(0, 1), -0.225);
  EXPECT_TRUE(std::isnan(*german.number(0, 2)));
  EXPECT_TRUE(std::isnan(*german.number(1, 2)));
  const inputs::Table plain = inputs::parse_table("# made by hand\n 1.5  2 3 \n4 5 x\n", "t");
  EXPECT_TRUE(plain.header.empty());
  EXPECT_EQ(*plain.column("2"), 1u);
  EXPECT_EQ(*plain.number(0, 1), 2);
  EXPECT_FALSE(plain.number(1, 2).has_value());
  EXPECT_EQ(plain.lines[1], 3);
  EXPECT_FALSE(plain.column("4").has_value());
}

TEST_F(CalibrateFiles, every_fault_is_named) {
  const std::string head = "asbuilt: captures/1\ncell: cell.yaml\n";
  const std::string poses = "poses: {file: t.csv, xyz: [x, y, z], quat: [w, a, b, c], sensor_xyz: [x, y, z], sensor_quat: [w, a, b, c]}\n";
  put("t.csv", "x,y,z,w,a,b,c\n1000,2,3,1,0,0,0\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\n" + poses), "");
  EXPECT_EQ(first_code(head + "sensor: narrow\ntarget: {kind: pose}\n" + poses), "input.unknown_sensor");
  EXPECT_EQ(first_code(head + "sensor: narrow\nmount: base\ntarget: {kind: pose}\n" + poses), "");
  EXPECT_EQ(first_code(head + "tool: saw\ntarget: {kind: pose}\n" + poses), "input.unknown_tool");
  EXPECT_EQ(first_code(head + "tool: cone-90\nmount: base\ntarget: {kind: pose}\n" + poses), "input.mount_of_tool");
  EXPECT_EQ(first_code(head + "robot: seven axes\ntarget: {kind: pose}\n" + poses), "input.unknown_robot");
  EXPECT_EQ(first_code(head + "robot: six axes\ntarget: {kind: pose}\n" + poses), "input.capture_empty");  // no joints
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: plane}\n" + poses), "input.capture_empty");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\n"), "input.missing_key");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\nposes: {file: t.csv, xyz: [x, y, q], quat: [w, a, b, c]}\n"), "input.table_columns");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\nposes: {file: t.csv, xyz: [x, y, z]}\n"), "input.table_columns");
  put("t.csv", "x,y,z,w,a,b,c\n1000,2,three,1,0,0,0\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\n" + poses), "input.table_value");
  put("t.csv", "x,y,z,w,a,b,c\n1000,2,3,0.5,0,0,0\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: pose}\n" + poses), "input.bad_rotation");
  put("p.csv", "# nothing\n");
  const std::string one = "captures:\n  - {profiles: p.csv, base_flange: {xyz: [1000, 0, 500], quat: [1, 0, 0, 0]}}\n";
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: ball, diameter: 80}\n" + one), "input.table_empty");
  put("p.csv", "1\n2\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: ball, diameter: 80}\n" + one), "input.table_columns");
  put("p.csv", "1,2\n2,z\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: ball, diameter: 80}\n" + one), "input.table_value");
  put("k.csv", "id,u,v\n0,1,1\n0,2,2\n");
  EXPECT_EQ(first_code(head + "sensor: wide\ntarget: {kind: checkerboard, columns: 4, rows: 3, pitch: 10}\ncaptures:\n  - {points: k.csv, base_flange: {xyz: [1000, 0, 500], quat: [1, 0, 0, 0]}}\n"), "input.table_value");
}

}  // namespace
}  // namespace asbuilt
