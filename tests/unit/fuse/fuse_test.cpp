// SPDX-License-Identifier: GPL-3.0-or-later
// What fusing keeps, drops and says about the points, on patches whose truth is known.
#include "planner/fuse/fuse.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "planner/base/random.hpp"
#include "planner/fuse/links.hpp"

namespace asbuilt {
namespace {

/// One sensor 200 mm above a plate; the plate is z = 200 in the sensor's frame.
Job plate_job(double noise_mm, double sheet_noise_mm, std::uint64_t seed = 1) {
  Job job;
  job.item_id = "plate";
  SensorSpec s;
  s.id = "eye", s.is_calibrated = true, s.working_distance_mm = 200, s.noise_mm = sheet_noise_mm;
  s.T_flange_sensor = {Eigen::Quaterniond::Identity(), Vec3(10, 0, 50)};
  job.cell.sensors.push_back(s);
  Capture c;
  c.name = "a.ply", c.sensor = 0;
  c.T_base_flange = {quat_from_z(-Vec3::UnitZ(), Vec3::UnitX()), Vec3(1000, 0, 800)};
  Random random(seed);
  for (int i = 0; i < 80; ++i)
    for (int j = 0; j < 80; ++j)
      c.points_sensor.push_back(Vec3(0.25 * i - 10, 0.25 * j - 10, 200 + noise_mm * random.normal()).cast<float>());
  job.captures.push_back(c);
  return job;
}

std::size_t count_above(const MeasuredCloud& cloud, double z_base) {
  return static_cast<std::size_t>(std::count_if(cloud.p_base.begin(), cloud.p_base.end(), [&](const Vec3& p) { return p.z() > z_base; }));
}

TEST(Fuse, places_points_by_flange_and_sensor_and_turns_normals_to_the_sensor) {
  const Job job = plate_job(0.005, 0.01);
  const auto done = fuse({}, job);
  ASSERT_TRUE(done);
  const MeasuredCloud& c = done->artefact;
  ASSERT_EQ(c.p_base.size(), 6400u);
  for (std::size_t i = 0; i < c.p_base.size(); ++i) {
    EXPECT_NEAR(c.p_base[i].z(), 800 - 50 - 200, 0.03);
    EXPECT_GT(c.n_base[i].z(), 0.99f);
  }
  EXPECT_NEAR(c.captures[0].spacing_mm, 0.25, 0.01);
  EXPECT_EQ(c.captures[0].end, 6400u);
}

TEST(Fuse, drops_what_hangs_alone_and_keeps_a_thin_fin) {
  Job job = plate_job(0.005, 0.01);
  auto& points = job.captures[0].points_sensor;
  Random random(2);
  for (int i = 0; i < 20; ++i)  // flying pixels: a group of them, each alone in the image
    points.push_back(Vec3(random.uniform(-6, 6), random.uniform(-6, 6), 200 - 4 - 6 * i).cast<float>());
  for (int i = 0; i < 70; ++i)  // a fin 0.3 .. 1.5 mm high along a line, one and two points wide
    for (int h = 1; h <= 4; ++h) points.push_back(Vec3(0.25 * i - 9 + 0.05, 0.02, 200 - 0.35 * h).cast<float>());
  const auto done = fuse({}, job);
  ASSERT_TRUE(done);
  EXPECT_GE(count_above(done->artefact, 550.25), 270u);
  EXPECT_LE(count_above(done->artefact, 552.0), 2u);
  EXPECT_GE(done->artefact.captures[0].outlier_count, 18u);
  EXPECT_LE(done->artefact.captures[0].outlier_count, 40u);
}

/// Two plates 25 mm apart and the wall between them, seen at 75 degrees, of which one reading in eight is left; pixels on the plates'
/// step fly anywhere between. The wall stays, what flies goes.
TEST(Fuse, keeps_a_sparse_grazing_wall_and_drops_groups_that_fly_along_their_rays) {
  Job job = plate_job(0.005, 0.01);
  auto& points = job.captures[0].points_sensor;
  points.clear();
  Random random(6);
  const double slope = 1 / std::tan(rad_from_deg(75));  // the wall recedes by so much a mm of depth
  std::vector<Eigen::Vector3f> wall, flying;
  for (int i = -60; i < 60; ++i)
    for (int j = -60; j < 60; ++j) {
      const Vec3 ray(0.00125 * i, 0.00125 * j, 1);
      // upper plate z = 200 for x < 0, lower plate z = 225 beyond the wall's foot
      const double z_wall = 200 / (1 - ray.x() / slope);
      if (ray.x() * 200 < 0) points.push_back((ray * (200 + 0.005 * random.normal())).cast<float>());
      else if (ray.x() * 225 > 25 * slope) {
        const bool flies = ray.x() * 225 < 25 * slope + 0.6 && random.uniform() < 0.25;
        const double z = flies ? random.uniform(206, 219) : 225 + 0.005 * random.normal();
        (flies && j % 2 ? flying : points).push_back((ray * z).cast<float>());
        if (flies && !(j % 2)) points.pop_back();
      } else if (random.uniform() < 0.125) wall.push_back((ray * (z_wall + 0.01 * random.normal())).cast<float>());
    }
  for (int k = 0; k < 25; ++k) {  // a group in free air before the lower plate, far from its edge
    const Vec3 ray(random.uniform(0.04, 0.07), random.uniform(-0.06, 0.06), 1);
    flying.push_back((ray * random.uniform(160, 215)).cast<float>());
  }
  ASSERT_GT(wall.size(), 40u);
  points.insert(points.end(), wall.begin(), wall.end()), points.insert(points.end(), flying.begin(), flying.end());
  const auto done = fuse({}, job);
  ASSERT_TRUE(done);
  const auto T = job.captures[0].T_base_flange * job.cell.sensors[0].T_flange_sensor;
  const auto kept = [&](const std::vector<Eigen::Vector3f>& list) {
    std::size_t count = 0;
    for (const auto& p : list)
      count += std::any_of(done->artefact.p_base.begin(), done->artefact.p_base.end(), [&](const Vec3& q) { return (q - T.point(p.cast<double>())).norm() < 1e-3; });
    return count;
  };
  EXPECT_GE(kept(wall), wall.size() * 90 / 100) << "of " << wall.size();
  EXPECT_LE(kept(flying), flying.size() * 20 / 100) << "of " << flying.size();
}

TEST(Fuse, sigma_grows_with_range_and_incidence) {
  Job job = plate_job(0.0, 0.01);
  Capture far = job.captures[0];
  far.name = "far.ply";
  for (auto& p : far.points_sensor) p.z() += 100;
  Capture steep = job.captures[0];
  steep.name = "steep.ply";
  for (auto& p : steep.points_sensor) p.z() += p.x() * 1.732f;
  job.captures.push_back(far), job.captures.push_back(steep);
  const auto done = fuse({}, job);
  ASSERT_TRUE(done);
  const auto mean = [&](const CloudCapture& c) {
    double sum = 0;
    for (std::size_t i = c.begin; i < c.end; ++i) sum += done->artefact.sigma_mm[i];
    return sum / static_cast<double>(c.end - c.begin);
  };
  const auto& captures = done->artefact.captures;
  EXPECT_NEAR(mean(captures[0]), 0.01, 0.0005);
  EXPECT_NEAR(mean(captures[1]) / mean(captures[0]), 2.25, 0.05);
  EXPECT_NEAR(mean(captures[2]) / mean(captures[0]), 2.0, 0.1);
}

TEST(Fuse, noise_above_the_sheet_is_measured_and_said) {
  const auto done = fuse({}, plate_job(0.05, 0.01));
  ASSERT_TRUE(done);
  EXPECT_NEAR(done->artefact.captures[0].noise_mm, 0.05, 0.01);
  ASSERT_EQ(done->notes.size(), 1u);
  EXPECT_EQ(done->notes[0].code, "fuse.noise_above_sheet");
}

TEST(Fuse, order_of_points_does_not_matter) {
  Job job = plate_job(0.005, 0.01);
  const auto first = fuse({}, job);
  auto& p = job.captures[0].points_sensor;
  Random random(3);
  for (std::size_t i = p.size(); i > 1; --i) std::swap(p[i - 1], p[random.below(i)]);
  const auto second = fuse({}, job);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->artefact.p_base, second->artefact.p_base);
  EXPECT_EQ(first->artefact.n_base, second->artefact.n_base);
  EXPECT_EQ(first->artefact.sigma_mm, second->artefact.sigma_mm);
}

TEST(FuseRefuses, no_valid_point_is_left) {
  Job job = plate_job(0.005, 0.01);
  job.captures[0].dropped_count = job.captures[0].points_sensor.size();
  job.captures[0].points_sensor.clear();
  const auto done = fuse({}, job);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error()[0].code, "fuse.no_points");
  EXPECT_NE(done.error()[0].message.find("6400"), std::string::npos);
  job.captures.clear();
  EXPECT_EQ(fuse({}, job).error()[0].code, "fuse.no_points");
}

