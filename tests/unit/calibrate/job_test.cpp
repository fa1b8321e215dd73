// SPDX-License-Identifier: GPL-3.0-or-later
// Whole calibrations from raw captures, one a target; the interim check; every refusal.
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planner/calibrate/calibrate.hpp"
#include "planner/calibrate/check.hpp"
#include "tests/support/calibrate_jobs.hpp"

namespace asbuilt {
namespace {

using testing_calibrate::JobOptions;
using testing_calibrate::make_job;
using testing_calibrate::TrueJob;

void expect_near_truth(const TrueJob& j, const CalibrationResult& r, double factor = 4.5) {
  const Vec6 d = twist_between(r.T_flange_sensor, j.T_true);
  for (int i = 0; i < 6; ++i) EXPECT_LT(std::abs(d[i]), factor * std::sqrt(r.covariance(i, i)) + 1e-9) << i;
}

TEST(Calibrate, every_target_finds_the_sensor_within_its_own_covariance) {
  for (const bool is_fixed : {false, true})
    for (const TargetKind kind : {TargetKind::balls, TargetKind::ball, TargetKind::checkerboard, TargetKind::charuco, TargetKind::plane, TargetKind::corner, TargetKind::pose}) {
      if (is_fixed && kind == TargetKind::plane) continue;  // needs a nominal pose, which the cell has for sensors on the flange
      JobOptions o{.seed = 40 + static_cast<std::uint64_t>(kind), .kind = kind, .captures_count = 16, .is_sensor_fixed = is_fixed};
      if (kind == TargetKind::checkerboard || kind == TargetKind::charuco) o.noise = 0.1;
      if (kind == TargetKind::ball || kind == TargetKind::plane) o.tilt_deg = 45, o.field_mm = 15;
      const TrueJob j = make_job(o);
      const auto r = calibrate(j.request);
      ASSERT_TRUE(r.has_value()) << int(kind) << is_fixed << ": " << r.error().front().code << " " << r.error().front().message;
      SCOPED_TRACE(std::to_string(int(kind)) + (is_fixed ? " fixed" : " on the flange"));
      expect_near_truth(j, r->artefact);
      const Calibrated& c = r->artefact.solved;
      EXPECT_GT(c.held_out_rms, 0.4 * c.held_out_expected);
      EXPECT_LT(c.held_out_rms, 2.0 * c.held_out_expected);
      EXPECT_FALSE(calibration_report(j.request, r->artefact).empty());
    }
}

TEST(Calibrate, ball_seen_whole_by_a_depth_camera) {
  const TrueJob j = make_job({.seed = 77, .kind = TargetKind::ball, .tilt_deg = 45, .is_depth_only = true, .field_mm = 25, .depth_mm = 60});
  const auto r = calibrate(j.request);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  expect_near_truth(j, r->artefact);
}

TEST(Calibrate, tool_tip_on_a_point) {
  const TrueJob j = make_job({.seed = 12, .kind = TargetKind::tip, .captures_count = 8, .tilt_deg = 60, .noise = 0.05});
  const auto r = calibrate(j.request);
  ASSERT_TRUE(r.has_value()) << r.error().front().message;
  EXPECT_LT((r->artefact.T_flange_sensor.p_mm - j.T_true.p_mm).norm(), 0.3);
  expect_near_truth(j, r->artefact);
  EXPECT_GT(r->artefact.covariance(3, 3), 2e-5);  // the direction is only as good as the nominal one
  // four points, but all upright: refused, and the poses that would help are none of a full hand-eye
  const auto flat = calibrate(make_job({.seed = 12, .kind = TargetKind::tip, .captures_count = 4, .is_one_axis = true}).request);
  ASSERT_FALSE(flat.has_value());
  EXPECT_EQ(flat.error().front().code, "calibrate.motion_degenerate");
}

TEST(Calibrate, same_captures_same_numbers_whatever_their_order) {
  TrueJob j = make_job({.seed = 3, .captures_count = 12});
  const auto a = calibrate(j.request), b = calibrate(j.request);
  ASSERT_TRUE(a.has_value() && b.has_value());
  EXPECT_EQ(a->artefact.T_flange_sensor.p_mm, b->artefact.T_flange_sensor.p_mm);
  EXPECT_EQ(a->artefact.covariance, b->artefact.covariance);
  std::reverse(j.request.captures.begin(), j.request.captures.end());
  const auto c = calibrate(j.request);
  ASSERT_TRUE(c.has_value());
  EXPECT_LT((a->artefact.T_flange_sensor.p_mm - c->artefact.T_flange_sensor.p_mm).norm(), 1e-5);
}

TEST(Calibrate, captures_marked_held_out_do_not_change_the_answer) {
  TrueJob j = make_job({.seed = 6, .captures_count = 16});
  for (int k = 0; k < 4; ++k) j.request.captures[static_cast<std::size_t>(k)].is_held_out = true;
  const auto a = calibrate(j.request);
  j.request.captures[1].T_base_flange.p_mm += Vec3(1, 1, 1);
  const auto b = calibrate(j.request);
  ASSERT_TRUE(a.has_value() && b.has_value());
  EXPECT_EQ(a->artefact.T_flange_sensor.p_mm, b->artefact.T_flange_sensor.p_mm);
  EXPECT_GT(b->artefact.solved.views[1].held_out_rms, 1.0);
}

TEST(Calibrate, camera_constants_are_found_when_free_and_stale_ones_are_named) {
  TrueJob j = make_job({.seed = 21, .kind = TargetKind::checkerboard, .captures_count = 20, .robot_mm = 0.02, .robot_rad = 5e-5, .noise = 0.1});
  j.request.is_camera_free = true;
  const auto free = calibrate(j.request);
  ASSERT_TRUE(free.has_value()) << free.error().front().message;
  EXPECT_NEAR((*free->artefact.camera)[0], 1350, 12);
  j.request.is_camera_free = false;
  (*j.request.camera)[0] += 25, (*j.request.camera)[1] += 18, (*j.request.camera)[2] += 14;
  const auto stale = calibrate(j.request);
  ASSERT_FALSE(stale.has_value());
  EXPECT_EQ(stale.error().front().code, "calibrate.intrinsics_stale") << stale.error().front().message;
  j.request.is_camera_free = true;
  const auto again = calibrate(j.request);
  ASSERT_TRUE(again.has_value());
  expect_near_truth(j, again->artefact);
}

TEST(Calibrate, refusals) {
  {  // nothing seen
    TrueJob j = make_job({.captures_count = 6});
    for (TargetCapture& c : j.request.captures) c.points_mm.resize(40);
    const auto r = calibrate(j.request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "calibrate.target_not_seen");
  }
  {  // no turns, no nominal pose
    TrueJob j = make_job({.captures_count = 8, .tilt_deg = 0.5});
    j.request.nominal.reset();
    const auto r = calibrate(j.request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "calibrate.no_start");
    j = make_job({.captures_count = 8, .tilt_deg = 0.5});
    const auto s = calibrate(j.request);
    ASSERT_FALSE(s.has_value());
    EXPECT_EQ(s.error().front().code, "calibrate.motion_degenerate");
  }
  {  // poses that belong to other captures
    TrueJob j = make_job({.captures_count = 15, .tilt_deg = 50});
    const auto first = j.request.captures.front().T_base_flange;
    for (std::size_t k = 0; k + 1 < j.request.captures.size(); ++k) j.request.captures[k].T_base_flange = j.request.captures[k + 1].T_base_flange;
    j.request.captures.back().T_base_flange = first;
    const auto r = calibrate(j.request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "calibrate.motions_incongruent");
  }
  {  // a depth scale that is off, by the known lengths or the known moves
    const auto r = calibrate(make_job({.captures_count = 15, .scale_ratio = 1.02}).request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "calibrate.scale_wrong");
    EXPECT_NEAR(r.error().front().measured, 102, 0.6);
  }
  {  // a corner that is none
    TrueJob j = make_job({.kind = TargetKind::corner, .captures_count = 8});
    for (TargetCapture& c : j.request.captures)
      for (Vec3& p : c.points_mm) p.x() += 0.2 * p.y();
    const auto r = calibrate(j.request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "calibrate.corner_not_square");
  }
  {  // a picture that is none
    TrueJob j = make_job({.kind = TargetKind::checkerboard, .captures_count = 6, .noise = 0.1});
    j.request.captures[2].corners.clear(), j.request.captures[2].image = "no picture";
    const auto r = calibrate(j.request);
    ASSERT_FALSE(r.has_value());
    EXPECT_EQ(r.error().front().code, "input.image_unreadable");
  }
}

/// An arm with wrong constants, measured by a tracker: corrected, what cannot be known is named, and the bands hold.
TEST(Calibrate, arm_from_tracker_poses) {
  Random r(4);
  CalibrationRequest q;
  q.subject = CalibrationRequest::Subject::robot, q.id = "six axes", q.is_sensor_fixed = true, q.taken = "2026-11-20", q.cell_file = "cell.yaml";
  const OpwParameters nominal{300, -150, 0, 750, 1000, 1080, 220, {0, -kPi / 2, 0, 0, 0, 0}, {-1, 1, 1, -1, 1, -1}};
  q.cell.robot.model = q.id, q.cell.robot.kinematics = nominal;
  for (JointSpec& j : q.cell.robot.joints) j = {-3, 3, 1, 1, 1};
  q.target.kind = TargetKind::pose;
  q.sensor_sd = 0.02, q.sensor_sd_rad = 4e-5, q.robot_sd_mm = 0.3, q.robot_sd_rad = 6e-4, q.repeat_sd_mm = 0.03, q.repeat_sd_rad = 4e-5;
  const auto arm = opw_parameters({}, q.cell.robot);
  ASSERT_TRUE(arm.has_value());
  Eigen::VectorXd truth(13);
  for (int i = 0; i < 13; ++i) truth[i] = i < 7 ? r.normal(0, 0.3) : r.normal(0, rad_from_deg(0.03));
  const Pose<frame::Base, frame::Sensor> tracker(quat_exp(Vec3(0.1, 0.2, 2)), Vec3(2500, 600, 300));
  const Pose<frame::Flange, frame::Target> held(quat_exp(Vec3(0.4, 0, 0.3)), Vec3(20, 10, 140));
  for (int i = 0; i < 40; ++i) {
    TargetCapture c;
    c.name = "pose " + std::to_string(i + 1);
    const std::vector<double> joints{r.uniform(-1, 1), r.uniform(-2, -1), r.uniform(0.8, 2), r.uniform(-1, 1), r.uniform(0.5, 1.5), r.uniform(-2, 2)};
    c.q_rad.emplace();
    std::copy(joints.begin(), joints.end(), c.q_rad->begin());
    c.T_base_flange = arm->forward(Eigen::VectorXd::Zero(13), joints);
    Vec6 e, z;
    for (int k = 0; k < 3; ++k) e[k] = r.normal(0, 0.03), e[3 + k] = r.normal(0, 4e-5), z[k] = r.normal(0, 0.02), z[3 + k] = r.normal(0, 4e-5);
    c.T_sensor_target = (tracker.inverse() * arm->forward(truth, joints).disturbed(e) * held).disturbed(z);
    q.captures.push_back(c);
  }
  const auto made = calibrate(q);
  ASSERT_TRUE(made.has_value()) << made.error().front().message;
  const CalibrationResult& c = made->artefact;
  ASSERT_EQ(c.arm.size(), 13u);
  for (Eigen::Index i = 0; i < 13; ++i) EXPECT_LT(std::abs(c.arm[static_cast<std::size_t>(i)].value - truth[i]), 4 * c.arm[static_cast<std::size_t>(i)].sd) << c.arm[static_cast<std::size_t>(i)].name;
  EXPECT_LT(c.accuracy_mm, 0.15);
  EXPECT_FALSE(c.arm_held.empty());  // the height of the arm and its first offset go with the tracker's place
  q.cell.robot.kinematics = ChainKinematics{};
  const auto chain = calibrate(q);
  ASSERT_FALSE(chain.has_value());
  EXPECT_EQ(chain.error().front().code, "calibrate.arm_not_opw");
}

EarlierCalibration earlier_of(const CalibrationRequest& job, const CalibrationResult& r) {
  EarlierCalibration e;
  e.file = "calibration.yaml", e.created = job.taken, e.valid_days = 30;
  e.T_flange_sensor = r.T_flange_sensor, e.covariance = r.covariance, e.camera = r.camera, e.references = r.references, e.sensor_sd = r.solved.solution.sensor_sd;
  return e;
}

/// One capture from a pose of the calibration, the sensor having moved by `moved`; the robot comes back within its repeatability.
CalibrationRequest again(JobOptions o, const Vec6& moved, double scale, int count, std::uint64_t noise_seed) {
  // the same poses as commanded: the calibration's job says where, the truth says what is seen from there
  const TrueJob was = make_job(o);
  CalibrationRequest q = was.request;
  Random r(noise_seed);
  q.captures.resize(static_cast<std::size_t>(count));
  for (TargetCapture& c : q.captures) {
    const Pose<frame::Sensor, frame::Sensor> M = Pose<frame::Sensor, frame::Sensor>().disturbed(moved).inverse();
    Vec6 e;
    for (int i = 0; i < 3; ++i) e[i] = r.normal(0, 0.02), e[3 + i] = r.normal(0, 4e-5);
    const Pose<frame::Sensor, frame::Sensor> back = was.T_true.inverse() * Pose<frame::Flange, frame::Flange>().disturbed(e).inverse() * was.T_true;
    for (Vec3& p : c.points_mm) p = scale * (M * back).point(p) + Vec3(r.normal(0, 0.003), r.normal(0, 0.003), r.normal(0, 0.003));
  }
  return q;
}

TEST(Check, a_sensor_that_moved_is_found_and_one_that_did_not_is_not) {
  const JobOptions o{.seed = 31, .captures_count = 20, .robot_mm = 0.2, .robot_rad = 3e-4};
  const TrueJob j = make_job(o);
  const auto made = calibrate(j.request);
  ASSERT_TRUE(made.has_value()) << made.error().front().message;
  const EarlierCalibration e = earlier_of(j.request, made->artefact);
  int false_alarms = 0, missed_shift = 0, missed_turn = 0;
  Random r(5);
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Vec3 way = Vec3(r.normal(), r.normal(), r.normal()).normalized();
    Vec6 shift = Vec6::Zero(), turn = Vec6::Zero();
    shift.head<3>() = 0.2 * way, turn.tail<3>() = rad_from_deg(0.1) * way;
    false_alarms += !check_calibration(again(o, Vec6::Zero(), 1, 1, seed), e).has_value();
    const auto s = check_calibration(again(o, shift, 1, 1, seed), e), t = check_calibration(again(o, turn, 1, 1, seed), e);
    missed_shift += s.has_value(), missed_turn += t.has_value();
    if (!s.has_value()) EXPECT_EQ(s.error().front().code, "calibrate.sensor_moved");
    if (!s.has_value()) EXPECT_NEAR(s.error().front().measured, 0.2, 0.12);
  }
  EXPECT_EQ(false_alarms, 0);
  EXPECT_EQ(missed_shift, 0);
  EXPECT_EQ(missed_turn, 0);
}

TEST(Check, a_depth_scale_two_percent_off_is_found_by_known_lengths_and_by_known_moves) {
  const JobOptions o{.seed = 31, .captures_count = 20};
  const TrueJob j = make_job(o);
  const auto made = calibrate(j.request);
  ASSERT_TRUE(made.has_value());
  const auto r = check_calibration(again(o, Vec6::Zero(), 1.02, 1, 3), earlier_of(j.request, made->artefact));
  ASSERT_FALSE(r.has_value());
  EXPECT_EQ(r.error().front().code, "calibrate.scale_wrong");
  EXPECT_NEAR(r.error().front().measured, 102, 0.4);
  // one ball has no lengths of its own: two captures 200 mm apart along the view tell it
  const JobOptions ball{.seed = 9, .kind = TargetKind::ball, .captures_count = 20, .tilt_deg = 45, .is_depth_only = true, .field_mm = 30, .depth_mm = 150};
  const TrueJob b = make_job(ball);
  const auto made_ball = calibrate(b.request);
  ASSERT_TRUE(made_ball.has_value()) << made_ball.error().front().message;
  const auto s = check_calibration(again(ball, Vec6::Zero(), 1.02, 6, 3), earlier_of(b.request, made_ball->artefact));
  ASSERT_FALSE(s.has_value());
  EXPECT_EQ(s.error().front().code, "calibrate.scale_wrong") << s.error().front().message;
  EXPECT_NEAR(s.error().front().measured, 102, 0.5);
}

TEST(Check, refuses_without_references_and_without_the_target) {
  const TrueJob j = make_job({.seed = 31, .captures_count = 8});
  EarlierCalibration e;
  e.file = "old.yaml";
  const auto a = check_calibration(j.request, e);
  ASSERT_FALSE(a.has_value());
  EXPECT_EQ(a.error().front().code, "calibrate.no_reference");
  e.references.resize(1);
  CalibrationRequest blind = j.request;
  for (TargetCapture& c : blind.captures) c.points_mm.resize(30);
  const auto b = check_calibration(blind, e);
  ASSERT_FALSE(b.has_value());
  EXPECT_EQ(b.error().front().code, "calibrate.target_not_seen");
}

TEST(Check, drift_against_an_earlier_calibration_is_told_with_its_probability) {
  const TrueJob was = make_job({.seed = 50, .captures_count = 20});
  const auto first = calibrate(was.request);
  ASSERT_TRUE(first.has_value());
  Vec6 moved = Vec6::Zero();
  moved << 0.3, 0, 0, 0, 0.002, 0;
  TrueJob now = make_job({.seed = 51, .captures_count = 20, .moved = moved});
  now.request.earlier = earlier_of(was.request, first->artefact);
  const auto r = calibrate(now.request);
  ASSERT_TRUE(r.has_value());
  ASSERT_TRUE(r->artefact.drift.has_value());
  EXPECT_LT(r->artefact.drift->probability_ratio, 1e-6);
  TrueJob same = make_job({.seed = 52, .captures_count = 20});
  same.request.earlier = now.request.earlier;
  const auto s = calibrate(same.request);
  ASSERT_TRUE(s.has_value());
  EXPECT_GT(s->artefact.drift->probability_ratio, 1e-4);
}

}  // namespace
}  // namespace asbuilt
