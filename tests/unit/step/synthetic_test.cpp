// SPDX-License-Identifier: GPL-3.0-or-later
// Small files with truth known by construction: areas, volumes, edges, units, placements, orientation.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "mesh_truth.hpp"
#include "planner/base/random.hpp"
#include "planner/io/step/step_reader.hpp"
#include "step_text.hpp"
#include "variants.hpp"

namespace asbuilt {
namespace {

using test::StepText;

Done<Brep> read(const StepText& s, const StepOptions& options = {}) {
  auto r = read_step(s.text(), "made.step", options);
  if (!r) {
    ADD_FAILURE() << r.error()[0].code << " " << r.error()[0].where << " " << r.error()[0].message;
    return {};
  }
  return *r;
}

std::map<std::string, int> kinds(const Brep& b) {
  std::map<std::string, int> m;
  for (const BrepEdge& e : b.edges) ++m[e.is_seam ? "seam" : std::string(name_of(e.kind))];
  return m;
}

double mesh_volume(const Mesh& m) {
  double v = 0;
  for (const auto& t : m.triangles)
    v += m.vertices[static_cast<std::size_t>(t[0])].dot(
             m.vertices[static_cast<std::size_t>(t[1])].cross(m.vertices[static_cast<std::size_t>(t[2])])) /
         6;
  return v;
}

void expect_sound(const Brep& b) {
  EXPECT_EQ(b.open_edges_count, 0);
  EXPECT_TRUE(b.unread.empty()) << b.unread[0].why;
  for (const BrepFace& f : b.faces) EXPECT_EQ(f.fault, "") << f.id;
  for (const BrepEdge& e : b.edges) EXPECT_EQ(e.fault, "") << e.id;
}

TEST(Synthetic, Cube) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_EQ(b.faces.size(), 6u);
  EXPECT_EQ(kinds(b)["sharp_convex"], 12);
  EXPECT_NEAR(b.volume_mm3, 6000, 1e-9);
  EXPECT_NEAR(b.area_mm2, 2200, 1e-9);
  EXPECT_NEAR(mesh_volume(b.mesh), 6000, 1e-9);
  EXPECT_EQ(b.solids_count, 1);
  EXPECT_EQ(b.units, "mm");
  EXPECT_LT((b.box.min_mm - Vec3(0, 0, 0)).norm() + (b.box.max_mm - Vec3(30, 20, 10)).norm(), 1e-12);
  for (const BrepEdge& e : b.edges) {
    EXPECT_NEAR(e.dihedral_rad, kPi / 2, 1e-12);
    for (std::size_t i = 0; i < e.p.size(); ++i) {
      EXPECT_GT(e.n_1[i].cross(e.n_2[i]).dot(e.tangent[i]), 1 - 1e-9);  // convex, walked as face_1 has it
      const BrepFace& f = b.faces[static_cast<std::size_t>(e.face_1)];
      EXPECT_LT(f.box.center_mm().dot(e.n_1[i].cross(e.tangent[i])) * -1 + e.p[i].dot(e.n_1[i].cross(e.tangent[i])), 1e-9);  // into face_1
    }
    EXPECT_NEAR(e.s_mm.back(), e.length_mm, 1e-12);
  }
}

TEST(Synthetic, SeamlessCylinderBand) {
  StepText s;
  s.part({test::add_seamless_cylinder(s, 8, 25)});
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_NEAR(b.volume_mm3, kPi * 64 * 25, 1e-4 * kPi * 64 * 25);
  EXPECT_NEAR(b.area_mm2, 2 * kPi * 8 * 25 + 2 * kPi * 64, 0.1);
  EXPECT_EQ(kinds(b)["sharp_convex"], 2);
  for (const BrepEdge& e : b.edges) {
    EXPECT_TRUE(e.is_closed);
    EXPECT_NEAR(e.length_mm, 2 * kPi * 8, 1e-5);
    EXPECT_EQ(e.p.front(), e.p.back());
    EXPECT_EQ(e.curve_type, "circle");
  }
}

TEST(Synthetic, CylinderWithSeamReadsTheSame) {
  StepText s;
  const double r = 8, h = 25;
  const int v0 = s.vertex({r, 0, 0}), v1 = s.vertex({r, 0, h});
  const int e0 = s.edge(v0, v0, s.circle({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX(), r)),
            e1 = s.edge(v1, v1, s.circle({0, 0, h}, Vec3::UnitZ(), Vec3::UnitX(), r));
  const int seam = s.edge(v0, v1, s.line({r, 0, 0}, {r, 0, h}));
  const int side = s.add("CYLINDRICAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",8.)");
  const int low = s.add("PLANE(''," + s.ref(s.axes({0, 0, 0}, -Vec3::UnitZ(), Vec3::UnitX())) + ")");
  const int high = s.add("PLANE(''," + s.ref(s.axes({0, 0, h}, Vec3::UnitZ(), Vec3::UnitX())) + ")");
  s.part({s.solid({s.face({s.bound({e0, seam, -e1, -seam})}, side), s.face({s.bound({-e0})}, low), s.face({s.bound({e1})}, high)})});
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_NEAR(b.volume_mm3, kPi * 64 * 25, 1e-4 * kPi * 64 * 25);
  EXPECT_EQ(kinds(b)["seam"], 1);
  EXPECT_EQ(kinds(b)["sharp_convex"], 2);
}

TEST(Synthetic, SphereWithAVertexLoopAndWithNothing) {
  for (bool has_loop : {true, false}) {
    StepText s;
    const int sphere = s.add("SPHERICAL_SURFACE(''," + s.ref(s.axes({1, 2, 3}, Vec3::UnitZ(), Vec3::UnitX())) + ",7.)");
    std::vector<int> bounds;
    if (has_loop) bounds.push_back(s.vertex_bound(s.vertex({1, 2, 10})));
    s.part({s.solid({s.face(bounds, sphere)})});
    const Brep b = read(s).artefact;
    expect_sound(b);
    EXPECT_NEAR(b.area_mm2, 4 * kPi * 49, 0.05);
    EXPECT_NEAR(b.volume_mm3, 4.0 / 3 * kPi * 343, 0.2);
    EXPECT_TRUE(b.edges.empty());
  }
}

TEST(Synthetic, SphereCapsOverAndBesideThePole) {
  // A cap of height 4 of a sphere of radius 5, about the pole axis and about an axis across it.
  for (const Vec3& z : {Vec3(0, 0, 1), Vec3(1, 0, 0), Vec3(0.6, 0, 0.8)}) {
    StepText s;
    const double R = 5, h = 4, d = R - h, r = std::sqrt(R * R - d * d);
    const Vec3 x = Vec3::UnitY(), c = d * z;
    const int v = s.vertex(c + r * x), e = s.edge(v, v, s.circle(c, z, x, r));
    const int sphere = s.add("SPHERICAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",5.)");
    const int plane = s.add("PLANE(''," + s.ref(s.axes(c, -z, x)) + ")");
    s.part({s.solid({s.face({s.bound({e})}, sphere), s.face({s.bound({-e})}, plane)})});
    const Brep b = read(s).artefact;
    expect_sound(b);
    const double volume = kPi * h * h * (3 * R - h) / 3, area = 2 * kPi * R * h + kPi * r * r;
    EXPECT_NEAR(b.volume_mm3, volume, 2e-4 * volume);
    EXPECT_NEAR(b.area_mm2, area, 2e-4 * area);
  }
}

TEST(Synthetic, SphereCutByACrossedTrough) {
  const double R = 10, d = 6, z = std::sqrt(R * R - 2 * d * d), r = std::sqrt(R * R - d * d);
  StepText s;
  // Four arcs in the planes x = +-d, y = +-d, two of them around the far side: a border that is far from any cap.
  const Vec3 top[4] = {{d, d, z}, {-d, d, z}, {-d, -d, z}, {d, -d, z}};
  int v[4];
  for (int k = 0; k < 4; ++k) v[k] = s.vertex(top[k]);
  const int e0 = s.edge(v[0], v[1], s.circle({0, d, 0}, Vec3::UnitY(), Vec3::UnitX(), r));
  const int e1 = s.edge(v[1], v[2], s.circle({-d, 0, 0}, Vec3::UnitX(), Vec3::UnitY(), r));
  const int e2 = s.edge(v[2], v[3], s.circle({0, -d, 0}, -Vec3::UnitY(), Vec3::UnitX(), r));
  const int e3 = s.edge(v[3], v[0], s.circle({d, 0, 0}, -Vec3::UnitX(), Vec3::UnitY(), r));
  const int sphere = s.add("SPHERICAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitX(), Vec3::UnitY())) + ",10.)");
  s.part({s.solid({s.face({s.bound({e0, e1, e2, e3})}, sphere), s.face({s.bound({-e3, -e2, -e1, -e0})}, sphere)})});
  const Brep b = read(s).artefact;
  EXPECT_EQ(b.open_edges_count, 0);
  EXPECT_NEAR(b.area_mm2, 4 * kPi * R * R, 0.005 * 4 * kPi * R * R);  // both sides of the border together
  for (const BrepEdge& e : b.edges) EXPECT_EQ(e.kind, EdgeKind::smooth);
}

TEST(Synthetic, BandWithOneBoundTheWrongWayRound) {
  StepText s;
  const int solid = test::add_seamless_cylinder(s, 8, 25);
  s.part({solid});
  std::string text = s.text();
  // The side's second bound is the fourth FACE_BOUND written before the shell: turn its orientation.
  const std::size_t face = text.find("ADVANCED_FACE('',(");
  const std::size_t comma = text.find(',', face + 18), close = text.find(')', comma);
  const std::string second = text.substr(comma + 1, close - comma - 1);
  const std::size_t at = text.find("\n" + second + "=FACE_BOUND"), flag = text.find(",.T.)", at);
  text.replace(flag, 5, ",.F.)");
  const auto r = read_step(text, "made.step");
  ASSERT_TRUE(r);
  EXPECT_NEAR(r->artefact.volume_mm3, kPi * 64 * 25, 1e-3 * kPi * 64 * 25);
}

TEST(Synthetic, ConeToItsApexByVertexLoopAndBySeam) {
  for (bool has_seam : {false, true}) {
    StepText s;
    s.use_degrees();  // half angle in degrees
    const double r = 6, h = 6 / std::tan(kPi / 6);
    const int v = s.vertex({r, 0, 0}), apex = s.vertex({0, 0, -h});
    const int e = s.edge(v, v, s.circle({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX(), r));
    const int cone = s.add("CONICAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",6.,30.)");
    const int plane = s.add("PLANE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ")");
    std::vector<int> bounds;
    if (has_seam) {
      const int seam = s.edge(v, apex, s.line({r, 0, 0}, {0, 0, -h}));
      bounds = {s.bound({-e, seam, -seam})};
    } else {
      bounds = {s.bound({-e}), s.vertex_bound(apex)};
    }
    s.part({s.solid({s.face(bounds, cone), s.face({s.bound({e})}, plane)})});
    const Brep b = read(s).artefact;
    expect_sound(b);
    EXPECT_NEAR(b.volume_mm3, kPi * r * r * h / 3, 2e-4 * b.volume_mm3) << has_seam;
    EXPECT_NEAR(b.area_mm2, kPi * r * r + kPi * r * std::hypot(r, h), 2e-4 * b.area_mm2) << has_seam;
    EXPECT_EQ(kinds(b)["sharp_convex"], 1);
  }
}

TEST(Synthetic, WholeTorus) {
  StepText s;
  const int torus = s.add("TOROIDAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",10.,3.)");
  s.part({s.solid({s.face({s.vertex_bound(s.vertex({13, 0, 0}))}, torus)})});
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_NEAR(b.area_mm2, 4 * kPi * kPi * 30, 0.5);
  EXPECT_NEAR(b.volume_mm3, 2 * kPi * kPi * 10 * 9, 1);
}

TEST(Synthetic, HalfTorusBetweenTwoRings) {
  // The outer half of a torus, cut at the two circles where it is flat, closed by two ring faces against a cylinder.
  StepText s;
  const double R = 10, r = 3;
  const int va = s.vertex({R, 0, r}), vb = s.vertex({R, 0, -r});
  const int ea = s.edge(va, va, s.circle({0, 0, r}, Vec3::UnitZ(), Vec3::UnitX(), R)),
            eb = s.edge(vb, vb, s.circle({0, 0, -r}, Vec3::UnitZ(), Vec3::UnitX(), R));
  const int torus = s.add("TOROIDAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",10.,3.)");
  const int top = s.add("PLANE(''," + s.ref(s.axes({0, 0, r}, Vec3::UnitZ(), Vec3::UnitX())) + ")"),
            low = s.add("PLANE(''," + s.ref(s.axes({0, 0, -r}, -Vec3::UnitZ(), Vec3::UnitX())) + ")");
  s.part({s.solid({s.face({s.bound({eb}), s.bound({-ea})}, torus), s.face({s.bound({ea})}, top), s.face({s.bound({-eb})}, low)})});
  const Brep b = read(s).artefact;
  expect_sound(b);
  const double volume = kPi * R * R * 2 * r + kPi * r * r / 2 * 2 * kPi * (R + 4 * r / (3 * kPi));  // cylinder and half ring by Pappus
  EXPECT_NEAR(b.volume_mm3, volume, 2e-4 * volume);
  EXPECT_EQ(kinds(b)["smooth"], 2);
}

TEST(Synthetic, InchMetreAndMillimetreAgree) {
  for (const auto& [factor, unit] : std::vector<std::pair<double, std::string>>{{1, "mm"}, {25.4, "inch"}, {1000, "m"}}) {
    StepText s;
    if (unit == "inch") s.use_inch();
    if (unit == "m") s.length_unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT($,.METRE.))";
    s.part({test::add_box(s, {0, 0, 0}, Vec3(30, 20, 10) / factor)});
    const Brep b = read(s).artefact;
    expect_sound(b);
    EXPECT_EQ(b.units, unit);
    EXPECT_NEAR(b.volume_mm3, 6000, 1e-6) << unit;
  }
}

TEST(Synthetic, InsideOutSolidIsTurnedAndSaid) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10}, true)});
  const Done<Brep> d = read(s);
  expect_sound(d.artefact);
  EXPECT_NEAR(d.artefact.volume_mm3, 6000, 1e-9);
  EXPECT_NEAR(mesh_volume(d.artefact.mesh), 6000, 1e-9);
  EXPECT_EQ(kinds(d.artefact)["sharp_convex"], 12);
  ASSERT_EQ(d.notes.size(), 1u);
  EXPECT_EQ(d.notes[0].code, "step.shell_turned");
}

