// SPDX-License-Identifier: GPL-3.0-or-later
// Edges of holes, free-form faces and flat patches of triangles.
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "planner/fit/fit.hpp"
#include "tests/unit/fit/synthetic_part.hpp"

namespace asbuilt {
namespace {

using namespace synthetic;

Features fitted(const Job& job, const Measured& m) {
  auto r = fit({}, job, m.cloud, m.location);
  if (!r) {
    ADD_FAILURE() << r.error()[0].code << " " << r.error()[0].where << " " << r.error()[0].message;
    return {};
  }
  return r->artefact;
}

TEST(FitShapes, RimOfAHole) {
  // A hole of radius 8 that came out 0.12 mm larger, 0.2 mm off its place, in a top that lies 0.05 mm low.
  const double radius = 8;
  Job job = disc_job(radius);
  job.part.brep.faces[1].same_sense = false;  // the material is outside
  const Vec3 shift(0.2, 0, 0);
  Scan scan;
  scan.name = "a.ply";
  for (int i = 0; i < 200; ++i) {
    const double a = 2 * kPi * i / 200;
    const Vec3 r(std::cos(a), std::sin(a), 0);
    for (double d = 0.15; d < 10; d += 0.3) {
      scan.p_part.push_back(shift + r * (radius + 0.12 + d) - Vec3(0, 0, 0.05)), scan.n_part.push_back(Vec3::UnitZ());
      scan.p_part.push_back(shift + r * (radius + 0.12) - Vec3(0, 0, d)), scan.n_part.push_back(-r);
    }
  }
  const Features f = fitted(job, measure({scan}, some_place(), 1));
  ASSERT_EQ(f.edges.size(), 1u);
  for (std::size_t i = 0; i < f.edges[0].adapted.size(); ++i) {
    const Vec3& p = f.edges[0].adapted[i];
    EXPECT_NEAR((p - shift).head<2>().norm(), radius + 0.12, 0.004);
    EXPECT_NEAR(p.z(), -0.05, 0.003);
    EXPECT_LT(f.edges[0].n_2[i].dot(p - shift), 0);  // out of the material: into the hole
  }
}

/// The plate's top as a B-spline: a gentle dome.
double dome(double x, double y) { return 3.0 * std::sin(kPi * x / 160 + 0.6) * std::cos(y / 60); }

Surface dome_surface() {
  BSplineSurface s;
  s.degree_u = s.degree_v = 3;
  s.count_u = 14, s.count_v = 10;
  const auto knots = [](int count) {
    std::vector<double> k;
    for (int i = 0; i < count + 4; ++i) k.push_back(std::clamp(i - 3, 0, count - 3));
    return k;
  };
  s.knots_u = knots(s.count_u), s.knots_v = knots(s.count_v);
  const auto greville = [](const std::vector<double>& k, int i) { return (k[i + 1] + k[i + 2] + k[i + 3]) / 3; };
  for (int i = 0; i < s.count_u; ++i)
    for (int j = 0; j < s.count_v; ++j) {
      const double x = -10 + 100 * greville(s.knots_u, i) / (s.count_u - 3), y = -10 + 70 * greville(s.knots_v, j) / (s.count_v - 3);
      s.poles.emplace_back(x, y, dome(x, y));
    }
  Surface out;
  out.shape = s;
  return out;
}

TEST(FitShapes, FreeFormTopWithAnOffset) {
  const Plate plate;
  Job job = plate_job(plate, {0});
  const Surface top = dome_surface();
  job.part.brep.faces[0].surface = top;
  const auto top_at = [&](double x, double y) {
    const SurfaceFoot foot = project(top, Vec3(x, y, dome(x, y)));
    return foot;
  };
  BrepEdge& e = job.part.brep.edges[0];
  e.p.clear(), e.tangent.clear(), e.n_1.clear(), e.n_2.clear(), e.s_mm.clear();
  for (int i = 0; i <= 160; ++i) {
    const SurfaceFoot f = top_at(0.5 * i, 0);
    e.p.emplace_back(f.p.x(), 0, f.p.z()), e.n_1.push_back(f.n), e.n_2.push_back(-Vec3::UnitY());
    e.tangent.push_back(Vec3(-Vec3::UnitY()).cross(f.n).normalized());
    e.s_mm.push_back(i == 0 ? 0.0 : e.s_mm.back() + (e.p[i] - e.p[i - 1]).norm());
  }
  if (e.tangent[0].x() < 0)
    for (Vec3& t : e.tangent) t = -t;
  e.length_mm = e.s_mm.back();
  // The true top: 0.15 mm proud and a little wavy; the side 0.1 mm back.
  const auto wave = [](double x) { return 0.15 + 0.05 * std::sin(x / 15); };
  Scan scan;
  scan.name = "a.ply";
  for (double x = 0.2; x < plate.length; x += 0.4)
    for (double d = 0.2; d < 14; d += 0.4) {
      const SurfaceFoot f = top_at(x, d);
      scan.p_part.push_back(f.p + wave(x) * f.n), scan.n_part.push_back(f.n);
      scan.p_part.emplace_back(x, 0.1, dome(x, 0) - d), scan.n_part.push_back(-Vec3::UnitY());
    }
  const Measured m = measure({scan}, some_place(), 2);
  const Features f = fitted(job, m);
  ASSERT_EQ(f.edges.size(), 1u);
  for (std::size_t i = 6; i + 6 < f.edges[0].adapted.size(); ++i) {
    const Vec3& p = f.edges[0].adapted[i];
    EXPECT_NEAR(p.y(), 0.1, 0.003);
    const SurfaceFoot foot = project(top, p);
    EXPECT_NEAR(foot.signed_distance_mm, wave(p.x()), 0.008) << p.x();
  }
}

TEST(FitShapes, FlatPatchOfTrianglesIsAPlane) {
  const Plate plate;
  Job job = plate_job(plate, {0});
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {plate.length, 0, 0}, {plate.length, plate.width, 0}, {0, plate.width, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  FacetSurface facets;
  facets.patch = std::make_shared<Mesh>(mesh);
  job.part.brep.faces[0].surface.shape = facets;
  const Features f = fitted(job, measure({scan_plate(plate, [](int face, const Vec3&) { return face == 0 ? 0.2 : -0.1; })}, some_place(), 3));
  ASSERT_EQ(f.edges.size(), 1u);
  for (const Vec3& p : f.edges[0].adapted) {
    EXPECT_NEAR(p.z(), 0.2, 0.003);
    EXPECT_NEAR(p.y(), 0.1, 0.003);
  }
}

}  // namespace
}  // namespace asbuilt
