// SPDX-License-Identifier: GPL-3.0-or-later
// Files on which the reader and the kernel of the oracle disagree: what is true is worked out a third way (closed forms, Gauss over
// whole patches by the definition of B-splines, limits of meshes), and the reader has to agree with that.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "independent.hpp"
#include "planner/io/step/step_reader.hpp"

namespace asbuilt {
namespace {

namespace fs = std::filesystem;
const fs::path kRoot = "../shared/data/step";

class KernelFaults : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(kRoot / "oracle.json")) GTEST_SKIP() << "no ../shared/data/step here";
  }
  static Brep part(const std::string& name, double chord_mm = 0.02, double angle_rad = 0.5) {
    std::ifstream in(kRoot / name, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    StepOptions o;
    o.chord_mm = chord_mm, o.angle_rad = angle_rad;
    auto r = read_step(bytes, name, o);
    EXPECT_TRUE(r);
    return r ? std::move(r->artefact) : Brep{};
  }
  static nlohmann::json kernel(const std::string& name) {
    return nlohmann::json::parse(std::ifstream(kRoot / "oracle.json"))["files"][name]["occ"];
  }
  /// Volume of the triangles alone as the chord goes to zero: the error falls with the chord, so three of them give the limit.
  static double limit_of_meshes(const std::string& name, double chord_mm) {
    const double coarse = test::triangle_sums(part(name, chord_mm, 1).mesh).volume_mm3.x();
    const double fine = test::triangle_sums(part(name, chord_mm / 4, 1).mesh).volume_mm3.x();
    return fine + (fine - coarse) / 3;
  }
};

// A half shell between R 60 and R 59 about (250, 0, 0) with a tube of R 18 / R 17 that ends blind on the sphere: all of it turned about x.
TEST_F(KernelFaults, HalfShellOfCatia) {
  const Brep b = part("catia5_head_back.stp");
  const auto h = [](double r, double sphere) { return std::sqrt(sphere * sphere - r * r); };
  const double shell = 2.0 / 3 * kPi * (std::pow(60, 3) - std::pow(59, 3));
  const auto under = [&](double r) { return 35 * r * r + std::pow(h(r, 60), 3) / 3; };  // integral of r (70 - sqrt(3600 - r^2))
  const double volume = shell + 2 * kPi * (under(18) - under(17));
  const double area = 2 * kPi * 60 * h(18, 60) + 2 * kPi * 59 * 59 + kPi * (3600 - 3481) + 2 * kPi * 18 * (70 - h(18, 60)) +
                      2 * kPi * 17 * (70 - h(17, 60)) + kPi * (324 - 289) + 2 * kPi * 60 * (60 - h(17, 60));
  // Its edges are B-splines up to 0.08 mm off the surfaces, so closed forms and file agree to that only.
  EXPECT_NEAR(b.volume_mm3, volume, 1e-3 * volume);
  EXPECT_NEAR(b.area_mm2, area, 1e-3 * area);
  const auto k = kernel("catia5_head_back.stp");
  EXPECT_GT(k["volume"].get<double>(), 30 * volume);  // 880 933 against 23 639: the half spheres closed the wrong way round
  EXPECT_GT(k["area"].get<double>(), 1.4 * area);
  double convex = 0;
  for (const BrepEdge& e : b.edges)
    if (e.kind == EdgeKind::sharp_convex) convex += e.length_mm;
  const double circles = 2 * kPi * (60 + 59 + 18 + 17);  // rims of the shell and of the tube; the two circles on the sphere are concave
  EXPECT_NEAR(convex, circles, 5e-3 * circles);
}

