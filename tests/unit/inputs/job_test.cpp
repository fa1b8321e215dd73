// SPDX-License-Identifier: GPL-3.0-or-later
// From files to a Job: units, order, hashes, paths, meshes as CAD, robots by URDF. The batch is the small one of tests/refuse.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "planner/base/archive.hpp"
#include "planner/inputs/inputs.hpp"
#include "planner/robot/robot.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;

std::string text_of(const Refusals& all) {
  std::string text;
  for (const Refusal& r : all) text += r.code + " | " + r.where + " | " + r.message + "\n";
  return text;
}

struct JobTest : testing::Test {
  fs::path folder = fs::path(testing::TempDir()) / ("asbuilt_job_" + std::to_string(getpid()));
  void SetUp() override {
    fs::remove_all(folder);
    fs::copy("tests/refuse/base", folder, fs::copy_options::recursive);
  }
  void TearDown() override { fs::remove_all(folder); }

  std::string read(const std::string& file) const {
    std::ifstream in(folder / file, std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  void write(const std::string& file, const std::string& text) const { std::ofstream(folder / file, std::ios::binary) << text; }
  void edit(const std::string& file, const std::string& old, const std::string& now) const {
    const std::string text = read(file);
    const std::size_t at = text.find(old);
    ASSERT_NE(at, std::string::npos) << file << ": " << old;
    write(file, text.substr(0, at) + now + text.substr(at + old.size()));
  }
  Job load(const InputsRecipe& recipe = {}, const std::string& item = "slot-1") const {
    const auto batch = load_batch(folder / "batch.yaml", recipe);
    EXPECT_TRUE(batch) << text_of(batch.error());
    if (!batch) return {};
    const auto job = load_job(batch->artefact, item, recipe);
    EXPECT_TRUE(job) << text_of(job.error());
    return job ? job->artefact : Job{};
  }
  std::string hash(const InputsRecipe& recipe = {}) const {
    const auto batch = load_batch(folder / "batch.yaml", recipe);
    return batch ? job_inputs_hash(batch->artefact, "slot-1", recipe) : "";
  }
};

TEST_F(JobTest, values_come_out_in_mm_and_rad) {
  const Job j = load();
  EXPECT_EQ(j.batch_id, "night");
  EXPECT_NEAR(j.cell.robot.joints[4].max_rad, rad_from_deg(122), 1e-12);
  EXPECT_NEAR(std::get<OpwParameters>(j.cell.robot.kinematics).offsets_rad[1], -kPi / 2, 1e-12);
  EXPECT_NEAR(j.cell.robot.home_rad[2], rad_from_deg(100), 1e-12);
  EXPECT_EQ(j.cell.robot.accuracy.short_term.mean_mm, 0.07);  // as repeatability where absent
  EXPECT_EQ(j.cell.sensors[0].working_distance_mm, 575);      // the middle of the range where absent
  EXPECT_NEAR(j.cell.tools[0].cutter.included_angle_rad, kPi / 2, 1e-12);
  EXPECT_EQ(j.cell.tools[0].T_flange_tool.p_mm.z(), 350.11);  // calibrated, not nominal
  EXPECT_EQ(j.cell.sensors[0].T_flange_sensor.p_mm.x(), -150.3);
  EXPECT_TRUE(j.cell.sensors[0].is_calibrated);
  EXPECT_EQ(j.cell.sensors[0].covariance(1, 3), 5e-6);
  EXPECT_FALSE(j.fixture.play_rad[2].has_value());
  EXPECT_NEAR(*j.fixture.play_rad[0], rad_from_deg(1), 1e-12);
  EXPECT_NEAR(j.recipes[0].cone_rad, rad_from_deg(30), 1e-12);
  ASSERT_EQ(j.part.features.size(), 2u);
  EXPECT_EQ(j.part.features[0].edges.size(), 2u);
  for (const FeatureSpec& f : j.part.features)
    for (const int e : f.edges) EXPECT_EQ(j.part.brep.edges[std::size_t(e)].kind, EdgeKind::sharp_convex);
  ASSERT_EQ(j.captures.size(), 2u);
  EXPECT_EQ(j.captures[0].points_sensor.size(), 5u);
  EXPECT_EQ(j.captures[0].dropped_count, 1u);
  EXPECT_EQ(j.captures[1].name, "wide_01.xyz");
  EXPECT_EQ(*j.captures[1].feature, "rim");
  // The obstacle stands where its pose says.
  EXPECT_LT((j.cell.obstacles[0].mesh_base.box().min_mm - Vec3(1220, 0, 615)).norm(), 1e-9);
  EXPECT_EQ(j.cell.obstacles[0].name, "block");
}

TEST_F(JobTest, joints_become_the_flange_they_reach) {
  const Job j = load();
  ASSERT_TRUE(j.captures[0].q_rad);
  const auto robot = Robot::from(j.cell.robot);
  ASSERT_TRUE(robot);
  const auto T = robot->forward(*j.captures[0].q_rad);
  EXPECT_LT((j.captures[0].T_base_flange.p_mm - T.p_mm).norm(), 1e-9);
  EXPECT_GT(T.p_mm.norm(), 500);
  // The same capture written as a pose.
  std::string rows;
  for (int r = 0; r < 3; ++r) {
    rows += "[";
    for (int c = 0; c < 3; ++c) rows += std::to_string(T.rotation()(r, c)) + ", ";
    rows += std::to_string(T.p_mm[r]) + "], ";
  }
  edit("slot-1/scans.yaml", "{joints: [-10, -76, 97, 9, 86, -151]}", "{matrix: [" + rows + "[0, 0, 0, 1]]}");
  EXPECT_LT((load().captures[0].T_base_flange.p_mm - T.p_mm).norm(), 1e-5);
}

TEST_F(JobTest, inputs_are_all_files_sorted) {
  const Job j = load();
  std::vector<std::string> names;
  for (const InputFile& f : j.inputs) {
    names.push_back(f.path);
    EXPECT_EQ(f.sha256.size(), 64u);
  }
  EXPECT_EQ(names, (std::vector<std::string>{"calibration.yaml", "cell.yaml", "deburr.yaml", "fixture.yaml", "meshes/block.stl",
                                             "part.yaml", "slot-1/scans.yaml", "slot-1/wide_00.ply", "slot-1/wide_01.xyz", "slot.step"}));
}

TEST_F(JobTest, the_hash_follows_every_byte_and_nothing_else) {
  const std::string before = hash();
  EXPECT_EQ(hash(), before);
  for (const InputFile& f : load().inputs) {
    const std::string text = read(f.path);
    write(f.path, text + "\n");
    EXPECT_NE(hash(), before) << f.path;
    write(f.path, text);
    EXPECT_EQ(hash(), before) << f.path;
  }
  // Another item in the batch is another item's business; an override of this one is not.
  const std::string batch = read("batch.yaml");
  write("batch.yaml", batch + "  - {id: slot-2, part: part.yaml, fixture: fixture.yaml, scans: nowhere.yaml}\n");
  EXPECT_EQ(hash(), before);
  write("batch.yaml", batch);
  edit("batch.yaml", "scans.yaml}", "scans.yaml, overrides: [{edge: \"#43\", name: N, reason: r, expires: 2026-12-01}]}");
  EXPECT_NE(hash(), before);
  EXPECT_EQ(load().overrides.size(), 1u);
  write("batch.yaml", batch);
  // Today counts only where the scans name no day.
  EXPECT_EQ(hash({.today = "2026-11-23"}), before);
  edit("slot-1/scans.yaml", "taken: 2026-11-22\n", "");
  EXPECT_NE(hash({.today = "2026-11-23"}), hash({.today = "2026-11-24"}));
  EXPECT_EQ(load({.today = "2026-11-23"}).taken, "2026-11-23");
}

TEST_F(JobTest, one_bad_item_does_not_stop_the_others) {
  write("batch.yaml", read("batch.yaml") + "  - {id: slot-2, part: nowhere.yaml, fixture: fixture.yaml, scans: slot-1/scans.yaml}\n");
  EXPECT_EQ(load().part.id, "slot");
  const auto batch = load_batch(folder / "batch.yaml", {});
  const auto job = load_job(batch->artefact, "slot-2", {});
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error()[0].code, "input.file_missing");
  EXPECT_EQ(job.error()[0].where, "batch.yaml:8: items[1].part");
}

TEST_F(JobTest, the_job_survives_the_store) {
  const Job j = load();
  const std::string bytes = to_bytes(j);
  EXPECT_EQ(to_bytes(from_bytes<Job>(bytes)), bytes);
  EXPECT_EQ(to_bytes(load()), bytes);
}

TEST_F(JobTest, a_link_out_of_the_folder_is_outside) {
  fs::create_directories(folder.string() + "_other");
  fs::copy_file(folder / "meshes/block.stl", folder.string() + "_other/block.stl", fs::copy_options::overwrite_existing);
  fs::create_directory_symlink(folder.string() + "_other", folder / "aside");
  edit("fixture.yaml", "meshes/block.stl", "aside/block.stl");
  const auto batch = load_batch(folder / "batch.yaml", {});
  const auto job = load_job(batch->artefact, "slot-1", {});
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error()[0].code, "input.path_outside");
  EXPECT_EQ(load({.allow_outside = true}).fixture.mesh_fixture.triangles.size(), 12u);
  fs::remove_all(folder.string() + "_other");
}

