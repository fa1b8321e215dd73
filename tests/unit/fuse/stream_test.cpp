// SPDX-License-Identifier: GPL-3.0-or-later
// Streams: interpolation of poses, clocks from flash and motion, faults of logs, the integer sums, and every refusal; on a simulated
// depth camera whose truth is known.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>

#include "planner/base/archive.hpp"
#include "planner/fuse/cells.hpp"
#include "planner/fuse/clock.hpp"
#include "planner/fuse/fuse.hpp"
#include "planner/io/robot_log.hpp"
#include "tests/bench/fuse/artefacts.hpp"

namespace asbuilt {
namespace {

using namespace artefact_study;
using namespace fuse_detail;

RobotTrack twist_track(const Vec6& xi, double cycle_s, int count) {
  RobotTrack track;
  track.cycle_s = cycle_s;
  const Eigen::Isometry3d start = Pose<frame::Base, frame::Flange>(quat_from_zyx(3.1, 1.5, -0.4), Vec3(900, 10, 500)).matrix();
  for (int i = 0; i < count; ++i) track.samples.push_back({cycle_s * i, Pose<frame::Base, frame::Flange>(start * screw_exp(xi * (cycle_s * i))), {}});
  return track;
}

TEST(Trajectory, constant_twist_is_reproduced_over_wraps_and_gimbals) {
  Random random(5);
  for (int round = 0; round < 50; ++round) {
    Vec6 xi;
    for (int i = 0; i < 6; ++i) xi[i] = random.normal() * (i < 3 ? 200 : 3);
    RobotTrack track = twist_track(xi, 0.004, 60);
    const Eigen::Isometry3d start = track.samples[0].T_base_flange.matrix();
    track.samples.erase(track.samples.begin() + 20, track.samples.begin() + 23);  // a gap of 16 ms
    const Trajectory robot(track, 0.020);
    EXPECT_EQ(robot.lost_count(), 3);
    EXPECT_NEAR(robot.gap_widest_s(), 0.016, 1e-9);
    for (int k = 0; k < 20; ++k) {
      const double t = random.uniform(0.004, 0.2);
      const PoseAt at = robot.at(t);
      ASSERT_TRUE(at.is_known);
      const Pose<frame::Base, frame::Flange> truth(start * screw_exp(xi * t));
      EXPECT_LT((at.T_base_flange.p_mm - truth.p_mm).norm(), 1e-8);
      EXPECT_LT(at.T_base_flange.q.angularDistance(truth.q), 1e-9);
    }
  }
}

TEST(Trajectory, gaps_too_wide_and_times_outside_are_not_known) {
  RobotTrack track = twist_track(Vec6::Constant(1), 0.004, 60);
  track.samples.erase(track.samples.begin() + 20, track.samples.begin() + 27);
  const Trajectory robot(track, 0.020);
  EXPECT_FALSE(robot.at(0.090).is_known);
  EXPECT_TRUE(robot.at(0.070).is_known);
  EXPECT_FALSE(robot.at(-0.001).is_known);
  EXPECT_FALSE(robot.at(9).is_known);
}

TEST(Clock, flashes_leave_the_interval_in_which_the_truth_lies) {
  Random random(11);
  for (int round = 0; round < 200; ++round) {
    const double truth = random.uniform(-5, 5), exposure = 0.008;
    const int flashes = 1 + static_cast<int>(random.below(8));
    std::vector<double> flash_s;  // sensor's clock
    for (int k = 0; k < flashes; ++k) flash_s.push_back(1 + 1.37 * k + random.uniform(0, 0.5));
    std::vector<StreamFrame> frames;
    for (int i = 0; i < 500; ++i) {
      StreamFrame f;
      f.t_s = i / 30.0, f.exposure_s = exposure, f.brightness_ratio = 0.2 + 0.005 * random.normal();
      for (const double t : flash_s)
        if (t < f.t_s + exposure / 2 && t + 0.1 > f.t_s - exposure / 2) f.brightness_ratio = 0.9;
      frames.push_back(f);
    }
    std::vector<std::array<double, 2>> log;
    for (const double t : flash_s) {
      const double edge = std::ceil((t + truth) / 0.004) * 0.004;
      log.push_back({edge - 0.004, edge});
    }
    const auto found = flash_offset(frames, log);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->flash_count, flashes);
    EXPECT_LE(found->low_s, truth + 1e-9);
    EXPECT_GE(found->high_s, truth - 1e-9);
    EXPECT_LT(found->high_s - found->low_s, 0.040);
    if (flashes >= 2) {
      log.back()[0] += 0.9, log.back()[1] += 0.9;
      EXPECT_FALSE(flash_offset(frames, log));
    }
  }
}

TEST(Clock, turns_of_two_bodies_on_one_link_tell_their_offset) {
  Random random(3);
  const Eigen::Quaterniond link = quat_exp(Vec3(0.3, -1.1, 0.7));
  const auto q_at = [](double t) { return quat_exp(Vec3(0.8 * std::sin(1.3 * t), 0.6 * std::sin(0.9 * t + 1), 0.5 * std::sin(2.1 * t))); };
  std::vector<TimedRotation> hand, eye;
  const double truth = -0.0213;  // t_hand = t_eye + offset
  for (int i = 0; i < 1500; ++i) hand.push_back({0.01 * i, q_at(0.01 * i)});
  for (int i = 20; i < 440; ++i) {
    const double t = i / 30.0;
    Vec3 noise(random.normal(), random.normal(), random.normal());
    if (i % 37 == 0) noise *= 60;  // outliers
    eye.push_back({t, q_at(t + truth) * link * quat_exp(0.003 * noise)});
  }
  const auto found = rotation_rate_offset(hand, eye, -0.5, 0.5, 0.25);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->offset_s, truth, 4 * found->sigma_s);
  EXPECT_LT(found->sigma_s, 0.002);
  EXPECT_LT(found->q_hand_eye.angularDistance(link), 0.01);
}

