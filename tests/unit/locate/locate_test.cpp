// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of the location on parts and arms made by construction.
#include "planner/locate/locate.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "planner/fuse/fuse.hpp"
#include "planner/robot/error_model.hpp"
#include "tests/unit/locate/synthetic.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

Job ring_job(int lugs_count = 8, double wider_mm = 10) {
  PartSpec part = make_ring(lugs_count, wider_mm);
  if (lugs_count > 0) {
    add_feature(part, "lug1", {"top-4", "top-5", "top-6"});
    add_feature(part, "lug4", {"top-16", "top-17", "top-18"});
  }
  return make_job(std::move(part), true);
}

std::vector<View> ring_views(const Pose<frame::Part, frame::Part>& play, bool with_sides = true) {
  const auto at = [&](double deg) { return play.point(Vec3(148 * std::cos(rad_from_deg(deg)), 148 * std::sin(rad_from_deg(deg)), 40)); };
  return usual_views({{"lug1", at(45)}, {"lug4", at(180)}}, with_sides);
}

Job bracket_job() {
  PartSpec part = make_bracket();
  add_feature(part, "front", {"top-0", "top-1"});
  return make_job(std::move(part), false);
}

std::vector<View> bracket_views() { return usual_views({{"front", Vec3(78, -20, 34)}}); }

Result<Done<Location>> run(const Job& job) {
  const auto cloud = fuse({}, job);
  if (!cloud) return tl::unexpected<Refusals>(cloud.error());
  return locate({}, job, cloud->artefact);
}

void expect_near(const Pose<frame::Base, frame::Part>& a, const Pose<frame::Base, frame::Part>& b, double mm, double deg) {
  const Vec3 c(0, 0, 20);
  EXPECT_LT((a.point(c) - b.point(c)).norm(), mm);
  EXPECT_LT(deg_from_rad(a.q.angularDistance(b.q)), deg);
}

/// How far corrected points are from where the controller has to be told, from the truth of the arm: by capture of a feature,
/// in the middle of the feature.
std::vector<Vec3> correction_errors(const Job& job, const Location& l, const Truth& truth, std::vector<Mat3>* covariances = nullptr) {
  const Robot robot = *Robot::from(job.cell.robot);
  const ToolSpec& tool = job.cell.tools.front();
  const RobotErrorModel model(robot, tool.T_flange_tool);
  JointVector home{};
  for (std::size_t i = 0; i < 6; ++i) home[i] = job.cell.robot.home_rad[i];
  // The cut's branch of the arm is that of the capture whose turn it takes over.
  const auto near_of = [&](const std::string& feature, const Pose<frame::Base, frame::Tool>& reference) {
    for (const Capture& c : job.captures)
      if (c.feature == feature && (c.T_base_flange.q * tool.T_flange_tool.q).angularDistance(reference.q) < 0.01)
        return *robot.inverse_like(c.T_base_flange, home);
    return home;
  };
  std::vector<Vec3> out;
  for (std::size_t k = 0; k < job.captures.size(); ++k) {
    const Capture& c = job.captures[k];
    if (!c.feature || c.points_sensor.empty()) continue;
    const auto& reference = l.T_base_tool_reference.at(*c.feature);
    const Pose<frame::Base, frame::Sensor> placed = c.T_base_flange * job.cell.sensors[static_cast<std::size_t>(c.sensor)].T_flange_sensor;
    const Vec3 p_base = reference.p_mm, p_true = truth.T_base_sensor_true[k].point(placed.inverse().point(p_base));
    const Pose<frame::Base, frame::Flange> flange = Pose<frame::Base, frame::Tool>(reference.q, p_true) * tool.T_flange_tool.inverse();
    const auto q = robot.inverse_like(flange, near_of(*c.feature, reference));
    const Pose<frame::Base, frame::Flange> real = flange.disturbed(model.twist(*q) * truth.arm - truth.calibrated);
    const Vec3 p_command = p_true - ((real * tool.T_flange_tool).p_mm - p_true);
    out.push_back(l.corrections[k].point(p_base) - p_command);
    if (covariances) {
      Eigen::Matrix<double, 3, 6> g;
      g << l.corrections[k].rotation(), -l.corrections[k].rotation() * skew(p_base);
      covariances->push_back(g * l.correction_covariances[k] * g.transpose());
    }
  }
  return out;
}

TEST(Locate, finds_a_ring_and_ties_its_captures_together) {
  Job job = ring_job();
  ScanOptions o;
  o.play = {quat_from_zyx(2.1, 0.01, -0.008), Vec3(2, -3, 1)};
  o.form_mm = 0.05;
  const Truth truth = scan(job, ring_views(o.play), o);
  const auto found = run(job);
  ASSERT_TRUE(found) << found.error()[0].code << " " << found.error()[0].message;
  expect_near(found->artefact.T_base_part, truth.T_base_part, 1.2, 0.15);  // the arm's own 0.4 mm stay in: commands, not truth
  for (const Vec3& e : correction_errors(job, found->artefact, truth)) EXPECT_LT(e.norm(), 0.10);
  EXPECT_GT(found->artefact.hypotheses.size(), 1u);
  EXPECT_GE(found->artefact.hypotheses[1].log_likelihood_ratio, 8.0);
}