TEST(FuseRefuses, too_few_points) {
  Job job = plate_job(0.005, 0.01);
  job.captures[0].points_sensor.resize(300);
  const auto done = fuse({}, job);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error()[0].code, "fuse.too_few_points");
  EXPECT_EQ(done.error()[0].limit, 500);
}

TEST(FuseRefuses, a_sensor_without_calibration) {
  Job job = plate_job(0.005, 0.01);
  job.cell.sensors[0].is_calibrated = false;
  const auto done = fuse({}, job);
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error()[0].code, "fuse.not_calibrated");
}

/// Two captures of faces with the given normals, one of them shifted.
MeasuredCloud two_captures(const std::vector<Vec3>& normals, const Vec3& shift, double noise_mm) {
  MeasuredCloud cloud;
  cloud.captures.resize(2);
  Random random(4);
  for (int k = 0; k < 2; ++k) {
    cloud.captures[std::size_t(k)].name = k ? "b.ply" : "a.ply", cloud.captures[std::size_t(k)].noise_mm = noise_mm;
    for (const Vec3& n : normals) {
      const Eigen::Quaterniond q = quat_from_z(n, n.unitOrthogonal());
      for (int i = 0; i < 60; ++i)
        for (int j = 0; j < 60; ++j) {
          cloud.p_base.push_back(Vec3(300, 20, 100) + q * Vec3(0.5 * i - 15, 0.5 * j - 15, 20 + noise_mm * random.normal()) + (k ? shift : Vec3(0, 0, 0)));
          cloud.n_base.push_back(n.cast<float>()), cloud.sigma_mm.push_back(float(noise_mm)), cloud.capture.push_back(k);
        }
    }
  }
  return cloud;
}