TEST(Cells, sums_do_not_depend_on_order_and_coarsen_the_same) {
  Random random(9);
  struct Reading {
    int view;
    Vec3 p;
    Eigen::Vector3f n;
    int w;
  };
  std::vector<Reading> all;
  for (int i = 0; i < 30000; ++i)
    all.push_back({static_cast<int>(random.below(3)), Vec3(random.uniform(-50, 50), random.uniform(-50, 50), random.normal()), Eigen::Vector3f(0, 0, i % 5 ? 1.f : -1.f), 1 + static_cast<int>(random.below(200))});
  const auto fused = [&] {
    Cells cells(0.5, 4000);
    for (const Reading& r : all) cells.add(r.view, r.p, r.n, r.w);
    EXPECT_LE(cells.count(), 4000u);
    std::string bytes = std::to_string(cells.cell_mm());
    for (const auto& p : cells.points()) bytes += to_bytes(p.p_base) + std::to_string(p.readings_count) + std::to_string(p.view);
    return bytes;
  };
  const std::string first = fused();
  for (std::size_t i = all.size(); i > 1; --i) std::swap(all[i - 1], all[random.below(i)]);
  EXPECT_EQ(first, fused());
}

/// A small scan: 200 x 130 pixels, a few seconds.
struct Small {
  Scene world = scene(0.35);
  Setup setup_ = setup(200, 130, 203);
  Scan recorded;
  explicit Small(double offset_s = 0, double scale = 1, double speed = 60, std::size_t frames = 80) {
    // few pixels, as exact as many: a longer baseline and a smaller matching window make up for the short focal length
    setup_.model.baseline_mm *= 3, setup_.sensor.noise_mm /= 3;
    setup_.model.fatten_px = 1, setup_.model.correlation_px = 1.5;
    ScanSettings s;
    s.speed_mm_s = speed, s.offset_s = offset_s, s.scale_ratio = scale, s.frames_count_max = frames, s.seed = 21;
    recorded = scan(world, setup_, s);
  }
  Result<Done<FusedStream>> fuse(const StreamRecipe& recipe = {}) const { return fuse_stream(recipe, recorded.capture, setup_.sensor, recorded.source()); }
  std::vector<Vec3> cloud(const FusedStream& f) const {
    std::vector<Vec3> all;
    for (const FusedStream::View& v : f.views)
      for (const auto& p : v.capture.points_sensor) all.push_back((v.capture.T_base_flange * setup_.sensor.T_flange_sensor).point(p.cast<double>()));
    return all;
  }
};

