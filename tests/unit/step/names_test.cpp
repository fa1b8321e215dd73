// SPDX-License-Identifier: GPL-3.0-or-later
// Names, colours, layers, chains of edges, stand-ins for what is not known, and bounds on work.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <set>

#include "planner/geom/edge_chains.hpp"
#include "planner/io/step/step_reader.hpp"
#include "step_text.hpp"
#include "variants.hpp"

namespace asbuilt {
namespace {

using test::StepText;

Brep brep_of(const std::string& text, const StepOptions& o = {}) {
  auto r = read_step(text, "made.step", o);
  EXPECT_TRUE(r) << (r ? "" : r.error()[0].message);
  return r ? std::move(r->artefact) : Brep{};
}

int colored(StepText& s, const std::string& color) {  // the chain of styles as systems write it
  const int fill = s.add("FILL_AREA_STYLE_COLOUR(''," + s.ref(s.add(color)) + ")"),
            area = s.add("FILL_AREA_STYLE(''," + s.list({fill}) + ")");
  const int side = s.add("SURFACE_SIDE_STYLE(''," + s.list({s.add("SURFACE_STYLE_FILL_AREA(" + s.ref(area) + ")")}) + ")");
  const int usage = s.add("SURFACE_STYLE_USAGE(.BOTH.," + s.ref(side) + ")");
  const int line = s.add("CURVE_STYLE('',$,POSITIVE_LENGTH_MEASURE(0.1)," + s.ref(s.add("COLOUR_RGB('',0.,0.,0.)")) + ")");
  return s.add("PRESENTATION_STYLE_ASSIGNMENT(" + s.list({line, usage}) + ")");
}

TEST(Names, ColoursLayersAndInstances) {
  StepText s;
  const int box = test::add_box(s, {0, 0, 0}, {30, 20, 10}), one_face = box - 2;
  s.add("STYLED_ITEM('',(" + s.ref(colored(s, "COLOUR_RGB('',1.,0.5,0.)")) + ")," + s.ref(box) + ")");
  s.add("OVER_RIDING_STYLED_ITEM('',(" + s.ref(colored(s, "DRAUGHTING_PRE_DEFINED_COLOUR('blue')")) + ")," + s.ref(one_face) + ",#1)");
  s.add("PRESENTATION_LAYER_ASSIGNMENT('7','outside'," + s.list({box}) + ")");
  const int context = s.context(), here = s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX()),
            there = s.axes({100, 0, 0}, Vec3::UnitZ(), Vec3::UnitX());
  const int rep = s.representation({box}, context), top_rep = s.representation({here, there}, context, "SHAPE_REPRESENTATION");
  const int part = s.product("lug"), top = s.product("frame");
  s.define(part, rep), s.define(top, top_rep);
  for (const auto& [name, at] : {std::pair{"left", here}, std::pair{"right", there}}) {
    const int nauo = s.add("NEXT_ASSEMBLY_USAGE_OCCURRENCE('u','" + std::string(name) + "',''," + s.ref(top) + "," + s.ref(part) + ",$)");
    const int shape = s.add("PRODUCT_DEFINITION_SHAPE('',''," + s.ref(nauo) + ")");
    const int t = s.add("ITEM_DEFINED_TRANSFORMATION('',''," + s.ref(here) + "," + s.ref(at) + ")");
    const int relation = s.add("(REPRESENTATION_RELATIONSHIP('',''," + s.ref(rep) + "," + s.ref(top_rep) +
                               ")REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(" + s.ref(t) + ")SHAPE_REPRESENTATION_RELATIONSHIP())");
    s.add("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(" + s.ref(relation) + "," + s.ref(shape) + ")");
  }
  const Brep b = brep_of(s.text());
  ASSERT_EQ(b.bodies.size(), 2u);
  EXPECT_EQ(b.bodies[0].product, "lug");
  EXPECT_EQ(b.bodies[0].instance, "left");
  EXPECT_EQ(b.bodies[1].instance, "right");
  EXPECT_EQ(b.bodies[0].color, "#ff8000");
  EXPECT_EQ(b.bodies[0].layer, "7 outside");
  EXPECT_EQ(b.bodies[1].id, b.bodies[0].id + ":2");
  std::set<std::string> faces, edges;
  int blue = 0;
  for (const BrepFace& f : b.faces) faces.insert(f.id), blue += f.color == "#0000ff";
  for (const BrepEdge& e : b.edges) edges.insert(e.id);
  EXPECT_EQ(blue, 2);
  EXPECT_EQ(faces.size(), 12u);  // no two of the same name
  EXPECT_EQ(edges.size(), 24u);
}

TEST(Chains, ArcsAndLinesOfASlotAreOneEdgeAndCornersAreNot) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10}), test::add_seamless_cylinder(s, 4, 9)});
  const Brep b = brep_of(s.text());
  const std::vector<EdgeChain> chains = edge_chains(b);
  std::size_t edges = 0;
  int closed = 0;
  for (const EdgeChain& c : chains) edges += c.edges.size(), closed += c.is_closed;
  EXPECT_EQ(chains.size(), 14u);  // twelve edges of the box, two rims
  EXPECT_EQ(edges, b.edges.size());
  EXPECT_EQ(closed, 2);
  // A rim in two arcs is one closed chain; the order of edges in the file does not matter.
  StepText t;
  const Vec3 z = Vec3::UnitZ(), x = Vec3::UnitX();
  const double r = 5, h = 8;
  std::vector<int> low, high;
  for (double at : {0.0, h}) {
    const int v = t.vertex({r, 0, at}), w = t.vertex({-r, 0, at});
    const int a = t.edge(v, w, t.circle({0, 0, at}, z, x, r)), c = t.edge(w, v, t.circle({0, 0, at}, z, x, r));
    (at == 0 ? low : high) = {a, c};
  }
  const int wall = t.add("CYLINDRICAL_SURFACE(''," + t.ref(t.axes({0, 0, 0}, z, x)) + ",5.)");
  const int bottom = t.add("PLANE(''," + t.ref(t.axes({0, 0, 0}, -z, x)) + ")"),
            top = t.add("PLANE(''," + t.ref(t.axes({0, 0, h}, z, x)) + ")");
  t.part({t.solid({t.face({t.bound(low), t.bound({-high[1], -high[0]})}, wall), t.face({t.bound({-low[1], -low[0]})}, bottom),
                   t.face({t.bound(high)}, top)})});
  const Brep d = brep_of(t.text());
  const std::vector<EdgeChain> rims = edge_chains(d);
  ASSERT_EQ(rims.size(), 2u);
  for (const EdgeChain& c : rims) {
    EXPECT_EQ(c.edges.size(), 2u);
    EXPECT_TRUE(c.is_closed);
    EXPECT_NEAR(c.length_mm, 2 * kPi * r, 1e-4);
    for (std::size_t k = 0; k < 2; ++k) {  // each ends where the next begins
      const BrepEdge &e = d.edges[static_cast<std::size_t>(c.edges[k])], &f = d.edges[static_cast<std::size_t>(c.edges[1 - k])];
      const Vec3 end = c.is_forward[k] ? e.p.back() : e.p.front(), begin = c.is_forward[1 - k] ? f.p.front() : f.p.back();
      EXPECT_LT((end - begin).norm(), 1e-9);
    }
  }
}

