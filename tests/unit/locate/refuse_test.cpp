// SPDX-License-Identifier: GPL-3.0-or-later
// Every refusal of the location, provoked.
#include <gtest/gtest.h>

#include "planner/fuse/fuse.hpp"
#include "planner/locate/gates.hpp"
#include "planner/locate/locate.hpp"
#include "tests/unit/locate/synthetic.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

std::string code_of(const Job& job, std::string* message = nullptr) {
  const auto cloud = fuse({}, job);
  if (!cloud) return cloud.error().front().code;
  const auto found = locate({}, job, cloud->artefact);
  if (message && !found) *message = found.error().front().message;
  return found ? "" : found.error().front().code;
}

Job ring_job(PartSpec part) {
  add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
  return make_job(std::move(part), true);
}

std::vector<View> ring_views(bool with_sides = true) { return usual_views({{"lug1", Vec3(105, 105, 40)}}, with_sides); }

TEST(LocateRefuses, a_scan_of_another_part) {
  Job job = ring_job(make_ring());
  const PartSpec other = make_bracket();
  ScanOptions o;
  o.scanned_part = &other;
  scan(job, ring_views(), o);
  EXPECT_EQ(code_of(job), "locate.no_match");
}

TEST(LocateRefuses, a_mirrored_scan) {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0"});
  Job job = make_job(std::move(part), true);
  const PartSpec mirrored = make_bracket(true);
  ScanOptions o;
  o.scanned_part = &mirrored;
  scan(job, usual_views({{"front", Vec3(78, -20, 34)}}), o);
  EXPECT_EQ(code_of(job), "locate.no_match");
}

TEST(LocateRefuses, an_empty_fixture) {
  Job job = ring_job(make_ring());
  const PartSpec small = make_part({{0, 12}}, 5, 1);
  ScanOptions o;
  o.scanned_part = &small;
  scan(job, ring_views(), o);
  EXPECT_EQ(code_of(job), "locate.no_match");
}

TEST(LocateRefuses, a_ring_whose_lugs_are_alike) {
  Job job = ring_job(make_ring(8, 0));
  ScanOptions o;
  o.play = {quat_from_zyx(0.3, 0, 0), Vec3::Zero()};
  scan(job, ring_views(), o);
  EXPECT_EQ(code_of(job), "locate.ambiguous");
}

TEST(LocateRefuses, a_ring_whose_lugs_are_missing) {
  Job job = ring_job(make_ring());
  const PartSpec plain = make_ring(0);
  ScanOptions o;
  o.scanned_part = &plain;
  scan(job, ring_views(), o);
  const std::string code = code_of(job);
  EXPECT_TRUE(code == "locate.ambiguous" || code == "locate.no_match") << code;
}

TEST(Locate, accepts_lugs_that_are_alike_where_all_are_worked) {
  PartSpec part = make_ring(8, 0);
  std::vector<std::string> ids;
  for (int i = 0; i < 8; ++i)
    for (int j = 0; j < 3; ++j) ids.push_back("top-" + std::to_string(4 * i + j));
  add_feature(part, "lugs", ids);
  Job job = make_job(std::move(part), true);
  ScanOptions o;
  o.play = {quat_from_zyx(0.3, 0, 0), Vec3::Zero()};
  scan(job, usual_views({{"lugs", Vec3(105, 105, 40)}}), o);
  std::string message;
  EXPECT_EQ(code_of(job, &message), "") << message;
}

TEST(LocateRefuses, flat_top_views_of_a_ring) {
  Job job = ring_job(make_ring());
  ScanOptions o;
  o.wide_pixels = 200;
  std::vector<View> views = ring_views(false);
  views.resize(4);
  scan(job, views, o);
  // A sensor straight above sees the top and the table, no side.
  for (Capture& c : job.captures) {
    const auto T = job.fixture.T_base_fixture.inverse() * c.T_base_flange * job.cell.sensors[0].T_flange_sensor;
    std::erase_if(c.points_sensor, [&](const Eigen::Vector3f& p) { return std::abs(T.point(p.cast<double>()).z() - 30) < 29; });
  }
  std::string message;
  EXPECT_EQ(code_of(job, &message), "locate.unobservable") << message;
  EXPECT_NE(message.find(" axis"), std::string::npos) << message;
}