bool has_note(const std::vector<Note>& notes, const std::string& code) {
  return std::any_of(notes.begin(), notes.end(), [&](const Note& n) { return n.code == code; });
}
std::string code_of(const Result<Done<FusedStream>>& r) { return r ? "" : r.error()[0].code; }

TEST(Stream, artefacts_are_met_within_half_a_millimetre_and_edges_stay_where_faces_meet) {
  const Small s;
  const auto fused = s.fuse();
  ASSERT_TRUE(fused) << fused.error()[0].message;
  const std::vector<Vec3> points = s.cloud(fused->artefact);
  for (int k = 0; k < 3; ++k) {
    const BestFit f = best_fit(s.world.bodies[static_cast<std::size_t>(k)], points, 3.0);
    EXPECT_GT(f.points_count, 150u) << k;
    EXPECT_LT(f.rms_mm, 0.6) << k;
    EXPECT_LT(f.mean_abs_mm, 0.5) << k;
  }
  EXPECT_LT(edge_error(s.world.bodies[2], points).faces_mean_mm, 0.4);
}

TEST(Stream, an_offset_of_12_ms_is_found_and_corrected_with_a_number) {
  const Small s(0.012);
  const auto fused = s.fuse();
  ASSERT_TRUE(fused) << fused.error()[0].message;
  const StreamSummary& sum = fused->artefact.summary;
  EXPECT_NEAR(sum.offset_s, 0.012, 4 * sum.offset_sigma_s);
  EXPECT_LT(sum.offset_sigma_s, 0.002);
  EXPECT_TRUE(has_note(fused->notes, "fuse.clock_corrected"));
}

TEST(Stream, separate_clocks_are_matched_by_motion_alone) {
  Small s(37.4, 1, 60, 300);  // frames near enough to each other that one is found from the next
  s.recorded.capture.stream->clock.is_common = false;
  const auto fused = s.fuse();
  ASSERT_TRUE(fused) << fused.error()[0].message;
  EXPECT_NEAR(fused->artefact.summary.offset_s, 37.4, 4 * fused->artefact.summary.offset_sigma_s);
}

TEST(Stream, a_view_gives_the_same_bytes_for_any_order_of_frames_and_any_number_of_threads) {
  Small s;
  const auto bytes = [&] {
    const auto fused = s.fuse();
    EXPECT_TRUE(fused);
    std::string all = to_bytes(fused->artefact.summary);
    for (const FusedStream::View& v : fused->artefact.views) all += to_bytes(v.capture) + to_bytes(v.noise_mm);
    const auto surface = fuse_surface({.voxel_mm = 1.5}, {}, s.recorded.capture, s.setup_.sensor, fused->artefact.summary.offset_s, s.recorded.source());
    EXPECT_TRUE(surface && surface->artefact.mesh_base.triangles.size() > 500);
    return all + to_bytes(surface->artefact.mesh_base) + to_bytes(surface->artefact.sigma_mm) + to_bytes(surface->artefact.p_base);
  };
  const std::string first = bytes();
  {
    tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(first, bytes());
  }
  Random random(4);
  auto& frames = s.recorded.capture.stream->frames;
  for (std::size_t i = frames.size(); i > 1; --i) std::swap(frames[i - 1], frames[random.below(i)]);
  EXPECT_EQ(first, bytes());
}

TEST(Stream, the_surface_says_how_well_and_how_often_it_was_seen) {
  const Small s;
  const auto surface = fuse_surface({.voxel_mm = 1.5}, {}, s.recorded.capture, s.setup_.sensor, 0, s.recorded.source());
  ASSERT_TRUE(surface);
  const FusedSurface& f = surface->artefact;
  ASSERT_GT(f.p_base.size(), 1000u);
  ASSERT_EQ(f.p_base.size(), f.sigma_mm.size());
  double error = 0;
  for (std::size_t i = 0; i < f.p_base.size(); ++i) {
    double d = 1e9;
    for (const Body& b : s.world.bodies) d = std::min(d, std::abs(distance_mm(b, f.p_base[i])));
    error += d / static_cast<double>(f.p_base.size());
    EXPECT_GE(f.frames_count[i], 3);
    EXPECT_GE(f.sigma_mm[i], 0.f);
  }
  EXPECT_LT(error, 0.5);
  SurfaceRecipe tiny{.voxel_mm = 0.5, .blocks_count_max = 50};
  const auto refused = fuse_surface(tiny, {}, s.recorded.capture, s.setup_.sensor, 0, s.recorded.source());
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error()[0].code, "fuse.surface_too_large");
}