TEST(Synthetic, VoidsTakeAwayVolume) {
  StepText s;
  const int outer = test::add_box(s, {0, 0, 0}, {30, 20, 10}), inner = test::add_box(s, {5, 5, 2}, {15, 10, 8});
  (void)outer, (void)inner;
  // The shells are the instances before the two solids.
  const int oriented = s.add("ORIENTED_CLOSED_SHELL('',*," + s.ref(inner - 1) + ",.F.)");
  s.part({s.add("BREP_WITH_VOIDS(''," + s.ref(outer - 1) + ",(" + s.ref(oriented) + "))")});
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_EQ(b.faces.size(), 12u);
  EXPECT_NEAR(b.volume_mm3, 6000 - 10 * 5 * 6, 1e-9);
  EXPECT_EQ(kinds(b)["sharp_convex"], 12);
  EXPECT_EQ(kinds(b)["sharp_concave"], 12);
}

TEST(Synthetic, AssemblyPlacesAPartTwice) {
  StepText s;
  const int context = s.context();
  const int part_axes = s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX());
  const int part_rep = s.representation({part_axes, test::add_box(s, {0, 0, 0}, {10, 10, 10})}, context);
  const int part = s.product("part"), assembly = s.product("assembly");
  s.define(part, part_rep);
  const int at_1 = s.axes({100, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()), at_2 = s.axes({0, 50, 0}, Vec3::UnitX(), Vec3::UnitY());
  const int assembly_rep = s.representation({at_1, at_2}, context, "SHAPE_REPRESENTATION");
  s.define(assembly, assembly_rep);
  for (const int at : {at_1, at_2}) {
    const int usage = s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('','',''," + s.ref(assembly) + "," + s.ref(part) + ",$)");
    const int shape = s.add("PRODUCT_DEFINITION_SHAPE('',''," + s.ref(usage) + ")");
    const int t = s.add("ITEM_DEFINED_TRANSFORMATION('',''," + s.ref(part_axes) + "," + s.ref(at) + ")");
    const int relation = s.add("(REPRESENTATION_RELATIONSHIP('',''," + s.ref(part_rep) + "," + s.ref(assembly_rep) +
                               ")REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(" + s.ref(t) + ")SHAPE_REPRESENTATION_RELATIONSHIP())");
    s.add("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(" + s.ref(relation) + "," + s.ref(shape) + ")");
  }
  const Brep b = read(s).artefact;
  expect_sound(b);
  EXPECT_EQ(b.solids_count, 2);
  EXPECT_NEAR(b.volume_mm3, 2000, 1e-9);
  // First at x 100..110; second: its z is x, its x is y, so it fills x 0..10, y 50..60, z 0..10.
  EXPECT_LT((b.box.min_mm - Vec3(0, 0, 0)).norm(), 1e-9);
  EXPECT_LT((b.box.max_mm - Vec3(110, 60, 10)).norm(), 1e-9);
}