TEST(LocateRefuses, a_hand_eye_that_is_off) {
  for (const Vec3& fault : {Vec3(1.5, 0, 0), Vec3(0, 1.5, 0), Vec3(0, 0, 1.5)}) {
    Job job = ring_job(make_ring());
    ScanOptions o;
    o.detail_hand_eye_fault_mm = fault;
    scan(job, ring_views(), o);
    std::string message;
    EXPECT_EQ(code_of(job, &message), "locate.captures_contradict") << fault.transpose() << " " << message;
    EXPECT_NE(message.find("detail_"), std::string::npos) << message;
  }
}

TEST(LocateRefuses, a_part_outside_the_play) {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0"});
  Job job = make_job(std::move(part), false);
  ScanOptions o;
  o.play = {Eigen::Quaterniond::Identity(), Vec3(11, 0, 0)};
  scan(job, usual_views({{"front", Vec3(78, -20, 34)}}), o);
  std::string message;
  EXPECT_EQ(code_of(job, &message), "locate.outside_play") << message;
}

TEST(LocateRefuses, a_part_turned_beyond_the_play) {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0"});
  Job job = make_job(std::move(part), false);  // 4 deg about z
  ScanOptions o;
  o.play = {quat_from_zyx(rad_from_deg(5.5), 0, 0), Vec3::Zero()};
  scan(job, usual_views({{"front", Vec3(78, -20, 34)}}), o);
  std::string message;
  EXPECT_EQ(code_of(job, &message), "locate.outside_play") << message;
  EXPECT_NE(message.find("deg about its z axis"), std::string::npos) << message;
}

TEST(LocateRefuses, a_part_put_in_the_wrong_way_round) {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0"});
  Job job = make_job(std::move(part), false);
  ScanOptions o;
  o.play = {quat_from_zyx(rad_from_deg(135), 0, 0), Vec3::Zero()};
  scan(job, usual_views({{"front", Vec3(78, -20, 34)}}), o);
  std::string message;
  EXPECT_EQ(code_of(job, &message), "locate.no_match") << message;
  EXPECT_NE(message.find("The part is turned 13"), std::string::npos) << message;
  EXPECT_NE(message.find("deg about its z axis"), std::string::npos) << message;
}

TEST(LocateRefuses, an_adjustment_that_still_moves) {
  const Job job;
  Adjusted adjusted;
  adjusted.state.cluster_count = 1000, adjusted.state.step_mm = 0.05, adjusted.is_converged = false;
  const auto refusal = check_converged(job, adjusted);
  ASSERT_TRUE(refusal);
  EXPECT_EQ(refusal->code, "locate.not_converged");
  EXPECT_NE(refusal->message.find("0.050"), std::string::npos) << refusal->message;
  adjusted.is_converged = true;
  EXPECT_FALSE(check_converged(job, adjusted));
}

TEST(LocateRefuses, a_scan_too_thin_to_adjust) {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0"});
  Job job = make_job(std::move(part), false);
  ScanOptions o;
  o.wide_pixels = 100;
  std::vector<View> views = usual_views({{"front", Vec3(78, -20, 34)}});
  views.resize(4);
  scan(job, views, o);
  for (Capture& c : job.captures) {
    std::vector<Eigen::Vector3f> thin;
    for (std::size_t i = 0; i < c.points_sensor.size(); i += 23) thin.push_back(c.points_sensor[i]);
    c.points_sensor = thin;
  }
  EXPECT_EQ(code_of(job), "locate.not_converged");
}

}  // namespace
}  // namespace asbuilt