TEST(Locate, finds_a_bracket_with_a_perfect_robot_exactly) {
  Job job = bracket_job();
  ScanOptions o;
  o.play = {quat_from_zyx(0.05, 0.01, -0.012), Vec3(-4, 5, 2)};
  o.robot_ratio = 0, o.hand_eye_ratio = 0, o.noise_ratio = 0.2;
  const Truth truth = scan(job, bracket_views(), o);
  const auto found = run(job);
  ASSERT_TRUE(found) << found.error()[0].code << " " << found.error()[0].message;
  expect_near(found->artefact.T_base_part, truth.T_base_part, 0.02, 0.02);
  for (const Vec3& e : correction_errors(job, found->artefact, truth)) EXPECT_LT(e.norm(), 0.02);
}

TEST(Locate, finds_a_ring_at_every_turn) {
  for (int i = 0; i < 36; i += 3) {  // every third of 36 turns; each meets the lugs' pitch of 45 deg elsewhere
    Job job = ring_job();
    ScanOptions o;
    o.seed = static_cast<std::uint64_t>(100 + i);
    o.play = {quat_from_zyx(rad_from_deg(10.0 * i + 3.7), rad_from_deg(0.8 * std::cos(i)), rad_from_deg(0.8 * std::sin(i))), Vec3(3 * std::sin(i), 2, -1)};
    o.wide_pixels = 110;
    std::vector<View> views = ring_views(o.play);
    views.resize(4);  // wide only
    const Truth truth = scan(job, views, o);
    const auto found = run(job);
    ASSERT_TRUE(found) << i << " " << found.error()[0].code << " " << found.error()[0].message;
    expect_near(found->artefact.T_base_part, truth.T_base_part, 1.5, 1.0);  // the next lug is 45 deg away
  }
}

TEST(Locate, moves_with_the_scan) {
  const auto at = [&](double turn_rad) {
    Job job = bracket_job();
    ScanOptions o;
    o.play = {quat_from_zyx(0.02, 0.0, 0.01), Vec3(1, 2, 0.5)};
    scan(job, bracket_views(), o);
    const Pose<frame::Base, frame::Base> G(quat_from_zyx(turn_rad, 0, 0), Vec3::Zero());
    job.fixture.T_base_fixture = G * job.fixture.T_base_fixture;
    for (Capture& c : job.captures) c.T_base_flange = G * c.T_base_flange;
    job.recipes.front().axis_base = G.direction(job.recipes.front().axis_base);
    auto found = run(job);
    EXPECT_TRUE(found);
    return found ? G.inverse() * found->artefact.T_base_part : Pose<frame::Base, frame::Part>();
  };
  // The usual posture to cut in does not turn with the scan: what the robot does otherwise there stays between the two.
  expect_near(at(0), at(0.4), 0.10, 0.02);
}

TEST(Locate, order_of_points_and_captures_does_not_matter) {
  Job job = bracket_job();
  ScanOptions o;
  o.play = {quat_from_zyx(0.03, 0.0, 0.01), Vec3(1, -2, 0.5)};
  scan(job, bracket_views(), o);
  const auto first = run(job);
  ASSERT_TRUE(first);
  Random random(9);
  for (Capture& c : job.captures)
    for (std::size_t i = c.points_sensor.size(); i > 1; --i) std::swap(c.points_sensor[i - 1], c.points_sensor[random.below(i)]);
  const auto shuffled = run(job);
  ASSERT_TRUE(shuffled);
  EXPECT_EQ(first->artefact.T_base_part.p_mm, shuffled->artefact.T_base_part.p_mm);
  EXPECT_EQ(first->artefact.covariance, shuffled->artefact.covariance);
  std::reverse(job.captures.begin(), job.captures.end());
  const auto reversed = run(job);
  ASSERT_TRUE(reversed);
  expect_near(first->artefact.T_base_part, reversed->artefact.T_base_part, 1e-3, 1e-3);
}

TEST(Locate, covariance_of_corrections_is_honest) {
  double sum = 0;
  int count = 0;
  for (int i = 0; i < 6; ++i) {
    Job job = bracket_job();
    ScanOptions o;
    o.seed = static_cast<std::uint64_t>(i + 1), o.form_mm = 0.05;
    o.play = {quat_from_zyx(0.03, 0.0, 0.01), Vec3(1, -2, 0.5)};
    const Truth truth = scan(job, bracket_views(), o);
    const auto found = run(job);
    ASSERT_TRUE(found) << found.error()[0].message;
    std::vector<Mat3> covariances;
    const auto errors = correction_errors(job, found->artefact, truth, &covariances);
    for (std::size_t k = 0; k < errors.size(); ++k) sum += errors[k].dot(covariances[k].ldlt().solve(errors[k])) / 3, ++count;
  }
  EXPECT_GT(sum / count, 0.2);
  EXPECT_LT(sum / count, 2.5);
}

}  // namespace
}  // namespace asbuilt