TEST(StreamRefuses, a_depth_scale_off_by_two_percent_with_its_number) {
  const auto r = Small(0, 1.02).fuse();
  ASSERT_EQ(code_of(r), "fuse.depth_scale");
  EXPECT_NEAR(r.error()[0].measured, 100 * (1 - 1 / 1.02), 0.3);
}

TEST(StreamRefuses, clocks_that_are_not_as_they_were_said) {
  EXPECT_EQ(code_of(Small(0.080).fuse()), "fuse.clock_offset");
  Small still;  // a robot that stands: nothing tells the offset
  still.recorded.capture.stream->clock.is_common = false;
  for (RobotSample& r : still.recorded.capture.stream->robot.samples) r.T_base_flange = still.recorded.capture.stream->robot.samples[0].T_base_flange;
  const std::string code = code_of(still.fuse());
  EXPECT_TRUE(code == "fuse.clock_not_seen" || code == "fuse.clock_ambiguous") << code;
  Small dark;
  dark.recorded.capture.stream->clock.uses_flash = true;
  EXPECT_EQ(code_of(dark.fuse()), "fuse.flash_not_seen");
}

TEST(StreamRefuses, a_flash_that_the_motion_contradicts) {
  Small s;
  SensorStream& stream = *s.recorded.capture.stream;
  stream.clock.uses_flash = true, stream.clock.is_common = false;
  for (StreamFrame& f : stream.frames) f.brightness_ratio = 0.2 + 0.001 * std::fmod(f.t_s * 977, 1.0);
  const std::size_t k = stream.frames.size() / 2;
  stream.frames[k].brightness_ratio = 0.9;
  const double truth = stream.frames[k].t_s;  // the true offset is 0
  stream.robot.flash_s = {{truth - 0.002, truth + 0.002}};
  const auto good = s.fuse();
  ASSERT_TRUE(good) << good.error()[0].message;
  EXPECT_EQ(good->artefact.summary.flash_count, 1);
  stream.robot.flash_s = {{truth + 0.098, truth + 0.102}};
  EXPECT_EQ(code_of(s.fuse()), "fuse.clocks_disagree");
}

TEST(StreamRefuses, lost_packets_above_the_limits) {
  Small s;
  auto& samples = s.recorded.capture.stream->robot.samples;
  const auto whole = samples;
  samples.erase(samples.begin() + 600, samples.begin() + 603);  // three: bridged, and said
  const auto bridged = s.fuse();
  ASSERT_TRUE(bridged) << bridged.error()[0].message;
  EXPECT_EQ(bridged->artefact.summary.lost_count, 3);
  EXPECT_TRUE(has_note(bridged->notes, "fuse.log_packets_lost"));
  samples = whole;
  for (std::size_t i = 400; i < samples.size(); i += 20) samples.erase(samples.begin() + static_cast<std::ptrdiff_t>(i), samples.begin() + static_cast<std::ptrdiff_t>(std::min(samples.size(), i + 9)));
  EXPECT_EQ(code_of(s.fuse()), "fuse.log_gaps");
  samples.assign(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() / 2));
  EXPECT_EQ(code_of(s.fuse()), "fuse.log_does_not_cover");
}

TEST(StreamRefuses, packets_that_were_lost_without_a_trace) {
  Small s(0, 1, 90);  // the second half of the log comes 30 ms early, its clock runs on evenly
  auto& samples = s.recorded.capture.stream->robot.samples;
  const double step = s.recorded.capture.stream->robot.cycle_s;
  const std::size_t half = samples.size() / 2;
  samples.erase(samples.begin() + static_cast<std::ptrdiff_t>(half), samples.begin() + static_cast<std::ptrdiff_t>(half) + 8);
  for (std::size_t i = half; i < samples.size(); ++i) samples[i].t_s -= 8 * step;
  StreamRecipe recipe;
  recipe.motion_error_max_mm = 10;
  const std::string code = code_of(s.fuse(recipe));
  EXPECT_EQ(code, "fuse.clock_jump");
}

