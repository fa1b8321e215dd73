// SPDX-License-Identifier: GPL-3.0-or-later
// What one view sees: the laws of looking.
#include <gtest/gtest.h>

#include "planner/plan/inspect/views.hpp"
#include "planner/simulate/sensor.hpp"
#include "tests/support/inspect_scene.hpp"

namespace asbuilt {
namespace {

using namespace inspecting;
using namespace test;

/// A workshop that only looks: no arm, nothing riding along.
struct Looking {
  InspectScene scene;
  InspectRecipe recipe;
  Workshop shop;
  explicit Looking(InspectScene s) : scene(std::move(s)) {
    shop.recipe = &recipe, shop.cell_spec = &scene.job.cell, shop.margin_mm = 1.5;
    shop.edges = stations_of(scene.job, scene.location, recipe.station_mm);
    for (const EdgeStations& e : shop.edges) shop.first_station.push_back(shop.stations_count), shop.stations_count += e.stations.size();
    for (const SensorSpec& x : scene.job.cell.sensors) shop.eyes.push_back(eye_of(x));
    shop.blockers.standing_base = RayTree(transformed(scene.location.T_base_part, scene.job.part.brep.mesh));
  }
  std::vector<float> from(const Pose<frame::Base, frame::Sensor>& T) const {
    Stand stand;
    stand.T_base_sensor = T;
    return expected_points(shop, stand, 0, shop.stations_count);
  }
};

Pose<frame::Base, frame::Sensor> looking_at(const Vec3& target, const Vec3& look, const Vec3& x, double distance = 206) {
  return {quat_from_z(look.normalized(), x), target - distance * look.normalized()};
}

TEST(Views, a_mirrored_part_is_seen_as_in_a_mirror) {
  // an unsymmetrical part: the block with a tower; mirrored at y = 0 of base with the sensor's eyes side by side in the mirror
  const Mesh part = joined(box_mesh(Vec3::Zero(), {kBlockX, kBlockY, kBlockZ}), box_mesh({20, 35, kBlockZ - 1}, {45, 50, kBlockZ + 30}));
  const Looking here(block_scene(part));
  InspectScene other = block_scene(part);
  const Vec3 flip(1, -1, 1);
  Mesh& m = other.job.part.brep.mesh;
  for (Vec3& v : m.vertices) v = v.cwiseProduct(flip);
  for (auto& t : m.triangles) std::swap(t[1], t[2]);
  other.location.T_base_part.p_mm = other.location.T_base_part.p_mm.cwiseProduct(flip);
  for (BrepEdge& e : other.job.part.brep.edges)
    for (std::size_t k = 0; k < e.p.size(); ++k) {
      e.p[k] = e.p[k].cwiseProduct(flip), e.n_1[k] = e.n_1[k].cwiseProduct(flip), e.n_2[k] = e.n_2[k].cwiseProduct(flip);
      e.tangent[k] = -e.tangent[k].cwiseProduct(flip);  // a mirror turns the walk round
    }
  const Looking there(std::move(other));
  ASSERT_EQ(here.shop.stations_count, there.shop.stations_count);
  std::size_t seen = 0, hidden = 0;
  for (const Vec3& look : {Vec3(0, 0, -1), Vec3(0.5, 0.6, -1), Vec3(-0.4, -0.7, -1), Vec3(0.8, -0.3, -0.9)})
    for (const double turn : {0.0, 0.7, 2.0, 4.1}) {
      const auto T = looking_at(here.scene.location.T_base_part.point({30, 40, kBlockZ}), look, Vec3(std::cos(turn), std::sin(turn), 0));
      Mat3 M = flip.asDiagonal();
      Mat3 flip_y = Vec3(1, -1, 1).asDiagonal();
      const Pose<frame::Base, frame::Sensor> mirrored(Eigen::Quaterniond(Mat3(M * T.rotation() * flip_y)), T.p_mm.cwiseProduct(flip));
      const auto a = here.from(T), b = there.from(mirrored);
      for (std::size_t i = 0; i < a.size(); ++i) {
        EXPECT_NEAR(a[i], b[i], 1e-3 + 1e-3 * a[i]) << i;
        (a[i] > 0 ? seen : hidden) += 1;
      }
    }
  EXPECT_GT(seen, 300u);
  EXPECT_GT(hidden, 300u);
}

TEST(Views, both_eyes_have_to_see) {
  Looking l(block_scene());
  const Vec3 target = l.scene.location.T_base_part.point({50, 0, kBlockZ});
  // straight down onto the edge at y = 0: its side face is never seen; from the front both are, unless the second eye looks from behind
  const auto count = [&](const std::vector<float>& p, std::size_t face) {
    std::size_t n = 0;
    for (std::size_t e = 0; e < l.shop.edges.size(); ++e) {
      if (std::abs(l.shop.edges[e].stations[0].p.y() - target.y()) > 1 || std::abs(l.shop.edges[e].stations.back().p.y() - target.y()) > 1) continue;
      for (std::size_t k = 0; k < l.shop.edges[e].stations.size(); ++k) {
        const std::size_t f = (l.shop.edges[e].stations[k].n[0].z() > 0.5) == (face == 0) ? 0 : 1;
        n += is_enough(l.recipe, p[2 * (l.shop.first_station[e] + k) + f]);
      }
    }
    return n;
  };
  const auto down = l.from(looking_at(target, -Vec3::UnitZ(), Vec3::UnitX()));
  EXPECT_GT(count(down, 0), 60u);
  EXPECT_EQ(count(down, 1), 0u);
  const auto front = l.from(looking_at(target, Vec3(0, 1, -1), Vec3::UnitX()));
  EXPECT_GT(count(front, 0), 60u);
  EXPECT_GT(count(front, 1), 60u);
  l.shop.eyes[0].second_mm = Vec3(0, -400, 0);  // over the part, to behind it: it cannot see the front face
  const auto lamp_behind = l.from(looking_at(target, Vec3(0, 1, -1), Vec3::UnitX()));
  l.shop.eyes[0].second_mm = Vec3(0, 400, 0);
  const auto lamp_below = l.from(looking_at(target, Vec3(0, 1, -1), Vec3::UnitX()));
  EXPECT_EQ(std::min(count(lamp_behind, 1), count(lamp_below, 1)), 0u);
  EXPECT_EQ(std::min(count(lamp_behind, 0), count(lamp_below, 0)), 0u);
}

TEST(Views, expected_points_are_what_a_simulated_picture_holds) {
  Looking l(block_scene());
  Random random(11);
  const Vec3 target = l.scene.location.T_base_part.point({50, 0, kBlockZ});
  const MeshQuery scene(transformed(l.scene.location.T_base_part, l.scene.job.part.brep.mesh));
  const SensorSpec& sheet = l.scene.job.cell.sensors[0];
  simulate_detail::SensorModel model;
  model.pitch_mm = 0.3, model.baseline_mm = 90, model.outlier_ratio = 0;
  for (const Vec3& look : {Vec3(0, 1, -1), Vec3(0.3, 1, -0.8), Vec3(-0.2, 0.7, -1)}) {
    const auto T = looking_at(target, look, Vec3::UnitX());
    const auto expected = l.from(T);
    double sum = 0, got = 0;
    SeenStations seen(l.shop.edges, 1.0);
    for (const float e : expected) sum += e;
    for (const Eigen::Vector3f& p : simulate_detail::scan(scene, sheet, model, T, random)) {
      const Vec3 q = T.point(p.cast<double>());
      seen.add(q);
    }
    for (std::size_t e = 0; e < l.shop.edges.size(); ++e) got += seen.points(e);
    EXPECT_GT(sum, 1000);
    // the simulator also keeps what lies beyond the margin at the field's rim
    EXPECT_NEAR(got / sum, 1.0, 0.12) << look.transpose();
  }
}

TEST(Views, the_cone_is_even_and_the_wanted_direction_first) {
  const Vec3 axis = Vec3(0.3, -0.5, -1).normalized();
  const auto d = cone_directions(axis, rad_from_deg(30), 37);
  ASSERT_EQ(d.size(), 37u);
  EXPECT_LT((d[0] - axis).norm(), 1e-12);
  Vec3 mean = Vec3::Zero();
  double least = 1e9;
  for (std::size_t i = 0; i < d.size(); ++i) {
    EXPECT_LE(std::acos(std::clamp(d[i].dot(axis), -1.0, 1.0)), rad_from_deg(30.0001));
    mean += d[i] / 37;
    for (std::size_t k = 0; k < i; ++k) least = std::min(least, std::acos(std::clamp(d[i].dot(d[k]), -1.0, 1.0)));
  }
  EXPECT_LT((mean.normalized() - axis).norm(), 0.02);
  EXPECT_GT(deg_from_rad(least), 4.0);
}

TEST(Views, what_the_cell_does_not_say_is_assumed_and_said) {
  SensorSpec s = detail_sensor(350);
  EXPECT_TRUE(eye_of(s).assumed.empty());
  s.pixels_count.reset(), s.second_ray_mm.reset(), s.incidence_max_rad.reset();
  const SensorEye e = eye_of(s);
  EXPECT_EQ(e.assumed.size(), 3u);
  EXPECT_NEAR(e.pitch_ratio * e.working_distance_mm, 0.4, 1e-9);
}

}  // namespace
}  // namespace asbuilt