TEST(Unknown, CurveIsReplacedByItsChordAndNamed) {
  StepText s;
  s.part({test::add_box(s, {0, 0, 0}, {30, 20, 10})});
  std::string text = s.text();
  text.replace(text.find("=LINE("), 6, "=KLOTHOID(");
  const Brep b = brep_of(text);
  ASSERT_EQ(b.unread.size(), 1u);
  EXPECT_EQ(b.unread[0].entity, "KLOTHOID");
  EXPECT_GT(b.unread[0].line, 7);
  EXPECT_EQ(b.faces.size(), 6u);
  EXPECT_EQ(b.open_edges_count, 0);
  EXPECT_NEAR(b.volume_mm3, 6000, 1e-9);
  int edges = 0, faces = 0;
  for (const BrepEdge& e : b.edges) edges += e.fault.find("KLOTHOID") != std::string::npos;
  for (const BrepFace& f : b.faces) faces += !f.fault.empty();
  EXPECT_EQ(edges, 1);
  EXPECT_EQ(faces, 2);  // those beside it, and no other
}

TEST(Bounds, PartsOfManyKilometresCostWhatSmallOnesDo) {  // found by fuzzing: HECTO for MILLI
  StepText s;
  s.length_unit = "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.HECTO.,.METRE.))";
  const int ring = s.face({}, s.add("TOROIDAL_SURFACE(''," + s.ref(s.axes({0, 0, 0}, Vec3::UnitZ(), Vec3::UnitX())) + ",300.,40.)"));
  s.part({s.solid({ring}), test::add_seamless_cylinder(s, 80, 250)});
  StepOptions o;
  o.chord_mm = 2;
  const Brep b = brep_of(s.text(), o);
  EXPECT_LT(b.mesh.triangles.size(), 3'000'000u);
  EXPECT_GT(b.chord_max_mm, 2);  // and says what it holds instead
  std::size_t samples = 0;
  for (const BrepEdge& e : b.edges) samples += e.p.size();
  EXPECT_LT(samples, 1'000'000u);
}

TEST(Bounds, EdgesFarOffTheirSurfaceCostWhatOthersDo) {  // found by fuzzing: an offset and poles of other sizes than their edges
  StepText s;
  const double far = 5e6;
  std::vector<std::vector<Vec3>> poles;
  for (int i = 0; i < 12; ++i) {
    poles.emplace_back();
    for (int j = 0; j < 12; ++j) poles.back().push_back(Vec3(10.0 * i, 10.0 * j, 5 * std::sin(i) * std::cos(j)));
  }
  const std::vector<int> mult{4, 1, 1, 1, 1, 1, 1, 1, 1, 4};
  const std::vector<double> knots{0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  const int base = test::spline_surface(s, 3, 3, poles, {}, mult, mult, knots, knots);
  const int wall = s.add("OFFSET_SURFACE(''," + s.ref(base) + ",30.,.F.)");
  const Vec3 corner[4] = {{0, 0, 0}, {far, 0, 0}, {far, far, 0}, {0, far, 0}};
  std::vector<int> loop, v;
  for (const Vec3& p : corner) v.push_back(s.vertex(p));
  for (std::size_t k = 0; k < 4; ++k) loop.push_back(s.edge(v[k], v[(k + 1) % 4], s.line(corner[k], corner[(k + 1) % 4])));
  s.part(
      {s.add("SHELL_BASED_SURFACE_MODEL(''," + s.list({s.add("OPEN_SHELL(''," + s.list({s.face({s.bound(loop)}, wall)}) + ")")}) + ")")});
  const std::clock_t t0 = std::clock();
  const Brep b = brep_of(s.text());
  EXPECT_LT(static_cast<double>(std::clock() - t0) / CLOCKS_PER_SEC, 7);
  std::size_t remarks = 0;
  for (const BrepEdge& e : b.edges) remarks += !e.fault.empty();
  EXPECT_EQ(remarks, 4u);
}

}  // namespace
}  // namespace asbuilt
