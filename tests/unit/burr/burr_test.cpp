// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of the burr measurement on fins of known height, and its refusals.
#include "planner/burr/burr.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "planner/fit/fit.hpp"
#include "tests/unit/burr/synthetic_burr.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

Job job_of_edge_0() { return plate_job({}, {0}); }

/// The edge's faces as seen from outside (y < 0) or from inside.
Scan faces_of_edge_0(const Vec3& from = Vec3(0, -0.5, 0.87)) {
  Scan s = scan_plate({}, [](int, const Vec3&) { return 0.0; }, 0.25, 6, {0});
  s.from = from;
  return s;
}
const Vec3 kInside(0, 0.6, 0.8);

Burrs measured(const Job& job, const Measured& m, const Features& f) {
  auto r = measure_burrs({}, job, m.cloud, m.location, f);
  if (!r) {
    ADD_FAILURE() << r.error()[0].code << ": " << r.error()[0].message;
    return {};
  }
  return r->artefact;
}

std::string refusal(const Job& job, const Measured& m, const Features& f) {
  auto r = measure_burrs({}, job, m.cloud, m.location, f);
  if (r) return "";
  EXPECT_FALSE(r.error()[0].where.empty());
  EXPECT_FALSE(r.error()[0].message.empty());
  return r.error()[0].code;
}

TEST(Burr, EdgeWithoutBurrReadsZero) {
  const Features f = plate_features({});
  const Burrs b = measured(job_of_edge_0(), measure({faces_of_edge_0(), faces_of_edge_0(kInside)}, some_place(), 1), f);
  ASSERT_EQ(b.edges.size(), 1u);
  for (std::size_t i = 0; i < b.edges[0].height_mm.size(); ++i) {
    EXPECT_EQ(b.edges[0].height_mm[i], 0) << i;
    EXPECT_LT(b.edges[0].height_upper_mm[i], 0.3);
    EXPECT_GT(b.edges[0].coverage_ratio[i], 0.9);
  }
  EXPECT_LT(b.edges[0].detection_limit_mm, 0.15);
}

TEST(Burr, FinsOfEveryHeightAreMeasured) {
  for (const double level : {0.15, 0.3, 0.8, 1.4}) {
    for (const double lean : {0.2, 0.78, 1.4}) {
      const Fin fin{.height = [&](double s) { return level * (1 + 0.15 * std::sin(s / 7)); }, .lean_rad = lean};
      Random random(7);
      std::vector<Scan> scans{faces_of_edge_0(), faces_of_edge_0(kInside)};
      for (int k = 0; k < 3; ++k) {
        Scan s;
        s.name = "fin";
        add_fin(s, fin, 0, 80, 0.2, random);
        scans.push_back(s);
      }
      Job job = job_of_edge_0();
      job.recipes[0].burr_max_height_mm = 3;
      const Burrs b = measured(job, measure(scans, some_place(), 2), plate_features({}));
      double square = 0, bias = 0;
      int count = 0, covered = 0;
      for (std::size_t i = 4; i + 4 < b.edges[0].height_mm.size(); ++i) {
        const double d = b.edges[0].height_mm[i] - fin.height(0.5 * static_cast<double>(i));
        square += d * d, bias += d, ++count;
        covered += fin.height(0.5 * static_cast<double>(i)) <= b.edges[0].height_upper_mm[i];
      }
      // Rays to the faces go right through these fins here, as they seem to where a capture is off: samples of the flank outweigh them.
      EXPECT_GE(covered, 0.95 * count) << level << " " << lean;
      EXPECT_LT(std::sqrt(square / count), 0.05) << level << " " << lean;
      EXPECT_LT(std::abs(bias / count), 0.03 + 0.02 * level) << level << " " << lean;
    }
  }
}