TEST(Synthetic, MirroredInstanceKeepsOutwardNormalsAndConvexity) {
  StepText s;
  const int context = s.context();
  const int origin = s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX());
  const int rep = s.representation({test::add_seamless_cylinder(s, 4, 9)}, context);
  const int map = s.add("REPRESENTATION_MAP(" + s.ref(origin) + "," + s.ref(rep) + ")");
  const int x = s.direction(Vec3::UnitX()), y = s.direction(-Vec3::UnitY()), z = s.direction(Vec3::UnitZ()), p = s.point({20, 0, 0});
  const int mirror =
      s.add("CARTESIAN_TRANSFORMATION_OPERATOR_3D('','',''," + s.ref(x) + "," + s.ref(y) + "," + s.ref(p) + ",1.," + s.ref(z) + ")");
  const int item = s.add("MAPPED_ITEM(''," + s.ref(map) + "," + s.ref(mirror) + ")");
  s.define(s.product("mirrored"), s.representation({item}, context, "SHAPE_REPRESENTATION"));
  const Brep b = read(s).artefact;
  EXPECT_EQ(b.open_edges_count, 0);
  ASSERT_EQ(b.solids_count, 1);
  EXPECT_NEAR(mesh_volume(b.mesh), kPi * 16 * 9, 0.02 * kPi * 16 * 9);
  EXPECT_NEAR(b.volume_mm3, kPi * 16 * 9, 1e-3 * kPi * 16 * 9);
  EXPECT_EQ(kinds(b)["sharp_convex"], 2);
  for (const BrepEdge& e : b.edges) {
    const double chirality = e.n_1[3].cross(e.n_2[3]).dot(e.tangent[3]);
    EXPECT_GT(chirality, 0.99);
    for (std::size_t i = 1; i < e.p.size(); ++i) {
      EXPECT_GT((e.p[i] - e.p[i - 1]).dot(e.tangent[i]), 0);
      EXPECT_GT(e.s_mm[i], e.s_mm[i - 1]);
    }
    for (const int f : {e.face_1, e.face_2}) {  // the face's own surface and sense give the same normal
      const BrepFace& g = b.faces[static_cast<std::size_t>(f)];
      const Vec3 n = (g.same_sense ? 1 : -1) * project(g.surface, e.p[3]).n;
      EXPECT_GT(n.dot(f == e.face_1 ? e.n_1[3] : e.n_2[3]), 0.999);
    }
  }
  EXPECT_NEAR(b.box.center_mm().x(), 20, 0.1);
}