TEST_F(JobTest, a_mesh_is_cad_with_its_unit) {
  edit("part.yaml", "cad: slot.step", "cad: meshes/block.stl\nunits: mm");
  edit("part.yaml", "[[0, -15, 10], [0, 15, 10]]", "[[50, 0, 60], [50, 80, 60]]");
  edit("part.yaml", "{near: [[35, 0, 10], [-35, 0, 10]]}", "{sharp_convex: {box: [[-1, -1, -1], [101, 81, 1]]}}");
  const Job mm = load();
  EXPECT_NEAR(mm.part.brep.volume_mm3, 100 * 80 * 60, 1e-3);
  EXPECT_EQ(mm.part.features[0].edges.size(), 2u);
  EXPECT_EQ(mm.part.features[1].edges.size(), 4u);
  // The same numbers in inches: everything grows, and the points of the part file stay mm.
  edit("part.yaml", "units: mm", "units: inch");
  edit("part.yaml", "[[50, 0, 60], [50, 80, 60]]", "[[1270, 0, 1524], [1270, 2032, 1524]]");
  edit("part.yaml", "[101, 81, 1]", "[2600, 2100, 1]");
  EXPECT_NEAR(load().part.brep.volume_mm3, 100 * 80 * 60 * 25.4 * 25.4 * 25.4, 10);
}