TEST(Burr, WhatWasNotSeenIsNoZero) {
  std::vector<Scan> scans;
  for (const Scan& s : {faces_of_edge_0(), faces_of_edge_0(kInside)}) {
    Scan half;
    half.name = "half", half.from = s.from;
    for (std::size_t i = 0; i < s.p_part.size(); ++i)
      if (s.p_part[i].x() < 70) half.p_part.push_back(s.p_part[i]), half.n_part.push_back(s.n_part[i]);
    scans.push_back(half);
  }
  const Burrs b = measured(job_of_edge_0(), measure(scans, some_place(), 3), plate_features({}));
  for (std::size_t i = 146; i < b.edges[0].height_mm.size(); ++i) {
    EXPECT_TRUE(std::isnan(b.edges[0].height_mm[i]));
    EXPECT_GE(b.edges[0].height_upper_mm[i], 1.5);
    EXPECT_EQ(b.edges[0].coverage_ratio[i], 0);
  }
  EXPECT_EQ(b.edges[0].height_mm[60], 0);
}

TEST(Burr, FinSeenEdgeOnIsBridgedAndNeverDenied) {
  // Along the middle third the only capture looks exactly along the fin: no point falls on it there.
  const Fin fin{.height = [](double) { return 0.35; }, .lean_rad = 0.52};
  Random random(12);
  Scan a = faces_of_edge_0(Vec3(0, -0.5, 0.87)), left, right;
  left.name = "left", right.name = "right", left.from = right.from = kInside;
  const Scan all = faces_of_edge_0(kInside);
  for (std::size_t i = 0; i < all.p_part.size(); ++i) {
    Scan* s = all.p_part[i].x() < 33 ? &left : all.p_part[i].x() > 47 ? &right : nullptr;
    if (s) s->p_part.push_back(all.p_part[i]), s->n_part.push_back(all.n_part[i]);
  }
  for (int k = 0; k < 2; ++k) add_fin(left, fin, 0, 33, 0.2, random), add_fin(right, fin, 47, 80, 0.2, random);
  const Burrs burrs = measured(job_of_edge_0(), measure({a, left, right}, some_place(), 13), plate_features({}));
  for (std::size_t i = 70; i < 90; ++i) {
    EXPECT_GT(burrs.edges[0].height_mm[i], 0.15) << i;
    EXPECT_GT(burrs.edges[0].height_upper_mm[i], 0.4);
    EXPECT_GT(burrs.edges[0].height_sd_mm[i], 0.05);
  }
}

/// One capture from outside sees both faces and the fin, one from inside the top and the fin's other flank; the second one is misplaced
/// square to the side that it does not see.
Burrs with_misplaced(double by_mm, double lean) {
  const Fin fin{.height = [](double s) { return 0.4 + 0.1 * std::sin(s / 6); }, .lean_rad = lean, .root_mm = 0.02};
  Random random(21);
  Scan outside = faces_of_edge_0(), inside;
  inside.name = "inside", inside.from = kInside;
  const Scan faces = faces_of_edge_0(kInside);
  for (std::size_t i = 0; i < faces.p_part.size(); ++i)
    if (faces.n_part[i].z() > 0.9 && faces.p_part[i].y() > 0.05) inside.p_part.push_back(faces.p_part[i]), inside.n_part.push_back(faces.n_part[i]);
  add_fin(outside, fin, 0, 80, 0.2, random);
  for (int k = 0; k < 3; ++k) add_fin(inside, fin, 0, 80, 0.2, random);
  Measured m = measure({outside, inside}, some_place(), 22);
  const Vec3 shift = m.location.T_base_part.direction(Vec3(0, -by_mm, 0));
  for (std::size_t i = m.cloud.captures[1].begin; i < m.cloud.captures[1].end; ++i) m.cloud.p_base[i] += shift;
  Mat6 doubt = Mat6::Zero();
  doubt.diagonal().head<3>().setConstant(0.03 * 0.03);
  m.location.corrections.resize(2), m.location.correction_covariances.assign(2, doubt);
  return measured(job_of_edge_0(), m, plate_features({}));
}

TEST(Burr, ACaptureThatDoesNotSeeAFaceIsNotBelievedOverIt) {
  for (const double lean : {0.5, 1.2}) {  // the fin stands out farther over the face that is seen, over the one that is not
    const Burrs at_place = with_misplaced(0, lean), off = with_misplaced(0.06, lean);
    double bias = 0, moved = 0;
    int count = 0;
    for (std::size_t i = 4; i + 4 < off.edges[0].height_mm.size(); ++i, ++count) {
      bias += off.edges[0].height_mm[i] - (0.4 + 0.1 * std::sin(0.5 * static_cast<double>(i) / 6));
      moved += off.edges[0].height_mm[i] - at_place.edges[0].height_mm[i];
    }
    EXPECT_LT(std::abs(bias / count), 0.02) << lean;
    EXPECT_LT(std::abs(moved / count), 0.01) << lean;
  }
}