// Ten balls: a half disc of r 3.175 turned about an axis 0.0254 off its flat side (Pappus), the bore left open.
TEST_F(KernelFaults, BallsOfZoo) {
  const Brep b = part("zoo_ball_bearing.step");
  const double r = 3.175, off = 0.0254;
  const double area = 2 * kPi * kPi * off * r + 4 * kPi * r * r, volume = kPi * kPi * off * r * r + 4.0 / 3 * kPi * r * r * r;
  int balls = 0;
  for (const BrepFace& f : b.faces)
    if (const auto* s = std::get_if<BSplineSurface>(&f.surface.shape)) {
      ++balls;
      EXPECT_NEAR(test::whole_patch(*s).area_mm2, area, 1e-6 * area);
      EXPECT_NEAR(f.area_mm2, area, 1e-4 * area);
    }
  EXPECT_EQ(balls, 10);
  const auto k = kernel("zoo_ball_bearing.step");
  double others = 0;
  int kernel_balls = 0;
  for (const auto& s : k["per_solid"]) {
    if (s["faces"] != 2) {
      others += s["volume"].get<double>();
      continue;
    }
    ++kernel_balls;
    EXPECT_GT(s["volume"].get<double>(), 1.009 * volume);  // 137.862 against 136.593
  }
  EXPECT_EQ(kernel_balls, 10);
  EXPECT_NEAR(b.volume_mm3, others + 10 * volume, 1e-4 * b.volume_mm3);
}

// Four tubes, each two whole rational patches and two plane rings, and a flange of planes and cylinders.
TEST_F(KernelFaults, TubesOfZoo) {
  const Brep b = part("zoo_exhaust_manifold.step", 0.1);
  std::map<int, double> volume, patches;
  double area = 0, worst_face = 0;
  for (const BrepFace& f : b.faces)
    if (const auto* s = std::get_if<BSplineSurface>(&f.surface.shape)) {
      ASSERT_EQ(f.edges.size(), 2u);
      const test::PatchSums sums = test::whole_patch(*s);
      area += sums.area_mm2;
      worst_face = std::max(worst_face, std::abs(f.area_mm2 - sums.area_mm2) / sums.area_mm2);
      volume[f.body] += (f.same_sense ? 1 : -1) * sums.flux_mm3.x(), ++patches[f.body];
    }
  EXPECT_LT(worst_face, 2e-4);
  for (const BrepFace& f : b.faces) {
    if (!patches.contains(f.body)) continue;
    const auto* plane = std::get_if<PlaneSurface>(&f.surface.shape);
    if (!plane) continue;
    double ring = 0;
    Vec3 center;
    ASSERT_EQ(f.edges.size(), 2u);
    double r[2];
    for (int i = 0; i < 2; ++i) {
      const auto* c = std::get_if<CircleCurve>(&b.edges[static_cast<std::size_t>(f.edges[static_cast<std::size_t>(i)])].curve.shape);
      ASSERT_NE(c, nullptr);
      r[i] = c->radius_mm, center = c->at.origin;
    }
    ring = kPi * std::abs(r[0] * r[0] - r[1] * r[1]);
    volume[f.body] += (f.same_sense ? 1 : -1) * plane->at.z.x() * center.x() * ring;
  }
  const auto k = kernel("zoo_exhaust_manifold.step");
  const double analytic = k["faces_by_surface"]["Cylinder"]["area"].get<double>() + k["faces_by_surface"]["Plane"]["area"].get<double>();
  EXPECT_NEAR(b.area_mm2, area + analytic, 1e-4 * area);                                            // 577 066 by whole patches
  EXPECT_LT(k["faces_by_surface"]["BSplineSurfaceRational"]["area"].get<double>(), 0.9985 * area);  // 553 603 against 554 730
  ASSERT_EQ(volume.size(), 4u);
  double tubes = 0, kernel_tubes = 0;
  for (const auto& [body, v] : volume) tubes += v;
  for (int i = 0; i < 4; ++i) kernel_tubes += k["per_solid"][static_cast<std::size_t>(i)]["volume"].get<double>();
  const double flange = k["volume"].get<double>() - kernel_tubes;
  EXPECT_NEAR(b.volume_mm3, tubes + flange, 1e-3 * b.volume_mm3);
  EXPECT_LT(k["volume"].get<double>(), 0.997 * (tubes + flange));
  std::printf("tubes: whole patches %.1f mm2 %.1f mm3; reader %.1f mm3 with the flange; kernel %.1f mm3\n", area, tubes, b.volume_mm3,
              k["volume"].get<double>());
}