TEST(StreamRefuses, a_log_of_another_scan) {
  Small s;
  Random random(8);
  for (RobotSample& r : s.recorded.capture.stream->robot.samples) {  // every pose lies on another path
    const double t = r.t_s;
    r.T_base_flange.p_mm += Vec3(40 * std::sin(3.1 * t), 55 * std::sin(2.3 * t), 30 * std::sin(4.7 * t));
    r.T_base_flange.q = (r.T_base_flange.q * quat_exp(Vec3(0.15 * std::sin(2 * t), 0.2 * std::sin(3.3 * t), 0))).normalized();
  }
  StreamRecipe recipe;
  recipe.motion_error_max_mm = 100, recipe.scale_max_ratio = 10, recipe.offset_max_s = 10, recipe.jump_max_s = 10;
  EXPECT_EQ(code_of(s.fuse(recipe)), "fuse.stream_contradicts");
}

TEST(Stream, becomes_captures_of_the_cloud_beside_snapshots) {
  const Small s;
  Job job;
  job.item_id = "stream";
  job.cell.sensors.push_back(s.setup_.sensor);
  job.captures.push_back(s.recorded.capture);
  const auto done = fuse({}, job, s.recorded.source());
  ASSERT_TRUE(done) << done.error()[0].message;
  const MeasuredCloud& c = done->artefact;
  ASSERT_EQ(c.streams.size(), 1u);
  EXPECT_GT(c.captures.size(), 1u);
  EXPECT_LE(c.captures.size(), 16u);
  double error = 0;
  for (const Vec3& p : c.p_base) {
    double d = 1e9;
    for (const Body& b : s.world.bodies) d = std::min(d, std::abs(distance_mm(b, p)));
    error += d / static_cast<double>(c.p_base.size());
  }
  EXPECT_LT(error, 0.5);
}

TEST(Stream, profiles_are_placed_line_by_line) {
  SensorSpec sensor;
  sensor.id = "line", sensor.kind = SensorKind::profile, sensor.is_calibrated = true, sensor.noise_mm = 0.03, sensor.working_distance_mm = 200;
  Capture c;
  c.name = "scan.csv", c.sensor = 0;
  c.stream.emplace();
  c.stream->clock.sigma_s = 0.0005;
  RobotTrack& track = c.stream->robot;
  track.cycle_s = 0.004;
  const Eigen::Quaterniond down = quat_from_z(-Vec3::UnitZ(), Vec3::UnitX());
  for (int i = 0; i <= 1250; ++i) track.samples.push_back({0.004 * i, {down, Vec3(900, -40 + 0.08 * i, 500)}, {}});
  for (int k = 0; k < 400; ++k) {
    StreamFrame f;
    f.t_s = 0.5 + 0.01 * k, f.begin = c.points_sensor.size();
    for (int i = 0; i < 100; ++i) c.points_sensor.emplace_back(0.3f * static_cast<float>(i - 50), 0.f, 200.f);
    f.end = c.points_sensor.size();
    c.stream->frames.push_back(f);
  }
  const auto fused = fuse_stream({}, c, sensor, {});
  ASSERT_TRUE(fused) << fused.error()[0].message;
  EXPECT_TRUE(has_note(fused->notes, "fuse.clock_not_checked"));
  std::size_t count = 0;
  double y_min = 1e9, y_max = -1e9;
  for (const auto& v : fused->artefact.views)
    for (const auto& p : v.capture.points_sensor) {
      const Vec3 q = (v.capture.T_base_flange * sensor.T_flange_sensor).point(p.cast<double>());
      EXPECT_NEAR(q.z(), 300, 1e-3);
      y_min = std::min(y_min, q.y()), y_max = std::max(y_max, q.y());
      ++count;
    }
  EXPECT_EQ(count, 40000u);
  EXPECT_NEAR(y_min, -30, 0.05);
  EXPECT_NEAR(y_max, -30 + 399 * 0.2, 0.05);
  c.stream->clock.is_common = false;
  EXPECT_EQ(code_of(fuse_stream({}, c, sensor, {})), "fuse.clock_not_seen");
}

}  // namespace
}  // namespace asbuilt