TEST(Synthetic, OrderOfInstancesDoesNotMatter) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10}), test::add_seamless_cylinder(s, 3, 50)});
  const Brep a = read(s).artefact;
  Random random(5);
  StepText t = s;
  for (std::size_t i = t.lines().size(); i > 1; --i) std::swap(t.lines()[i - 1], t.lines()[random.below(i)]);
  const Brep b = read(t).artefact;
  ASSERT_EQ(a.faces.size(), b.faces.size());
  EXPECT_EQ(a.mesh.triangles, b.mesh.triangles);
  EXPECT_EQ(a.volume_mm3, b.volume_mm3);
  for (std::size_t i = 0; i < a.edges.size(); ++i) EXPECT_EQ(a.edges[i].id, b.edges[i].id);
}

TEST(Synthetic, ChordToleranceIsHeld) {
  for (double chord : {0.2, 0.02, 0.002}) {
    StepText s;
    s.part({test::add_seamless_cylinder(s, 20, 30)});
    StepOptions o;
    o.chord_mm = chord, o.angle_rad = 1;
    const Brep b = read(s, o).artefact;
    double worst = 0;
    for (std::size_t t = 0; t < b.mesh.triangles.size(); ++t) {
      const auto& f = b.mesh.triangles[t];
      const Surface& surface = b.faces[static_cast<std::size_t>(b.triangle_face[t])].surface;
      for (double u : {0.0, 0.25, 0.5})
        for (double v : {0.0, 0.25, 0.5}) {
          const Vec3 p = b.mesh.vertices[static_cast<std::size_t>(f[0])] * (1 - u - v) +
                         b.mesh.vertices[static_cast<std::size_t>(f[1])] * u + b.mesh.vertices[static_cast<std::size_t>(f[2])] * v;
          worst = std::max(worst, std::abs(project(surface, p).signed_distance_mm));
        }
    }
    EXPECT_LE(worst, 1.02 * chord);
  }
}