TEST(Links, a_flat_face_tells_no_sliding_and_a_corner_tells_all) {
  const Vec3 up(0, 0, 1);
  const auto flat = capture_links(two_captures({up}, Vec3(0.2, 0.1, 0.05), 0.02));
  ASSERT_EQ(flat.size(), 1u);
  EXPECT_NEAR(flat[0].rms_mm, 0.05, 0.02);
  EXPECT_LT(flat[0].sd_mm[0], 0.02);
  EXPECT_GT(flat[0].sd_mm[5], 10) << flat[0].text;
  EXPECT_LT(std::abs(flat[0].weakest[2]), 0.05) << "what is not told lies in the face";
  const auto corner = capture_links(two_captures({up, Vec3(1, 0, 0), Vec3(0, 1, 0)}, Vec3(0.2, 0.1, 0.05), 0.02));
  ASSERT_EQ(corner.size(), 1u);
  EXPECT_LT(corner[0].sd_mm[5], 0.02) << corner[0].text;
  EXPECT_GT(corner[0].cells_count, flat[0].cells_count);
  // two faces leave the shift along the edge they share
  const auto edge = capture_links(two_captures({up, Vec3(1, 0, 0)}, Vec3::Zero(), 0.02));
  ASSERT_EQ(edge.size(), 1u);
  EXPECT_GT(std::abs(edge[0].weakest[1]), 0.95) << edge[0].text;
  // apart: no link; any order of the points: the same
  EXPECT_TRUE(capture_links(two_captures({up}, Vec3(500, 0, 0), 0.02)).empty());
  MeasuredCloud turned = two_captures({up, Vec3(1, 0, 0), Vec3(0, 1, 0)}, Vec3(0.2, 0.1, 0.05), 0.02);
  std::reverse(turned.p_base.begin(), turned.p_base.end()), std::reverse(turned.n_base.begin(), turned.n_base.end()), std::reverse(turned.capture.begin(), turned.capture.end());
  const auto again = capture_links(turned);
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(again[0].sd_mm, corner[0].sd_mm);
}

}  // namespace
}  // namespace asbuilt
