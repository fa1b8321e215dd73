// SPDX-License-Identifier: GPL-3.0-or-later
// Legs by construction, against a brute-force swept cutter; the law that the tip moves with the edge.
#include "planner/plan/path/chamfer.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "planner/base/random.hpp"
#include "tests/unit/path/world.hpp"

namespace asbuilt {
namespace {

using testing::cone_cutter;

Cutter ball_cutter() {
  Cutter c = cone_cutter();
  c.shape = CutterShape::ball, c.diameter_mm = 6;
  return c;
}
Cutter cylinder_cutter() {
  Cutter c = cone_cutter();
  c.shape = CutterShape::cylinder, c.diameter_mm = 6, c.length_mm = 30;
  return c;
}

/// An own swept cutter: the leg is the first point along the face that no pose of the cutter reaches.
double swept_leg(const Cutter& cutter, const std::vector<CutterPlacement>& poses, const Vec3& p, const Vec3& t) {
  double before_gap = 0;
  for (int i = 0; i <= 400; ++i) {
    const double u = 0.005 * i;
    double gap = 1e9;
    for (const CutterPlacement& c : poses) {
      const Vec3 d = p + u * t - c.tip;
      const double h = d.dot(c.up), r = (d - h * c.up).norm();
      gap = std::min(gap, gap_mm(cutter, Vec3(r, 0, -h)));
    }
    if (gap > 0) return i == 0 ? 0.0 : u - 0.005 * gap / (gap - before_gap);
    before_gap = gap;
  }
  return 2.0;
}

struct Case {
  const char* name;
  Cutter cutter;
};

void expect_legs(const Cutter& cutter, const std::vector<EdgeStation>& stations, const std::function<Vec3(const EdgeStation&)>& up, std::size_t at,
                 double tolerance) {
  std::vector<CutterPlacement> poses;
  for (const EdgeStation& s : stations) poses.push_back(place_cutter(cutter, s, up(s), 0.4, 0, 0.5));
  const EdgeStation& s = stations[at];
  ASSERT_EQ(poses[at].fault, "");
  EXPECT_NEAR(0.5 * (poses[at].leg_1_mm + poses[at].leg_2_mm), 0.4, 1e-9);
  EXPECT_NEAR(swept_leg(cutter, poses, s.p, into_face(s, 1)), poses[at].leg_1_mm, tolerance);
  EXPECT_NEAR(swept_leg(cutter, poses, s.p, into_face(s, 2)), poses[at].leg_2_mm, tolerance);
}

std::vector<EdgeStation> straight(const Vec3& tau, const Vec3& n_1, const Vec3& n_2) {
  std::vector<EdgeStation> out;
  for (int i = -200; i <= 200; ++i) out.push_back({0.05 * i * tau, tau, n_1, n_2});
  return out;
}

TEST(Chamfer, legs_of_every_cutter_match_the_swept_body_at_many_dihedrals) {
  for (const Case& c : {Case{"cone", cone_cutter()}, Case{"ball", ball_cutter()}, Case{"cylinder", cylinder_cutter()}})
    for (double beta_deg : {70.0, 90.0, 110.0, 140.0})
      for (double slope_deg : {0.0, 12.0, 25.0}) {
        SCOPED_TRACE(std::string(c.name) + " " + std::to_string(beta_deg) + " " + std::to_string(slope_deg));
        // faces symmetric about the bisector b, which leans by 40 degrees from z about the tangent; the edge climbs by the slope
        const double half = rad_from_deg(180 - beta_deg) / 2;
        const Eigen::Quaterniond lean(Eigen::AngleAxisd(rad_from_deg(40), Vec3::UnitX()));
        const Eigen::Quaterniond climb(Eigen::AngleAxisd(rad_from_deg(-slope_deg), Vec3::UnitY()));
        const Vec3 tau = climb * lean * Vec3::UnitX();
        const Vec3 n_1 = climb * lean * Vec3(0, std::sin(half), std::cos(half)), n_2 = climb * lean * Vec3(0, -std::sin(half), std::cos(half));
        const auto stations = straight(tau, n_1, n_2);
        // a cylinder has to be tilted to chamfer at all; the others stand upright and also tilted
        if (c.cutter.shape != CutterShape::cylinder)
          expect_legs(c.cutter, stations, [](const EdgeStation&) { return Vec3(Vec3::UnitZ()); }, 200, 0.003);
        expect_legs(c.cutter, stations, [&](const EdgeStation& s) { return tilted_up(c.cutter, s, Vec3::UnitZ(), 1.5); }, 200, 0.003);
      }
}

TEST(Chamfer, legs_hold_on_curved_edges_inside_and_outside) {
  for (double radius : {8.0, 14.0, 128.0})
    for (bool is_hole : {false, true}) {
      SCOPED_TRACE(std::to_string(radius) + (is_hole ? " hole" : " boss"));
      std::vector<EdgeStation> stations;
      const int n = static_cast<int>(std::min(6.2832 * radius, 24.0) / 0.05);
      for (int i = 0; i < n; ++i) {
        const double a = 0.05 * (i - n / 2) / radius;
        const Vec3 r(std::cos(a), std::sin(a), 0);
        stations.push_back({radius * r, Vec3(-std::sin(a), std::cos(a), 0), Vec3::UnitZ(), is_hole ? Vec3(-r) : r});
      }
      expect_legs(cone_cutter(), stations, [](const EdgeStation&) { return Vec3(Vec3::UnitZ()); }, static_cast<std::size_t>(n / 2), 0.004);
      expect_legs(ball_cutter(), stations, [](const EdgeStation&) { return Vec3(Vec3::UnitZ()); }, static_cast<std::size_t>(n / 2), 0.004);
    }
}

TEST(Chamfer, tilt_makes_both_legs_equal_where_the_cone_allows_it) {
  const EdgeStation s{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitZ(), Vec3(0, -std::sin(1.2), std::cos(1.2))};
  const CutterPlacement fixed = place_cutter(cone_cutter(), s, Vec3::UnitZ(), 0.4, 0, 0.5);
  const CutterPlacement tilted = place_cutter(cone_cutter(), s, tilted_up(cone_cutter(), s, Vec3::UnitZ(), rad_from_deg(30)), 0.4, 0, 0.5);
  EXPECT_GT(std::abs(fixed.leg_1_mm - fixed.leg_2_mm), 0.05);
  EXPECT_NEAR(tilted.leg_1_mm, tilted.leg_2_mm, 1e-9);
  const Vec3 held = tilted_up(cone_cutter(), s, Vec3::UnitZ(), rad_from_deg(3));
  EXPECT_NEAR(std::acos(held.z()), rad_from_deg(3), 1e-9);
}

TEST(Chamfer, the_tip_moves_and_turns_with_the_edge) {
  Random random(5);
  for (int k = 0; k < 200; ++k) {
    const double half = rad_from_deg(random.uniform(20, 55));
    const EdgeStation s{Vec3(random.normal(), random.normal(), random.normal()), Vec3::UnitX(), Vec3(0, std::sin(half), std::cos(half)),
                        Vec3(0, -std::sin(half), std::cos(half))};
    const Vec3 up = Vec3(0.3 * random.normal(), 0.2 * random.normal(), 1).normalized();
    const Pose<frame::Part, frame::Part> T(quat_exp(Vec3(random.normal(), random.normal(), random.normal())),
                                           Vec3(random.normal(0, 100), random.normal(0, 100), random.normal(0, 100)));
    const EdgeStation moved{T.point(s.p), T.direction(s.tau), T.direction(s.n_1), T.direction(s.n_2)};
    const CutterPlacement a = place_cutter(cone_cutter(), s, up, 0.4, 0, 0.5), b = place_cutter(cone_cutter(), moved, T.direction(up), 0.4, 0, 0.5);
    ASSERT_EQ(a.fault, b.fault);
    if (!a.fault.empty()) continue;
    EXPECT_LT((T.point(a.tip) - b.tip).norm(), 1e-9);
    EXPECT_NEAR(a.leg_1_mm, b.leg_1_mm, 1e-9);
  }
}

TEST(Chamfer, slopes_predict_what_a_displaced_edge_gets) {
  for (const Cutter& cutter : {cone_cutter(), ball_cutter()}) {
    const auto stations = straight(Vec3::UnitX(), Vec3::UnitZ(), -Vec3::UnitY());
    std::vector<CutterPlacement> poses;
    for (const EdgeStation& s : stations) poses.push_back(place_cutter(cutter, s, Vec3::UnitZ(), 0.4, 0, 0.5));
    for (const Vec3& d : {Vec3(0, 0.02, 0.01), Vec3(0, -0.015, 0.02), Vec3(0, 0.01, -0.02)}) {
      const EdgeStation& s = stations[200];
      EXPECT_NEAR(swept_leg(cutter, poses, s.p + d, into_face(s, 1)), 0.4 + poses[200].slope_1.dot(d), 0.004);
      EXPECT_NEAR(swept_leg(cutter, poses, s.p + d, into_face(s, 2)), 0.4 + poses[200].slope_2.dot(d), 0.004);
    }
  }
}

TEST(Chamfer, names_what_the_cutter_cannot_do) {
  const EdgeStation s{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitZ(), -Vec3::UnitY()};
  EXPECT_NE(place_cutter(cylinder_cutter(), s, Vec3::UnitZ(), 0.4, 0, 0.5).fault, "");      // upright: parallel to the wall
  EXPECT_NE(place_cutter(cone_cutter(), s, Vec3::UnitX(), 0.4, 0, 0.5).fault, "");          // lying along the edge
  EXPECT_NE(place_cutter(cone_cutter(), s, -Vec3::UnitZ(), 0.4, 0, 0.5).fault, "");         // from below, through the part
  EXPECT_NE(place_cutter(cone_cutter(), s, Vec3::UnitZ(), 4.0, 0, 0.5).fault, "");          // wider than the flank
  EXPECT_EQ(place_cutter(cone_cutter(), s, Vec3::UnitZ(), 0.4, 0, 0.5).fault, "");
}

}  // namespace
}  // namespace asbuilt