// Rational half-round grooves; no closed form at hand, so the triangles alone have to lead to the reader's number.
TEST_F(KernelFaults, GroovesOfNist) {
  const double limit = limit_of_meshes("nist_mbe_pmi_11.stp", 0.005);
  const Brep b = part("nist_mbe_pmi_11.stp");
  EXPECT_NEAR(b.volume_mm3, limit, 1e-4 * limit);                                    // 5129.38
  EXPECT_GT(kernel("nist_mbe_pmi_11.stp")["volume"].get<double>(), 1.0015 * limit);  // 5138.63; its own mesh 5126.0
  int whole = 0;  // the tori are r 1.5 at R 30 and R 17.5: whole patches by Gauss against 4 pi^2 R r
  for (const BrepFace& f : b.faces)
    if (const auto* s = std::get_if<BSplineSurface>(&f.surface.shape))
      for (double R : {30.0, 17.5}) whole += std::abs(test::whole_patch(*s).area_mm2 / (4 * kPi * kPi * R * 1.5) - 1) < 1e-6;
  EXPECT_EQ(whole, 4);
}

TEST_F(KernelFaults, ShellOfOnshape) {
  const double limit = limit_of_meshes("onshape_proximal_shell.step", 0.004);
  const Brep b = part("onshape_proximal_shell.step");
  EXPECT_NEAR(b.volume_mm3, limit, 3e-4 * limit);                                           // 3533.1
  EXPECT_LT(kernel("onshape_proximal_shell.step")["volume"].get<double>(), 0.993 * limit);  // 3506.99; its own mesh 3536.0
}

// The kernel sees 5 to 15 degrees along 40 short edges of tangent fillets. The normals by differences of positions, taken from the
// definition of B-splines a little inside each face, agree within half a degree there and everywhere else.
TEST_F(KernelFaults, FilletsOfRhino) {
  const Brep b = part("rhino8_boxed_sphere.step");
  const double limit = limit_of_meshes("rhino8_boxed_sphere.step", 0.02);
  EXPECT_NEAR(b.volume_mm3, limit, 5e-4 * limit);                                         // 733.6
  EXPECT_LT(kernel("rhino8_boxed_sphere.step")["volume"].get<double>(), 0.9985 * limit);  // 732.01; its own mesh 733.51
  const auto normal_at = [](const BrepFace& f, const Vec3& p) {
    const SurfaceFoot foot = project(f.surface, p);
    const SurfaceDomain d = domain(f.surface);
    const double hu = 1e-5 * (d.u1 - d.u0 < 1e200 ? d.u1 - d.u0 : 1), hv = 1e-5 * (d.v1 - d.v0 < 1e200 ? d.v1 - d.v0 : 1);
    const auto inside = [](double t, double h, bool bounded, double low, double high) {
      return bounded ? std::clamp(t, low + 2 * h, high - 2 * h) : t;
    };
    const double u = inside(foot.u, 10 * hu, d.is_bounded_u, d.u0, d.u1), v = inside(foot.v, 10 * hv, d.is_bounded_v, d.v0, d.v1);
    const auto at = [&](double a, double c) { return evaluate_jet(f.surface, a, c, 1).p; };
    const Vec3 n = (at(u + hu, v) - at(u - hu, v)).cross(at(u, v + hv) - at(u, v - hv));
    return Vec3((f.same_sense ? 1 : -1) * n.normalized());
  };
  double worst = 0, length = 0;
  for (const BrepEdge& e : b.edges) {
    if (e.face_1 < 0 || e.face_2 < 0) continue;
    length += e.length_mm;
    for (std::size_t i = 1; i + 1 < e.p.size(); ++i) {
      const Vec3 n_1 = normal_at(b.faces[static_cast<std::size_t>(e.face_1)], e.p[i]),
                 n_2 = normal_at(b.faces[static_cast<std::size_t>(e.face_2)], e.p[i]);
      worst = std::max(worst, std::atan2(n_1.cross(n_2).norm(), n_1.dot(n_2)));
    }
  }
  EXPECT_LT(deg_from_rad(worst), 0.5);
  EXPECT_GT(length, 800);
}

}  // namespace
}  // namespace asbuilt