TEST_F(JobTest, edges_by_face_and_by_id) {
  const Job j = load();
  const Brep& b = j.part.brep;
  const BrepEdge& rim = b.edges[std::size_t(j.part.features[0].edges[0])];
  const std::string top =
      b.faces[std::size_t(std::abs(b.faces[std::size_t(rim.face_1)].box.min_mm.z() - 10) < 1e-6 ? rim.face_1 : rim.face_2)].id;
  edit("part.yaml", "{near: [[0, -15, 10], [0, 15, 10]]}", "{faces: [\"" + top + "\"]}");
  edit("part.yaml", "{near: [[35, 0, 10], [-35, 0, 10]]}", "{sharp_convex: {box: [[-50, -50, -1], [50, 50, 1]]}}");
  const Job k = load();
  EXPECT_EQ(k.part.features[0].edges.size(), 4u);  // all round the top
  EXPECT_EQ(k.part.features[1].edges.size(), 4u);  // all round the bottom, not the tangent seams between
  edit("part.yaml", "{faces: [\"" + top + "\"]}", "{step: [\"" + rim.id + "\"]}");
  EXPECT_EQ(load().part.features[0].edges, std::vector<int>{j.part.features[0].edges[0]});
}

class RealRobot : public JobTest, public testing::WithParamInterface<const char*> {};
TEST_P(RealRobot, drives_a_cell_by_its_urdf) {
  const std::string name = GetParam();
  const fs::path urdf = fs::absolute(fs::path("../shared/data/robots") / name / (name + ".urdf"));
  if (!fs::exists(urdf)) GTEST_SKIP() << "no " << urdf;
  const std::string cell = read("cell.yaml");
  const std::size_t opw = cell.find("    opw:"), joints = cell.find("  joints:\n"), links = cell.find("  links:\n"),
                    home = cell.find("  home:");
  std::string limits;
  for (int i = 0; i < 6; ++i) limits += "    - {min: -100, max: 100, speed: 120, acceleration: 350, jerk: 2500}\n";
  write("cell.yaml",
        cell.substr(0, opw) + "    {urdf: " + urdf.string() + ", base: base_link, tip: tool0}\n  joints:\n" + limits + cell.substr(home));
  (void)joints, (void)links;
  edit("cell.yaml", "[0, -100, 100, 0, 90, 0]", "[0, 0, 0, 0, 0, 0]");
  edit("slot-1/scans.yaml", "[-10, -76, 97, 9, 86, -151]", "[0, 10, 20, 0, 30, 0]");
  const Job j = load({.allow_outside = true});
  ASSERT_EQ(std::get<ChainKinematics>(j.cell.robot.kinematics).joints.size(), 6u);
  ASSERT_GE(j.cell.robot.links.size(), 7u);
  std::set<int> moving;
  Box3 all;
  for (const LinkMesh& l : j.cell.robot.links) {
    moving.insert(l.joint);
    all.extend(l.mesh.box().min_mm), all.extend(l.mesh.box().max_mm);
  }
  EXPECT_EQ(moving.size(), 7u);
  EXPECT_GT(all.diagonal_mm(), 700);
  EXPECT_LT(all.diagonal_mm(), 4500);
  // Neighbouring links touch: each link's box meets the box of the link before it, grown by 60 mm.
  for (std::size_t i = 1; i < j.cell.robot.links.size(); ++i) {
    const Box3 a = j.cell.robot.links[i - 1].mesh.box(), b = j.cell.robot.links[i].mesh.box();
    EXPECT_TRUE((a.min_mm.array() - 60 <= b.max_mm.array()).all() && (b.min_mm.array() - 60 <= a.max_mm.array()).all())
        << name << " link " << i;
  }
  EXPECT_GT(j.captures[0].T_base_flange.p_mm.norm(), 300);
}
INSTANTIATE_TEST_SUITE_P(Inputs, RealRobot,
                         testing::Values("kuka_kr16_2", "kuka_kr120_r2700_2", "motoman_gp12", "motoman_gp25", "abb_irb2400",
                                         "staubli_rx160", "fanuc_m10ia", "motoman_hc10"));

TEST_F(JobTest, a_cell_loads_by_itself) {
  const auto cell = load_cell(folder / "cell.yaml", {});
  ASSERT_TRUE(cell) << text_of(cell.error());
  EXPECT_EQ(cell->artefact.tools[0].T_flange_tool.p_mm.z(), 350);
  EXPECT_TRUE(check_file("cell", folder / "cell.yaml").empty());
  EXPECT_EQ(check_file("part", folder / "cell.yaml").at(0).code, "input.wrong_kind");
  EXPECT_EQ(check_file("nothing", folder / "cell.yaml").at(0).code, "input.wrong_kind");
}

}  // namespace
}  // namespace asbuilt