TEST(Burr, OrderOfPointsAndPlaceOfTheCellDoNotMatter) {
  const Fin fin{.height = [](double s) { return 0.4 + 0.1 * std::sin(s / 5); }};
  Random random(8);
  Scan s = faces_of_edge_0();
  add_fin(s, fin, 0, 80, 0.2, random);
  const Measured a = measure({s}, some_place(), 4);
  Measured b = a;
  for (std::size_t i = b.cloud.p_base.size(); i > 1; --i) {
    const std::size_t j = random.below(i);
    std::swap(b.cloud.p_base[i - 1], b.cloud.p_base[j]), std::swap(b.cloud.n_base[i - 1], b.cloud.n_base[j]);
  }
  const Pose<frame::Base, frame::Base> move(quat_from_zyx(1.1, 0.2, -0.4), Vec3(-900, 200, 100));
  for (Vec3& p : b.cloud.p_base) p = move.point(p);
  for (auto& c : b.cloud.captures) c.T_base_sensor = move * c.T_base_sensor;
  b.location.T_base_part = move * a.location.T_base_part;
  const Burrs x = measured(job_of_edge_0(), a, plate_features({})), y = measured(job_of_edge_0(), b, plate_features({}));
  for (std::size_t i = 0; i < x.edges[0].height_mm.size(); ++i) EXPECT_NEAR(x.edges[0].height_mm[i], y.edges[0].height_mm[i], 2e-3);
}

TEST(Burr, FitAndBurrTogether) {
  const Fin fin{.height = [](double s) { return 0.5 + 0.1 * std::sin(s / 5); }, .lean_rad = 0.9};
  Random random(9);
  Scan s = scan_plate({}, [](int face, const Vec3& p) { return face == 0 ? 0.1 + 0.001 * p.x() : -0.15; }, 0.25, 14, {0});
  Scan burr;
  add_fin(burr, fin, 0, 80, 0.2, random);
  for (std::size_t i = 0; i < burr.p_part.size(); ++i) {  // stands on the true edge
    const Vec3 p = burr.p_part[i] + Vec3(0, 0.15, 0.1 + 0.001 * burr.p_part[i].x());
    s.p_part.push_back(p), s.n_part.push_back(burr.n_part[i]);
  }
  const Job job = job_of_edge_0();
  const Measured m = measure({s}, some_place(), 5);
  auto f = fit({}, job, m.cloud, m.location);
  ASSERT_TRUE(f.has_value()) << f.error()[0].message;
  const Burrs b = measured(job, m, f->artefact);
  double square = 0;
  int count = 0;
  for (std::size_t i = 4; i + 4 < b.edges[0].height_mm.size(); ++i, ++count)
    square += std::pow(b.edges[0].height_mm[i] - fin.height(f->artefact.edges[0].adapted[i].x()), 2);
  EXPECT_LT(std::sqrt(square / count), 0.06);
}

TEST(BurrRefuses, TallerThanTheRecipeRemoves) {
  const Fin fin{.height = [](double s) { return s > 30 && s < 50 ? 2.4 : 0.3; }};
  Random random(10);
  Scan s = faces_of_edge_0();
  add_fin(s, fin, 0, 80, 0.2, random);
  EXPECT_EQ(refusal(job_of_edge_0(), measure({s}, some_place(), 6), plate_features({})), "burr.above_limit");
}

TEST(BurrRefuses, NotSeen) {
  Scan s = faces_of_edge_0(), half;
  half.name = "half";
  for (std::size_t i = 0; i < s.p_part.size(); ++i)
    if (s.p_part[i].x() < 40) half.p_part.push_back(s.p_part[i]), half.n_part.push_back(s.n_part[i]);
  EXPECT_EQ(refusal(job_of_edge_0(), measure({half}, some_place(), 11), plate_features({})), "burr.not_seen");
}

}  // namespace
}  // namespace asbuilt
