// SPDX-License-Identifier: GPL-3.0-or-later
// Laws of the fit on parts whose truth is known by construction, and every refusal provoked.
#include "planner/fit/fit.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/unit/fit/synthetic_part.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

Deviation none() {
  return [](int, const Vec3&) { return 0.0; };
}
/// Every face shifted and tilted a little, like machined ones.
Deviation machined() {
  return [](int face, const Vec3& p) {
    static const double shift[5] = {0.12, -0.2, 0.15, 0.05, -0.11};
    static const Vec3 tilt[5] = {{0.001, -0.0015, 0}, {0.0012, 0, 0.002}, {0, -0.001, 0.001}, {0.0008, 0, -0.001}, {0, 0.002, 0.001}};
    return shift[face] + tilt[face].dot(p);
  };
}
Deviation bent() {
  return [](int face, const Vec3& p) {
    if (face == 0) return 0.4 * std::sin(kPi * p.x() / 80) + 0.2 * std::cos(kPi * p.y() / 60);
    return 0.3 * std::sin(0.05 * (p.x() + 0.7 * p.y()) + face) + 0.01 * p.z();
  };
}

/// True point of the rim between top and side k (0..3) of a plate with the deviation, at s along the drawing's edge.
Vec3 true_rim(const Plate& plate, const Deviation& deviation, int k, double s) {
  const Vec3 c[4] = {{0, 0, 0}, {plate.length, 0, 0}, {plate.length, plate.width, 0}, {0, plate.width, 0}};
  const Vec3 n[4] = {{0, -1, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  const Vec3 p = c[k] + (c[(k + 1) % 4] - c[k]).normalized() * s;
  Vec3 x = p;
  for (int i = 0; i < 20; ++i) {
    // the surfaces are height fields over the nominal ones
    const Vec3 on_side = x - n[k] * n[k].dot(x - p), on_top(x.x(), x.y(), 0);
    x = p + n[k] * deviation(k + 1, on_side) + Vec3(0, 0, deviation(0, on_top));
  }
  return x;
}

double worst_error(const Features& f, const Plate& plate, const Deviation& deviation, double keep_off_mm = 2) {
  double worst = 0;
  for (std::size_t e = 0; e < f.edges.size(); ++e) {
    const AdaptedEdge& edge = f.edges[e];
    const int k = edge.edge;
    const double length = k % 2 == 0 ? plate.length : plate.width;
    for (double s = keep_off_mm; s < length - keep_off_mm; s += 1.0) {
      const Vec3 t = true_rim(plate, deviation, k, s);
      double best = 1e300;
      for (std::size_t i = 0; i + 1 < edge.adapted.size(); ++i) {
        const Vec3 d = edge.adapted[i + 1] - edge.adapted[i];
        const double u = std::clamp(d.dot(t - edge.adapted[i]) / d.squaredNorm(), 0.0, 1.0);
        best = std::min(best, (t - edge.adapted[i] - u * d).norm());
      }
      worst = std::max(worst, best);
    }
  }
  return worst;
}

Features fitted(const Job& job, const Measured& m) {
  auto r = fit({}, job, m.cloud, m.location);
  if (!r) {
    ADD_FAILURE() << r.error()[0].code << " " << r.error()[0].where << " " << r.error()[0].message;
    return {};
  }
  return r->artefact;
}

std::string refusal(const Job& job, const Measured& m, const FitRecipe& recipe = {}) {
  auto r = fit(recipe, job, m.cloud, m.location);
  if (r) return "";
  EXPECT_FALSE(r.error()[0].message.empty());
  EXPECT_FALSE(r.error()[0].where.empty());
  EXPECT_EQ(r.error()[0].stage, "fit");
  return r.error()[0].code;
}

TEST(Fit, TruePlateGivesItsDrawing) {
  const Plate plate;
  const Features f = fitted(plate_job(plate), measure({scan_plate(plate, none())}, some_place(), 1));
  ASSERT_EQ(f.edges.size(), 4u);
  EXPECT_LT(worst_error(f, plate, none()), 0.003);
  for (const AdaptedEdge& e : f.edges)
    for (const StationStatus s : e.status) EXPECT_EQ(s, StationStatus::measured);
}

TEST(Fit, MachinedPlateIsFoundToMicrometres) {
  const Plate plate;
  const Features f = fitted(plate_job(plate), measure({scan_plate(plate, machined())}, some_place(), 2));
  ASSERT_EQ(f.edges.size(), 4u);
  EXPECT_LT(worst_error(f, plate, machined()), 0.004);
}

TEST(Fit, BentPlateIsFollowed) {
  const Plate plate;
  const Features f = fitted(plate_job(plate), measure({scan_plate(plate, bent())}, some_place(), 3));
  ASSERT_EQ(f.edges.size(), 4u);
  EXPECT_LT(worst_error(f, plate, bent()), 0.01);
}

TEST(Fit, DiscEdgeIsClosedAndRound) {
  const double radius = 30;
  const auto deviation = [](int face, double) { return face == 0 ? 0.1 : -0.25; };
  const Features f = fitted(disc_job(radius), measure({scan_disc(radius, deviation)}, some_place(), 4));
  ASSERT_EQ(f.edges.size(), 1u);
  const AdaptedEdge& e = f.edges[0];
  EXPECT_TRUE(e.is_closed);
  EXPECT_EQ(e.adapted.front(), e.adapted.back());
  for (const Vec3& p : e.adapted) {
    EXPECT_NEAR(p.head<2>().norm(), radius - 0.25, 0.003);
    EXPECT_NEAR(p.z(), 0.1, 0.003);
  }
}

TEST(Fit, StationsAreAtMostHalfAMillimetreApartAndArraysAreParallel) {
  const Plate plate;
  const Features f = fitted(plate_job(plate), measure({scan_plate(plate, bent())}, some_place(), 5));
  for (const AdaptedEdge& e : f.edges) {
    for (std::size_t i = 1; i < e.s_mm.size(); ++i) EXPECT_LE(e.s_mm[i] - e.s_mm[i - 1], 0.5 + 1e-9);
    for (const std::size_t n : {e.nominal.size(), e.adapted.size(), e.tangent.size(), e.n_1.size(), e.n_2.size(), e.sigma_mm.size(),
                                e.covariance.size(), e.status.size(), e.rigid_mm.size(), e.feature_mm.size(), e.local_mm.size()})
      EXPECT_EQ(n, e.s_mm.size());
    const Job job = plate_job(plate);
    const Measured m = measure({}, some_place(), 5);
    for (std::size_t i = 0; i < e.s_mm.size(); ++i) {
      const Vec3 whole = m.location.T_base_part.point(e.adapted[i]) - e.nominal[i];  // the drawing's place is base here
      EXPECT_NEAR(e.rigid_mm[i] + e.feature_mm[i] + e.local_mm[i], whole.norm(), 1e-9);
    }
  }
}

TEST(Fit, ShiftAndTurnOfTheWholeCellChangeNothing) {
  const Plate plate;
  const Measured a = measure({scan_plate(plate, machined())}, some_place(), 6);
  const Pose<frame::Base, frame::Base> move(quat_from_zyx(2.1, 0.3, -0.9), Vec3(-2500, 900, 300));
  Measured b = a;
  for (Vec3& p : b.cloud.p_base) p = move.point(p);
  for (auto& n : b.cloud.n_base) n = (move.q * n.cast<double>()).cast<float>();
  for (auto& c : b.cloud.captures) c.T_base_sensor = move * c.T_base_sensor;
  b.location.T_base_part = move * a.location.T_base_part;
  const Features fa = fitted(plate_job(plate), a), fb = fitted(plate_job(plate), b);
  ASSERT_EQ(fa.edges.size(), fb.edges.size());
  for (std::size_t e = 0; e < fa.edges.size(); ++e) {
    ASSERT_EQ(fa.edges[e].adapted.size(), fb.edges[e].adapted.size());
    for (std::size_t i = 0; i < fa.edges[e].adapted.size(); ++i) EXPECT_LT((fa.edges[e].adapted[i] - fb.edges[e].adapted[i]).norm(), 1e-4);
  }
}

TEST(Fit, OrderOfPointsDoesNotMatter) {
  const Plate plate;
  const Measured a = measure({scan_plate(plate, machined())}, some_place(), 7);
  Measured b = a;
  Random random(5);
  for (std::size_t i = b.cloud.p_base.size(); i > 1; --i) {
    const std::size_t j = random.below(i);
    std::swap(b.cloud.p_base[i - 1], b.cloud.p_base[j]), std::swap(b.cloud.n_base[i - 1], b.cloud.n_base[j]);
  }
  const Features fa = fitted(plate_job(plate), a), fb = fitted(plate_job(plate), b);
  for (std::size_t e = 0; e < fa.edges.size(); ++e)
    for (std::size_t i = 0; i < fa.edges[e].adapted.size(); ++i) EXPECT_LT((fa.edges[e].adapted[i] - fb.edges[e].adapted[i]).norm(), 1e-7);
}

TEST(Fit, SameInputSameBits) {
  const Plate plate;
  const Measured m = measure({scan_plate(plate, bent())}, some_place(), 8);
  const Features a = fitted(plate_job(plate), m), b = fitted(plate_job(plate), m);
  for (std::size_t e = 0; e < a.edges.size(); ++e)
    for (std::size_t i = 0; i < a.edges[e].adapted.size(); ++i) EXPECT_EQ(a.edges[e].adapted[i], b.edges[e].adapted[i]);
}

TEST(Fit, BurrDoesNotTiltTheFaces) {
  const Plate plate;
  Scan clean = scan_plate(plate, machined());
  Scan burred = clean;
  Random random(9);
  const std::size_t count = clean.p_part.size() / 5;  // 20 % of the points stand on a burr along the rim and lean over the faces
  for (std::size_t i = 0; i < count; ++i) {
    const int k = static_cast<int>(random.below(4));
    const double length = k % 2 == 0 ? plate.length : plate.width;
    const Vec3 n[4] = {{0, -1, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
    burred.p_part.push_back(true_rim(plate, machined(), k, random.uniform(0, length)) + n[k] * random.uniform(-1.2, 0.4) +
                            Vec3(0, 0, random.uniform(0.02, 0.8)));
    burred.n_part.push_back(Vec3::UnitZ());
  }
  const Features a = fitted(plate_job(plate), measure({clean}, some_place(), 10));
  const Features b = fitted(plate_job(plate), measure({burred}, some_place(), 10));
  ASSERT_EQ(a.edges.size(), b.edges.size());
  EXPECT_LT(worst_error(b, plate, machined()), 0.005);
}

TEST(Fit, CapturesAreBroughtTogether) {
  const Plate plate;
  Scan a = scan_plate(plate, machined()), b = a;
  a.name = "a.ply", b.name = "b.ply";
  b.error = {Eigen::Quaterniond::Identity(), Vec3(0.05, -0.06, 0.08)};
  Measured m = measure({a, b}, some_place(), 11, 0.05);
  m.location.correction_covariances[0] *= 1e-4;  // the reference
  const Features f = fitted(plate_job(plate), m);
  EXPECT_LT(worst_error(f, plate, machined()), 0.006);
  EXPECT_LT((f.corrections[1].p_mm + Vec3(0.05, -0.06, 0.08)).norm(), 0.01);
}

TEST(Fit, SigmaCoversTheError) {
  const Plate plate;
  int over_2 = 0, over_3 = 0, count = 0;
  for (int trial = 0; trial < 6; ++trial) {
    Scan a = scan_plate(plate, machined(), 0.6);
    const Features f = fitted(plate_job(plate), measure({a}, some_place(), 100 + trial));
    for (const AdaptedEdge& e : f.edges)
      for (std::size_t i = 8; i + 8 < e.adapted.size(); i += 8) {
        const double s = e.s_mm[i];
        Vec3 v = true_rim(plate, machined(), e.edge, s) - e.adapted[i];
        v -= e.tangent[i] * e.tangent[i].dot(v);
        const double best = v.norm();
        ++count;
        over_2 += best > 2 * e.sigma_mm[i], over_3 += best > 3 * e.sigma_mm[i];
        EXPECT_LT(e.sigma_mm[i], 0.01);
      }
  }
  EXPECT_LT(over_3, 0.03 * count);
  EXPECT_LT(over_2, 0.15 * count);
}

// ---------------------------------------------------------------- refusals
TEST(FitRefuses, EdgeNeverSeen) {
  const Plate plate;
  EXPECT_EQ(refusal(plate_job(plate), measure({scan_plate(plate, none(), 0.3, 14, {0, 1, 3})}, some_place(), 20)), "fit.edge_not_seen");
}

TEST(FitRefuses, OneFaceSeenOnly) {
  const Plate plate;
  Scan s = scan_plate(plate, none());
  Scan top;
  top.name = "top.ply";
  for (std::size_t i = 0; i < s.p_part.size(); ++i)
    if (s.n_part[i].z() > 0.5) top.p_part.push_back(s.p_part[i]), top.n_part.push_back(s.n_part[i]);
  EXPECT_EQ(refusal(plate_job(plate), measure({top}, some_place(), 21)), "fit.edge_not_seen");
}

TEST(FitRefuses, TooFewPoints) {
  const Plate plate;
  EXPECT_EQ(refusal(plate_job(plate), measure({scan_plate(plate, none(), 2.4)}, some_place(), 22)).substr(0, 4), "fit.");
  Job job = plate_job({.length = 12, .width = 12, .height = 12});
  EXPECT_EQ(refusal(job, measure({scan_plate({.length = 12, .width = 12, .height = 12}, none(), 1.4)}, some_place(), 22)), "fit.too_few_points");
}

TEST(FitRefuses, TangentFaces) {
  Job job = plate_job();
  job.part.brep.edges[0].kind = EdgeKind::near_tangent;
  job.part.brep.edges[0].dihedral_rad = rad_from_deg(4);
  EXPECT_EQ(refusal(job, measure({scan_plate({}, none())}, some_place(), 23)), "fit.tangent");
}

TEST(FitRefuses, EdgeWithOneFace) {
  Job job = plate_job();
  job.part.brep.edges[0].face_2 = -1;
  EXPECT_EQ(refusal(job, measure({scan_plate({}, none())}, some_place(), 24)), "fit.no_face");
}

TEST(FitRefuses, TooFarFromTheDrawing) {
  const Plate plate;
  const auto far = [](int face, const Vec3&) { return face == 1 ? 0.9 : 0.0; };
  EXPECT_EQ(refusal(plate_job(plate), measure({scan_plate(plate, far)}, some_place(), 25), {.deviation_max_mm = 0.8}).substr(0, 4), "fit.");
  const auto both = [](int face, const Vec3&) { return face < 2 ? 0.7 : 0.0; };
  EXPECT_EQ(refusal(plate_job(plate), measure({scan_plate(plate, both)}, some_place(), 25), {.deviation_max_mm = 0.8}), "fit.deviation_above_limit");
}

TEST(FitRefuses, CapturesContradict) {
  const Plate plate;
  Scan a = scan_plate(plate, none()), b = a;
  b.name = "b.ply";
  b.error = {Eigen::Quaterniond::Identity(), Vec3(0, 0, 0.4)};
  EXPECT_EQ(refusal(plate_job(plate), measure({a, b}, some_place(), 26, 0.01)), "fit.captures_contradict");
}

TEST(FitRefuses, EdgeAlreadyBroken) {
  const Plate plate;
  Scan whole = scan_plate(plate, none()), s;
  s.name = "a.ply";
  for (std::size_t i = 0; i < whole.p_part.size(); ++i)  // a chamfer of 0.8 mm along y = 0
    if (whole.p_part[i].y() - whole.p_part[i].z() > 0.8) s.p_part.push_back(whole.p_part[i]), s.n_part.push_back(whole.n_part[i]);
  for (double x = 0; x < plate.length; x += 0.25)
    for (double u = 0; u < 0.8; u += 0.2) s.p_part.emplace_back(x, u, u - 0.8), s.n_part.push_back(Vec3(0, -1, 1).normalized());
  EXPECT_EQ(refusal(plate_job(plate), measure({s}, some_place(), 27)), "fit.edge_broken");
}

}  // namespace
}  // namespace asbuilt