TEST(Synthetic, TolerancesDimensionsAndDatumsAreShown) {
  StepText s;
  const int solid = test::add_box(s, {0, 0, 0}, {30, 20, 10});
  const int face = solid - 2;  // the last face before shell and solid
  const int shape = s.add("PRODUCT_DEFINITION_SHAPE('','',$)");
  const int mm = s.add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))");
  const auto measure = [&](const std::string& v) { return s.add("LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(" + v + ")," + s.ref(mm) + ")"); };
  const int aspect = s.add("SHAPE_ASPECT('',$," + s.ref(shape) + ",.T.)");
  s.add("GEOMETRIC_ITEM_SPECIFIC_USAGE('',''," + s.ref(aspect) + ",$," + s.ref(face) + ")");
  const int datum = s.add("DATUM('',$," + s.ref(shape) + ",.F.,'A')");
  const int compartment = s.add("DATUM_REFERENCE_COMPARTMENT('',$," + s.ref(shape) + ",.F.," + s.ref(datum) + ",$)");
  const int system = s.add("DATUM_SYSTEM('',$," + s.ref(shape) + ",.F.,(" + s.ref(compartment) + "))");
  s.add("FLATNESS_TOLERANCE('',''," + s.ref(measure("0.05")) + "," + s.ref(aspect) + ")");
  s.add("(GEOMETRIC_TOLERANCE('',''," + s.ref(measure("0.2")) + "," + s.ref(aspect) + ")GEOMETRIC_TOLERANCE_WITH_DATUM_REFERENCE((" +
        s.ref(system) + "))GEOMETRIC_TOLERANCE_WITH_MODIFIERS((.MAXIMUM_MATERIAL_REQUIREMENT.))POSITION_TOLERANCE())");
  const int size = s.add("DIMENSIONAL_SIZE(" + s.ref(aspect) + ",'diameter')");
  const int value = s.add("(LENGTH_MEASURE_WITH_UNIT()MEASURE_REPRESENTATION_ITEM()MEASURE_WITH_UNIT(POSITIVE_LENGTH_MEASURE(12.)," +
                          s.ref(mm) + ")REPRESENTATION_ITEM('nominal value'))");
  const int rep = s.add("SHAPE_DIMENSION_REPRESENTATION('',(" + s.ref(value) + "),$)");
  s.add("DIMENSIONAL_CHARACTERISTIC_REPRESENTATION(" + s.ref(size) + "," + s.ref(rep) + ")");
  const int range = s.add("TOLERANCE_VALUE(" + s.ref(measure("-0.02")) + "," + s.ref(measure("0.05")) + ")");
  s.add("PLUS_MINUS_TOLERANCE(" + s.ref(range) + "," + s.ref(size) + ")");
  s.part({solid});
  const Brep b = read(s).artefact;
  const std::string on = " faces #" + std::to_string(face);
  ASSERT_EQ(b.pmi.size(), 4u);
  EXPECT_EQ(b.pmi[0], "datum A #" + std::to_string(datum));
  EXPECT_EQ(b.pmi[1].substr(0, 17), "flatness 0.05 mm ");
  EXPECT_EQ(b.pmi[1].substr(b.pmi[1].size() - on.size()), on);
  EXPECT_EQ(b.pmi[2].substr(0, 23), "position 0.2 mm M | A #");
  EXPECT_EQ(b.pmi[3].substr(0, 37), "diameter 12 mm -0.02 mm .. +0.05 mm #");
}

TEST(Synthetic, CommentsBlanksAndCodesAreRead) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
  std::string text = s.text();
  const auto replace_all = [&](const std::string& a, const std::string& b) {
    for (std::size_t at = text.find(a); at != std::string::npos; at = text.find(a, at + b.size())) text.replace(at, a.size(), b);
  };
  replace_all("=", " /* a comment; with ' and #1= */ = \r\n ");
  replace_all("('',", " ( 'it''s \\X2\\30D6\\X0\\ \\nonsense; ' , ");
  replace_all(",1.)", ",1)");  // integers where reals belong
  const auto r = read_step("\xEF\xBB\xBF junk " + text, "made.step");
  ASSERT_TRUE(r) << r.error()[0].message;
  EXPECT_NEAR(r->artefact.volume_mm3, 6000, 1e-9);
}

TEST(Synthetic, AngleIsHeldWhereTheSidesOfASurfaceRunTogether) {
  // Two poles of a side 4e-6 mm apart: the normal turns by a quarter within a thousandth of a millimetre of the corner.
  StepText s;
  const std::vector<std::vector<Vec3>> poles{{{0, 0, 0}, {2, 1.1, 0}, {4.2, 0.4, 0}, {4.200004, 0.4, 0}},
                                             {{-1, -0.4, -1}, {2, 0.2, 0.9}, {4.8, 0.15, 0.1}, {4.8, 0.15, 0}},
                                             {{-1.6, -0.8, -1.6}, {2.2, 0, 2}, {5.4, 0, 0.2}, {5.4, 0, 0}},
                                             {{-2.2, -0.9, -2}, {2.4, 0, 3}, {6.1, 0, 0.3}, {6.1, 0, 0}}};
  const int surface = test::spline_surface(s, 3, 3, poles, {}, {4, 4}, {4, 4}, {0, 1}, {0, 1});
  const int v[4] = {s.vertex(poles[0][0]), s.vertex(poles[3][0]), s.vertex(poles[3][3]), s.vertex(poles[0][3])};
  std::vector<std::vector<Vec3>> sides(4);
  for (std::size_t k = 0; k < 4; ++k)
    sides[0].push_back(poles[k][0]), sides[1].push_back(poles[3][k]), sides[2].push_back(poles[3 - k][3]),
        sides[3].push_back(poles[0][3 - k]);
  std::vector<int> loop;
  for (std::size_t k = 0; k < 4; ++k) loop.push_back(s.edge(v[k], v[(k + 1) % 4], test::spline_curve(s, 3, sides[k], {4, 4}, {0, 1})));
  const int shell = s.add("OPEN_SHELL(''," + s.list({s.face({s.bound(loop)}, surface)}) + ")");
  s.part({s.add("SHELL_BASED_SURFACE_MODEL(''," + s.list({shell}) + ")")});
  for (const double chord : {0.1, 0.01, 0.001}) {
    StepOptions o;
    o.chord_mm = chord, o.angle_rad = 0.1745;
    const Brep b = read(s, o).artefact;
    const test::ChordCheck c = test::check_chords(b, 4, chord, o.angle_rad);
    EXPECT_EQ(c.over, 0u) << c.worst_mm;
    EXPECT_EQ(c.turns_over, 0u) << c.worst_turn_rad;
    EXPECT_GT(c.turns, 100u);
    EXPECT_LT(b.mesh.triangles.size(), 20000u);
  }
}

TEST(Synthetic, LengthsDoNotDependOnHowACurveIsRunThrough) {
  // A straight front edge as a spline whose pieces are run through at speeds of 1 to 400: kinks in the speed at every knot.
  StepText s;
  const int box = test::add_box(s, {0, 0, 0}, {30, 20, 10});
  s.part({box});
  std::vector<Vec3> poles{{0, 0, 0}};
  std::vector<int> mult{3};
  std::vector<double> knots{0};
  double x = 0;
  for (int k = 1; k <= 60; ++k) {
    const double next = 30.0 * k / 60, span = k % 3 == 0 ? 0.01 : k % 3 == 1 ? 1 : 4;
    poles.push_back({x + (k % 2 ? 0.1 : 0.4), 0, 0}), poles.push_back({next, 0, 0});
    knots.push_back(knots.back() + span), mult.push_back(k == 60 ? 3 : 2);
    x = next;
  }
  const int spline = test::spline_curve(s, 2, poles, mult, knots);
  std::string text = s.text();
  const std::size_t edge = text.find("EDGE_CURVE("), comma = text.rfind(",", text.find(",.T.)", edge) - 1);
  text.replace(comma + 1, text.find(",.T.)", edge) - comma - 1, "#" + std::to_string(spline));
  const auto r = read_step(text, "made.step");
  ASSERT_TRUE(r);
  int splines = 0;
  for (const BrepEdge& e : r->artefact.edges)
    if (e.curve_type == "bspline") {
      ++splines;
      EXPECT_NEAR(e.length_mm, (e.p.back() - e.p.front()).norm(), 1e-5);
      for (std::size_t k = 0; k < e.p.size(); ++k) EXPECT_NEAR(e.s_mm[k], (e.p[k] - e.p[0]).norm(), 1e-5);
    }
  EXPECT_EQ(splines, 1);
}

TEST(Synthetic, TangentEdgesIntoAnApexAreSmooth) {
  // Two flanks with a quarter cone between them, tangent to both: at the apex the cone has no normal.
  StepText s;
  const double r = 6, h = 6;
  const Vec3 apex(0, 0, h), x = Vec3::UnitX(), y = Vec3::UnitY(), z = Vec3::UnitZ();
  const int a = s.vertex({r, 0, 0}), b = s.vertex({0, r, 0}), top = s.vertex(apex);
  const Vec3 pa(r, 0, 0), pb(0, r, 0), po(-9, r, 0), pq(r, -9, 0);
  const int vo = s.vertex(po), vq = s.vertex(pq), vc = s.vertex({-9, -9, 0}), to = s.vertex({-9, 0, h}), tq = s.vertex({0, -9, h}),
            tc = s.vertex({-9, -9, h});
  const Vec3 pc(-9, -9, 0), pto(-9, 0, h), ptq(0, -9, h), ptc(-9, -9, h);
  const int arc = s.edge(a, b, s.circle({0, 0, 0}, z, x, r)), ea = s.edge(a, top, s.line(pa, apex)), eb = s.edge(b, top, s.line(pb, apex));
  const int bo = s.edge(b, vo, s.line(pb, po)), oc = s.edge(vo, vc, s.line(po, pc)), cq = s.edge(vc, vq, s.line(pc, pq)),
            qa = s.edge(vq, a, s.line(pq, pa));
  const int o_up = s.edge(vo, to, s.line(po, pto)), c_up = s.edge(vc, tc, s.line(pc, ptc)), q_up = s.edge(vq, tq, s.line(pq, ptq));
  const int t1 = s.edge(top, to, s.line(apex, pto)), t2 = s.edge(to, tc, s.line(pto, ptc)), t3 = s.edge(tc, tq, s.line(ptc, ptq)),
            t4 = s.edge(tq, top, s.line(ptq, apex));
  const auto plane = [&](const Vec3& p, const Vec3& n) {
    const Vec3 u = std::abs(n.x()) < 0.9 ? Vec3((x - n * n.x()).normalized()) : Vec3((y - n * n.y()).normalized());
    return s.add("PLANE(''," + s.ref(s.axes(p, n, u)) + ")");
  };
  const int cone = s.add("CONICAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, -z, x)) + ",6.," + s.real(kPi / 4) + ")");
  s.part({s.solid({s.face({s.bound({arc, eb, -ea})}, cone), s.face({s.bound({bo, o_up, -t1, -eb})}, plane(pb, Vec3(0, 1, 1).normalized())),
                   s.face({s.bound({qa, ea, -t4, -q_up})}, plane(pa, Vec3(1, 0, 1).normalized())),
                   s.face({s.bound({oc, c_up, -t2, -o_up})}, plane(po, -x)), s.face({s.bound({cq, q_up, -t3, -c_up})}, plane(pq, -y)),
                   s.face({s.bound({t1, t2, t3, t4})}, plane(apex, z)), s.face({s.bound({-qa, -cq, -oc, -bo, -arc})}, plane(pc, -z))})});
  const Brep part = read(s).artefact;
  EXPECT_EQ(part.open_edges_count, 0);
  EXPECT_EQ(kinds(part)["smooth"], 2);
  EXPECT_EQ(kinds(part)["sharp_convex"], 12);
}

}  // namespace
}  // namespace asbuilt
